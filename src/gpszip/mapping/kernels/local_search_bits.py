"""What changed walks take when they are coded: all of them, or only the knots about the change."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import Coder, count_bits
from gpszip.codec.kernels.walk_model import WalkModel
from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.local_search_state import KNOTS, NODES, KnotList

__all__ = [
    "FIXED",
    "TRACKS",
    "WORK",
    "CoderWorkspace",
    "encode_all",
    "encode_prefix",
    "encode_window",
]

#: Numbers kept in ``Desk.counts``: nodes of the prefix, tracks begun in it, all tracks, known nodes, knots that may still be coded.
_VISITED, _BEGUN, TRACKS, FIXED, WORK = 0, 1, 2, 3, 4

#: Bits that a node first visited in a window takes off what comes after the window.
_PLACE_BITS = 10.0

#: Bytes that are copied in the time in which a knot is coded.
_BYTES_PER_KNOT = 40_000


class CoderWorkspace(NamedTuple):
    """The coder with its model, and room to write down the knots that it is to code."""

    coder: Coder
    empty_coder_words: NDArray[np.uint64]  # words of a coder that has written nothing
    model: WalkModel
    model_words: NDArray[np.int64]  # all arrays of the model in a row
    empty_model_words: NDArray[np.int64]  # the same before the first knot
    prefix_model_words: NDArray[np.int64]  # the same after the prefix
    nodes: NDArray[np.int64]
    time_steps: NDArray[np.int64]
    gaps: NDArray[np.int8]
    begins: NDArray[np.int8]
    visit_numbers: NDArray[np.int64]  # of each node by first visit, or -1
    saved_visit_numbers: NDArray[np.int64]  # the same before all walks are coded
    uses_after_window: NDArray[np.int64]  # uses of each node after the window
    numbered_nodes: NDArray[np.int64]  # nodes numbered in the window
    counts: NDArray[np.int64]
    has_gaps: bool


@jit
def _copy(numbers: NDArray[np.int64], to: NDArray[np.int64]) -> None:
    for i in range(len(numbers)):
        to[i] = numbers[i]


@jit
def _number_node(workspace: CoderWorkspace, knot_list: KnotList, node: int, visited: int) -> int:
    if workspace.visit_numbers[node] < 0:
        workspace.visit_numbers[node] = visited
        for axis in range(knot_list.places.shape[1]):
            workspace.model.places[visited, axis] = np.int64(knot_list.places[node, axis])
        return visited + 1
    return visited


@jit
def _count_bits(code: Any, workspace: CoderWorkspace, knots: int, tracks: int) -> float:
    for i in range(len(workspace.empty_coder_words)):
        workspace.coder.words[i] = workspace.empty_coder_words[i]
    workspace.coder.cursor[0] = 0
    code(
        workspace.coder,
        workspace.model,
        workspace.nodes[:knots],
        workspace.time_steps[:knots],
        workspace.gaps[:knots],
        workspace.begins[:knots],
        tracks,
        True,
        workspace.has_gaps,
    )
    workspace.counts[WORK] -= knots + 8 * len(workspace.model_words) // _BYTES_PER_KNOT
    return count_bits(workspace.coder) - 64.0


@jit
def _write_knot(
    workspace: CoderWorkspace, at: int, number: int, cell: int, joined: int, begins: int
) -> None:
    workspace.nodes[at], workspace.time_steps[at], workspace.begins[at] = number, cell, begins
    workspace.gaps[at] = 1 if joined == 0 and begins == 0 else 0


@jit
def _reset_numbers(workspace: CoderWorkspace) -> None:
    for v in range(workspace.counts[FIXED], len(workspace.visit_numbers)):
        workspace.visit_numbers[v] = -1


@jit
def encode_prefix(
    code: Any, workspace: CoderWorkspace, knot_list: KnotList, cells: NDArray[np.int64], knots: int
) -> None:
    """Code the first ``knots`` knots and keep what the model is then."""
    _copy(workspace.empty_model_words, workspace.model_words)
    _reset_numbers(workspace)
    visited, begun = workspace.counts[FIXED], np.int64(0)
    for i in range(knots):
        visited = _number_node(workspace, knot_list, knot_list.node[i], visited)
        begun += knot_list.begins[i]
        _write_knot(
            workspace,
            i,
            workspace.visit_numbers[knot_list.node[i]],
            cells[knot_list.slot[i]],
            knot_list.joined[i],
            knot_list.begins[i],
        )
    if knots > 0:
        _count_bits(code, workspace, knots, workspace.counts[TRACKS])
    _copy(workspace.model_words, workspace.prefix_model_words)
    workspace.counts[_VISITED], workspace.counts[_BEGUN] = visited, begun


@jit
def encode_all(
    code: Any, workspace: CoderWorkspace, knot_list: KnotList, cells: NDArray[np.int64]
) -> float:
    """Bits of all walks; what is known of a prefix is kept."""
    _copy(workspace.empty_model_words, workspace.model_words)
    fixed = workspace.counts[FIXED]
    visited = fixed
    for v in range(fixed, knot_list.counts[NODES]):
        workspace.saved_visit_numbers[v] = workspace.visit_numbers[v]
        workspace.visit_numbers[v] = -1
    knots = knot_list.counts[KNOTS]
    for i in range(knots):
        visited = _number_node(workspace, knot_list, knot_list.node[i], visited)
        _write_knot(
            workspace,
            i,
            workspace.visit_numbers[knot_list.node[i]],
            cells[knot_list.slot[i]],
            knot_list.joined[i],
            knot_list.begins[i],
        )
    bits = _count_bits(code, workspace, knots, workspace.counts[TRACKS])
    for v in range(fixed, knot_list.counts[NODES]):
        workspace.visit_numbers[v] = workspace.saved_visit_numbers[v]
    return bits


@jit
def encode_window(
    code: Any,
    workspace: CoderWorkspace,
    knot_list: KnotList,
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
    _copy(workspace.prefix_model_words, workspace.model_words)
    visited, spared = workspace.counts[_VISITED], 0
    at, given, new = np.int64(0), np.int64(0), np.int64(0)
    i = start
    while i < end or (i == end and i == first and new < count):
        if i == first and new < count:
            node, cell = nodes[new], cells[slots[new]]
            replaces = first + new < after
            joined = knot_list.joined[first + new] if replaces else np.int8(1)
            begins = knot_list.begins[first + new] if replaces else np.int8(0)
            new += 1
        else:
            if i == first:
                i = max(after, first)
                if i >= end:
                    break
            node, cell, joined, begins = (
                knot_list.node[i],
                cells[knot_list.slot[i]],
                knot_list.joined[i],
                knot_list.begins[i],
            )
            i += 1
        before = visited
        visited = _number_node(workspace, knot_list, node, visited)
        if visited > before:
            workspace.numbered_nodes[given] = node
            given += 1
            spared += 1 if workspace.uses_after_window[node] > 0 else 0
        _write_knot(workspace, at, workspace.visit_numbers[node], cell, joined, begins)
        at += 1
    tracks = workspace.counts[TRACKS] - workspace.counts[_BEGUN] + (1 if start > 0 else 0)
    bits = _count_bits(code, workspace, at, tracks)
    for g in range(given):
        workspace.visit_numbers[workspace.numbered_nodes[g]] = -1
    return bits - _PLACE_BITS * spared
