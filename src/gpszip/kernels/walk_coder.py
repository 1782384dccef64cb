"""Coding of walks: one loop that writes or reads, knot by knot.

A knot is reached by a part. First comes what kind of step the part is (back, along a known way, to a known node by a new way,
to a new node, a stop, or a gap), then how long it takes, then where a new node lies. Every probability follows from what was
coded before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import code_bit
from gpszip.kernels.borrowed import borrowed
from gpszip.kernels.jit import jit
from gpszip.kernels.link_coder import code_link
from gpszip.kernels.place_coder import ON_AXES, ON_HEADING, code_step
from gpszip.kernels.range_coder import Coder, code_interval, target, used_bits
from gpszip.kernels.span_coder import T_GAP, T_STAY, code_move, code_rest
from gpszip.kernels.spread import FIRST_PLACE, TRACK_START, code_far
from gpszip.kernels.walk_model import (
    BEGUN,
    F_END,
    F_GAP,
    F_GAP_KIND,
    F_KNOWN_START,
    GAP_BITS,
    KIND_BITS,
    LATEST,
    NODES,
    ON_GAP,
    ON_LINK,
    PLACE_BITS,
    SPAN_BITS,
    START_BITS,
    U_GAP,
    U_STAY,
    WalkModel,
    add_node,
    book,
    follow,
    forget_way,
    pick,
    weigh,
    weight_below,
)
from gpszip.kernels.way_coder import KIND_BACK, KIND_KNOWN, KIND_LINK, KIND_NEW, KIND_STAY, code_kind, code_way, kind_of

__all__ = ["code_walks"]

#: Coordinates and times that an archive may hold are below these.
_FARTHEST, _LATEST = np.int64(1) << 45, np.int64(1) << 60

#: Weight that a node gains each time a track starts or ends there.
_WEIGHTS_END = np.int64(24)

#: What stands for no node.
_NOWHERE = np.int64(-1)


@jit
def _code_start(coder: Coder, model: WalkModel, last: int, node: int) -> int:
    """Code the first node of a track: a known one, likelier where tracks began or ended, or a new one."""
    nodes = model.scalars[NODES]
    known = 0
    if nodes > 0:
        known = code_bit(coder, model.flags, F_KNOWN_START, 1 if node < nodes else 0)
    if known:
        total = weight_below(model, nodes)
        if coder.cursor[1] == 1:
            node = pick(model, target(coder, total))
        start = weight_below(model, node)
        code_interval(coder, start, weight_below(model, node + 1) - start, total)
        return node
    node = nodes
    if last < 0:
        for axis in range(model.places.shape[1]):
            model.places[node, axis] = code_far(coder, model, FIRST_PLACE, model.places[node, axis])
    else:
        code_step(coder, model, last, node, ON_AXES)
    return add_node(model)


@jit
def _code_gap(coder: Coder, model: WalkModel, u: int, node: int, cells: int, timed: bool) -> tuple[int, int]:
    """Code a part in which no travel is claimed: how long, and where the track goes on."""
    if timed:
        cells = code_rest(coder, model, T_GAP, U_GAP, cells)
    if code_bit(coder, model.flags, F_GAP_KIND, 1 if node == u else 0):
        return u, cells
    nodes = model.scalars[NODES]
    if code_bit(coder, model.flags, F_GAP_KIND + 1, 1 if node < nodes else 0):
        return code_link(coder, model, u, _NOWHERE, node, ON_GAP), cells
    node = nodes
    code_step(coder, model, u, node, ON_AXES)
    return add_node(model), cells


@jit
def _gap_context(model: WalkModel, u: int, last: int) -> int:
    """Context of whether a gap follows: how often one began or ended at u, and whether the walk stopped there."""
    rests = model.rests[u]
    return F_GAP + 2 * (2 if rests > 2 else 1 if rests > 0 else 0) + (1 if last == KIND_STAY else 0)


@jit
def _code_part(
    coder: Coder, model: WalkModel, u: int, before: int, arrived: int, last: int, node: int, cells: int, timed: bool
) -> tuple[int, int, int]:
    """Code one part from u: return its kind, the node it ends at and its cells."""
    back = arrived ^ 1 if arrived >= 0 else -1
    bits = used_bits(coder)
    kind = code_kind(coder, model, u, arrived, back, kind_of(model, u, back, node), last)
    half = -1
    if kind == KIND_STAY:
        node = u
    elif kind == KIND_BACK:
        half = back
    elif kind == KIND_KNOWN:
        half = code_way(coder, model, u, before, arrived, back, node)
    elif kind == KIND_LINK:
        node = code_link(coder, model, u, before, node, ON_LINK)
    if half >= 0:
        node = model.into[half]
    book(model, KIND_BITS + kind, used_bits(coder) - bits)
    if kind == KIND_NEW:
        bits = used_bits(coder)
        node = model.scalars[NODES]
        code_step(coder, model, u, node, ON_HEADING)
        add_node(model)
        book(model, PLACE_BITS, used_bits(coder) - bits)
    if timed:
        bits = used_bits(coder)
        if kind == KIND_STAY:
            cells = code_rest(coder, model, T_STAY, U_STAY, cells)
        else:
            cells = code_move(coder, model, half, u, node, cells)
        book(model, SPAN_BITS + kind, used_bits(coder) - bits)
    return kind, node, cells


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
    nodes, cells : int64 arrays, shape (K,)
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
    coder, model = borrowed(coder), borrowed(model)
    knots = len(nodes)
    left = tracks
    u, before, arrived, last = model.scalars[LATEST] - 1, -1, -1, KIND_NEW
    start = model.scalars[BEGUN]
    ended = True
    for j in range(knots):
        if coder.cursor[1] == 1 and coder.cursor[0] > len(coder.data) + 8:
            return -1
        if ended:
            if left == 0:
                return -1
            left -= 1
            begins[j] = 1
            if timed:
                cells[j] = start + code_far(coder, model, TRACK_START, cells[j] - start)
                start = cells[j]
            bits = used_bits(coder)
            u = _code_start(coder, model, u, nodes[j])
            book(model, START_BITS, used_bits(coder) - bits)
            nodes[j] = u
            weigh(model, u, _WEIGHTS_END)
            before, arrived, last = -1, -1, KIND_NEW
            forget_way(model)
        else:
            begins[j] = 0
            span = cells[j] - cells[j - 1]
            gap = 0
            if gapped:
                gap = code_bit(coder, model.flags, _gap_context(model, u, last), np.int64(gaps[j]))
            gaps[j] = gap
            if gap:
                bits = used_bits(coder)
                node, span = _code_gap(coder, model, u, nodes[j], span, timed)
                book(model, GAP_BITS, used_bits(coder) - bits)
                before, arrived, last = -1, -1, KIND_NEW
                forget_way(model)
                model.rests[u] += 1
                model.rests[node] += 1
            else:
                last, node, span = _code_part(coder, model, u, before, arrived, last, nodes[j], span, timed)
                if node != u:
                    arrived = follow(model, arrived, u, node, span if timed else np.int64(0))
                    before = u
            nodes[j] = node
            u = node
            cells[j] = cells[j - 1] + span if timed else 0
        if coder.cursor[1] == 1 and not _is_sound(model, u, cells[j]):
            return -1
        ended = False
        if left > 0:
            terminal = 1 if weight_below(model, u + 1) - weight_below(model, u) > 1 else 0
            ended = code_bit(coder, model.flags, F_END + terminal, 1 if j + 1 == knots or begins[j + 1] == 1 else 0) == 1
            if ended:
                weigh(model, u, _WEIGHTS_END)
    model.scalars[LATEST], model.scalars[BEGUN] = u + 1, start
    return model.scalars[NODES] if left == 0 else np.int64(-1)
