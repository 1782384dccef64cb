"""From the chain of one track to its match: pieces, breaks with their reasons, and a place for every sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.averaging import estimate_noise
from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import Legs, legs_to_line, place_samples
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

#: Ways up to so many times the straight line are looked for to tell a detour from no way at all.
_FAR = 100.0

#: A piece shorter than this share of what its samples move stays at one place: so much way is made by errors.
_NOTHING = 0.1

#: Errors of a standing receiver wander: within an hour by so many times what they change from sample to sample.
_WANDER = 100.0


def route_from_legs(index: RoadIndex, legs: Legs) -> Route:
    """The route of legs on directed roads."""
    back = (legs.roads & 1).astype(np.bool_)
    lengths = index.graph.lengths[legs.roads]
    begin, end = (
        np.where(back, lengths - legs.begin, legs.begin),
        np.where(back, lengths - legs.end, legs.end),
    )
    return Route(legs.roads >> 1, ~back, begin, end)


def build_match(
    index: RoadIndex, work: Workspace, track: str, chain: ViterbiPath, scales: Scales
) -> Match:
    """Put together what is told of a track.

    Parameters
    ----------
    index, work : RoadIndex, Work
        The network, and room to search it.
    track : str
        Name of the track.
    chain : Chain
        Its cheapest chain.
    scales : Scales
        What it was matched with.
    """
    samples = len(chain.observations.times)
    leg, metres, distance = place_samples(
        chain.observations.positions, chain.sample_indices, chain.leg, chain.metres, chain.legs, index.roads, index.graph
    )  # fmt: skip
    spans = [span for span in _spans(chain) if not _claims_nothing(chain, scales, *span)]
    leg = _taken_off(chain, leg, spans)
    distance = np.where(leg >= 0, distance, np.nan)
    reasons = [
        _reason(index, work, chain, scales, a, b)
        for a, b in _between(spans, len(chain.sample_indices))
    ]
    confidence = np.where(
        leg >= 0, np.interp(np.arange(samples), chain.sample_indices, chain.confidence), 0.0
    )
    piece, number, along = (
        np.full(samples, -1, np.int32),
        np.full(samples, -1, np.int32),
        np.full(samples, np.nan),
    )
    pieces = []
    for i, (first, last) in enumerate(spans):
        low, high = int(chain.leg[first]), int(chain.leg[last]) + 1
        legs = Legs(
            chain.legs.roads[low:high],
            chain.legs.begin[low:high],
            chain.legs.end[low:high],
            chain.legs.piece[low:high],
        )
        a, b = int(chain.sample_indices[first]), int(chain.sample_indices[last])
        here = slice(a, b + 1)
        piece[here], number[here] = i, leg[here] - low
        along[here] = (
            np.concatenate(([0.0], np.cumsum(legs.end - legs.begin)))[number[here]]
            + metres[here]
            - legs.begin[number[here]]
        )
        sure = float(confidence[here].mean())
        pieces.append(
            Piece(
                a,
                b,
                route_from_legs(index, legs),
                legs_to_line(legs, index.roads, index.graph),
                sure,
                reasons[i + 1] or "end of track",
            )
        )
    breaks = _breaks(chain, spans, reasons)
    edge, forward, offset = _on_roads(index, chain, leg, metres)
    return Match(
        track, tuple(pieces), breaks, piece, number, edge, forward, offset, along, distance, confidence, scales
    )  # fmt: skip


def _on_roads(
    index: RoadIndex, chain: ViterbiPath, leg: NDArray[np.int64], metres: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.float64]]:
    """Road, direction and offset of every sample."""
    on = leg >= 0
    roads = np.zeros(len(leg), np.int32)
    roads[on] = chain.legs.roads[leg[on]]
    back = (roads & 1).astype(np.bool_)
    edge = np.where(on, roads >> 1, -1).astype(np.int32)
    return edge, on & ~back, np.where(back, index.graph.lengths[roads] - metres, metres)


def _spans(chain: ViterbiPath) -> list[tuple[int, int]]:
    """First and last layer of each piece."""
    on = chain.leg >= 0
    if not on.any():
        return []
    piece = np.where(on, chain.legs.piece[np.maximum(chain.leg, 0)], -1)
    change = np.flatnonzero(np.diff(piece)) + 1
    firsts, lasts = np.concatenate(([0], change)), np.concatenate((change, [len(piece)])) - 1
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if piece[a] >= 0]


def _claims_nothing(chain: ViterbiPath, scales: Scales, first: int, last: int) -> bool:
    """Whether a piece from one layer to another is no route: it stays at one place while its samples move.

    So it is where no way leads on from a sample, nor to it: the sample before and the next one are elsewhere, too.
    """
    low, high = int(chain.leg[first]), int(chain.leg[last])
    length = float((chain.legs.end - chain.legs.begin)[low : high + 1].sum())

    # how far its samples get, with those from which, and to which, there is no way
    before = first > 0 and chain.transitions[first] == JUMP
    behind = last + 1 < len(chain.sample_indices) and chain.transitions[last + 1] == JUMP
    a, b = int(chain.sample_indices[first - before]), int(chain.sample_indices[last + behind])
    places = chain.observations.positions[a : b + 1]
    moved = float(
        np.sqrt(
            ((places - chain.observations.positions[chain.sample_indices[first]]) ** 2).sum(axis=1)
        ).max()
    )
    if length > _NOTHING * moved:
        return False
    return moved > (min_spacing(scales) if before or behind else _standing(chain, scales))


def _standing(chain: ViterbiPath, scales: Scales) -> float:
    """Metres that samples of a standing agent may lie apart.

    The error tells it, but not where the whole log is far off the roads; then the samples' own noise does.
    """
    noise = estimate_noise(chain.observations.positions, chain.observations.is_gap)
    return (
        min(backward_tolerance(scales), max(_WANDER * noise, 0.5 * scales.error))
        if noise
        else backward_tolerance(scales)
    )


def _taken_off(
    chain: ViterbiPath, leg: NDArray[np.int64], spans: list[tuple[int, int]]
) -> NDArray[np.int64]:
    """The legs of samples, of those that lie on pieces."""
    on = np.zeros(len(leg), np.bool_)
    for first, last in spans:
        on[chain.sample_indices[first] : chain.sample_indices[last] + 1] = True
    return np.where(on, leg, -1)


def _between(spans: list[tuple[int, int]], layers: int) -> list[tuple[int, int]]:
    """Layers before the first piece, between pieces and after the last one: the last on a piece and the next on one."""
    ends = [-1, *(last for _, last in spans)]
    return list(zip(ends, [*(first for first, _ in spans), layers], strict=True))


def _breaks(
    chain: ViterbiPath, spans: list[tuple[int, int]], reasons: list[str]
) -> tuple[Break, ...]:
    layers, samples = len(chain.sample_indices), len(chain.observations.times)
    out = []
    for (a, b), reason in zip(_between(spans, layers), reasons, strict=True):
        if reason:
            out.append(
                Break(
                    int(chain.sample_indices[a]) if a >= 0 else -1,
                    int(chain.sample_indices[b]) if b < layers else samples,
                    reason,
                )
            )
    return tuple(out)


def _reason(
    index: RoadIndex, work: Workspace, chain: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why no piece leads from layer a to layer b; nothing where the track begins or ends with a piece."""
    if b - a == 1 and (a < 0 or b == len(chain.sample_indices)):
        return ""
    if b - a > 1:
        return _reason_of_layers(index, work, chain, scales, a, b)
    if chain.transitions[b] == BREAK:
        return (
            "gap"
            if chain.observations.is_gap[chain.sample_indices[a] : chain.sample_indices[b]].any()
            else "too fast"
        )
    return _obstacle(index, work, chain, scales, a, b)


def _reason_of_layers(
    index: RoadIndex, work: Workspace, chain: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why the layers between a and b lie on no piece."""
    if chain.no_road_near[a + 1 : b].any():
        return "no road near"
    if (chain.leg[a + 1 : b] < 0).any():
        return "off road"

    # all of them are on roads, from which no way leads on
    jumps = [
        k
        for k in range(max(a, 0) + 1, min(b, len(chain.sample_indices) - 1) + 1)
        if chain.transitions[k] == JUMP
    ]
    several = {
        _obstacle(index, work, chain, scales, k - 1, k)
        for k in jumps
        if min(chain.leg[k - 1], chain.leg[k]) >= 0
    }
    return "off road" if not several else "detour" if several == {"detour"} else "no route"


def _obstacle(
    index: RoadIndex, work: Workspace, chain: ViterbiPath, scales: Scales, a: int, b: int
) -> str:
    """Why no way was taken from layer a to layer b, both on roads."""
    i, j = chain.sample_indices[a], chain.sample_indices[b]
    straight = distance_between(chain.observations.positions, i, j)
    road, target = int(chain.roads[a]), int(chain.roads[b])
    if road in {target, target ^ 1}:
        return "detour"
    rest = float(index.graph.lengths[road] - chain.metres[a])
    free = model_parameters(scales)._replace(turn_cost=0.0, u_turn_cost=0.0)
    goal, far = chain.observations.positions[j], _FAR * (straight + search_radius(scales))
    found = find_path(road, rest, target, far, far, goal, math.inf, index.graph, free, work)
    return "detour" if len(found) else "no route"
