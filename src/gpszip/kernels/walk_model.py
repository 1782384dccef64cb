"""What the coder of walks knows so far: nodes, ways, how often and how fast they were taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import PARTS, SHEET_ROWS, SIZES
from gpszip.kernels.binary_log import log2_of
from gpszip.kernels.heading import DIRECTIONS, direction
from gpszip.kernels.jit import jit
from gpszip.kernels.pair_table import pair_slot

__all__ = [
    "ACCOUNTS",
    "AIMS",
    "BEGUN",
    "BREADTH",
    "CHEAP",
    "CLASSES",
    "FLAGS",
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
    "GAP_BITS",
    "HEADING",
    "KIND_BITS",
    "LAST_CELLS",
    "LAST_FAR",
    "LAST_NEW",
    "LATEST",
    "MODES",
    "MOST",
    "NO_TURN",
    "OCTAVES",
    "ON_AIM",
    "ON_GAP",
    "ON_LINK",
    "ON_WAY",
    "ORDER_AT",
    "PACED",
    "PLACE_BITS",
    "SEARCHES",
    "SORTED",
    "SPAN_BITS",
    "START_BITS",
    "SUM_CELLS",
    "SUM_FAR",
    "TIMED",
    "TRAIL_AT",
    "TRAIL_END",
    "TURN",
    "U_GAP",
    "U_NEW",
    "U_STAY",
    "WalkModel",
    "add_node",
    "book",
    "class_of",
    "follow",
    "forget_way",
    "grown",
    "half_edge",
    "length",
    "new_model",
    "pair_count",
    "pick",
    "prepared",
    "settle_usual",
    "weigh",
    "weight_below",
]

#: Numbers kept in ``WalkModel.scalars``; two are the node (plus 1) and the first cell of the latest track. Paces are logarithms,
#: known once a step was ``TIMED``; the heading is -1 and the turn ``NO_TURN`` where none is known.
NODES, HALVES, PACE, PACE_SLOW, STEP_LENGTH, LATEST, BEGUN, TIMED, HEADING, TURN, CHEAP, MODES = np.arange(12)
LAST_FAR, LAST_CELLS, SUM_FAR, SUM_CELLS, LAST_NEW, TRAIL_AT, TRAIL_END, ORDER_AT, SEARCHES = np.arange(12, 21)
_SCALARS = 21
NO_TURN = 1 << 10

#: Modes, of which any may be on: starts of tracks are told ahead, in order; spans of new ways come before their places; walks aim at
#: places, to which they take the shortest path.
SORTED, PACED, AIMS = np.array([1, 2, 4])

#: Rows of ``WalkModel.usual``: spans by class of length, of stops, of gaps and of new ways coded ahead of their places.
CLASSES = 48
U_STAY, U_GAP, U_NEW = np.array([48, 49, 50])

#: A mean of steps about as long is that of about so many.
_SPANS = np.int64(20)

#: Layers of ``WalkModel.hits`` and ``offers``: links, what follows on gaps, turns between ways, aims.
ON_LINK, ON_GAP, ON_WAY, ON_AIM = np.arange(4)

#: Nodes that a search for aims settles at most.
BREADTH = 256

#: Classes of length of new ways.
OCTAVES = 13

#: Rows of the ledger: kinds of steps (back, known, link, new, stay), their durations, places of new nodes, starts, gaps.
ACCOUNTS = 13
KIND_BITS, SPAN_BITS, PLACE_BITS, START_BITS, GAP_BITS = np.array([0, 5, 10, 11, 12])

#: Bit contexts, ahead of those of whole numbers.
FLAGS = 512
_SIZE_SLOTS = 10

#: Sets of mixture weights, histograms and how many distributions a mixture may have.
_MIXTURES = 24
_DISTRIBUTIONS = 28
_HISTOGRAM = 48

#: First bit context of each flag.
F_END, F_GAP, F_ESCAPE, F_BACK, F_STAY, F_NEW, F_KNOWN_START, F_NEAR, F_GAP_KIND, F_AIM = np.array(
    [0, 8, 16, 96, 176, 200, 232, 240, 256, 264]
)

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
    0: (26, 3, 3, 13, 30, 53, 6, 14, 3, 3, 151, 230, 73, 17, 11, 6, 68, 45, 14, 35, 8, 115, 66, 16, 9),
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

#: Spans are learnt as if at most this many cells, and lengths are below it.
MOST = np.int64(1) << 36


#: Steps count as at most this long and as at most so many cells for the speed.
_FARTHEST, _LONGEST = np.int64(1) << 34, np.int64(1) << 25


class WalkModel(NamedTuple):
    """State shared by coder and decoder, on arrays."""

    flags: NDArray[np.int32]  # counts of bits by context
    weights: NDArray[np.int64]  # of the distributions of each mixture
    histograms: NDArray[np.int64]
    places: NDArray[np.int64]  # nodes, in quanta
    head: NDArray[np.int64]  # first half-edge of a node, or -1
    into: NDArray[np.int64]  # node that a half-edge leads to
    following: NDArray[np.int64]  # next half-edge of the same node, or -1
    count: NDArray[np.int64]  # times a half-edge was taken
    usual_span: NDArray[np.int64]  # mean logarithm of the cells it took
    passed: NDArray[np.int64]  # times that something followed on a half-edge
    keys: NDArray[np.int64]  # table of pairs of half-edges taken in a row
    counts: NDArray[np.int64]
    tree: NDArray[np.int64]  # Fenwick tree over the nodes' weights as ends of tracks
    rests: NDArray[np.int64]  # how often a gap began or ended at a node
    usual: NDArray[np.int64]  # mean logarithm of cells, and of how many
    scalars: NDArray[np.int64]
    offers: NDArray[np.int64]  # by layer and class: how much was to be had there, and what was chosen
    hits: NDArray[np.int64]
    sheet: NDArray[np.int64]  # the distributions being mixed
    starts: NDArray[np.int64]  # by time, of each track: its first cell and whether it was had
    trail: NDArray[np.int64]  # the way to the place aimed at, and nodes settled in search for one
    found: NDArray[np.int64]  # of each node, where it was settled in the latest search, and which that was
    spent: NDArray[np.float64]  # bits that the steps to the knots take without aims; only a writer's choice of aims asks for it
    ledger: NDArray[np.float64]  # bits written and how often, by ``ACCOUNTS``; nothing is decided by it


def new_model(knots: int, dimension: int) -> WalkModel:
    """Return the model before the first knot; memory is about 250 bytes for each knot."""
    size = max(knots, 1)
    table = 1 << (2 * size).bit_length()
    return WalkModel(
        flags=_first_flags(),
        weights=_first_weights(),
        histograms=np.full((_MIXTURES, _HISTOGRAM), 2, np.int64),
        places=np.zeros((size, dimension), np.int64),
        head=np.full(size, -1, np.int64),
        into=np.zeros(2 * size, np.int64),
        following=np.zeros(2 * size, np.int64),
        count=np.zeros(2 * size, np.int64),
        usual_span=np.zeros(2 * size, np.int64),
        passed=np.zeros(2 * size, np.int64),
        keys=np.full(table, -1, np.int64),
        counts=np.zeros(table, np.int64),
        tree=np.zeros(size + 1, np.int64),
        rests=np.zeros(size, np.int64),
        usual=np.zeros((CLASSES + 3, 2), np.int64),
        scalars=np.array([0] * 8 + [-1, NO_TURN] + [0] * (_SCALARS - 10), np.int64),
        offers=np.array([10, 10, _TURNS, 10], np.int64)[:, None, None] * np.ones((4, OCTAVES, 8), np.int64),
        hits=_first_hits(),
        sheet=np.zeros((SHEET_ROWS, _DISTRIBUTIONS), np.int64),
        starts=np.zeros((0, 2), np.int64),
        trail=np.zeros(0, np.int64),
        found=np.zeros((0, 2), np.int64),
        spent=np.zeros(0),
        ledger=np.zeros((ACCOUNTS, 2)),
    )


#: Fields of which a larger model begins with what a smaller one holds.
_KEPT = (
    "flags", "weights", "histograms", "scalars", "offers", "hits", "places", "head", "into", "following", "count", "usual_span", "passed",
    "rests", "usual",
)  # fmt: skip


def grown(model: WalkModel, knots: int) -> WalkModel:
    """Return a copy of a model with room for so many knots in all; its ledger begins anew."""
    whole = new_model(knots, model.places.shape[1])
    for field in _KEPT:
        old, new = getattr(model, field), getattr(whole, field)
        new[: len(old)] = old
    _enter_pairs(model.keys, model.counts, whole.keys, whole.counts)
    _extend_tree(model.tree, whole.tree)
    return whole


@jit
def _enter_pairs(keys: NDArray[np.int64], counts: NDArray[np.int64], to_keys: NDArray[np.int64], to_counts: NDArray[np.int64]) -> None:
    for i in range(len(keys)):
        if keys[i] != -1:
            at = pair_slot(to_keys, keys[i])
            to_keys[at] = keys[i]
            to_counts[at] = counts[i]


@jit
def _extend_tree(tree: NDArray[np.int64], longer: NDArray[np.int64]) -> None:
    """Fill a longer Fenwick tree, in which whatever is beyond the shorter one weighs nothing yet."""
    known = len(tree)
    longer[:known] = tree
    for at in range(known, len(longer)):
        child = 1
        while child < (at & -at):
            longer[at] += longer[at - child]
            child *= 2


def prepared(model: WalkModel, modes: int, starts: NDArray[np.int64], spent: NDArray[np.float64]) -> WalkModel:
    """Return a model that codes in these modes.

    Parameters
    ----------
    starts : int64 array, shape (tracks,)
        For ``SORTED`` the first cells of the tracks, in order; a reader's are filled in.
    spent : float64 array, shape (K,) or (0,)
        For a writer that aims, bits that the steps to the knots take without; filled in where no mode is on.
    """
    model.scalars[MODES] = modes
    starts = np.column_stack([starts, np.zeros_like(starts)]) if modes & SORTED else model.starts
    if not modes & AIMS:
        return model._replace(starts=starts, spent=spent)
    return model._replace(starts=starts, spent=spent, trail=np.zeros(BREADTH, np.int64), found=np.zeros((len(model.head), 2), np.int64))


def _first_weights() -> NDArray[np.int64]:
    weights = np.full((_MIXTURES, _DISTRIBUTIONS + 1), 64 * _EVEN, np.int64)
    for mixture, shares in _WEIGHTS.items():
        weights[mixture, : len(shares)] = 64 * np.array(shares)
    weights[:, -1] = 0
    return weights


def _first_hits() -> NDArray[np.int64]:
    hits = np.full((4, OCTAVES, 8), _TURNS, np.int64)
    hits[ON_LINK] = np.outer(_LIKELY_DISTANCE, _LIKELY_BEARING)
    hits[ON_GAP] = np.outer(_LIKELY_BEYOND, _LIKELY_AGAIN)
    hits[ON_AIM] = np.outer(_LIKELY_RANK, _LIKELY_END)
    return hits


def _first_flags() -> NDArray[np.int32]:
    flags = np.full((FLAGS + _SIZE_SLOTS * SIZES, 2), 10, np.int32)
    for first, count, stride, zeros, ones in _EXPECTED:
        flags[first : first + count * stride : stride] = zeros, ones
    return flags


@jit
def book(model: WalkModel, account: int, bits: float) -> None:
    """Enter written bits into the ledger."""
    model.ledger[account, 0] += bits
    model.ledger[account, 1] += 1.0


@jit
def length(places: NDArray[np.int64], u: int, v: int) -> int:
    """Distance between two nodes in sixteenths of a quantum, at most 2**36."""
    square = np.int64(0)
    for axis in range(places.shape[1]):
        step = min(abs(places[u, axis] - places[v, axis]), np.int64(1) << 29)
        square += step * step
    return np.int64(PARTS * np.sqrt(np.float64(square)))


@jit
def half_edge(model: WalkModel, u: int, v: int) -> int:
    """Half-edge from u to v, or -1."""
    half = model.head[u]
    while half >= 0 and model.into[half] != v:
        half = model.following[half]
    return half


@jit
def _join(model: WalkModel, u: int, v: int) -> int:
    half = model.scalars[HALVES]
    for h, a, b in ((half, u, v), (half + 1, v, u)):
        model.into[h] = b
        model.following[h] = model.head[a]
        model.head[a] = h
    model.scalars[HALVES] = half + 2
    return half


@jit
def pair_count(model: WalkModel, before: int, half: int) -> int:
    """How often ``half`` was taken right after the half-edge ``before``."""
    return model.counts[pair_slot(model.keys, before * (np.int64(1) << 31) + half)]


@jit
def class_of(far: int) -> int:
    """Class of a length, by half octaves from a quantum on: its row of ``usual``."""
    if far < PARTS:
        return 0
    return min(np.int64(1 + ((log2_of(far) - (4 << 16)) >> 15)), np.int64(CLASSES - 1))


@jit
def settle_usual(model: WalkModel, row: int, most: int, logarithm: int) -> None:
    """Move a mean logarithm of spans towards one more, as if it were one of at most ``most``."""
    usual = model.usual
    usual[row, 1] = min(usual[row, 1] + 1, np.int64(most))
    usual[row, 0] += (logarithm - usual[row, 0]) // usual[row, 1]


@jit
def forget_way(model: WalkModel) -> None:
    """Know of no heading, as a walk begins or goes on after a gap."""
    model.scalars[HEADING] = -1
    model.scalars[TURN] = NO_TURN


@jit
def _turn(model: WalkModel, u: int, v: int) -> None:
    places, scalars = model.places, model.scalars
    heading = direction(places[v, 0] - places[u, 0], places[v, 1] - places[u, 1])
    scalars[TURN] = NO_TURN
    if scalars[HEADING] >= 0:
        scalars[TURN] = (heading - scalars[HEADING] + DIRECTIONS // 2) % DIRECTIONS - DIRECTIONS // 2
    scalars[HEADING] = heading


@jit
def _learn_speed(scalars: NDArray[np.int64], far: int, cells: int) -> None:
    """Learn how far the last step went in how many cells, and the last few in all."""
    scalars[LAST_FAR], scalars[LAST_CELLS] = far, cells
    scalars[SUM_FAR] += far - (scalars[SUM_FAR] >> 3)
    scalars[SUM_CELLS] += cells - (scalars[SUM_CELLS] >> 3)


@jit
def _learn_span(model: WalkModel, half: int, far: int, cells: int) -> None:
    """Learn how many cells a step took."""
    scalars = model.scalars
    span = log2_of(min(max(cells, np.int64(1)), MOST))
    settle_usual(model, class_of(far), _SPANS, span)
    model.usual_span[half] += (span - model.usual_span[half]) // min(model.count[half], np.int64(12))
    if far > 0:
        pace = span - log2_of(far)
        scalars[PACE] = pace
        scalars[PACE_SLOW] = pace if scalars[TIMED] == 0 else scalars[PACE_SLOW] + 5 * (pace - scalars[PACE_SLOW]) // 32
        scalars[TIMED] = 1
        _learn_speed(scalars, min(far, _FARTHEST), min(cells, _LONGEST))


@jit
def follow(model: WalkModel, before: int, u: int, v: int, cells: int) -> int:
    """Learn a step from u to v in ``cells`` (0: no times) after the half-edge ``before`` (-1: none); return its half-edge."""
    half = half_edge(model, u, v)
    if half < 0:
        half = _join(model, u, v)
    model.count[half] += 1
    if before >= 0:
        key = before * (np.int64(1) << 31) + half
        at = pair_slot(model.keys, key)
        model.keys[at] = key
        model.counts[at] += 1
        model.passed[before] += 1
    scalars = model.scalars
    far = length(model.places, u, v)
    if cells != 0:
        _learn_span(model, half, far, cells)
    if model.places.shape[1] > 1:
        _turn(model, u, v)
    scalars[STEP_LENGTH] = far if scalars[STEP_LENGTH] == 0 else scalars[STEP_LENGTH] + (far - scalars[STEP_LENGTH]) // 8
    return half


@jit
def add_node(model: WalkModel) -> int:
    """Add a node whose place is set already; return it."""
    node = model.scalars[NODES]
    model.scalars[NODES] = node + 1
    weigh(model, node, np.int64(1))
    return node


@jit
def weigh(model: WalkModel, node: int, weight: int) -> None:
    """Raise the weight of a node as the end of a track."""
    at = node + 1
    while at < len(model.tree):
        model.tree[at] += weight
        at += at & -at


@jit
def weight_below(model: WalkModel, node: int) -> int:
    """Sum of the weights of the nodes before ``node``."""
    total = np.int64(0)
    while node > 0:
        total += model.tree[node]
        node -= node & -node
    return total


@jit
def pick(model: WalkModel, at: int) -> int:
    """Node into whose share of the summed weights ``at`` falls."""
    step = 1
    while 2 * step < len(model.tree):
        step *= 2
    node = 0
    while step > 0:
        if node + step < len(model.tree) and model.tree[node + step] <= at:
            node += step
            at -= model.tree[node]
        step //= 2
    return node
