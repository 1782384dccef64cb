"""What the coder of walks expects before it has seen any: of flags, of the nodes that ways lead to, and of mixtures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import INTEGER_CONTEXTS

__all__ = [
    "BIT_CONTEXTS",
    "DISTRIBUTIONS",
    "F_AIM",
    "F_BACK",
    "F_END",
    "F_ESCAPE",
    "F_GAP",
    "F_GAP_KIND",
    "F_KNOWN_START",
    "F_NEAR",
    "F_NEW",
    "F_STAY",
    "HISTOGRAM_BINS",
    "MIXTURES",
    "OCTAVES",
    "ON_AIM",
    "ON_GAP",
    "ON_LINK",
    "ON_WAY",
    "initial_bit_counts",
    "initial_chosen",
    "initial_mixture_weights",
    "initial_offered",
]

#: Bit contexts, ahead of those of whole numbers.
BIT_CONTEXTS = 512
_SIZE_SLOTS = 10

#: Sets of mixture weights, histograms and how many distributions a mixture may have.
MIXTURES = 24
DISTRIBUTIONS = 28
HISTOGRAM_BINS = 48

#: First bit context of each flag.
F_END, F_GAP, F_ESCAPE, F_BACK, F_STAY, F_NEW, F_KNOWN_START, F_NEAR, F_GAP_KIND, F_AIM = np.array(
    [0, 8, 16, 96, 176, 200, 232, 240, 256, 264]
)

#: Layers of ``hits`` and ``offers``: links, what follows on gaps, turns between ways, aims.
ON_LINK, ON_GAP, ON_WAY, ON_AIM = np.arange(4)

#: Classes of length of new ways.
OCTAVES = 13

#: What is expected of flags before any is seen: counts of zeros and ones where they aren't even.
_EXPECTED = (
    (F_END, 2, 1, 36, 4),
    (F_GAP, 6, 1, 36, 4),
    (F_ESCAPE + 6, 6, 10, 28, 12),
    (F_ESCAPE + 8, 6, 10, 34, 8),
    (F_ESCAPE + 11, 2, 2, 3, 37),
    (F_BACK, 40, 2, 36, 4),
    (F_STAY, 10, 1, 28, 12),
    (F_KNOWN_START, 1, 1, 12, 28),
    (F_NEAR, 1, 1, 8, 32),
    (F_AIM, 6, 1, 36, 4),
)

#: How likely a new way leads to a node at a distance (in half octaves of the expected one) and a bearing, before any is seen.
_LIKELY_DISTANCE = (160, 128, 128, 112, 112, 96, 80, 64, 48, 48, 1, 1, 1)
_LIKELY_BEARING = (5, 4, 4, 4, 2, 1, 2, 4)

#: How likely a gap leads to a node at a distance, and to one where none, one, few, many gaps began or ended.
_LIKELY_BEYOND = (128, 128, 128, 128, 128, 128, 128, 96, 64, 48, 40, 24, 24)
_LIKELY_AGAIN = (1, 4, 8, 16, 1, 1, 1, 1)

#: How likely an aim is a node at a rank (by its binary digits) by distance, and one where so often (by binary digits) tracks or aims ended.
_LIKELY_RANK = (1, 4, 16, 48, 96, 128, 128, 96, 64, 1, 1, 1, 1)
_LIKELY_END = (2, 4, 6, 8, 8, 8, 8, 8)

#: Turns between ways count from this, so that the first few don't weigh too much.
_TURNS = 5 << 16

#: How heavy the distributions of each mixture are before any number is seen, of 1,024.
_WEIGHTS = {
    0: (
        26,
        3,
        3,
        13,
        30,
        53,
        6,
        14,
        3,
        3,
        151,
        230,
        73,
        17,
        11,
        6,
        68,
        45,
        14,
        35,
        8,
        115,
        66,
        16,
        9,
    ),
    1: (54, 4, 20, 153, 214, 122, 120, 34, 4, 4, 8, 179, 108),
    2: (40, 5, 5, 6, 20, 16, 90, 90, 232, 89, 125, 193, 113),
    5: (257, 4, 3, 3, 203, 23, 10, 40, 63, 158, 126, 68, 31, 13, 5, 4, 4, 3, 3, 3),
    6: (123, 15, 13, 16, 8, 6, 45, 6, 20, 38, 5, 11, 78, 478, 131, 8, 5, 4, 4, 3, 3, 2, 2),
    3: (259, 8, 34, 11, 53, 46, 7, 6, 5, 5, 7, 18, 215, 205, 22, 7, 11, 28, 52, 27),
    12: (20, 57, 48, 75, 5, 5, 36, 265, 40, 66, 16, 25, 13, 236, 49, 22, 9, 6, 5, 4, 4, 4, 4, 4, 4),
    13: (75, 15, 11, 16, 10, 265, 51, 176, 69, 5, 13, 38, 205, 18, 18, 6, 5, 5, 5, 5, 5, 5, 5),
    **dict.fromkeys((8, 9, 10, 11), (41, 166, 116, 100, 117, 190, 142, 30, 62, 25, 20, 15)),
}
_EVEN = 36


def initial_mixture_weights() -> NDArray[np.int64]:
    """Return the weights of each mixture's distributions, and that none was used yet."""
    weights = np.full((MIXTURES, DISTRIBUTIONS + 1), 64 * _EVEN, np.int64)
    for mixture, shares in _WEIGHTS.items():
        weights[mixture, : len(shares)] = 64 * np.array(shares)
    weights[:, -1] = 0
    return weights


def initial_chosen() -> NDArray[np.int64]:
    """Return what was chosen among nodes and turns, by layer and class."""
    hits = np.full((4, OCTAVES, 8), _TURNS, np.int64)
    hits[ON_LINK] = np.outer(_LIKELY_DISTANCE, _LIKELY_BEARING)
    hits[ON_GAP] = np.outer(_LIKELY_BEYOND, _LIKELY_AGAIN)
    hits[ON_AIM] = np.outer(_LIKELY_RANK, _LIKELY_END)
    return hits


def initial_offered() -> NDArray[np.int64]:
    """Return how much was to be had among nodes and turns, by layer and class."""
    return np.array([10, 10, _TURNS, 10], np.int64)[:, None, None] * np.ones(
        (4, OCTAVES, 8), np.int64
    )


def initial_bit_counts() -> NDArray[np.int32]:
    """Return the counts of zeros and ones of each context."""
    flags = np.full((BIT_CONTEXTS + _SIZE_SLOTS * INTEGER_CONTEXTS, 2), 10, np.int32)
    for first, count, stride, zeros, ones in _EXPECTED:
        flags[first : first + count * stride : stride] = zeros, ones
    return flags
