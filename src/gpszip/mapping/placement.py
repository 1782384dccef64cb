"""The M-step of the connected map: positions of the nodes, and merges of nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.assignment import drop_unused_nodes
from gpszip.mapping.initial_map import (
    MAX_DENSE_NODES,
    Segments,
    free_equations,
    normal_equations,
    round_positions,
    solve_positions,
)
from gpszip.mapping.kernels.assign import Prices
from gpszip.mapping.kernels.initial_map import merge_disjoint_pairs
from gpszip.mapping.plan import Plan

__all__ = ["merge_nodes", "place_nodes", "place_on_grid"]

#: Distance in targets up to which two nodes may merge.
_MERGE_REACH = 4

#: Share of its price that a node saves when it merges, and of a new edge's for each neighbour that
#: the two nodes share: the coder's model adapts to what is left.
_SAVED_SHARE = 0.7


def place_nodes(
    segments: Segments, positions: NDArray[np.float64], fixed: int = 0
) -> NDArray[np.float64]:
    """Place all nodes but the first ``fixed`` at least squared error (M-step)."""
    equations = free_equations(*normal_equations(segments, positions), positions, fixed)
    return np.concatenate([positions[:fixed], solve_positions(*equations, positions[fixed:])])


def place_on_grid(
    segments: Segments, positions: NDArray[np.float64], fixed: int
) -> NDArray[np.float64]:
    """Round the positions of all nodes to whole grid steps; the first ``fixed`` are whole."""
    equations = normal_equations(segments, positions)
    return np.concatenate(
        [
            positions[:fixed],
            round_positions(*free_equations(*equations, positions, fixed), positions[fixed:]),
        ]
    )


def merge_nodes(
    slot_nodes: NDArray[np.int64],
    segments: Segments,
    positions: NDArray[np.float64],
    plan: Plan,
    prices: Prices,
    fixed: int,
) -> tuple[NDArray[np.int64], Segments, NDArray[np.float64]]:
    """Merge nodes where that saves more bits than the error that it adds is worth.

    Parameters
    ----------
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; not changed.
    segments : Segments
        The segments between these knots.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps.
    plan : Plan
        The target.
    prices : Prices
        Prices in bits.
    fixed : int
        The first nodes stay.

    Returns
    -------
    slot_nodes, segments, positions
        The same after the merges, with the nodes placed again.
    """
    # Only nodes within some target errors of each other may merge.
    pairs = _find_near_pairs(positions, _MERGE_REACH * plan.target, fixed)
    if len(pairs) == 0:
        return slot_nodes, segments, positions

    # Merge the pairs that gain, the best first.
    gain = _merge_gain(pairs, segments, positions, prices, fixed)
    gaining = np.flatnonzero(gain > 0)
    if len(gaining) == 0:
        return slot_nodes, segments, positions
    order = gaining[np.argsort(-gain[gaining], kind="stable")]
    target = np.arange(len(positions))
    merge_disjoint_pairs(pairs[order], target)

    # Renumber the nodes that are left, and place them.
    slot_nodes = np.where(slot_nodes >= 0, target[slot_nodes], -1)
    slot_nodes, positions = drop_unused_nodes(slot_nodes, positions, fixed)
    segments = segments.relabelled(slot_nodes, len(positions))
    return slot_nodes, segments, place_nodes(segments, positions, fixed)


def _merge_gain(
    pairs: NDArray[np.int64],
    segments: Segments,
    positions: NDArray[np.float64],
    prices: Prices,
    fixed: int,
) -> NDArray[np.float64]:
    """Bits that the merge of each pair saves, less the price of the error that it adds.

    Two nodes of stiffness a and b at distance r that move to their common optimum add the squared
    error r^2 a b / (a + b). A fixed node stays, as if its stiffness were infinite.
    """
    # The price of the added error.
    stiffness = segments.stiffness.diagonal()
    square = ((positions[pairs[:, 0]] - positions[pairs[:, 1]]) ** 2).sum(axis=1)
    pull = np.where(
        pairs[:, 0] < fixed,
        1.0,
        stiffness[pairs[:, 0]] / (stiffness[pairs[:, 0]] + stiffness[pairs[:, 1]]),
    )
    error_bits = prices.error * square * stiffness[pairs[:, 1]] * pull

    # Neighbours that both nodes have: their edges merge, too.
    shared = _count_shared_neighbours(pairs, segments, len(positions))

    # A merge saves a share of a node's and the shared edges' bits: the model adapts to the rest.
    gain: NDArray[np.float64] = (
        _SAVED_SHARE * (prices.new_node + prices.position)
        + _SAVED_SHARE * prices.new_edge * shared
        - error_bits
    )
    return gain


def _count_shared_neighbours(
    pairs: NDArray[np.int64], segments: Segments, count: int
) -> NDArray[np.float64]:
    """Number of neighbours that both nodes of each pair have."""
    if count <= MAX_DENSE_NODES:
        is_linked = np.zeros((count, count), np.bool_)
        is_linked[segments.starts, segments.ends] = True
        is_linked[segments.ends, segments.starts] = True
        is_shared = is_linked[pairs[:, 0]] & is_linked[pairs[:, 1]]
        return np.asarray(is_shared.sum(axis=1), np.float64)

    from scipy.sparse import csr_array

    ones = np.ones(len(segments.starts))
    adjacency = csr_array((ones, (segments.starts, segments.ends)), shape=(count, count))
    linked = ((adjacency + adjacency.T) > 0).astype(np.float64)
    return np.asarray((linked @ linked).tocsr()[pairs[:, 0], pairs[:, 1]]).ravel()


def _find_near_pairs(positions: NDArray[np.float64], reach: float, fixed: int) -> NDArray[np.int64]:
    """Pairs of nodes within reach, the lower number first.

    The second node is never one of the first ``fixed``.
    """
    # Among few nodes, all pairs but those of two fixed ones.
    if len(positions) <= MAX_DENSE_NODES:
        first, second = np.triu_indices(len(positions), 1)
        square = ((positions[first] - positions[second]) ** 2).sum(axis=1)
        is_near = (square <= reach * reach) & (second >= fixed)
        return np.stack([first[is_near], second[is_near]], axis=1).astype(np.int64)

    from scipy.spatial import cKDTree

    # Without fixed nodes, any near pair may merge.
    if fixed == 0:
        return cKDTree(positions).query_pairs(reach, output_type="ndarray").astype(np.int64)

    # Pairs of free nodes.
    free = cKDTree(positions[fixed:])
    pairs = [free.query_pairs(reach, output_type="ndarray") + fixed]

    # Pairs of a fixed and a free node; only fixed nodes near the bounding box of the free ones
    # count.
    low = positions[fixed:].min(axis=0, initial=np.inf) - reach
    high = positions[fixed:].max(axis=0, initial=-np.inf) + reach
    near = np.flatnonzero(((positions[:fixed] >= low) & (positions[:fixed] <= high)).all(axis=1))
    if len(near) and free.n:
        mixed = cKDTree(positions[near]).sparse_distance_matrix(free, reach, output_type="ndarray")
        pairs.append(np.stack([near[mixed["i"]], mixed["j"] + fixed], axis=1))
    return np.concatenate(pairs).astype(np.int64)
