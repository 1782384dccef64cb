"""The knots of walks, one after the other; see :mod:`gpszip.codec.kernels.walk_coder`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
from gpszip.codec.knots import Knots
from gpszip.codec.payload_head import SHORTEST_PATHS, SORTED_STARTS, TIME_FIRST
from gpszip.codec.plain.choices import read_known_node, read_target
from gpszip.codec.plain.durations import (
    ROW_GAP,
    ROW_STAY,
    learn_duration,
    read_duration_first,
    read_move_duration,
    read_pause_duration,
)
from gpszip.codec.plain.model import (
    FIRST_POSITION,
    KIND_BACK,
    KIND_KNOWN,
    KIND_NEW_EDGE,
    KIND_NEW_NODE,
    KIND_STAY,
    START_GAP,
    TRACK_ORDER,
    TRACK_START,
    PlainModel,
)
from gpszip.codec.plain.positions import read_jump, read_position
from gpszip.codec.plain.steps import read_known_edge, read_step_kind
from gpszip.codec.plain.walk_map import HalfEdge
from gpszip.errors import CorruptArchiveError

__all__ = ["read_knots"]

#: Coordinates (in space steps) and times (in time steps) of an archive are below these in size.
_MAX_COORDINATE = 1 << 45
_MAX_TIME_STEP = 1 << 60

#: Weight that a node gains each time a track starts or ends there.
_END_WEIGHT = 24

#: Context of a target where another one was just reached; otherwise, the kind of the last step.
_AT_TARGET = 5

#: Work of a knot beside its mixtures, in units of a distribution.
_KNOT_WORK = 30


@dataclass
class _WalkState:
    """Where a walk is, and how it came there."""

    node: int  # node of the latest knot
    time_step: int  # of the latest knot
    before: int | None = None  # node from which the last step came
    incoming: HalfEdge | None = None  # half-edge of that step
    last_kind: int = KIND_NEW_NODE  # kind of that step; at first and after a gap, of a new node
    target_context: int = KIND_NEW_NODE  # the same, or _AT_TARGET


class _Starts:
    """First time steps of the tracks: sorted ahead of all knots, or each after the last.

    Parameters
    ----------
    model : PlainModel
        Reads them.
    tracks : int
        Number of tracks.
    """

    def __init__(self, model: PlainModel, tracks: int) -> None:
        self._model, self._tracks = model, tracks
        self._last = 0
        self._next = 0  # number of the sorted start from which the next one is sought
        self._sorted = self._read_sorted() if model.modes & SORTED_STARTS else []
        self._left = list(range(len(self._sorted)))  # numbers of those not taken

    def read(self) -> int:
        """Read the first time step of the next track."""
        model = self._model
        if not model.timed:
            return 0
        if not model.modes & SORTED_STARTS:
            self._last += model.read_signed(TRACK_START)
            return self._last

        # As many of those left are passed over, in a circle.
        model.work.spend(len(self._left) // 16)
        skipped = model.read_unsigned(TRACK_ORDER) % self._tracks
        # Those before the place where the last search ended come last in the circle.
        after = sum(number < self._next for number in self._left)
        number = self._left.pop((after + skipped) % len(self._left))
        self._next = number + 1
        return self._sorted[number]

    def _read_sorted(self) -> list[int]:
        """Read the first time steps of all tracks in order, as differences."""
        starts = [self._model.read_signed(TRACK_START)]
        while len(starts) < self._tracks:
            starts.append(starts[-1] + self._model.read_unsigned(START_GAP))
        if any(abs(start) >= _MAX_TIME_STEP for start in starts):
            raise _no_walks()
        return starts


def read_knots(model: PlainModel, knots: int, tracks: int, gapped: bool) -> Knots:
    """Read all knots of all tracks.

    Parameters
    ----------
    model : PlainModel
        New; it has the positions of the nodes afterwards.
    knots, tracks : int
        Numbers of knots and of tracks.
    gapped : bool
        Whether there is any gap.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no walks of so many tracks.
    TooMuchWorkError
        If that takes more work than the model may do.
    """
    # A payload that is certainly too much is refused before its arrays are made.
    model.work.check(_KNOT_WORK * knots)
    nodes, time_steps = np.zeros(knots, np.int64), np.zeros(knots, np.int64)
    gaps, begins = np.zeros(knots, np.int8), np.zeros(knots, np.int8)
    starts = _Starts(model, tracks)
    state, ended, begun = None, True, 0
    for j in range(knots):
        # Bytes that end too early, or tracks that do, are no walks.
        model.work.spend(_KNOT_WORK)
        if model.decoder.is_exhausted or (ended and begun == tracks):
            raise _no_walks()

        # a knot begins a track where the one before it ended a track
        if ended or state is None:
            begun, begins[j] = begun + 1, 1
            state = _read_start(model, starts.read(), None if state is None else state.node)
        elif gapped and not model.path and _read_gap_bit(model, state):
            gaps[j], state = 1, _read_gap(model, state)
        else:
            state = _read_step(model, state)
        nodes[j], time_steps[j] = state.node, _check_bounds(model, state)

        # Does the track end here? the last one does when the knots are used up.
        ended = begun < tracks and not model.path and _read_end(model, state.node)
    if begun < tracks or model.path:
        raise _no_walks()
    return Knots(nodes, time_steps, gaps, begins)


def _no_walks() -> CorruptArchiveError:
    return CorruptArchiveError("the walks end before all tracks are read")


def _check_bounds(model: PlainModel, state: _WalkState) -> int:
    """Refuse a node or a time out of bounds; return the time step."""
    largest = max(map(abs, model.map.positions[state.node]), default=0)
    if largest >= _MAX_COORDINATE or abs(state.time_step) >= _MAX_TIME_STEP:
        raise _no_walks()
    return state.time_step


def _read_start(model: PlainModel, time_step: int, last_end: int | None) -> _WalkState:
    """Read the first node of a track after one that ended at ``last_end``."""
    if last_end is None:
        position = [model.read_signed(FIRST_POSITION) for _ in range(model.dimension)]
        node = model.map.add_node(position)
    elif model.read_bit(int(BIT_KNOWN_START)):
        node = _read_known_start(model)
    else:
        node = model.map.add_node(read_jump(model, last_end))
    model.map.end_weights[node] += _END_WEIGHT
    model.forget_heading()
    return _WalkState(node, time_step)


def _read_known_start(model: PlainModel) -> int:
    """Read a known node, likelier where tracks began or ended."""
    # A node owns as many numbers as it weighs, after those of the nodes before it.
    ends: NDArray[np.int64] = np.cumsum(model.map.end_weights)
    model.work.spend(len(ends) // 16)
    total = int(ends[-1])
    node = int(np.searchsorted(ends, model.decoder.find(total), side="right"))
    weight = int(model.map.end_weights[node])
    model.decoder.take(int(ends[node]) - weight, weight, total)
    return node


def _read_gap_bit(model: PlainModel, state: _WalkState) -> bool:
    """Read whether a gap follows, by the gaps that began or ended here and a stop just before."""
    # Level 0 is no gap, 1 is one or two, 2 is more.
    level = min((int(model.map.gap_ends[state.node]) + 1) // 2, 2)
    return bool(model.read_bit(int(BIT_GAP) + 2 * level + (state.last_kind == KIND_STAY)))


def _read_gap(model: PlainModel, state: _WalkState) -> _WalkState:
    """Read a gap: it ends where it began, at another known node, or at a new one."""
    u = state.node
    duration = read_pause_duration(model, int(MIX_GAP), ROW_GAP) if model.timed else 0
    if model.read_bit(int(BIT_GAP_TO_SELF)):
        node = u
    elif model.read_bit(int(BIT_GAP_TO_KNOWN)):
        node = read_known_node(model, u, None, int(BEYOND_GAPS))
    else:
        node = model.map.add_node(read_jump(model, u))

    # Learn it.
    model.map.gap_ends[u] += 1
    model.map.gap_ends[node] += 1
    model.forget_heading()
    return _WalkState(node, state.time_step + duration)


def _read_step(model: PlainModel, state: _WalkState) -> _WalkState:
    """Read a target if there is one, and a step; learn it."""
    # a target, then the kind of the step and its edge
    u = state.node
    if model.modes & SHORTEST_PATHS and not model.path and model.map.degree(u):
        read_target(model, u, state.target_context)
    on_path = bool(model.path)
    kind, edge, end = _read_edge(model, state)
    node, duration = _read_measures(model, u, kind, edge, end)

    # Learn the step; a stop leaves the heading.
    before, incoming = state.before, state.incoming
    if node != u:
        before, incoming = u, model.learn_step(u, node, incoming)
        if model.timed:
            learn_duration(model, incoming, duration)
    context = _AT_TARGET if on_path and not model.path else kind
    return _WalkState(node, state.time_step + duration, before, incoming, kind, context)


def _read_edge(model: PlainModel, state: _WalkState) -> tuple[int, HalfEdge | None, int | None]:
    """Read the kind of a step; return it with its known half-edge, and the node it leads to.

    A new node is None: its position follows.
    """
    # On the path to a target, the step is implied.
    u, incoming = state.node, state.incoming
    if model.path:
        # The path was found on the map, so that the edge exists.
        edge = model.map.half_edge(u, model.path.pop())
        assert edge is not None
        is_back = incoming is not None and edge is incoming.opposite
        return KIND_BACK if is_back else KIND_KNOWN, edge, edge.end

    # Otherwise it is read, and which edge or node it leads to where the kind leaves that open.
    kind = read_step_kind(model, u, incoming, state.last_kind)
    if kind == KIND_STAY:
        return kind, None, u
    if kind == KIND_NEW_NODE:
        return kind, None, None
    if kind == KIND_NEW_EDGE:
        return kind, None, read_known_node(model, u, state.before, int(AMONG_NEW_EDGES))
    if kind == KIND_BACK and incoming is not None:
        return kind, incoming.opposite, incoming.opposite.end
    edge = read_known_edge(model, u, state.before, incoming)
    return kind, edge, edge.end


def _read_measures(
    model: PlainModel, u: int, kind: int, edge: HalfEdge | None, node: int | None
) -> tuple[int, int]:
    """Read the position of a new node and the duration of a step from u; return both.

    They come in the order of the modes.
    """
    # The duration first, where that mode is on.
    if node is None and model.timed and model.modes & TIME_FIRST:
        duration = read_duration_first(model)
        return model.map.add_node(read_position(model, u, duration)), duration

    # The position of a new node; then the duration, which its length tells much of.
    if node is None:
        node = model.map.add_node(read_position(model, u, 0))
    if not model.timed:
        duration = 0
    elif kind == KIND_STAY:
        duration = read_pause_duration(model, int(MIX_STAY), ROW_STAY)
    else:
        duration = read_move_duration(model, u, node, edge)
    return node, duration


def _read_end(model: PlainModel, u: int) -> bool:
    """Read whether the track ends at u, and learn it."""
    # a node weighs 1 as long as no track began or ended there
    is_end = bool(model.map.end_weights[u] > 1)
    ended = bool(model.read_bit(int(BIT_END) + is_end))
    if ended:
        model.map.end_weights[u] += _END_WEIGHT
    return ended
