"""Bits of changed walks by the real coder: of all walks, or of the knots around a change only."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import Coder, count_bits
from gpszip.codec.kernels.walk_model import WalkModel
from gpszip.kernels.jit import inner_uncounted, jit_uncounted
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

#: Index in ``CoderWorkspace.counts`` of the number of nodes visited in the prefix.
_VISITED = 0
#: Index of the number of tracks that begin in the prefix.
_BEGUN = 1
#: Index of the number of all tracks.
TRACKS = 2
#: Index of the number of nodes of prior walks.
FIXED = 3
#: Index of the number of knots that may still be encoded.
WORK = 4

#: Bits of the position of a node: a first visit in a window saves them after the window.
_POSITION_BITS = 10.0

#: Bytes that are copied in the time that it takes to encode a knot.
_BYTES_PER_KNOT = 40_000

#: Bits that are subtracted from each count; no comparison of walks depends on this constant.
_OFFSET_BITS = 64.0


class CoderWorkspace(NamedTuple):
    """The coder with its model, and the knots that it is to encode."""

    coder: Coder
    empty_coder_words: NDArray[np.uint64]  # words of a coder that has written nothing
    model: WalkModel  # views of ``model_words``
    model_words: NDArray[np.int64]  # all arrays of the model, one after the other
    empty_model_words: NDArray[np.int64]  # the same before the first knot
    prefix_model_words: NDArray[np.int64]  # the same after the prefix
    nodes: NDArray[np.int64]  # of the knots to encode, by their visit numbers
    time_steps: NDArray[np.int64]  # of the knots to encode
    gaps: NDArray[np.int8]  # 1 where a gap ends at the knot
    begins: NDArray[np.int8]  # 1 where a track begins at the knot
    visit_numbers: NDArray[np.int64]  # of each node by first visit, or -1
    saved_visit_numbers: NDArray[np.int64]  # the same before all walks are encoded
    uses_after_window: NDArray[np.int64]  # uses of each node after the window
    numbered_nodes: NDArray[np.int64]  # nodes that are numbered in the window
    counts: NDArray[np.int64]  # by the indices above
    has_gaps: bool


@inner_uncounted
def _copy(source: NDArray[np.int64], target: NDArray[np.int64]) -> None:
    for i in range(len(source)):
        target[i] = source[i]


@inner_uncounted
def _number_node(workspace: CoderWorkspace, knot_list: KnotList, node: int, visited: int) -> int:
    """Number a node at its first visit; return the number of nodes visited."""
    if workspace.visit_numbers[node] < 0:
        workspace.visit_numbers[node] = visited
        for axis in range(knot_list.positions.shape[1]):
            workspace.model.places[visited, axis] = np.int64(knot_list.positions[node, axis])
        return visited + 1
    return visited


@inner_uncounted
def _count_bits(code: Any, workspace: CoderWorkspace, knots: int, tracks: int) -> float:
    """Bits of the first ``knots`` knots of the workspace, by the model as it is."""
    # Reset the coder: its words, and the cursor of the bytes written.
    for i in range(len(workspace.empty_coder_words)):
        workspace.coder.words[i] = workspace.empty_coder_words[i]
    workspace.coder.cursor[0] = 0

    # Encode the knots; the model adapts as it does so.
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

    # Copies of the model count as work, too.
    workspace.counts[WORK] -= knots + 8 * len(workspace.model_words) // _BYTES_PER_KNOT
    return count_bits(workspace.coder) - _OFFSET_BITS


@inner_uncounted
def _write_knot(
    workspace: CoderWorkspace, i: int, number: int, time_step: int, joined: int, begins: int
) -> None:
    """Write knot i of the workspace."""
    workspace.nodes[i], workspace.time_steps[i], workspace.begins[i] = number, time_step, begins
    workspace.gaps[i] = 1 if joined == 0 and begins == 0 else 0


@inner_uncounted
def _reset_numbers(workspace: CoderWorkspace) -> None:
    """Forget all visits but those of the prior nodes."""
    for v in range(workspace.counts[FIXED], len(workspace.visit_numbers)):
        workspace.visit_numbers[v] = -1


@inner_uncounted
def encode_prefix(
    code: Any,
    workspace: CoderWorkspace,
    knot_list: KnotList,
    time_steps: NDArray[np.int64],
    knots: int,
) -> None:
    """Encode the first ``knots`` knots, and keep the model as it is after them."""
    # Start from the model of the prior walks, with only their nodes visited.
    _copy(workspace.empty_model_words, workspace.model_words)
    _reset_numbers(workspace)

    # Write the knots, with nodes numbered by their first visits.
    visited, begun = workspace.counts[FIXED], np.int64(0)
    for i in range(knots):
        visited = _number_node(workspace, knot_list, knot_list.nodes[i], visited)
        begun += knot_list.begins[i]
        _write_knot(
            workspace,
            i,
            workspace.visit_numbers[knot_list.nodes[i]],
            time_steps[knot_list.slots[i]],
            knot_list.joined[i],
            knot_list.begins[i],
        )

    # Encode them, and keep the model.
    if knots > 0:
        _count_bits(code, workspace, knots, workspace.counts[TRACKS])
    _copy(workspace.model_words, workspace.prefix_model_words)
    workspace.counts[_VISITED], workspace.counts[_BEGUN] = visited, begun


@jit_uncounted
def encode_all(
    code: Any, workspace: CoderWorkspace, knot_list: KnotList, time_steps: NDArray[np.int64]
) -> float:
    """Bits of all walks; the model and the visits of the prefix stay."""
    # Number all nodes anew, and keep the numbers of the prefix.
    _copy(workspace.empty_model_words, workspace.model_words)
    fixed = workspace.counts[FIXED]
    visited = fixed
    for v in range(fixed, knot_list.counts[NODES]):
        workspace.saved_visit_numbers[v] = workspace.visit_numbers[v]
        workspace.visit_numbers[v] = -1

    # Write and encode all knots.
    knots = knot_list.counts[KNOTS]
    for i in range(knots):
        visited = _number_node(workspace, knot_list, knot_list.nodes[i], visited)
        _write_knot(
            workspace,
            i,
            workspace.visit_numbers[knot_list.nodes[i]],
            time_steps[knot_list.slots[i]],
            knot_list.joined[i],
            knot_list.begins[i],
        )
    bits = _count_bits(code, workspace, knots, workspace.counts[TRACKS])

    # Put the visits of the prefix back.
    for v in range(fixed, knot_list.counts[NODES]):
        workspace.visit_numbers[v] = workspace.saved_visit_numbers[v]
    return bits


@jit_uncounted
def encode_window(
    code: Any,
    workspace: CoderWorkspace,
    knot_list: KnotList,
    time_steps: NDArray[np.int64],
    start: int,
    end: int,
    first: int,
    after: int,
    count: int,
    slots: NDArray[np.int64],
    nodes: NDArray[np.int64],
) -> float:
    """Bits of a window of knots with a change, after the prefix.

    Parameters
    ----------
    start, end : int
        First knot of the window, and the one after its last. The prefix ends with knot ``start``,
        or is empty if that is 0.
    first, after : int
        The knots from ``first`` to before ``after`` are replaced.
    count : int
        Number of new knots.
    slots, nodes : int64 arrays, shape (at least count,)
        Slots and nodes of the new knots.
    """
    # Start from the model as it is after the prefix.
    _copy(workspace.prefix_model_words, workspace.model_words)
    visited, reused = workspace.counts[_VISITED], 0
    written, numbered, new = np.int64(0), np.int64(0), np.int64(0)
    i = start
    while i < end or (i == end and i == first and new < count):
        # Take the next new knot, or the next old one that stays. A new knot joins the walk as the
        # old one that it replaces, or within a piece.
        if i == first and new < count:
            node, time_step = nodes[new], time_steps[slots[new]]
            is_replacement = first + new < after
            joined = knot_list.joined[first + new] if is_replacement else np.int8(1)
            begins = knot_list.begins[first + new] if is_replacement else np.int8(0)
            new += 1
        else:
            if i == first:
                i = max(after, first)
                if i >= end:
                    break
            node, time_step, joined, begins = (
                knot_list.nodes[i],
                time_steps[knot_list.slots[i]],
                knot_list.joined[i],
                knot_list.begins[i],
            )
            i += 1

        # A node that is first visited here saves its position after the window.
        before = visited
        visited = _number_node(workspace, knot_list, node, visited)
        if visited > before:
            workspace.numbered_nodes[numbered] = node
            numbered += 1
            reused += 1 if workspace.uses_after_window[node] > 0 else 0
        _write_knot(workspace, written, workspace.visit_numbers[node], time_step, joined, begins)
        written += 1

    # Encode the window, with as many tracks as are left, and the one that the prefix ends in.
    tracks = workspace.counts[TRACKS] - workspace.counts[_BEGUN] + (1 if start > 0 else 0)
    bits = _count_bits(code, workspace, written, tracks)

    # Forget the visits of the window.
    for g in range(numbered):
        workspace.visit_numbers[workspace.numbered_nodes[g]] = -1
    return bits - _POSITION_BITS * reused
