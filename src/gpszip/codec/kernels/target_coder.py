"""Coding of targets: nodes to which the walk takes the shortest path, which implies its steps.

This is path compression by waypoints (thesis, section 7.2, algorithm 6) in a stream. A waypoint is
one of the nodes nearest along known edges, and is coded when the walk sets off to it. A node that
no path leads to cannot be a target, and no path has more than ``MAX_SEARCH_NODES`` steps.

Candidates are ranked by distance along edges (E. W. Dijkstra, 1959). Their classes are the binary
digits of the rank, and those of how often tracks or paths to targets ended at the node.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.new_edge_coder import (
    class_weights,
    code_candidate,
    count_classes,
    is_cheap,
    is_search_limited,
    learn_candidate,
    sum_weights,
)
from gpszip.codec.kernels.range_coder import Coder, is_decoding
from gpszip.codec.kernels.walk_model import (
    MARK_RANK,
    MARK_SEARCH,
    MAX_SEARCH_NODES,
    PATH_END,
    PATH_NEXT,
    SEARCHES,
    WalkModel,
    add_end_weight,
    end_weight_below,
    find_half_edge,
    node_distance,
)
from gpszip.codec.kernels.walk_priors import AMONG_TARGETS, BIT_TARGET, KINDS_PER_OCTAVE
from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner, inner_uncounted

__all__ = ["code_target", "has_target", "take_next_node"]

#: Entries of a search's heap at most, and their binary digits in a key.
_MAX_ENTRIES = 4096
_ENTRY_BITS = 12

#: Nodes that a search reaches at most once forged bytes may be at work, see ``is_search_limited``.
_FEW_NODES = 16

#: Weight that a node gains as a target, as much as by the end of a track.
_TARGET_WEIGHT = np.int64(24)


@inner_uncounted
def has_target(model: WalkModel) -> bool:
    """Whether the walk is on its way to a target."""
    return model.scalars[PATH_NEXT] < model.scalars[PATH_END]


@inner_uncounted
def take_next_node(model: WalkModel) -> int:
    """Take the next node of the path to the target."""
    model.scalars[PATH_NEXT] += 1
    return model.target_path[model.scalars[PATH_NEXT] - 1]


@inner
def _find_nearest(
    model: WalkModel, u: int, nearest: NDArray[np.int64], parents: NDArray[np.int64]
) -> int:
    """Find the nodes nearest to u along known edges, u first; return how many.

    Parameters
    ----------
    model : WalkModel
        Its ``search_marks`` are set for the nodes found.
    u : int
        Where the walk is.
    nearest, parents : int64 arrays, shape (MAX_SEARCH_NODES,)
        Filled in: the nodes by rank, and the rank of the node from which each was reached.
    """
    # Number the search, so that the marks of earlier ones count as unset.
    marks, end_node, next_half_edge = model.search_marks, model.end_node, model.next_half_edge
    max_nodes = np.int64(_FEW_NODES if is_search_limited(model) else MAX_SEARCH_NODES)
    search = model.scalars[SEARCHES] + 1
    model.scalars[SEARCHES] = search

    # a heap of entries (node, rank of its parent) by distance; among equals the oldest comes first
    keys, heap = np.empty(_MAX_ENTRIES + 1, np.int64), np.empty(_MAX_ENTRIES + 1, np.int64)
    nodes, origins = np.empty(_MAX_ENTRIES, np.int64), np.empty(_MAX_ENTRIES, np.int64)
    nodes[0], origins[0] = u, -1
    entries, size = np.int64(1), push(keys, heap, 0, np.int64(0), np.int64(0))

    # Rank the nodes by distance from u, by Dijkstra's algorithm.
    count = np.int64(0)
    while size > 0 and count < max_nodes:
        # The nearest entry gives its node a rank.
        key = keys[0]
        entry, size = pop(keys, heap, size)
        node = nodes[entry]
        if marks[node, MARK_SEARCH] == search:
            continue
        marks[node, MARK_RANK], marks[node, MARK_SEARCH] = count, search
        nearest[count], parents[count] = node, origins[entry]

        # Its neighbours enter the heap.
        half_edge = model.first_half_edge[node]
        while half_edge >= 0 and entries < _MAX_ENTRIES:
            neighbour = end_node[half_edge]
            if marks[neighbour, MARK_SEARCH] != search:
                length = max(node_distance(model.places, node, neighbour), np.int64(1))
                distance = (key >> _ENTRY_BITS) + length
                nodes[entries], origins[entries] = neighbour, count
                size = push(keys, heap, size, distance << _ENTRY_BITS | entries, entries)
                entries += 1
            half_edge = next_half_edge[half_edge]
        count += 1
    return count


@inner_uncounted
def _binary_digits(number: int) -> int:
    """Binary digits of a number >= 0; none of 0."""
    digits = 0
    while number >> digits > 0:
        digits += 1
    return digits


@inner
def _classify(model: WalkModel, nearest: NDArray[np.int64], count: int) -> NDArray[np.uint8]:
    """Class of each of the nearest nodes but the first, by rank and how often walks ended there."""
    classes = np.zeros(count - 1, np.uint8)
    for rank in range(1, count):
        node = nearest[rank]
        weight = end_weight_below(model, node + 1) - end_weight_below(model, node)
        kind = min(_binary_digits(weight // _TARGET_WEIGHT), KINDS_PER_OCTAVE - 1)
        classes[rank - 1] = _binary_digits(rank) * KINDS_PER_OCTAVE + kind
    return classes


@inner
def _best_rank(
    model: WalkModel,
    nodes: NDArray[np.int64],
    is_step: NDArray[np.bool_],
    j: int,
    parents: NDArray[np.int64],
    classes: NDArray[np.uint8],
) -> int:
    """Rank of the node that saves most bits as a target from knot j on, or 0 if none saves any.

    A target saves the bits of the steps to it without targets. It costs those of its own choice,
    -log2(weight / total), and those of saying that there is a target.
    """
    # A target has to save more than the bits of saying that there is one.
    weights = class_weights(model, AMONG_TARGETS)
    total, counts = sum_weights(count_classes(classes), weights), model.bit_counts
    zeros, ones = counts[BIT_TARGET, 0], counts[BIT_TARGET, 1]
    most_saved = np.log2(np.float64(zeros + ones) / np.float64(ones))

    # Follow the walk as long as it keeps to the tree of shortest paths.
    rank, best_rank, saved = np.int64(0), np.int64(0), 0.0
    while j < len(nodes) and is_step[j]:
        node = nodes[j]
        if (
            node >= len(model.search_marks)
            or model.search_marks[node, MARK_SEARCH] != model.scalars[SEARCHES]
            or parents[model.search_marks[node, MARK_RANK]] != rank
        ):
            break
        rank = model.search_marks[node, MARK_RANK]
        saved += model.step_bits[j]
        bits = np.log2(np.float64(total) / np.float64(weights[classes[rank - 1]]))
        if saved - bits > most_saved:
            most_saved, best_rank = saved - bits, rank
        j += 1
    return best_rank


@inner_uncounted
def _set_path(
    model: WalkModel, rank: int, nearest: NDArray[np.int64], parents: NDArray[np.int64]
) -> None:
    """Enter the shortest path to the node of a rank; it ends where the array ends."""
    start = np.int64(MAX_SEARCH_NODES)
    model.scalars[PATH_END] = start
    while rank > 0:
        start -= 1
        model.target_path[start] = nearest[rank]
        rank = parents[rank]
    model.scalars[PATH_NEXT] = start


@inner
def code_target(
    coder: Coder,
    model: WalkModel,
    u: int,
    context: int,
    nodes: NDArray[np.int64],
    is_step: NDArray[np.bool_],
    j: int,
) -> None:
    """Code whether the walk takes a shortest path from u on, and to which target.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Gets the path, and learns the choice.
    u : int
        Where the walk is; it has an edge.
    context : int
        Kind of the last step, or 5 where a target was just reached.
    nodes, is_step : arrays, shape (K,)
        Node of each knot, and whether a step leads to it; an encoder finds the best target.
    j : int
        The next knot.
    """
    nearest, parents = np.empty(MAX_SEARCH_NODES, np.int64), np.empty(MAX_SEARCH_NODES, np.int64)
    encodes = not is_decoding(coder)

    # An encoder looks for a target that saves bits.
    rank, count = np.int64(0), np.int64(0)
    if encodes and is_step[j] and find_half_edge(model, u, nodes[j]) >= 0:
        count = _find_nearest(model, u, nearest, parents)
        rank = _best_rank(model, nodes, is_step, j, parents, _classify(model, nearest, count))
    if not code_bit(coder, model.bit_counts, BIT_TARGET + context, 1 if rank > 0 else 0):
        return

    # The choice among the nearest nodes.
    if not encodes:
        count = _find_nearest(model, u, nearest, parents)
    classes = _classify(model, nearest, count)
    counts, weights = count_classes(classes), class_weights(model, AMONG_TARGETS)
    total = sum_weights(counts, weights)
    choice = code_candidate(coder, classes, weights, total, rank - 1)
    chosen = np.int64(classes[choice])
    learn_candidate(model, AMONG_TARGETS, counts, chosen, is_cheap(weights[chosen], total))

    # The node is likelier to be a target again.
    rank = choice + 1
    add_end_weight(model, nearest[rank], _TARGET_WEIGHT)
    _set_path(model, rank, nearest, parents)
