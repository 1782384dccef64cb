"""The M-step of the connected map: where nodes lie, on whole places at last, and which of them become one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gpszip.mapping.assignment import drop_unused_nodes
from gpszip.mapping.initial_map import (
    Segments,
    free_equations,
    normal_equations,
    round_positions,
    solve_positions,
)
from gpszip.mapping.kernels.initial_map import merge_disjoint_pairs
from gpszip.mapping.plan import Plan

__all__ = ["merge_nodes", "place_nodes", "place_on_grid"]


def place_nodes(
    segments: Segments, positions: NDArray[np.float64], fixed: int = 0
) -> NDArray[np.float64]:
    """Place all nodes but the first ``fixed`` at least squared error (M-step)."""
    equations = normal_equations(segments, positions)
    return np.concatenate(
        [positions[:fixed], solve_positions(*free_equations(*equations, positions, fixed))]
    )


def place_on_grid(
    segments: Segments, positions: NDArray[np.float64], fixed: int
) -> NDArray[np.float64]:
    """Whole places of all nodes; the first ``fixed`` are so already."""
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
    bits: NDArray[np.float64],
    fixed: int,
) -> tuple[NDArray[np.int64], Segments, NDArray[np.float64]]:
    """Unite nodes whose error apart costs fewer bits than the second node, which is never one of the first ``fixed``."""
    pairs = _near_pairs(positions, 4 * plan.target, fixed)
    if len(pairs) == 0:
        return slot_nodes, segments, positions
    own = segments.stiffness.diagonal()
    square = ((positions[pairs[:, 0]] - positions[pairs[:, 1]]) ** 2).sum(axis=1)
    # a node that stays where it is pulls as if it were infinitely stiff
    pull = np.where(
        pairs[:, 0] < fixed, 1.0, own[pairs[:, 0]] / (own[pairs[:, 0]] + own[pairs[:, 1]])
    )
    harm = bits[0] * square * own[pairs[:, 1]] * pull
    count = len(positions)
    ones = np.ones(len(segments.starts))
    one_way = csr_array((ones, (segments.starts, segments.ends)), shape=(count, count))
    linked = ((one_way + one_way.T) > 0).astype(np.float64)
    shared = (linked @ linked).tocsr()[pairs[:, 0], pairs[:, 1]]
    gain = 0.7 * (bits[3] + bits[4]) + 0.7 * bits[5] * np.asarray(shared).ravel() - harm
    good = np.flatnonzero(gain > 0)
    if len(good) == 0:
        return slot_nodes, segments, positions
    order = good[np.argsort(-gain[good], kind="stable")]
    target = np.arange(count)
    merge_disjoint_pairs(pairs[order], target)
    slot_nodes = np.where(slot_nodes >= 0, target[slot_nodes], -1)
    slot_nodes, positions = drop_unused_nodes(slot_nodes, positions, fixed)
    segments = segments.relabelled(slot_nodes, len(positions))
    return slot_nodes, segments, place_nodes(segments, positions, fixed)


def _near_pairs(positions: NDArray[np.float64], reach: float, fixed: int) -> NDArray[np.int64]:
    """Pairs of nodes within reach, the lower number first, at least one of them not of the first ``fixed``."""
    if fixed == 0:
        return cKDTree(positions).query_pairs(reach, output_type="ndarray").astype(np.int64)
    free = cKDTree(positions[fixed:])
    pairs = [free.query_pairs(reach, output_type="ndarray") + fixed]
    low, high = (
        positions[fixed:].min(axis=0, initial=np.inf) - reach,
        positions[fixed:].max(axis=0, initial=-np.inf) + reach,
    )
    near = np.flatnonzero(((positions[:fixed] >= low) & (positions[:fixed] <= high)).all(axis=1))
    found = (
        cKDTree(positions[near]).sparse_distance_matrix(free, reach, output_type="ndarray")
        if len(near) and free.n
        else None
    )
    if found is not None:
        pairs.append(np.stack([near[found["i"]], found["j"] + fixed], axis=1))
    return np.concatenate(pairs).astype(np.int64)
