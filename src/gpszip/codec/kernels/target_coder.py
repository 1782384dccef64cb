"""Coding of aims: a place to which the walk takes the shortest path on the map so far, so that no way to it is told.

This is path compression by waypoints (thesis, section 7.2, algorithm 6) in a stream: a waypoint is one of the places nearest along the
ways that are known, and is told when the walk sets off to it. A place that no path leads to can't be told, and no path is long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.new_edge_coder import (
    NODE_KINDS,
    class_weights,
    code_candidate,
    is_search_limited,
    learn_candidate,
    sum_weights,
)
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import (
    MAX_SEARCH_NODES,
    SEARCHES,
    TRAIL_AT,
    TRAIL_END,
    WalkModel,
    add_end_weight,
    end_weight_below,
    find_half_edge,
    node_distance,
)
from gpszip.codec.kernels.walk_priors import F_AIM, ON_AIM
from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

__all__ = ["code_target", "has_target", "take_next_node"]

#: Offers of ways that a search weighs at most, and nodes that it settles once forged bytes may be at work.
_OFFERS, _FEW = 4096, 16

#: Weight that a node gains as the end of an aim; what a track's end brings, too.
_WEIGHT = np.int64(24)


@jit
def has_target(model: WalkModel) -> bool:
    """Whether the walk is on its way to a place that was told."""
    return model.scalars[TRAIL_AT] < model.scalars[TRAIL_END]


@jit
def take_next_node(model: WalkModel) -> int:
    """Take the next node on the way."""
    model.scalars[TRAIL_AT] += 1
    return model.trail[model.scalars[TRAIL_AT] - 1]


@jit
def _settle(
    model: WalkModel, u: int, settled: NDArray[np.int64], parents: NDArray[np.int64]
) -> int:
    """Settle the nodes nearest to u along known ways, u first; return how many."""
    found, into, following = model.found, model.into, model.following
    keys, offers = np.empty(_OFFERS + 1, np.int64), np.empty(_OFFERS + 1, np.int64)
    nodes, origins = np.empty(_OFFERS, np.int64), np.empty(_OFFERS, np.int64)
    breadth = np.int64(_FEW if is_search_limited(model) else MAX_SEARCH_NODES)
    search = model.scalars[SEARCHES] + 1
    model.scalars[SEARCHES] = search
    count, made, size = np.int64(0), np.int64(1), push(keys, offers, 0, np.int64(0), np.int64(0))
    nodes[0], origins[0] = u, -1
    while size > 0 and count < breadth:
        key = keys[0]
        offer, size = pop(keys, offers, size)
        node = nodes[offer]
        if found[node, 1] == search:
            continue
        found[node, 0], found[node, 1] = count, search
        settled[count], parents[count] = node, origins[offer]
        half = model.head[node]
        while half >= 0 and made < _OFFERS:
            if found[into[half], 1] != search:
                far = (key >> 12) + max(node_distance(model.places, node, into[half]), np.int64(1))
                nodes[made], origins[made] = into[half], count
                size = push(keys, offers, size, far << 12 | made, made)
                made += 1
            half = following[half]
        count += 1
    return count


@jit
def _classify(model: WalkModel, settled: NDArray[np.int64], count: int) -> NDArray[np.uint8]:
    """Class of each settled node but the first: binary digits of its rank by distance, and of how often tracks or aims ended there."""
    classes = np.zeros(count - 1, np.uint8)
    for i in range(1, count):
        ends = (
            end_weight_below(model, settled[i] + 1) - end_weight_below(model, settled[i])
        ) // _WEIGHT
        kind = 0
        while kind < NODE_KINDS - 1 and ends >> kind > 0:
            kind += 1
        octave = 0
        while i >> octave > 0:
            octave += 1
        classes[i - 1] = octave * NODE_KINDS + kind
    return classes


@jit
def _best_aim(
    model: WalkModel,
    nodes: NDArray[np.int64],
    joined: NDArray[np.bool_],
    j: int,
    parents: NDArray[np.int64],
    classes: NDArray[np.uint8],
) -> int:
    """Rank of the node for which an aim saves most bits from knot j on, or 0 if none does."""
    weights = class_weights(model, ON_AIM)
    total, flags = sum_weights(classes, weights), model.flags
    best = np.log2(np.float64(flags[F_AIM, 0] + flags[F_AIM, 1]) / np.float64(flags[F_AIM, 1]))
    at, rank, saved = np.int64(0), np.int64(0), 0.0
    while j < len(nodes) and joined[j]:
        node = nodes[j]
        if (
            node >= len(model.found)
            or model.found[node, 1] != model.scalars[SEARCHES]
            or parents[model.found[node, 0]] != at
        ):
            break
        at = model.found[node, 0]
        saved += model.spent[j]
        bits = np.log2(np.float64(total) / np.float64(weights[classes[at - 1]]))
        if saved - bits > best:
            best, rank = saved - bits, at
        j += 1
    return rank


@jit
def code_target(
    coder: Coder,
    model: WalkModel,
    u: int,
    context: int,
    nodes: NDArray[np.int64],
    joined: NDArray[np.bool_],
    j: int,
) -> None:
    """Code whether the walk aims at a place from u on, and at which; a writer picks it for the knots from j on."""
    writing = coder.cursor[1] != 1
    settled, parents = np.empty(MAX_SEARCH_NODES, np.int64), np.empty(MAX_SEARCH_NODES, np.int64)
    rank, count = np.int64(0), np.int64(0)
    if writing and joined[j] and find_half_edge(model, u, nodes[j]) >= 0:
        count = _settle(model, u, settled, parents)
        rank = _best_aim(model, nodes, joined, j, parents, _classify(model, settled, count))
    if not code_bit(coder, model.flags, F_AIM + context, 1 if rank > 0 else 0):
        return
    if not writing:
        count = _settle(model, u, settled, parents)
    classes = _classify(model, settled, count)
    weights = class_weights(model, ON_AIM)
    total = sum_weights(classes, weights)
    chosen = code_candidate(coder, classes, weights, total, rank - 1)
    learn_candidate(model, ON_AIM, classes, chosen, 4 * weights[classes[chosen]] > total)
    add_end_weight(model, settled[chosen + 1], _WEIGHT)
    end, at = np.int64(MAX_SEARCH_NODES), chosen + 1
    model.scalars[TRAIL_END] = end
    while at > 0:
        end -= 1
        model.trail[end] = settled[at]
        at = parents[at]
    model.scalars[TRAIL_AT] = end
