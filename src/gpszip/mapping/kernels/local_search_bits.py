"""What changed walks take when they are coded: all of them, or only the knots about the change."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import Coder, used_bits
from gpszip.codec.kernels.walk_model import WalkModel
from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.local_search_state import KNOTS, NODES, Chain

__all__ = ["FIXED", "TRACKS", "WORK", "Desk", "code_all", "code_prefix", "code_window"]

#: Numbers kept in ``Desk.counts``: nodes of the prefix, tracks begun in it, all tracks, known nodes, knots that may still be coded.
_VISITED, _BEGUN, TRACKS, FIXED, WORK = 0, 1, 2, 3, 4

#: Bits that a node first visited in a window takes off what comes after the window.
_PLACE_BITS = 10.0

#: Bytes that are copied in the time in which a knot is coded.
_BYTES_PER_KNOT = 40_000


class Desk(NamedTuple):
    """The coder with its model, and room to write down the knots that it is to code."""

    coder: Coder
    blank: NDArray[np.uint64]  # words of a coder that has written nothing
    model: WalkModel
    whole: NDArray[np.int64]  # all arrays of the model in a row
    fresh: NDArray[np.int64]  # the same before the first knot
    prefix: NDArray[np.int64]  # the same after the prefix
    nodes: NDArray[np.int64]
    cells: NDArray[np.int64]
    gaps: NDArray[np.int8]
    begins: NDArray[np.int8]
    number: NDArray[np.int64]  # of each node by first visit, or -1
    kept: NDArray[np.int64]  # the same before all walks are coded
    later: NDArray[np.int64]  # uses of each node after the window
    given: NDArray[np.int64]  # nodes numbered in the window
    counts: NDArray[np.int64]
    gapped: bool


@jit
def _copy(numbers: NDArray[np.int64], to: NDArray[np.int64]) -> None:
    for i in range(len(numbers)):
        to[i] = numbers[i]


@jit
def _number(desk: Desk, chain: Chain, node: int, visited: int) -> int:
    if desk.number[node] < 0:
        desk.number[node] = visited
        for axis in range(chain.places.shape[1]):
            desk.model.places[visited, axis] = np.int64(chain.places[node, axis])
        return visited + 1
    return visited


@jit
def _run(code: Any, desk: Desk, knots: int, tracks: int) -> float:
    for i in range(len(desk.blank)):
        desk.coder.words[i] = desk.blank[i]
    desk.coder.cursor[0] = 0
    code(desk.coder, desk.model, desk.nodes[:knots], desk.cells[:knots], desk.gaps[:knots], desk.begins[:knots], tracks, True, desk.gapped)
    desk.counts[WORK] -= knots + 8 * len(desk.whole) // _BYTES_PER_KNOT
    return used_bits(desk.coder) - 64.0


@jit
def _put(desk: Desk, at: int, number: int, cell: int, joined: int, begins: int) -> None:
    desk.nodes[at], desk.cells[at], desk.begins[at] = number, cell, begins
    desk.gaps[at] = 1 if joined == 0 and begins == 0 else 0


@jit
def _forget_numbers(desk: Desk) -> None:
    for v in range(desk.counts[FIXED], len(desk.number)):
        desk.number[v] = -1


@jit
def code_prefix(code: Any, desk: Desk, chain: Chain, cells: NDArray[np.int64], knots: int) -> None:
    """Code the first ``knots`` knots and keep what the model is then."""
    _copy(desk.fresh, desk.whole)
    _forget_numbers(desk)
    visited, begun = desk.counts[FIXED], np.int64(0)
    for i in range(knots):
        visited = _number(desk, chain, chain.node[i], visited)
        begun += chain.begins[i]
        _put(desk, i, desk.number[chain.node[i]], cells[chain.slot[i]], chain.joined[i], chain.begins[i])
    if knots > 0:
        _run(code, desk, knots, desk.counts[TRACKS])
    _copy(desk.whole, desk.prefix)
    desk.counts[_VISITED], desk.counts[_BEGUN] = visited, begun


@jit
def code_all(code: Any, desk: Desk, chain: Chain, cells: NDArray[np.int64]) -> float:
    """Bits of all walks; what is known of a prefix is kept."""
    _copy(desk.fresh, desk.whole)
    fixed = desk.counts[FIXED]
    visited = fixed
    for v in range(fixed, chain.counts[NODES]):
        desk.kept[v] = desk.number[v]
        desk.number[v] = -1
    knots = chain.counts[KNOTS]
    for i in range(knots):
        visited = _number(desk, chain, chain.node[i], visited)
        _put(desk, i, desk.number[chain.node[i]], cells[chain.slot[i]], chain.joined[i], chain.begins[i])
    bits = _run(code, desk, knots, desk.counts[TRACKS])
    for v in range(fixed, chain.counts[NODES]):
        desk.number[v] = desk.kept[v]
    return bits


@jit
def code_window(
    code: Any,
    desk: Desk,
    chain: Chain,
    cells: NDArray[np.int64],
    start: int,
    end: int,
    first: int,
    after: int,
    count: int,
    slots: NDArray[np.int64],
    nodes: NDArray[np.int64],
) -> float:
    """Bits of the knots from ``start`` to before ``end``, those from ``first`` to before ``after`` replaced by ``count`` others.

    The prefix ends with the knot ``start``, or is empty if that is 0.
    """
    _copy(desk.prefix, desk.whole)
    visited, spared = desk.counts[_VISITED], 0
    at, given, new = np.int64(0), np.int64(0), np.int64(0)
    i = start
    while i < end or (i == end and i == first and new < count):
        if i == first and new < count:
            node, cell = nodes[new], cells[slots[new]]
            replaces = first + new < after
            joined = chain.joined[first + new] if replaces else np.int8(1)
            begins = chain.begins[first + new] if replaces else np.int8(0)
            new += 1
        else:
            if i == first:
                i = max(after, first)
                if i >= end:
                    break
            node, cell, joined, begins = chain.node[i], cells[chain.slot[i]], chain.joined[i], chain.begins[i]
            i += 1
        before = visited
        visited = _number(desk, chain, node, visited)
        if visited > before:
            desk.given[given] = node
            given += 1
            spared += 1 if desk.later[node] > 0 else 0
        _put(desk, at, desk.number[node], cell, joined, begins)
        at += 1
    tracks = desk.counts[TRACKS] - desk.counts[_BEGUN] + (1 if start > 0 else 0)
    bits = _run(code, desk, at, tracks)
    for g in range(given):
        desk.number[desk.given[g]] = -1
    return bits - _PLACE_BITS * spared
