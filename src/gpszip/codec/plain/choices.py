"""Choices among nodes; see :mod:`gpszip.codec.kernels.new_edge_coder` and ``target_coder``.

Distances and bearings are floats: those of the compiled decoder, computed in the same order.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.walk_priors import (
    AMONG_NEW_EDGES,
    AMONG_TARGETS,
    BEYOND_GAPS,
    BIT_RECENT_NODE,
    BIT_TARGET,
    KINDS_PER_OCTAVE,
    OCTAVES,
)
from gpszip.codec.plain.model import PlainModel
from gpszip.codec.plain.walk_map import BEARING_COSINES, NO_BEARING, WalkMap

__all__ = ["read_known_node", "read_target"]

#: The newest nodes that are candidates; fewer once so many more choices were cheap than not.
_MAX_CANDIDATES = 4096
_FEW_CANDIDATES = 64
_MAX_CHEAP_CHOICES = 1 << 14

#: Classes of candidates, and the class of nodes that can't be chosen, which weighs nothing.
_CLASSES = OCTAVES * KINDS_PER_OCTAVE
_BARRED = _CLASSES

#: What a choice adds to its class.
_CHOSEN_INCREMENT = 128

#: Differences of coordinates count as at most this.
_MAX_DIFFERENCE = 2.0**25

#: The mean step length counts as at most this, in sixteenths of a space step.
_MAX_REACH = 1 << 27

#: Bounds of the classes of how many gaps began or ended at a node.
_GAP_ENDS = (0, 1, 3)

#: Nodes that a search for a target finds at most, and once choices are cheap; entries of its heap.
_MAX_SEARCH_NODES = 256
_FEW_SEARCH_NODES = 16
_MAX_ENTRIES = 4096

#: What a node's weight grows by as a target.
_TARGET_WEIGHT = 24

#: Candidates that NumPy weighs in the time of one distribution: 0.04 of 0.6 microseconds.
_CANDIDATES_PER_UNIT = 16


def read_known_node(model: PlainModel, u: int, before: int | None, table: int) -> int:
    """Read the known node to which a new edge or a gap from u leads.

    Parameters
    ----------
    model : PlainModel
        Learns the choice.
    u : int
        Where the walk is.
    before : int or None
        Node from which it came there.
    table : int
        ``AMONG_NEW_EDGES`` or ``BEYOND_GAPS``.
    """
    # The newest nodes are candidates.
    nodes = len(model.map)
    count = min(nodes, _FEW_CANDIDATES if _is_limited(model) else _MAX_CANDIDATES)
    first = nodes - count
    classes = _classify(model, u, before, table, first)
    weights = _class_weights(model, table)[classes]
    total = int(weights.sum())
    model.work.spend(count // _CANDIDATES_PER_UNIT)

    # a candidate by its weight, any other node with equal probabilities
    choice, cheap = None, False
    if total > 0 and (first == 0 or model.read_bit(int(BIT_RECENT_NODE))):
        choice, cheap = _read_candidate(model, weights, total)
    node = model.decoder.read_uniform(nodes) if choice is None else first + choice
    _learn_candidate(model, table, classes, choice, cheap)
    return node


def read_target(model: PlainModel, u: int, context: int) -> None:
    """Read whether the walk takes a shortest path from u on, and enter it in ``model.path``.

    Parameters
    ----------
    model : PlainModel
        Learns the choice.
    u : int
        Where the walk is; it has an edge.
    context : int
        Kind of the last step, or 5 where a target was just reached.
    """
    if not model.read_bit(int(BIT_TARGET) + context):
        return

    # The choice among the nearest nodes but u itself.
    nodes, parents = _find_nearest(model, u)
    classes = _classify_targets(model.map, nodes)
    weights = _class_weights(model, int(AMONG_TARGETS))[classes]
    choice, cheap = _read_candidate(model, weights, int(weights.sum()))
    _learn_candidate(model, int(AMONG_TARGETS), classes, choice, cheap)

    # The path to it, and its weight as a target later on.
    rank = choice + 1
    model.map.end_weights[nodes[rank]] += _TARGET_WEIGHT
    while rank > 0:
        model.path.append(nodes[rank])
        rank = parents[rank]


def _is_limited(model: PlainModel) -> bool:
    """Whether so many choices were cheap that only few candidates are weighed any more."""
    return model.cheap_choices >= _MAX_CHEAP_CHOICES


def _class_weights(model: PlainModel, table: int) -> NDArray[np.int64]:
    """Weight of a candidate of each class; 0 for the class that is barred."""
    # How often each was chosen, of how often it could be, in units of 2**-16. The 1 keeps every
    # class possible, and the 0 at the end is for the class that is barred.
    return np.append((model.chosen[table] << 16) // model.offered[table] + 1, 0)


def _read_candidate(model: PlainModel, weights: NDArray[np.int64], total: int) -> tuple[int, bool]:
    """Read which candidate is chosen, and whether that took less than 2 bits.

    The last candidate owns the lowest interval.
    """
    # The ends of all intervals; the one that holds the number ends first beyond it.
    ends = np.cumsum(weights[::-1])
    i = int(np.searchsorted(ends, model.decoder.find(total), side="right"))
    choice = len(weights) - 1 - i
    weight = int(weights[choice])
    model.decoder.take(int(ends[i]) - weight, weight, total)
    return choice, 4 * weight > total


def _learn_candidate(
    model: PlainModel, table: int, classes: NDArray[np.int64], choice: int | None, cheap: bool
) -> None:
    """Learn which candidate was chosen, and whether that took few bits."""
    # Barred nodes were no candidates, so that their class is cut off.
    model.offered[table] += np.bincount(classes, minlength=_CLASSES + 1)[:_CLASSES]
    if choice is not None:
        model.chosen[table, classes[choice]] += _CHOSEN_INCREMENT

    # Only forged bytes make many cheap choices among many nodes. To count them bounds the time that
    # each byte takes, see _is_limited.
    if len(model.map) > _FEW_CANDIDATES:
        model.cheap_choices = max(model.cheap_choices + (1 if cheap else -1), 0)


def _classify(
    model: PlainModel, u: int, before: int | None, table: int, first: int
) -> NDArray[np.int64]:
    """Class of each node from ``first`` on, as a candidate for u."""
    # Octave of the distance, and kind.
    places = model.map.places
    differences = (places[first:] - places[u]).astype(np.float64)
    classes = _octaves(differences, model.reach) * KINDS_PER_OCTAVE
    if table == BEYOND_GAPS:
        gap_ends = model.map.gap_ends[first:]
        classes += sum((gap_ends > bound).astype(np.int64) for bound in _GAP_ENDS)
    elif before is None:
        classes += NO_BEARING
    else:
        classes += _bearings(differences, (places[u] - places[before]).astype(np.float64))

    # u is barred and, but after gaps, the nodes to which it has an edge
    barred = [u, *(model.map.neighbours(u) if table == AMONG_NEW_EDGES else ())]
    model.work.spend(len(barred) // _CANDIDATES_PER_UNIT)
    classes[[node - first for node in barred if node >= first]] = _BARRED
    return classes


def _octaves(differences: NDArray[np.float64], reach: int) -> NDArray[np.int64]:
    """Octave of each length: how many bounds its square reaches, each twice the one before."""
    # Squared lengths, summed up axis by axis.
    squares = np.zeros(len(differences))
    for axis in differences.T:
        step = np.minimum(np.abs(axis), _MAX_DIFFERENCE)
        squares += step * step

    # The first bound is the step to expect over 4 sqrt(2), which is 181 / 1024 of it. Squares of
    # the bounds double, so that two of them make an octave of length. 256 turns sixteenths into
    # steps.
    first = float((min(reach, _MAX_REACH) * 181 >> 10) ** 2) / 256
    bounds = first * 2.0 ** np.arange(OCTAVES - 1)
    return np.searchsorted(bounds, squares, side="right").astype(np.int64)


def _bearings(differences: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.int64]:
    """Class of the turn from a step towards each node; 7 where either is null."""
    # Scalar products, and squared lengths.
    dots, squares, step_square = np.zeros(len(differences)), np.zeros(len(differences)), 0.0
    # Axis by axis, in the order of the compiled decoder: floats added up otherwise may differ.
    for a, axis in zip(step.tolist(), differences.T, strict=True):
        dots += a * axis
        squares += axis * axis
        step_square += a * a

    # Count the bounds that cos * |cos| is not above; that takes no square root.
    products = step_square * squares
    cosines = dots * np.abs(dots) / np.where(products > 0, products, 1.0)
    bearings = sum((~(cosines > bound)).astype(np.int64) for bound in BEARING_COSINES)
    return np.where(products > 0, bearings, NO_BEARING)


def _classify_targets(walk_map: WalkMap, nodes: list[int]) -> NDArray[np.int64]:
    """Class of each of the nearest nodes but the first, by rank and how often walks ended there."""
    # Each start, end or path that ended at a node added 24 to its weight.
    weights = walk_map.end_weights[nodes[1:]].tolist()
    return np.array(
        [
            rank.bit_length() * KINDS_PER_OCTAVE
            + min((weight // _TARGET_WEIGHT).bit_length(), KINDS_PER_OCTAVE - 1)
            for rank, weight in enumerate(weights, 1)
        ],
        np.int64,
    )


def _find_nearest(model: PlainModel, u: int) -> tuple[list[int], list[int]]:
    """Find the nodes nearest to u along known edges, by Dijkstra's algorithm.

    Returns
    -------
    list of int, list of int
        Nodes by rank, u first, and the rank of the node from which each was reached.
    """
    # a heap of (distance, entry, node, rank of its parent): among equals the oldest comes first
    max_nodes = _FEW_SEARCH_NODES if _is_limited(model) else _MAX_SEARCH_NODES
    heap, entries = [(0, 0, u, -1)], 1
    nodes: list[int] = []
    parents: list[int] = []
    reached: set[int] = set()
    while heap and len(nodes) < max_nodes:
        # The nearest entry gives its node a rank.
        distance, _, node, parent = heapq.heappop(heap)
        if node in reached:
            continue
        reached.add(node)

        # Its neighbours enter the heap.
        edges = model.map.half_edges(node) if entries < _MAX_ENTRIES else []
        model.work.spend(len(edges))
        for edge in edges:
            if entries < _MAX_ENTRIES and edge.end not in reached:
                entry = (distance + max(edge.length, 1), entries, edge.end, len(nodes))
                heapq.heappush(heap, entry)
                entries += 1
        nodes.append(node)
        parents.append(parent)
    return nodes, parents
