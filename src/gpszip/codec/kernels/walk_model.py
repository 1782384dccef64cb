"""What the coder of walks knows so far: nodes, ways, how often and how fast they were taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import MIXTURE_ROWS, SUBSTEPS
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.rotation import DIRECTIONS, nearest_direction
from gpszip.codec.kernels.walk_priors import (
    DISTRIBUTIONS,
    HISTOGRAM_BINS,
    MIXTURES,
    initial_bit_counts,
    initial_chosen,
    initial_mixture_weights,
    initial_offered,
)
from gpszip.kernels.jit import jit
from gpszip.kernels.pair_table import find_pair_slot

__all__ = [
    "BEGUN",
    "CHEAP",
    "DURATION_BITS",
    "GAP_BITS",
    "HEADING",
    "LAST_CELLS",
    "LAST_FAR",
    "LAST_NEW",
    "LATEST",
    "LENGTH_CLASSES",
    "MAX_MAGNITUDE",
    "MAX_SEARCH_NODES",
    "MODES",
    "NO_TURN",
    "ORDER_AT",
    "POSITION_BITS",
    "SEARCHES",
    "SHORTEST_PATHS",
    "SORTED_STARTS",
    "START_BITS",
    "STATISTICS",
    "STEP_KIND_BITS",
    "SUM_CELLS",
    "SUM_FAR",
    "TIMED",
    "TIME_FIRST",
    "TRAIL_AT",
    "TRAIL_END",
    "TURN",
    "U_GAP",
    "U_NEW",
    "U_STAY",
    "WalkModel",
    "add_end_weight",
    "add_node",
    "end_weight_below",
    "extended",
    "find_by_end_weight",
    "find_half_edge",
    "forget_heading",
    "learn_step",
    "length_class",
    "new_model",
    "node_distance",
    "pair_count",
    "record_bits",
    "update_mean_log",
    "with_modes",
]

#: Numbers kept in ``WalkModel.scalars``; two are the node (plus 1) and the first cell of the latest track. Paces are logarithms,
#: known once a step was ``TIMED``; the heading is -1 and the turn ``NO_TURN`` where none is known.
NODES, HALVES, PACE, PACE_SLOW, STEP_LENGTH, LATEST, BEGUN, TIMED, HEADING, TURN, CHEAP, MODES = (
    np.arange(12)
)
LAST_FAR, LAST_CELLS, SUM_FAR, SUM_CELLS, LAST_NEW, TRAIL_AT, TRAIL_END, ORDER_AT, SEARCHES = (
    np.arange(12, 21)
)
_SCALARS = 21
NO_TURN = 1 << 10

#: Modes, of which any may be on: starts of tracks are told ahead, in order; spans of new ways come before their places; walks aim at
#: places, to which they take the shortest path.
SORTED_STARTS, TIME_FIRST, SHORTEST_PATHS = np.array([1, 2, 4])

#: Rows of ``WalkModel.usual``: spans by class of length, of stops, of gaps and of new ways coded ahead of their places.
LENGTH_CLASSES = 48
U_STAY, U_GAP, U_NEW = np.array([48, 49, 50])

#: A mean of steps about as long is that of about so many.
_SPANS = np.int64(20)

#: Nodes that a search for aims settles at most.
MAX_SEARCH_NODES = 256

#: Rows of the ledger: kinds of steps (back, known, link, new, stay), their durations, places of new nodes, starts, gaps.
STATISTICS = 13
STEP_KIND_BITS, DURATION_BITS, POSITION_BITS, START_BITS, GAP_BITS = np.array([0, 5, 10, 11, 12])

#: Spans are learnt as if at most this many cells, and lengths are below it.
MAX_MAGNITUDE = np.int64(1) << 36

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
    offers: NDArray[
        np.int64
    ]  # by layer and class: how much was to be had there, and what was chosen
    hits: NDArray[np.int64]
    sheet: NDArray[np.int64]  # the distributions being mixed
    starts: NDArray[np.int64]  # by time, of each track: its first cell and whether it was had
    trail: NDArray[np.int64]  # the way to the place aimed at, and nodes settled in search for one
    found: NDArray[
        np.int64
    ]  # of each node, where it was settled in the latest search, and which that was
    spent: NDArray[
        np.float64
    ]  # bits that the steps to the knots take without aims; only a writer's choice of aims asks for it
    ledger: NDArray[
        np.float64
    ]  # bits written and how often, by ``ACCOUNTS``; nothing is decided by it


def new_model(knots: int, dimension: int) -> WalkModel:
    """Return the model before the first knot; memory is about 250 bytes for each knot."""
    return _empty(max(knots, 1), max(knots, 1), max(knots, 1), dimension)


def _empty(nodes: int, steps: int, pairs: int, dimension: int) -> WalkModel:
    """Return the model before the first knot, with room for so many nodes, edges, and pairs of them in a row."""
    table = 1 << (2 * pairs).bit_length()
    return WalkModel(
        flags=initial_bit_counts(),
        weights=initial_mixture_weights(),
        histograms=np.full((MIXTURES, HISTOGRAM_BINS), 2, np.int64),
        places=np.zeros((nodes, dimension), np.int64),
        head=np.full(nodes, -1, np.int64),
        into=np.zeros(2 * steps, np.int64),
        following=np.zeros(2 * steps, np.int64),
        count=np.zeros(2 * steps, np.int64),
        usual_span=np.zeros(2 * steps, np.int64),
        passed=np.zeros(2 * steps, np.int64),
        keys=np.full(table, -1, np.int64),
        counts=np.zeros(table, np.int64),
        tree=np.zeros(nodes + 1, np.int64),
        rests=np.zeros(nodes, np.int64),
        usual=np.zeros((LENGTH_CLASSES + 3, 2), np.int64),
        scalars=np.array([0] * 8 + [-1, NO_TURN] + [0] * (_SCALARS - 10), np.int64),
        offers=initial_offered(),
        hits=initial_chosen(),
        sheet=np.zeros((MIXTURE_ROWS, DISTRIBUTIONS), np.int64),
        starts=np.zeros((0, 2), np.int64),
        trail=np.zeros(0, np.int64),
        found=np.zeros((0, 2), np.int64),
        spent=np.zeros(0),
        ledger=np.zeros((STATISTICS, 2)),
    )


#: Fields that are copied as far as anything is in them.
_KEPT = (
    "flags", "weights", "histograms", "scalars", "offers", "hits", "places", "head", "into", "following", "count", "usual_span", "passed",
    "rests", "usual",
)  # fmt: skip


def extended(model: WalkModel, knots: int) -> WalkModel:
    """Return a copy of what a model has learned, with room for so many more knots; its ledger begins anew."""
    nodes, halves = int(model.scalars[NODES]), int(model.scalars[HALVES])
    pairs, more = int((model.keys >= 0).sum()), max(knots, 1)
    whole = _empty(nodes + more, halves // 2 + more, pairs + more, model.places.shape[1])
    for field in _KEPT:
        old, new = getattr(model, field), getattr(whole, field)
        known = min(len(old), len(new))
        new[:known] = old[:known]
    _enter_pairs(model.keys, model.counts, whole.keys, whole.counts)
    _extend_tree(model.tree[: nodes + 1], whole.tree)
    return whole


@jit
def _enter_pairs(
    keys: NDArray[np.int64],
    counts: NDArray[np.int64],
    to_keys: NDArray[np.int64],
    to_counts: NDArray[np.int64],
) -> None:
    for i in range(len(keys)):
        if keys[i] != -1:
            at = find_pair_slot(to_keys, keys[i])
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


def with_modes(
    model: WalkModel, modes: int, starts: NDArray[np.int64], spent: NDArray[np.float64]
) -> WalkModel:
    """Return a model that codes in these modes.

    Parameters
    ----------
    starts : int64 array, shape (tracks,)
        For ``SORTED`` the first cells of the tracks, in order; a reader's are filled in.
    spent : float64 array, shape (K,) or (0,)
        For a writer that aims, bits that the steps to the knots take without; filled in where no mode is on.
    """
    model.scalars[MODES] = modes
    starts = (
        np.column_stack([starts, np.zeros_like(starts)]) if modes & SORTED_STARTS else model.starts
    )
    if not modes & SHORTEST_PATHS:
        return model._replace(starts=starts, spent=spent)
    return model._replace(
        starts=starts,
        spent=spent,
        trail=np.zeros(MAX_SEARCH_NODES, np.int64),
        found=np.zeros((len(model.head), 2), np.int64),
    )


@jit
def record_bits(model: WalkModel, account: int, bits: float) -> None:
    """Enter written bits into the ledger."""
    model.ledger[account, 0] += bits
    model.ledger[account, 1] += 1.0


@jit
def node_distance(places: NDArray[np.int64], u: int, v: int) -> int:
    """Distance between two nodes in sixteenths of a quantum, at most 2**36."""
    square = np.int64(0)
    for axis in range(places.shape[1]):
        step = min(abs(places[u, axis] - places[v, axis]), np.int64(1) << 29)
        square += step * step
    return np.int64(SUBSTEPS * np.sqrt(np.float64(square)))


@jit
def find_half_edge(model: WalkModel, u: int, v: int) -> int:
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
    return model.counts[find_pair_slot(model.keys, before * (np.int64(1) << 31) + half)]


@jit
def length_class(far: int) -> int:
    """Class of a length, by half octaves from a quantum on: its row of ``usual``."""
    if far < SUBSTEPS:
        return 0
    return min(np.int64(1 + ((fixed_log2(far) - (4 << 16)) >> 15)), np.int64(LENGTH_CLASSES - 1))


@jit
def update_mean_log(model: WalkModel, row: int, most: int, logarithm: int) -> None:
    """Move a mean logarithm of spans towards one more, as if it were one of at most ``most``."""
    usual = model.usual
    usual[row, 1] = min(usual[row, 1] + 1, np.int64(most))
    usual[row, 0] += (logarithm - usual[row, 0]) // usual[row, 1]


@jit
def forget_heading(model: WalkModel) -> None:
    """Know of no heading, as a walk begins or goes on after a gap."""
    model.scalars[HEADING] = -1
    model.scalars[TURN] = NO_TURN


@jit
def _turn(model: WalkModel, u: int, v: int) -> None:
    places, scalars = model.places, model.scalars
    heading = nearest_direction(places[v, 0] - places[u, 0], places[v, 1] - places[u, 1])
    scalars[TURN] = NO_TURN
    if scalars[HEADING] >= 0:
        scalars[TURN] = (
            heading - scalars[HEADING] + DIRECTIONS // 2
        ) % DIRECTIONS - DIRECTIONS // 2
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
    span = fixed_log2(min(max(cells, np.int64(1)), MAX_MAGNITUDE))
    update_mean_log(model, length_class(far), _SPANS, span)
    model.usual_span[half] += (span - model.usual_span[half]) // min(
        model.count[half], np.int64(12)
    )
    if far > 0:
        pace = span - fixed_log2(far)
        scalars[PACE] = pace
        scalars[PACE_SLOW] = (
            pace
            if scalars[TIMED] == 0
            else scalars[PACE_SLOW] + 5 * (pace - scalars[PACE_SLOW]) // 32
        )
        scalars[TIMED] = 1
        _learn_speed(scalars, min(far, _FARTHEST), min(cells, _LONGEST))


@jit
def learn_step(model: WalkModel, before: int, u: int, v: int, cells: int) -> int:
    """Learn a step from u to v in ``cells`` (0: no times) after the half-edge ``before`` (-1: none); return its half-edge."""
    half = find_half_edge(model, u, v)
    if half < 0:
        half = _join(model, u, v)
    model.count[half] += 1
    if before >= 0:
        key = before * (np.int64(1) << 31) + half
        at = find_pair_slot(model.keys, key)
        model.keys[at] = key
        model.counts[at] += 1
        model.passed[before] += 1
    scalars = model.scalars
    far = node_distance(model.places, u, v)
    if cells != 0:
        _learn_span(model, half, far, cells)
    if model.places.shape[1] > 1:
        _turn(model, u, v)
    scalars[STEP_LENGTH] = (
        far
        if scalars[STEP_LENGTH] == 0
        else scalars[STEP_LENGTH] + (far - scalars[STEP_LENGTH]) // 8
    )
    return half


@jit
def add_node(model: WalkModel) -> int:
    """Add a node whose place is set already; return it."""
    node = model.scalars[NODES]
    model.scalars[NODES] = node + 1
    add_end_weight(model, node, np.int64(1))
    return node


@jit
def add_end_weight(model: WalkModel, node: int, weight: int) -> None:
    """Raise the weight of a node as the end of a track."""
    at = node + 1
    while at < len(model.tree):
        model.tree[at] += weight
        at += at & -at


@jit
def end_weight_below(model: WalkModel, node: int) -> int:
    """Sum of the weights of the nodes before ``node``."""
    total = np.int64(0)
    while node > 0:
        total += model.tree[node]
        node -= node & -node
    return total


@jit
def find_by_end_weight(model: WalkModel, at: int) -> int:
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
