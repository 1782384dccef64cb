"""The M-step of the connected map: where nodes lie, on whole places at last, and which of them become one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gpszip.mapping.assignment import compact
from gpszip.mapping.initial_map import Parts, free_equations, normal_equations, place_nodes, round_nodes
from gpszip.mapping.kernels.initial_map import keep_disjoint
from gpszip.mapping.plan import Plan

__all__ = ["place", "rounded_places", "unite"]


def place(parts: Parts, places: NDArray[np.float64], fixed: int = 0) -> NDArray[np.float64]:
    """Place all nodes but the first ``fixed`` at least squared error (M-step)."""
    equations = normal_equations(parts, places)
    return np.concatenate([places[:fixed], place_nodes(*free_equations(*equations, places, fixed))])


def rounded_places(parts: Parts, places: NDArray[np.float64], fixed: int) -> NDArray[np.float64]:
    """Whole places of all nodes; the first ``fixed`` are so already."""
    equations = normal_equations(parts, places)
    return np.concatenate([places[:fixed], round_nodes(*free_equations(*equations, places, fixed), places[fixed:])])


def unite(
    at: NDArray[np.int64], parts: Parts, places: NDArray[np.float64], plan: Plan, bits: NDArray[np.float64], fixed: int
) -> tuple[NDArray[np.int64], Parts, NDArray[np.float64]]:
    """Unite nodes whose error apart costs fewer bits than the second node, which is never one of the first ``fixed``."""
    pairs = _near_pairs(places, 4 * plan.target, fixed)
    if len(pairs) == 0:
        return at, parts, places
    own = parts.stiffness.diagonal()
    square = ((places[pairs[:, 0]] - places[pairs[:, 1]]) ** 2).sum(axis=1)
    # a node that stays where it is pulls as if it were infinitely stiff
    pull = np.where(pairs[:, 0] < fixed, 1.0, own[pairs[:, 0]] / (own[pairs[:, 0]] + own[pairs[:, 1]]))
    harm = bits[0] * square * own[pairs[:, 1]] * pull
    count = len(places)
    ones = np.ones(len(parts.starts))
    one_way = csr_array((ones, (parts.starts, parts.ends)), shape=(count, count))
    linked = ((one_way + one_way.T) > 0).astype(np.float64)
    shared = (linked @ linked).tocsr()[pairs[:, 0], pairs[:, 1]]
    gain = 0.7 * (bits[3] + bits[4]) + 0.7 * bits[5] * np.asarray(shared).ravel() - harm
    good = np.flatnonzero(gain > 0)
    if len(good) == 0:
        return at, parts, places
    order = good[np.argsort(-gain[good], kind="stable")]
    target = np.arange(count)
    keep_disjoint(pairs[order], target)
    at = np.where(at >= 0, target[at], -1)
    at, places = compact(at, places, fixed)
    parts = parts.renamed(at, len(places))
    return at, parts, place(parts, places, fixed)


def _near_pairs(places: NDArray[np.float64], reach: float, fixed: int) -> NDArray[np.int64]:
    """Pairs of nodes within reach, the lower number first, at least one of them not of the first ``fixed``."""
    if fixed == 0:
        return cKDTree(places).query_pairs(reach, output_type="ndarray").astype(np.int64)
    free = cKDTree(places[fixed:])
    pairs = [free.query_pairs(reach, output_type="ndarray") + fixed]
    low, high = places[fixed:].min(axis=0, initial=np.inf) - reach, places[fixed:].max(axis=0, initial=-np.inf) + reach
    near = np.flatnonzero(((places[:fixed] >= low) & (places[:fixed] <= high)).all(axis=1))
    found = cKDTree(places[near]).sparse_distance_matrix(free, reach, output_type="ndarray") if len(near) and free.n else None
    if found is not None:
        pairs.append(np.stack([near[found["i"]], found["j"] + fixed], axis=1))
    return np.concatenate(pairs).astype(np.int64)
