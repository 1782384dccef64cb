"""The lattice of a hidden Markov model on roads: a layer for each used sample, and the cheapest chain through them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.candidates import (
    Candidates,
    candidates_from,
    empty_candidates,
    find_candidates,
    first_minimum,
    start_paths,
)
from gpszip.matching.kernels.roads import (
    Graph,
    ModelParameters,
    RoadGrid,
    Roads,
    Workspace,
    distance_between,
    resized,
)
from gpszip.matching.kernels.transitions import advance_paths, is_too_fast, max_path_length

__all__ = ["Trellis", "build_trellis", "select_samples"]


class Trellis(NamedTuple):
    """All layers of a track: layer i has the candidates ``begins[i]`` to ``begins[i + 1]`` of ``all``.

    ``moves[starts[i]:starts[i + 1]]`` are the prices of moves from each candidate of layer i - 1 to each of layer i, none after a break.
    """

    candidate_starts: NDArray[np.int64]
    candidates: Candidates
    cost_starts: NDArray[np.int64]
    transition_costs: NDArray[np.float32]


@jit
def select_samples(
    positions: NDArray[np.float64], is_gap: NDArray[np.bool_], spacing: float
) -> NDArray[np.int64]:
    """Samples that make a layer: the first, each that lies ``spacing`` from the last one used, and both ends of a silence."""
    n = len(positions)
    used, count = np.empty(n, np.int64), 0
    begin = 0  # layers before the last silence
    for i in range(n):
        first, last = i == 0 or is_gap[i - 1], i == n - 1 or is_gap[i]
        if first:
            begin = count
        far = first or distance_between(positions, i, used[count - 1]) >= spacing
        if last and not far:
            if count - begin > 1:  # the end itself stands for the layer just before it
                count -= 1
            far = True
        if far:
            used[count] = i
            count += 1
    return used[:count]


@jit
def build_trellis(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    headings: NDArray[np.float64],
    is_gap: NDArray[np.bool_],
    used: NDArray[np.int64],
    roads: Roads,
    cells: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> Trellis:
    """Layers of all used samples of a track and the cheapest chain to each candidate."""
    layers, width = len(used), 2 * model.max_candidates + 1
    begins, starts = np.zeros(layers + 1, np.int64), np.zeros(layers + 1, np.int64)
    room = width + 8 * layers
    every = empty_candidates(room)
    moves = np.empty((width, width))
    kept = np.empty(8 * room, np.float32)
    for layer in range(layers):
        low = begins[layer]
        if low + width > room:
            room = 2 * room
            every = _more(every, room)
        here = candidates_from(every, low)
        n = find_candidates(
            positions[used[layer]], headings[used[layer]], roads, cells, graph, model, here
        )
        begins[layer + 1], filled = low + n, starts[layer]
        starts[layer + 1] = filled
        if layer == 0:
            start_paths(here, n, -1)
            continue
        last = begins[layer - 1]
        before = candidates_from(every, last)
        straight, seconds = (
            distance_between(positions, used[layer - 1], used[layer]),
            times[used[layer]] - times[used[layer - 1]],
        )
        if _silence(is_gap, used[layer - 1], used[layer]) or is_too_fast(straight, seconds, model):
            start_paths(here, n, first_minimum(every.path_costs[last:low]))
            continue
        longest = max_path_length(straight, seconds, model)
        n0 = low - last
        advance_paths(
            before,
            n0,
            here,
            n,
            positions[used[layer]],
            straight,
            longest,
            graph,
            model,
            work,
            moves,
        )
        if filled + n0 * n > len(kept):
            kept = resized(kept, 2 * len(kept) + n0 * n)
        for i in range(n0):
            for j in range(n):
                kept[filled + i * n + j] = moves[i, j]
        starts[layer + 1] = filled + n0 * n
    return Trellis(begins, candidates_from(every, 0), starts, kept)


@jit
def _more(layer: Candidates, size: int) -> Candidates:
    return Candidates(
        resized(layer.roads, size),
        resized(layer.metres, size),
        resized(layer.distances, size),
        resized(layer.emission_costs, size),
        resized(layer.path_costs, size),
        resized(layer.predecessors, size),
        resized(layer.transitions, size),
    )


@jit
def _silence(is_gap: NDArray[np.bool_], first: int, last: int) -> bool:
    return bool(is_gap[first:last].any())
