"""What the coder of walks expects before it has seen any, and where its adaptive numbers are kept.

Bits have counts by context, choices among nodes and edges have counts by class, and numbers have
mixtures of distributions with weights. Each begins with counts or weights that fit most logs, so
that short logs need not pay for learning them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import INTEGER_CONTEXTS

__all__ = [
    "AMONG_EDGES",
    "AMONG_NEW_EDGES",
    "AMONG_TARGETS",
    "BEYOND_GAPS",
    "BIT_CONTEXTS",
    "BIT_END",
    "BIT_ESCAPE",
    "BIT_GAP",
    "BIT_GAP_TO_KNOWN",
    "BIT_GAP_TO_SELF",
    "BIT_KNOWN_START",
    "BIT_NEW_NODE",
    "BIT_RECENT_NODE",
    "BIT_STAY",
    "BIT_TARGET",
    "BIT_TURN_BACK",
    "DISTRIBUTIONS",
    "HISTOGRAM_BINS",
    "KINDS_PER_OCTAVE",
    "MIXTURES",
    "MIX_ACROSS",
    "MIX_ACROSS_TIMED",
    "MIX_ALONG",
    "MIX_ALONG_TIMED",
    "MIX_BESIDE",
    "MIX_DURATION_FIRST",
    "MIX_GAP",
    "MIX_JUMP",
    "MIX_MOVE",
    "MIX_STAY",
    "OCTAVES",
    "initial_bit_counts",
    "initial_chosen",
    "initial_mixture_weights",
    "initial_offered",
]

#: Contexts of single bits; those of integers of any size follow.
BIT_CONTEXTS = 512

#: Sets of contexts for integers of any size.
_INTEGER_SETS = 10

#: First context of each bit, by what the bit says. The comment names what the context depends on.
BIT_END = np.int64(0)  # the track ends: whether tracks began or ended at the node
BIT_GAP = np.int64(8)  # a gap follows: gaps at the node (3), whether the walk stopped
BIT_ESCAPE = np.int64(16)  # the step is on no known edge: edges (6) and traversals (5) at the node,
#                            whether the last step was new or a stop
BIT_TURN_BACK = np.int64(96)  # the step goes back: edges at the node (5), whether walks went back
#                               here (3), whether the last step went back
BIT_STAY = np.int64(176)  # the walk stops: kind of the last step (5), whether that was new or stop
BIT_NEW_NODE = np.int64(200)  # the node is new: edges at the node (4), kind of the last step (5)
BIT_KNOWN_START = np.int64(232)  # the track starts at a known node
BIT_RECENT_NODE = np.int64(240)  # the node is among the newest
BIT_GAP_TO_SELF = np.int64(256)  # the gap ends at the node where it began
BIT_GAP_TO_KNOWN = np.int64(257)  # it ends at another known node
BIT_TARGET = np.int64(264)  # a target follows: kind of the last step, or arrival at a target (6)

#: Mixtures that can be told apart, and distributions that a mixture may have.
MIXTURES = 24
DISTRIBUTIONS = 28

#: Counts of a mixture's histogram.
HISTOGRAM_BINS = 48

#: Mixtures of durations, by what lasts.
MIX_MOVE = np.int64(0)
MIX_STAY = np.int64(1)
MIX_GAP = np.int64(2)
MIX_DURATION_FIRST = np.int64(3)  # a step to a new node, before its position

#: Mixtures of the coordinates of a new node.
MIX_ALONG = np.int64(5)  # along the heading
MIX_ACROSS = np.int64(6)  # across it
MIX_BESIDE = np.int64(7)  # on further axes
MIX_JUMP = np.int64(8)  # on the axes of the grid; one mixture for each of four axes
MIX_ALONG_TIMED = np.int64(12)  # along and across the heading, where the duration is known
MIX_ACROSS_TIMED = np.int64(13)

#: Tables of ``WalkModel.chosen`` and ``offered``, by what is chosen.
AMONG_NEW_EDGES = np.int64(0)  # the known node to which a new edge leads
BEYOND_GAPS = np.int64(1)  # the known node at which a gap ends
AMONG_EDGES = np.int64(2)  # a known edge, by its turn
AMONG_TARGETS = np.int64(3)  # the target of a shortest path
_TABLES = 4

#: Classes of candidates: octaves of distance or rank, with kinds within each.
OCTAVES = 13
KINDS_PER_OCTAVE = 8


class _InitialCounts(NamedTuple):
    """Counts of zeros and ones of ``contexts`` contexts from ``first`` on, ``stride`` apart."""

    first: int
    contexts: int
    stride: int
    zeros: int
    ones: int


#: Initial counts of contexts that don't begin at even ones.
_INITIAL_COUNTS = (
    _InitialCounts(int(BIT_END), 2, 1, 36, 4),
    _InitialCounts(int(BIT_GAP), 6, 1, 36, 4),
    _InitialCounts(int(BIT_ESCAPE) + 6, 6, 10, 28, 12),  # 4 to 7 traversals
    _InitialCounts(int(BIT_ESCAPE) + 8, 6, 10, 34, 8),  # 8 and more
    _InitialCounts(int(BIT_ESCAPE) + 11, 2, 2, 3, 37),  # new: one edge, at most 1 traversal
    _InitialCounts(int(BIT_TURN_BACK), 40, 2, 36, 4),  # the last step did not go back
    _InitialCounts(int(BIT_STAY), 10, 1, 28, 12),
    _InitialCounts(int(BIT_KNOWN_START), 1, 1, 12, 28),
    _InitialCounts(int(BIT_RECENT_NODE), 1, 1, 8, 32),
    _InitialCounts(int(BIT_TARGET), 6, 1, 36, 4),
)

#: Counts of zeros and ones of all other contexts.
_EVEN_COUNT = 10

#: How likely a new edge leads to a node by its distance, in half octaves of the step to expect,
#: and by its bearing (from straight on, 0, to straight back, 6; 7 where the walk has no heading).
_NEW_EDGE_BY_DISTANCE = (160, 128, 128, 112, 112, 96, 80, 64, 48, 48, 1, 1, 1)
_NEW_EDGE_BY_BEARING = (5, 4, 4, 4, 2, 1, 2, 4)

#: How likely a gap ends at a node by its distance, and by whether none, one, few or many gaps began
#: or ended there.
_GAP_BY_DISTANCE = (128, 128, 128, 128, 128, 128, 128, 96, 64, 48, 40, 24, 24)
_GAP_BY_GAP_ENDS = (1, 4, 8, 16, 1, 1, 1, 1)

#: How likely a node is a target by the binary digits of its rank by distance, and by the binary
#: digits of how often tracks or paths to targets ended there.
_TARGET_BY_RANK = (1, 4, 16, 48, 96, 128, 128, 96, 64, 1, 1, 1, 1)
_TARGET_BY_ENDS = (2, 4, 6, 8, 8, 8, 8, 8)

#: Both counts of turns begin at this, five choices of weight 2**16, so that the first few choices
#: don't weigh too much.
_INITIAL_TURNS = 5 << 16

#: What was offered in the other tables at first.
_INITIAL_OFFERED = 10

#: Initial weights of the distributions of each mixture, of 1,024, in the order in which the coder
#: enters the distributions.
_MIXTURE_WEIGHTS = {
    int(MIX_MOVE): (
        *(26, 3, 3, 13, 30, 53, 6, 14, 3, 3),  # histogram and one-sided ones
        *(151, 230, 73, 17, 11),  # by ratio, about the guess for the edge and the length
        *(6, 68, 45, 14, 35),  # about the last pace
        *(8, 115, 66, 16, 9),  # about the mean pace
    ),
    int(MIX_STAY): (54, 4, 20, 153, 214, 122, 120, 34, 4, 4, 8, 179, 108),
    int(MIX_GAP): (40, 5, 5, 6, 20, 16, 90, 90, 232, 89, 125, 193, 113),
    int(MIX_DURATION_FIRST): (
        *(259, 8, 34, 11, 53, 46, 7, 6, 5, 5),  # histogram and one-sided ones
        *(7, 18, 215, 205, 22),  # about the mean
        *(7, 11, 28, 52, 27),  # about the last one
    ),
    int(MIX_ALONG): (
        *(257, 4, 3, 3, 203, 23, 10, 40),
        *(63, 158, 126, 68, 31, 13, 5, 4, 4, 3, 3, 3),  # about 0
    ),
    int(MIX_ACROSS): (
        *(123, 15, 13, 16, 8, 6, 45, 6, 20, 38, 5),
        *(11, 78, 478, 131, 8, 5, 4, 4, 3, 3, 2, 2),  # about 0
    ),
    int(MIX_ALONG_TIMED): (
        *(20, 57, 48, 75, 5, 5, 36, 265, 40, 66, 16, 25, 13),
        *(236, 49, 22, 9, 6, 5, 4, 4, 4, 4, 4, 4),  # about 0
    ),
    int(MIX_ACROSS_TIMED): (
        *(75, 15, 11, 16, 10, 265, 51, 176, 69, 5, 13),
        *(38, 205, 18, 18, 6, 5, 5, 5, 5, 5, 5, 5),  # about 0
    ),
    **dict.fromkeys(
        range(int(MIX_JUMP), int(MIX_JUMP) + 4),
        (41, 166, 116, 100, 117, 190, 142, 30, 62, 25, 20, 15),
    ),
}

#: Initial weight of the distributions of a mixture that is not named above, of 1,024.
_EVEN_WEIGHT = 36

#: The weights above are multiplied by this, so that they sum up to about 2**16.
_WEIGHT_UNIT = 64


def initial_mixture_weights() -> NDArray[np.int64]:
    """Return the initial weights of each mixture, shape (MIXTURES, DISTRIBUTIONS + 1).

    The last column counts the numbers that a mixture has coded: none.
    """
    weights = np.full((MIXTURES, DISTRIBUTIONS + 1), _WEIGHT_UNIT * _EVEN_WEIGHT, np.int64)
    for mixture, shares in _MIXTURE_WEIGHTS.items():
        weights[mixture, : len(shares)] = _WEIGHT_UNIT * np.array(shares)
    weights[:, -1] = 0
    return weights


def initial_chosen() -> NDArray[np.int64]:
    """Return how often candidates were chosen, shape (tables, OCTAVES, KINDS_PER_OCTAVE)."""
    chosen = np.full((_TABLES, OCTAVES, KINDS_PER_OCTAVE), _INITIAL_TURNS, np.int64)
    chosen[AMONG_NEW_EDGES] = np.outer(_NEW_EDGE_BY_DISTANCE, _NEW_EDGE_BY_BEARING)
    chosen[BEYOND_GAPS] = np.outer(_GAP_BY_DISTANCE, _GAP_BY_GAP_ENDS)
    chosen[AMONG_TARGETS] = np.outer(_TARGET_BY_RANK, _TARGET_BY_ENDS)
    return chosen


def initial_offered() -> NDArray[np.int64]:
    """Return how often candidates could be chosen, shape (tables, OCTAVES, KINDS_PER_OCTAVE)."""
    offered = np.full((_TABLES, OCTAVES, KINDS_PER_OCTAVE), _INITIAL_OFFERED, np.int64)
    offered[AMONG_EDGES] = _INITIAL_TURNS
    return offered


def initial_bit_counts() -> NDArray[np.int32]:
    """Return the counts of zeros and ones of each context, shape (contexts, 2)."""
    contexts = BIT_CONTEXTS + _INTEGER_SETS * INTEGER_CONTEXTS
    counts = np.full((contexts, 2), _EVEN_COUNT, np.int32)
    for initial in _INITIAL_COUNTS:
        end = initial.first + initial.contexts * initial.stride
        counts[initial.first : end : initial.stride] = initial.zeros, initial.ones
    return counts
