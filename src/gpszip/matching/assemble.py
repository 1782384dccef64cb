"""From a Viterbi path to a match: pieces, breaks with their reasons, and sample positions.

An interval between pieces is a pair of time steps (a, b): the last one on a piece, -1 before the
first piece, and the next one on a piece, the number of time steps after the last piece.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.averaging import estimate_noise
from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import Legs, legs_to_line, place_samples, slice_legs
from gpszip.matching.kernels.candidates import BREAK, JUMP
from gpszip.matching.kernels.roads import Workspace, distance_between
from gpszip.matching.kernels.search import find_path
from gpszip.matching.parameters import (
    backward_tolerance,
    min_spacing,
    model_parameters,
    search_radius,
)
from gpszip.matching.viterbi import ViterbiPath
from gpszip.model.match import Break, Match, Piece, Route, Scales

__all__ = ["build_match", "route_from_legs"]

#: Length of the longest path, in straight lines, that is a detour rather than no route at all.
_MAX_DETOUR = 100.0

#: A piece shorter than this share of what its samples move stays in one position: errors alone
#: make a path that long.
_MIN_PROGRESS = 0.1

#: Distance that the errors of a standing receiver wander within an hour, as a multiple of their
#: change from sample to sample.
_WANDER = 100.0


def route_from_legs(index: RoadIndex, legs: Legs) -> Route:
    """Convert legs on directed roads to a route."""
    is_backward = (legs.roads & 1).astype(np.bool_)
    lengths = index.graph.lengths[legs.roads]
    begin = np.where(is_backward, lengths - legs.begin, legs.begin)
    end = np.where(is_backward, lengths - legs.end, legs.end)
    return Route(legs.roads >> 1, ~is_backward, begin, end)


def build_match(
    index: RoadIndex, work: Workspace, track: str, path: ViterbiPath, scales: Scales
) -> Match:
    """Build the match of a track.

    Parameters
    ----------
    index, work : RoadIndex, Workspace
        The network, and arrays for its searches.
    track : str
        Name of the track.
    path : ViterbiPath
        Its Viterbi path.
    scales : Scales
        The scales that the path was found with.
    """
    # Position of every sample on the legs.
    samples, steps = len(path.observations.times), len(path.sample_indices)
    leg, metres, distance = place_samples(
        path.observations.positions,
        path.sample_indices,
        path.leg,
        path.metres,
        path.legs,
        index.roads,
        index.graph,
    )

    # Pieces, without those that are no route, and the reasons of the breaks between them.
    spans = [span for span in _piece_spans(path) if not _is_standstill(path, scales, *span)]
    leg = _drop_other_legs(path, leg, spans)
    distance = np.where(leg >= 0, distance, np.nan)
    reasons = [
        _break_reason(index, work, path, scales, a, b) for a, b in _intervals_between(spans, steps)
    ]
    confidence = np.where(
        leg >= 0, np.interp(np.arange(samples), path.sample_indices, path.confidence), 0.0
    )

    # Each piece, and where its samples lie along it.
    piece_of = np.full(samples, -1, np.int32)
    leg_of = np.full(samples, -1, np.int32)
    along = np.full(samples, np.nan)
    pieces = []
    for number, (first_step, last_step) in enumerate(spans):
        low, high = int(path.leg[first_step]), int(path.leg[last_step]) + 1
        legs = slice_legs(path.legs, low, high)
        first, last = int(path.sample_indices[first_step]), int(path.sample_indices[last_step])
        inside = slice(first, last + 1)
        piece_of[inside] = number
        leg_of[inside] = leg[inside] - low
        leg_starts = np.concatenate(([0.0], np.cumsum(legs.end - legs.begin)))
        along[inside] = leg_starts[leg_of[inside]] + metres[inside] - legs.begin[leg_of[inside]]
        pieces.append(
            Piece(
                first,
                last,
                route_from_legs(index, legs),
                legs_to_line(legs, index.roads, index.graph),
                float(confidence[inside].mean()),
                reasons[number + 1] or "end of track",
            )
        )

    # Express the position of each sample as edge, direction and offset from the edge's start.
    edge, forward, offset = _edges_of_samples(index, path, leg, metres)
    return Match(
        track,
        tuple(pieces),
        _build_breaks(path, spans, reasons),
        piece_of,
        leg_of,
        edge,
        forward,
        offset,
        along,
        distance,
        confidence,
        scales,
    )


def _edges_of_samples(
    index: RoadIndex, path: ViterbiPath, leg: NDArray[np.int64], metres: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.float64]]:
    """Road, direction and offset of every sample."""
    is_on_road = leg >= 0
    roads = np.zeros(len(leg), np.int32)
    roads[is_on_road] = path.legs.roads[leg[is_on_road]]
    is_backward = (roads & 1).astype(np.bool_)
    edge = np.where(is_on_road, roads >> 1, -1).astype(np.int32)
    offset = np.where(is_backward, index.graph.lengths[roads] - metres, metres)
    return edge, is_on_road & ~is_backward, offset


def _piece_spans(path: ViterbiPath) -> list[tuple[int, int]]:
    """First and last time step of each piece."""
    is_on_road = path.leg >= 0
    if not is_on_road.any():
        return []
    piece = np.where(is_on_road, path.legs.piece[np.maximum(path.leg, 0)], -1)
    change = np.flatnonzero(np.diff(piece)) + 1
    firsts = np.concatenate(([0], change))
    lasts = np.concatenate((change, [len(piece)])) - 1
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if piece[a] >= 0]


def _is_standstill(path: ViterbiPath, scales: Scales, first: int, last: int) -> bool:
    """Whether a piece is no route: it stays in one position while its samples move.

    This happens where no path leads on from a sample, nor to it: the samples before and after are
    elsewhere, too.
    """
    # Length in metres of the route that the piece takes.
    low, high = int(path.leg[first]), int(path.leg[last])
    length = float((path.legs.end - path.legs.begin)[low : high + 1].sum())

    # How far its samples move, with the next ones to which, or from which, no path leads.
    jumped_before = first > 0 and path.transitions[first] == JUMP
    jumps_after = last + 1 < len(path.sample_indices) and path.transitions[last + 1] == JUMP
    first_sample = int(path.sample_indices[first - jumped_before])
    last_sample = int(path.sample_indices[last + jumps_after])
    positions = path.observations.positions
    steps = positions[first_sample : last_sample + 1] - positions[path.sample_indices[first]]
    moved = float(np.sqrt((steps**2).sum(axis=1)).max())

    # More than errors can make.
    if length > _MIN_PROGRESS * moved:
        return False
    return moved > (
        min_spacing(scales) if jumped_before or jumps_after else _standstill_diameter(path, scales)
    )


def _standstill_diameter(path: ViterbiPath, scales: Scales) -> float:
    """Metres that samples of a standing agent may lie apart.

    The error bounds it. Where the log is far off the roads the error is too large, and the
    samples' own noise bounds it.
    """
    noise = estimate_noise(path.observations.positions, path.observations.is_gap)
    tolerance = backward_tolerance(scales)
    return min(tolerance, max(_WANDER * noise, 0.5 * scales.error)) if noise else tolerance


def _drop_other_legs(
    path: ViterbiPath, leg: NDArray[np.int64], spans: list[tuple[int, int]]
) -> NDArray[np.int64]:
    """The legs of samples on pieces, -1 for all others."""
    is_on_piece = np.zeros(len(leg), np.bool_)
    for first, last in spans:
        is_on_piece[path.sample_indices[first] : path.sample_indices[last] + 1] = True
    return np.where(is_on_piece, leg, -1)


def _intervals_between(spans: list[tuple[int, int]], steps: int) -> list[tuple[int, int]]:
    """Intervals before the first piece, between pieces, and after the last one."""
    ends = [-1, *(last for _, last in spans)]
    return list(zip(ends, [*(first for first, _ in spans), steps], strict=True))


def _build_breaks(
    path: ViterbiPath, spans: list[tuple[int, int]], reasons: list[str]
) -> tuple[Break, ...]:
    """Breaks in the intervals that have a reason."""
    steps, samples = len(path.sample_indices), len(path.observations.times)
    breaks = []
    for (a, b), reason in zip(_intervals_between(spans, steps), reasons, strict=True):
        if reason:
            after = int(path.sample_indices[a]) if a >= 0 else -1
            before = int(path.sample_indices[b]) if b < steps else samples
            breaks.append(Break(after, before, reason))
    return tuple(breaks)


def _break_reason(
    index: RoadIndex, work: Workspace, path: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why no piece leads from time step a to time step b; empty at a matched end of the track."""
    if b - a == 1 and (a < 0 or b == len(path.sample_indices)):
        return ""
    if b - a > 1:
        return _reason_of_steps(index, work, path, scales, a, b)
    if path.transitions[b] == BREAK:
        is_gap = path.observations.is_gap[path.sample_indices[a] : path.sample_indices[b]]
        return "gap" if is_gap.any() else "too fast"
    return _reason_of_jump(index, work, path, scales, a, b)


def _reason_of_steps(
    index: RoadIndex, work: Workspace, path: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why the time steps between a and b are on no piece."""
    # Steps without a road near come first: nothing else explains them.
    if path.no_road_near[a + 1 : b].any():
        return "no road near"
    if (path.leg[a + 1 : b] < 0).any():
        return "off road"

    # All of them are on roads, from which no path leads on.
    jumps = [
        k
        for k in range(max(a, 0) + 1, min(b, len(path.sample_indices) - 1) + 1)
        if path.transitions[k] == JUMP
    ]
    reasons = {
        _reason_of_jump(index, work, path, scales, k - 1, k)
        for k in jumps
        if min(path.leg[k - 1], path.leg[k]) >= 0
    }
    if not reasons:
        return "off road"
    return "detour" if reasons == {"detour"} else "no route"


def _reason_of_jump(
    index: RoadIndex, work: Workspace, path: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why no path was taken from time step a to time step b, both on roads.

    A search without costs for turns and with a far bound tells a detour from no route.
    """
    # A break between positions on one road is a detour, without a search for a path.
    i, j = path.sample_indices[a], path.sample_indices[b]
    road, target = int(path.roads[a]), int(path.roads[b])
    if road in {target, target ^ 1}:
        return "detour"

    # a path with neither costs nor limits but for its length
    straight = distance_between(path.observations.positions, i, j)
    bound = _MAX_DETOUR * (straight + search_radius(scales))
    between = find_path(
        road,
        float(index.graph.lengths[road] - path.metres[a]),
        target,
        bound,
        bound,
        path.observations.positions[j],
        math.inf,
        index.graph,
        model_parameters(scales)._replace(turn_cost=0.0, u_turn_cost=0.0),
        work,
    )
    return "detour" if len(between) else "no route"
