"""What the coder of walks knows so far: nodes, ways, how often and how fast they were taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import PARTS, SIZES, WEIGHT
from gpszip.kernels.jit import jit
from gpszip.kernels.pair_table import pair_slot

__all__ = [
    "ACCOUNTS",
    "BEGUN",
    "FLAGS",
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
    "KIND_BITS",
    "LATEST",
    "PLACE_BITS",
    "SPAN_BITS",
    "START_BITS",
    "WalkModel",
    "add_node",
    "book",
    "follow",
    "grown",
    "half_edge",
    "length",
    "new_model",
    "pair_count",
    "pick",
    "weigh",
    "weight_below",
]

#: Numbers kept in ``WalkModel.scalars``; the last two are the node (plus 1) and the first cell of the latest track.
NODES, HALVES, PACE, PACE_SLOW, STEP_LENGTH, LATEST, BEGUN = 0, 1, 2, 3, 4, 5, 6

#: Rows of the ledger: kinds of steps (back, known, link, new, stay), their durations, places of new nodes, starts, gaps.
ACCOUNTS = 13
KIND_BITS, SPAN_BITS, PLACE_BITS, START_BITS, GAP_BITS = 0, 5, 10, 11, 12

#: Bit contexts, ahead of those of whole numbers.
FLAGS = 512
_SIZE_SLOTS = 10

#: Sets of mixture weights, histograms and how many distributions a mixture may have.
_MIXTURES = 24
_DISTRIBUTIONS = 28
_HISTOGRAM = 48

#: First bit context of each flag.
F_END, F_GAP, F_ESCAPE, F_BACK, F_STAY, F_NEW, F_KNOWN_START, F_NEAR, F_GAP_KIND = 0, 8, 16, 96, 176, 200, 232, 240, 256

#: What is expected of flags before any is seen: counts of zeros and ones where they aren't even.
_EXPECTED = (
    (F_END, 2, 1, 36, 4),
    (F_GAP, 2, 1, 36, 4),
    (F_ESCAPE + 6, 6, 10, 28, 12),
    (F_ESCAPE + 8, 6, 10, 34, 8),
    (F_ESCAPE + 11, 2, 2, 3, 37),
    (F_BACK, 40, 2, 36, 4),
    (F_STAY, 10, 1, 28, 12),
    (F_KNOWN_START, 1, 1, 12, 28),
    (F_NEAR, 1, 1, 8, 32),
)

#: How likely a new way leads to a node at a distance (in half octaves of the expected one) and a bearing, before any is seen.
_LIKELY_DISTANCE = (10, 8, 8, 7, 7, 6, 5, 4, 3, 3)
_LIKELY_BEARING = (5, 4, 4, 4, 2, 1, 2, 4)

#: Weight that a node gains each time a track starts or ends there.
_TERMINAL = 24


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
    pace: NDArray[np.int64]  # its last pace, 0 if unknown
    passed: NDArray[np.int64]  # times that something followed on a half-edge
    keys: NDArray[np.int64]  # table of pairs of half-edges taken in a row
    counts: NDArray[np.int64]
    tree: NDArray[np.int64]  # Fenwick tree over the nodes' weights as ends of tracks
    scalars: NDArray[np.int64]
    offers: NDArray[np.int64]  # by place relative to the expected one: nodes there, and nodes chosen
    hits: NDArray[np.int64]
    ledger: NDArray[np.float64]  # bits written and how often, by ``ACCOUNTS``; nothing is decided by it


def new_model(knots: int, dimension: int) -> WalkModel:
    """Return the model before the first knot; memory is about 250 bytes for each knot."""
    size = max(knots, 1)
    table = 1 << (2 * size).bit_length()
    weights = np.full((_MIXTURES, _DISTRIBUTIONS + 1), WEIGHT // _DISTRIBUTIONS, np.int64)
    weights[:, -1] = 0
    return WalkModel(
        flags=_first_flags(),
        weights=weights,
        histograms=np.full((_MIXTURES, _HISTOGRAM), 2, np.int64),
        places=np.zeros((size, dimension), np.int64),
        head=np.full(size, -1, np.int64),
        into=np.zeros(2 * size, np.int64),
        following=np.zeros(2 * size, np.int64),
        count=np.zeros(2 * size, np.int64),
        pace=np.zeros(2 * size, np.int64),
        passed=np.zeros(2 * size, np.int64),
        keys=np.full(table, -1, np.int64),
        counts=np.zeros(table, np.int64),
        tree=np.zeros(size + 1, np.int64),
        scalars=np.zeros(8, np.int64),
        offers=np.full((10, 8), 10, np.int64),
        hits=np.outer(_LIKELY_DISTANCE, _LIKELY_BEARING).astype(np.int64) // 4,
        ledger=np.zeros((ACCOUNTS, 2)),
    )


#: Fields of which a larger model begins with what a smaller one holds.
_KEPT = (
    "flags", "weights", "histograms", "scalars", "offers", "hits", "places", "head", "into", "following", "count", "pace", "passed",
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
def follow(model: WalkModel, before: int, u: int, v: int, pace: int) -> int:
    """Learn a step from u to v after the half-edge ``before`` (-1: none); return its half-edge."""
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
    if pace > 0:
        model.pace[half] = pace
        scalars[PACE] = pace
        scalars[PACE_SLOW] = pace if scalars[PACE_SLOW] == 0 else scalars[PACE_SLOW] + (pace - scalars[PACE_SLOW]) // 4
    far = length(model.places, u, v)
    scalars[STEP_LENGTH] = far if scalars[STEP_LENGTH] == 0 else scalars[STEP_LENGTH] + (far - scalars[STEP_LENGTH]) // 8
    return half


@jit
def add_node(model: WalkModel) -> int:
    """Add a node whose place is set already; return it."""
    node = model.scalars[NODES]
    model.scalars[NODES] = node + 1
    weigh(model, node, 1)
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
