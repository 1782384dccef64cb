"""Coding of walks: one loop that encodes or decodes, knot by knot.

A segment leads to each knot but a track's first. Its kind comes first: back, along another known
edge, along a new edge to a known node, to a new node, a stop, or a gap. Then comes its duration,
then the position of a new node. Every probability follows from what was coded before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.distributions import (
    FIRST_POSITION,
    START_GAP,
    TRACK_ORDER,
    TRACK_START,
    ZERO,
    code_large_signed,
    code_large_unsigned,
)
from gpszip.codec.kernels.duration_coder import (
    code_duration_first,
    code_move_duration,
    code_pause_duration,
)
from gpszip.codec.kernels.new_edge_coder import code_known_node
from gpszip.codec.kernels.position_coder import ON_GRID_AXES, ON_HEADING, code_position
from gpszip.codec.kernels.range_coder import (
    Coder,
    code_interval,
    count_bits,
    decode_cumulative,
    is_decoding,
    is_exhausted,
)
from gpszip.codec.kernels.step_coder import (
    KIND_BACK,
    KIND_KNOWN,
    KIND_NEW_EDGE,
    KIND_NEW_NODE,
    KIND_STAY,
    code_known_edge,
    code_step_kind,
    step_kind,
)
from gpszip.codec.kernels.target_coder import code_target, has_target, take_next_node
from gpszip.codec.kernels.walk_model import (
    DURATION_BITS,
    GAP_BITS,
    LAST_TRACK_END,
    LAST_TRACK_START,
    MODES,
    NEXT_START,
    NODE_COUNT,
    POSITION_BITS,
    ROW_GAP,
    ROW_STAY,
    SHORTEST_PATHS,
    START_BITS,
    START_IS_TAKEN,
    START_TIME_STEP,
    STEP_KIND_BITS,
    TIME_FIRST,
    WalkModel,
    add_end_weight,
    add_node,
    end_weight_below,
    find_by_end_weight,
    find_half_edge,
    forget_heading,
    learn_step,
    record_bits,
)
from gpszip.codec.kernels.walk_priors import (
    AMONG_NEW_EDGES,
    BEYOND_GAPS,
    BIT_END,
    BIT_GAP,
    BIT_GAP_TO_KNOWN,
    BIT_GAP_TO_SELF,
    BIT_KNOWN_START,
    MIX_GAP,
    MIX_STAY,
)
from gpszip.kernels.jit import inner, inner_uncounted, jit

__all__ = ["code_walks"]

#: Coordinates (in space steps) and times (in time steps) of an archive are below these in size.
_MAX_COORDINATE = np.int64(1) << 45
_MAX_TIME_STEP = np.int64(1) << 60

#: Weight that a node gains each time a track starts or ends there.
_END_WEIGHT = np.int64(24)

#: Stands for no node or no half-edge.
_NONE = np.int64(-1)

#: Context of a target where another one was just reached; otherwise, the kind of the last step.
_AT_TARGET = np.int64(5)


class _WalkState(NamedTuple):
    """Where a walk is, and how it came there."""

    node: int  # node of the latest knot
    before: int  # node from which the last step came, or -1
    incoming: int  # half-edge of that step, or -1
    last_kind: int  # kind of that step; that of a new node at a track's start and after a gap
    target_context: int  # the same, or _AT_TARGET


@inner_uncounted
def _arrive_without_heading(model: WalkModel, node: int) -> _WalkState:
    """State where a track begins or goes on after a gap."""
    forget_heading(model)
    return _WalkState(node, _NONE, _NONE, KIND_NEW_NODE, KIND_NEW_NODE)


@inner_uncounted
def _code_sorted_starts(coder: Coder, model: WalkModel, time_step: int) -> bool:
    """Code the first time steps of all tracks in order, as differences, after ``time_step``.

    Returns False if what is read is out of bounds.
    """
    starts = model.track_starts
    for i in range(len(starts)):
        gap = starts[i, START_TIME_STEP] - time_step
        time_step += (
            code_large_signed(coder, model, TRACK_START, gap)
            if i == 0
            else code_large_unsigned(coder, model, START_GAP, gap)
        )
        starts[i, START_TIME_STEP], starts[i, START_IS_TAKEN] = time_step, 0
        if abs(time_step) >= _MAX_TIME_STEP:
            return False
    return True


@inner_uncounted
def _take_sorted_start(coder: Coder, model: WalkModel, first: int) -> int:
    """Code which of the sorted starts is a track's first time step, by how many are passed over."""
    starts = model.track_starts
    count = len(starts)

    # Count the starts that are not taken, up to the next one at this time step.
    i, skipped = model.scalars[NEXT_START], np.int64(0)
    if not is_decoding(coder):
        while starts[i, START_IS_TAKEN] == 1 or starts[i, START_TIME_STEP] != first:
            skipped += 1 - starts[i, START_IS_TAKEN]
            i = (i + 1) % count
    skipped = code_large_unsigned(coder, model, TRACK_ORDER, skipped) % count

    # Pass over as many, and take the next one.
    i = model.scalars[NEXT_START]
    while starts[i, START_IS_TAKEN] == 1 or skipped > 0:
        skipped -= 1 - starts[i, START_IS_TAKEN]
        i = (i + 1) % count
    starts[i, START_IS_TAKEN] = 1
    model.scalars[NEXT_START] = (i + 1) % count
    return starts[i, START_TIME_STEP]


@inner_uncounted
def _code_first_time_step(coder: Coder, model: WalkModel, last_start: int, first: int) -> int:
    """Code the first time step of a track after a track that began at ``last_start``."""
    if len(model.track_starts) > 0:
        return _take_sorted_start(coder, model, first)
    return last_start + code_large_signed(coder, model, TRACK_START, first - last_start)


@inner_uncounted
def _code_first_node(coder: Coder, model: WalkModel, last_end: int, node: int) -> int:
    """Code the first node of a track after one that ended at ``last_end`` (-1: none)."""
    # Whether it is known.
    nodes = model.scalars[NODE_COUNT]
    is_known = 0
    if nodes > 0:
        is_known = code_bit(coder, model.bit_counts, BIT_KNOWN_START, 1 if node < nodes else 0)

    # a known node is likelier where tracks began or ended
    if is_known:
        total = end_weight_below(model, nodes)
        if is_decoding(coder):
            node = find_by_end_weight(model, decode_cumulative(coder, total))
        start = end_weight_below(model, node)
        code_interval(coder, start, end_weight_below(model, node + 1) - start, total)
        return node

    # a new node jumps from the end of the track before; the very first has its coordinates
    node = nodes
    if last_end < 0:
        for axis in range(model.places.shape[1]):
            model.places[node, axis] = code_large_signed(
                coder, model, FIRST_POSITION, model.places[node, axis]
            )
    else:
        code_position(coder, model, last_end, node, ON_GRID_AXES, ZERO)
    return add_node(model)


@inner_uncounted
def _code_start(coder: Coder, model: WalkModel, last_end: int, node: int) -> int:
    """Code the first node of a track after one that ended at ``last_end``, and learn it."""
    bits = count_bits(coder)
    node = _code_first_node(coder, model, last_end, node)
    record_bits(model, START_BITS, count_bits(coder) - bits)
    add_end_weight(model, node, _END_WEIGHT)
    return node


@inner_uncounted
def _code_gap(
    coder: Coder, model: WalkModel, u: int, node: int, duration: int, timed: bool
) -> tuple[int, int]:
    """Code a gap that begins at u; return the node at which it ends, and its duration."""
    if timed:
        duration = code_pause_duration(coder, model, MIX_GAP, ROW_GAP, duration)

    # It ends where it began, at another known node, or at a new one.
    if code_bit(coder, model.bit_counts, BIT_GAP_TO_SELF, 1 if node == u else 0):
        return u, duration
    nodes = model.scalars[NODE_COUNT]
    if code_bit(coder, model.bit_counts, BIT_GAP_TO_KNOWN, 1 if node < nodes else 0):
        return code_known_node(coder, model, u, _NONE, node, BEYOND_GAPS), duration
    node = nodes
    code_position(coder, model, u, node, ON_GRID_AXES, ZERO)
    return add_node(model), duration


@inner_uncounted
def _gap_context(gap_ends: int, last_kind: int) -> int:
    """Context of whether a gap follows: gaps that began or ended here, and a stop just before."""
    level = 2 if gap_ends > 2 else 1 if gap_ends > 0 else 0
    return BIT_GAP + 2 * level + (1 if last_kind == KIND_STAY else 0)


@inner
def _find_steps(gaps: NDArray[np.int8], begins: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Whether a step leads to each knot, and not a gap."""
    is_step = np.zeros(len(gaps), np.bool_)
    for j in range(1, len(gaps)):
        is_step[j] = begins[j] == 0 and gaps[j] == 0
    return is_step


@inner_uncounted
def _code_step(
    coder: Coder, model: WalkModel, state: _WalkState, node: int
) -> tuple[int, int, int]:
    """Code the kind of the next step and the edge that it takes.

    Returns the kind, the half-edge or -1, and the node to which the step leads; a new node has no
    position yet.
    """
    # The two half-edges of an edge differ in the lowest bit.
    u, incoming = state.node, state.incoming
    back = incoming ^ 1 if incoming >= 0 else _NONE

    # On the path to a target, the step is implied.
    if has_target(model):
        node = take_next_node(model)
        half_edge = find_half_edge(model, u, node)
        return KIND_BACK if half_edge == back else KIND_KNOWN, half_edge, node

    # Code the kind of the step, and which edge or node it leads to where the kind leaves that open.
    kind = step_kind(model, u, back, node)
    kind = code_step_kind(coder, model, u, incoming, back, kind, state.last_kind)
    half_edge = _NONE
    if kind == KIND_STAY:
        node = u
    elif kind == KIND_BACK:
        half_edge = back
    elif kind == KIND_KNOWN:
        half_edge = code_known_edge(coder, model, u, state.before, incoming, back, node)
    elif kind == KIND_NEW_EDGE:
        node = code_known_node(coder, model, u, state.before, node, AMONG_NEW_EDGES)
    elif kind == KIND_NEW_NODE:
        node = model.scalars[NODE_COUNT]
    if half_edge >= 0:
        node = model.end_node[half_edge]
    return kind, half_edge, node


@inner_uncounted
def _code_measures(
    coder: Coder,
    model: WalkModel,
    kind: int,
    half_edge: int,
    u: int,
    node: int,
    duration: int,
    timed: bool,
) -> int:
    """Code the duration of a step from u to ``node``, and the position of a new node.

    Returns the duration.
    """
    # The duration first, where that mode is on.
    bits = count_bits(coder)
    is_first = timed and kind == KIND_NEW_NODE and model.scalars[MODES] & TIME_FIRST > 0
    if is_first:
        duration = code_duration_first(coder, model, duration)
        record_bits(model, DURATION_BITS + kind, count_bits(coder) - bits)
        bits = count_bits(coder)

    # The position of a new node.
    if kind == KIND_NEW_NODE:
        code_position(coder, model, u, node, ON_HEADING, duration if is_first else ZERO)
        add_node(model)
        record_bits(model, POSITION_BITS, count_bits(coder) - bits)
        bits = count_bits(coder)

    # The duration after it, which its length tells much of.
    if timed and not is_first:
        if kind == KIND_STAY:
            duration = code_pause_duration(coder, model, MIX_STAY, ROW_STAY, duration)
        else:
            duration = code_move_duration(coder, model, half_edge, u, node, duration)
        record_bits(model, DURATION_BITS + kind, count_bits(coder) - bits)
    return duration


@inner_uncounted
def _code_segment(
    coder: Coder,
    model: WalkModel,
    state: _WalkState,
    nodes: NDArray[np.int64],
    time_steps: NDArray[np.int64],
    gaps: NDArray[np.int8],
    is_step: NDArray[np.bool_],
    j: int,
    timed: bool,
    gapped: bool,
) -> _WalkState:
    """Code the segment that leads to knot j, in place, and learn it; return the state there.

    The parameters are those of :func:`code_walks`; ``is_step`` is what :func:`_find_steps` returns.
    """
    u = state.node
    duration = time_steps[j] - time_steps[j - 1]
    bits = count_bits(coder)
    on_path = has_target(model)

    # Is it a gap? a path to a target has none.
    gap = 0
    if gapped and not on_path:
        context = _gap_context(model.gap_ends[u], state.last_kind)
        gap = code_bit(coder, model.bit_counts, context, np.int64(gaps[j]))
    gaps[j] = gap
    if gap:
        node, duration = _code_gap(coder, model, u, nodes[j], duration, timed)
        record_bits(model, GAP_BITS, count_bits(coder) - bits)
        model.gap_ends[u] += 1
        model.gap_ends[node] += 1
        nodes[j], time_steps[j] = node, time_steps[j - 1] + duration if timed else 0
        return _arrive_without_heading(model, node)

    # a target, then the kind of the step and its edge
    seeks_targets = model.scalars[MODES] & SHORTEST_PATHS > 0
    if seeks_targets and not on_path and model.first_half_edge[u] >= 0:
        code_target(coder, model, u, state.target_context, nodes, is_step, j)
    on_path = has_target(model)
    kind, half_edge, node = _code_step(coder, model, state, nodes[j])
    record_bits(model, STEP_KIND_BITS + kind, count_bits(coder) - bits)
    if len(model.step_bits) > 0 and not seeks_targets:
        model.step_bits[j] = count_bits(coder) - bits

    # Duration and position.
    duration = _code_measures(coder, model, kind, half_edge, u, node, duration, timed)
    nodes[j], time_steps[j] = node, time_steps[j - 1] + duration if timed else 0

    # Learn the step; a stop leaves the heading.
    before, incoming = state.before, state.incoming
    if node != u:
        before = u
        incoming = learn_step(model, incoming, u, node, duration if timed else np.int64(0))
    target_context = _AT_TARGET if on_path and not has_target(model) else kind
    return _WalkState(node, before, incoming, kind, target_context)


@inner_uncounted
def _code_end(coder: Coder, model: WalkModel, u: int, ends: bool) -> bool:
    """Code whether the track ends at u, and learn it."""
    # a node weighs 1 as long as no track began or ended there
    weight = end_weight_below(model, u + 1) - end_weight_below(model, u)
    context = BIT_END + (1 if weight > 1 else 0)
    ended = code_bit(coder, model.bit_counts, context, 1 if ends else 0) == 1
    if ended:
        add_end_weight(model, u, _END_WEIGHT)
    return ended


@inner_uncounted
def _is_in_bounds(model: WalkModel, node: int, time_step: int) -> bool:
    """Whether a node and a time that were read lie where no arithmetic overflows."""
    for axis in range(model.places.shape[1]):
        if abs(model.places[node, axis]) >= _MAX_COORDINATE:
            return False
    return abs(time_step) < _MAX_TIME_STEP


@jit
def code_walks(
    coder: Coder,
    model: WalkModel,
    nodes: NDArray[np.int64],
    time_steps: NDArray[np.int64],
    gaps: NDArray[np.int8],
    begins: NDArray[np.int8],
    tracks: int,
    timed: bool,
    gapped: bool,
) -> int:
    """Code all knots of all tracks, in place, after those that the model has seen.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the walks. Its ``places`` hold the positions of new nodes; a decoder fills them in.
    nodes, time_steps : int64 arrays, shape (K,)
        Node of each knot, numbered by first visit, and its time step; a decoder fills them in.
    gaps, begins : int8 arrays, shape (K,)
        Whether the segment that leads to the knot is a gap, and whether a track begins at the knot;
        a decoder fills them in.
    tracks : int
        Number of tracks.
    timed, gapped : bool
        Whether there are times, and whether there is any gap.

    Returns
    -------
    int
        Number of nodes, or -1 if what was read is no walk.
    """
    # Start after the last track that the model has seen; sorted starts precede all knots.
    knots = len(nodes)
    is_step = _find_steps(gaps, begins)
    tracks_left = tracks
    ended = True
    start = model.scalars[LAST_TRACK_START]
    state = _WalkState(
        model.scalars[LAST_TRACK_END] - 1, _NONE, _NONE, KIND_NEW_NODE, KIND_NEW_NODE
    )
    if timed and len(model.track_starts) > 0 and not _code_sorted_starts(coder, model, start):
        return -1

    # Code knot by knot; a decoder that has read all bytes too early has read no walk.
    for j in range(knots):
        if is_decoding(coder) and is_exhausted(coder):
            return -1

        # a knot begins a track where the one before it ended a track
        begins[j] = 1 if ended else 0
        if ended:
            if tracks_left == 0:
                return -1
            tracks_left -= 1
            if timed:
                start = _code_first_time_step(coder, model, start, time_steps[j])
                time_steps[j] = start
            nodes[j] = _code_start(coder, model, state.node, nodes[j])
            state = _arrive_without_heading(model, nodes[j])
        else:
            state = _code_segment(
                coder, model, state, nodes, time_steps, gaps, is_step, j, timed, gapped
            )
        if is_decoding(coder) and not _is_in_bounds(model, state.node, time_steps[j]):
            return -1

        # Does the track end here? the last one does when the knots are used up.
        ended = (
            tracks_left > 0
            and not has_target(model)
            and _code_end(coder, model, state.node, j + 1 == knots or begins[j + 1] == 1)
        )

    # The next walks, if the model goes on, follow the last track.
    model.scalars[LAST_TRACK_END], model.scalars[LAST_TRACK_START] = state.node + 1, start
    return model.scalars[NODE_COUNT] if tracks_left == 0 and not has_target(model) else np.int64(-1)
