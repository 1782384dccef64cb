"""The lattice of a hidden Markov model on roads: a layer for each used sample, and the cheapest chain through them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.candidates import Layer, begin, candidates, cheapest, empty_layer, layer_from
from gpszip.matching.kernels.roads import Cells, Graph, Model, Roads, Work, apart, larger
from gpszip.matching.kernels.transitions import advance, longest_way, too_fast

__all__ = ["Lattice", "lattice", "thin"]


class Lattice(NamedTuple):
    """All layers of a track: layer i has the candidates ``begins[i]`` to ``begins[i + 1]`` of ``all``.

    ``moves[starts[i]:starts[i + 1]]`` are the prices of moves from each candidate of layer i - 1 to each of layer i, none after a break.
    """

    begins: NDArray[np.int64]
    all: Layer
    starts: NDArray[np.int64]
    moves: NDArray[np.float32]


@jit
def thin(positions: NDArray[np.float64], silent: NDArray[np.bool_], spacing: float) -> NDArray[np.int64]:
    """Samples that make a layer: the first, each that lies ``spacing`` from the last one used, and both ends of a silence."""
    n = len(positions)
    used, count = np.empty(n, np.int64), 0
    begin = 0  # layers before the last silence
    for i in range(n):
        first, last = i == 0 or silent[i - 1], i == n - 1 or silent[i]
        if first:
            begin = count
        far = first or apart(positions, i, used[count - 1]) >= spacing
        if last and not far:
            if count - begin > 1:  # the end itself stands for the layer just before it
                count -= 1
            far = True
        if far:
            used[count] = i
            count += 1
    return used[:count]


@jit
def lattice(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    headings: NDArray[np.float64],
    silent: NDArray[np.bool_],
    used: NDArray[np.int64],
    roads: Roads,
    cells: Cells,
    graph: Graph,
    model: Model,
    work: Work,
) -> Lattice:
    """Layers of all used samples of a track and the cheapest chain to each candidate."""
    layers, width = len(used), 2 * model.most + 1
    begins, starts = np.zeros(layers + 1, np.int64), np.zeros(layers + 1, np.int64)
    room = width + 8 * layers
    every = empty_layer(room)
    moves = np.empty((width, width))
    kept = np.empty(8 * room, np.float32)
    for layer in range(layers):
        low = begins[layer]
        if low + width > room:
            room = 2 * room
            every = _more(every, room)
        here = layer_from(every, low)
        n = candidates(positions[used[layer]], headings[used[layer]], roads, cells, graph, model, here)
        begins[layer + 1], filled = low + n, starts[layer]
        starts[layer + 1] = filled
        if layer == 0:
            begin(here, n, -1)
            continue
        last = begins[layer - 1]
        before = layer_from(every, last)
        straight, seconds = apart(positions, used[layer - 1], used[layer]), times[used[layer]] - times[used[layer - 1]]
        if _silence(silent, used[layer - 1], used[layer]) or too_fast(straight, seconds, model):
            begin(here, n, cheapest(every.scores[last:low]))
            continue
        longest = longest_way(straight, seconds, model)
        n0 = low - last
        advance(before, n0, here, n, positions[used[layer]], straight, longest, graph, model, work, moves)
        if filled + n0 * n > len(kept):
            kept = larger(kept, 2 * len(kept) + n0 * n)
        for i in range(n0):
            for j in range(n):
                kept[filled + i * n + j] = moves[i, j]
        starts[layer + 1] = filled + n0 * n
    return Lattice(begins, layer_from(every, 0), starts, kept)


@jit
def _more(layer: Layer, size: int) -> Layer:
    return Layer(
        larger(layer.roads, size),
        larger(layer.metres, size),
        larger(layer.distances, size),
        larger(layer.prices, size),
        larger(layer.scores, size),
        larger(layer.backs, size),
        larger(layer.kinds, size),
    )


@jit
def _silence(silent: NDArray[np.bool_], first: int, last: int) -> bool:
    return bool(silent[first:last].any())
