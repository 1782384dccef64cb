"""Coding of walks: one loop that writes or reads, knot by knot.

A knot is reached by a part. First comes what kind of step the part is (back, along a known way, to a known node by a new way,
to a new node, a stop, or a gap), then how long it takes, then where a new node lies. Every probability follows from what was
coded before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.distributions import (
    FIRST_PLACE,
    START_GAP,
    TRACK_ORDER,
    TRACK_START,
    ZERO,
    code_large_signed,
    code_large_unsigned,
)
from gpszip.codec.kernels.duration_coder import (
    T_GAP,
    T_STAY,
    code_duration_first,
    code_move_duration,
    code_pause_duration,
)
from gpszip.codec.kernels.new_edge_coder import code_known_node
from gpszip.codec.kernels.no_refcount import without_refcount
from gpszip.codec.kernels.position_coder import ON_AXES, ON_HEADING, code_position
from gpszip.codec.kernels.range_coder import Coder, code_interval, count_bits, decode_cumulative
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
    BEGUN,
    DURATION_BITS,
    GAP_BITS,
    LATEST,
    MODES,
    NODES,
    ORDER_AT,
    POSITION_BITS,
    SHORTEST_PATHS,
    START_BITS,
    STEP_KIND_BITS,
    TIME_FIRST,
    U_GAP,
    U_STAY,
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
    F_END,
    F_GAP,
    F_GAP_KIND,
    F_KNOWN_START,
    ON_GAP,
    ON_LINK,
)
from gpszip.kernels.jit import jit

__all__ = ["code_walks"]

#: Coordinates and times that an archive may hold are below these.
_FARTHEST, _LATEST = np.int64(1) << 45, np.int64(1) << 60

#: Weight that a node gains each time a track starts or ends there.
_WEIGHTS_END = np.int64(24)

#: What stands for no node.
_NOWHERE = np.int64(-1)


@jit
def _code_starts(coder: Coder, model: WalkModel, cell: int) -> bool:
    """Code the first cells of all tracks in order, as gaps after ``cell``; return whether they are bearable."""
    starts = model.starts
    for i in range(len(starts)):
        gap = starts[i, 0] - cell
        cell += (
            code_large_signed(coder, model, TRACK_START, gap)
            if i == 0
            else code_large_unsigned(coder, model, START_GAP, gap)
        )
        starts[i, 0], starts[i, 1] = cell, 0
        if abs(cell) >= _LATEST:
            return False
    return True


@jit
def _code_first_cell(coder: Coder, model: WalkModel, cell: int, first: int) -> int:
    """Code the first cell of a track after a track that began at ``cell``."""
    starts = model.starts
    if len(starts) == 0:
        return cell + code_large_signed(coder, model, TRACK_START, first - cell)
    at, skipped = model.scalars[ORDER_AT], np.int64(0)
    if coder.cursor[1] != 1:
        while starts[at, 1] == 1 or starts[at, 0] != first:
            skipped += 1 - starts[at, 1]
            at = (at + 1) % len(starts)
    skipped = code_large_unsigned(coder, model, TRACK_ORDER, skipped) % len(starts)
    at = model.scalars[ORDER_AT]
    while starts[at, 1] == 1 or skipped > 0:
        skipped -= 1 - starts[at, 1]
        at = (at + 1) % len(starts)
    starts[at, 1] = 1
    model.scalars[ORDER_AT] = (at + 1) % len(starts)
    return starts[at, 0]


@jit
def _code_first(coder: Coder, model: WalkModel, last: int, node: int) -> int:
    """Code the first node of a track: a known one, likelier where tracks began or ended, or a new one."""
    nodes = model.scalars[NODES]
    known = 0
    if nodes > 0:
        known = code_bit(coder, model.flags, F_KNOWN_START, 1 if node < nodes else 0)
    if known:
        total = end_weight_below(model, nodes)
        if coder.cursor[1] == 1:
            node = find_by_end_weight(model, decode_cumulative(coder, total))
        start = end_weight_below(model, node)
        code_interval(coder, start, end_weight_below(model, node + 1) - start, total)
        return node
    node = nodes
    if last < 0:
        for axis in range(model.places.shape[1]):
            model.places[node, axis] = code_large_signed(
                coder, model, FIRST_PLACE, model.places[node, axis]
            )
    else:
        code_position(coder, model, last, node, ON_AXES, ZERO)
    return add_node(model)


@jit
def _code_start(coder: Coder, model: WalkModel, last: int, node: int) -> int:
    """Code the first node of a track after one that ended at ``last``, and learn it."""
    bits = count_bits(coder)
    node = _code_first(coder, model, last, node)
    record_bits(model, START_BITS, count_bits(coder) - bits)
    add_end_weight(model, node, _WEIGHTS_END)
    return node


@jit
def _code_gap(
    coder: Coder, model: WalkModel, u: int, node: int, cells: int, timed: bool
) -> tuple[int, int]:
    """Code a part in which no travel is claimed: how long, and where the track goes on."""
    if timed:
        cells = code_pause_duration(coder, model, T_GAP, U_GAP, cells)
    if code_bit(coder, model.flags, F_GAP_KIND, 1 if node == u else 0):
        return u, cells
    nodes = model.scalars[NODES]
    if code_bit(coder, model.flags, F_GAP_KIND + 1, 1 if node < nodes else 0):
        return code_known_node(coder, model, u, _NOWHERE, node, ON_GAP), cells
    node = nodes
    code_position(coder, model, u, node, ON_AXES, ZERO)
    return add_node(model), cells


@jit
def _gap_context(model: WalkModel, u: int, last: int) -> int:
    """Context of whether a gap follows: how often one began or ended at u, and whether the walk stopped there."""
    rests = model.rests[u]
    return F_GAP + 2 * (2 if rests > 2 else 1 if rests > 0 else 0) + (1 if last == KIND_STAY else 0)


@jit
def _joined(gaps: NDArray[np.int8], begins: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Whether a step leads to each knot."""
    joined = np.zeros(len(gaps), np.bool_)
    for j in range(1, len(gaps)):
        joined[j] = begins[j] == 0 and gaps[j] == 0
    return joined


@jit
def _code_way_on(
    coder: Coder, model: WalkModel, u: int, before: int, arrived: int, last: int, node: int
) -> tuple[int, int, int]:
    """Code what kind of step follows on u and along which way: return the kind, the half-edge if there is one, and where it leads."""
    back = arrived ^ 1 if arrived >= 0 else _NOWHERE
    if has_target(model):
        node = take_next_node(model)
        half = find_half_edge(model, u, node)
        return KIND_BACK if half == back else KIND_KNOWN, half, node
    kind = code_step_kind(coder, model, u, arrived, back, step_kind(model, u, back, node), last)
    half = _NOWHERE
    if kind == KIND_STAY:
        node = u
    elif kind == KIND_BACK:
        half = back
    elif kind == KIND_KNOWN:
        half = code_known_edge(coder, model, u, before, arrived, back, node)
    elif kind == KIND_NEW_EDGE:
        node = code_known_node(coder, model, u, before, node, ON_LINK)
    elif kind == KIND_NEW_NODE:
        node = model.scalars[NODES]
    if half >= 0:
        node = model.into[half]
    return kind, half, node


@jit
def _code_part(
    coder: Coder, model: WalkModel, kind: int, half: int, u: int, node: int, cells: int, timed: bool
) -> int:
    """Code where a new node lies, and how many cells the step to a node takes; return these."""
    bits = count_bits(coder)
    ahead = timed and kind == KIND_NEW_NODE and model.scalars[MODES] & TIME_FIRST > 0
    if ahead:
        cells = code_duration_first(coder, model, cells)
        record_bits(model, DURATION_BITS + kind, count_bits(coder) - bits)
        bits = count_bits(coder)
    if kind == KIND_NEW_NODE:
        code_position(coder, model, u, node, ON_HEADING, cells if ahead else ZERO)
        add_node(model)
        record_bits(model, POSITION_BITS, count_bits(coder) - bits)
        bits = count_bits(coder)
    if timed and not ahead:
        if kind == KIND_STAY:
            cells = code_pause_duration(coder, model, T_STAY, U_STAY, cells)
        else:
            cells = code_move_duration(coder, model, half, u, node, cells)
        record_bits(model, DURATION_BITS + kind, count_bits(coder) - bits)
    return cells


@jit
def _code_end(coder: Coder, model: WalkModel, u: int, ends: bool) -> bool:
    """Code whether a track that has come to u ends."""
    terminal = 1 if end_weight_below(model, u + 1) - end_weight_below(model, u) > 1 else 0
    ended = code_bit(coder, model.flags, F_END + terminal, 1 if ends else 0) == 1
    if ended:
        add_end_weight(model, u, _WEIGHTS_END)
    return ended


@jit
def _is_sound(model: WalkModel, node: int, cell: int) -> bool:
    """Whether a node and a time that were read lie where no arithmetic overflows."""
    for axis in range(model.places.shape[1]):
        if abs(model.places[node, axis]) >= _FARTHEST:
            return False
    return abs(cell) < _LATEST


@jit
def code_walks(
    coder: Coder,
    model: WalkModel,
    nodes: NDArray[np.int64],
    cells: NDArray[np.int64],
    gaps: NDArray[np.int8],
    begins: NDArray[np.int8],
    tracks: int,
    timed: bool,
    gapped: bool,
) -> int:
    """Code all knots of all tracks, in place, after those that the model has seen.

    Parameters
    ----------
    nodes, time_steps : int64 arrays, shape (K,)
        Node of each knot, numbered by first visit, and its time cell; filled in when reading.
    gaps, begins : int8 arrays, shape (K,)
        Whether the part that leads to the knot is a gap, and whether a track begins at the knot.
    tracks : int
        Number of tracks.
    timed, gapped : bool
        Whether there are times, and whether there is any gap.

    Returns
    -------
    int
        Number of nodes, or -1 if what was read is no walk.
    """
    coder, model = without_refcount(coder), without_refcount(model)
    knots = len(nodes)
    left = tracks
    u, before, arrived, last = model.scalars[LATEST] - 1, _NOWHERE, _NOWHERE, KIND_NEW_NODE
    start = model.scalars[BEGUN]
    ended, arrival = True, False
    aims = model.scalars[MODES] & SHORTEST_PATHS > 0
    joined = _joined(gaps, begins)
    if timed and len(model.starts) > 0 and not _code_starts(coder, model, start):
        return -1
    for j in range(knots):
        if coder.cursor[1] == 1 and coder.cursor[0] > len(coder.data) + 8:
            return -1
        if ended:
            if left == 0:
                return -1
            left -= 1
            begins[j] = 1
            if timed:
                start = _code_first_cell(coder, model, start, cells[j])
                cells[j] = start
            u = _code_start(coder, model, u, nodes[j])
            nodes[j] = u
            before, arrived, last, arrival = _NOWHERE, _NOWHERE, KIND_NEW_NODE, False
            forget_heading(model)
        else:
            begins[j] = 0
            span = cells[j] - cells[j - 1]
            gap = 0
            bits = count_bits(coder)
            under_way = has_target(model)
            if gapped and not under_way:
                gap = code_bit(coder, model.flags, _gap_context(model, u, last), np.int64(gaps[j]))
            gaps[j] = gap
            if aims and gap == 0 and not under_way and model.head[u] >= 0:
                code_target(coder, model, u, np.int64(5) if arrival else last, nodes, joined, j)
            under_way = has_target(model)
            if gap:
                node, span = _code_gap(coder, model, u, nodes[j], span, timed)
                record_bits(model, GAP_BITS, count_bits(coder) - bits)
                before, arrived, last = _NOWHERE, _NOWHERE, KIND_NEW_NODE
                forget_heading(model)
                model.rests[u] += 1
                model.rests[node] += 1
            else:
                last, half, node = _code_way_on(coder, model, u, before, arrived, last, nodes[j])
                record_bits(model, STEP_KIND_BITS + last, count_bits(coder) - bits)
                if len(model.spent) > 0 and not aims:
                    model.spent[j] = count_bits(coder) - bits
                span = _code_part(coder, model, last, half, u, node, span, timed)
                if node != u:
                    arrived = learn_step(model, arrived, u, node, span if timed else np.int64(0))
                    before = u
            arrival = under_way and not has_target(model)
            nodes[j] = node
            u = node
            cells[j] = cells[j - 1] + span if timed else 0
        if coder.cursor[1] == 1 and not _is_sound(model, u, cells[j]):
            return -1
        ended = (
            left > 0
            and not has_target(model)
            and _code_end(coder, model, u, j + 1 == knots or begins[j + 1] == 1)
        )
    model.scalars[LATEST], model.scalars[BEGUN] = u + 1, start
    return model.scalars[NODES] if left == 0 and not has_target(model) else np.int64(-1)
