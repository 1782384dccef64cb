"""From the chain of one track to its match: pieces, breaks with their reasons, and a place for every sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.match_layer import GAP
from gpszip.kernels.match_roads import Work, apart
from gpszip.kernels.match_search import find_way
from gpszip.kernels.match_trace import Legs, draw, place_samples
from gpszip.matching.chain import Chain
from gpszip.matching.index import RoadIndex
from gpszip.matching.rules import model_of, reach
from gpszip.model.match import Break, Match, Piece, Route, Scales

__all__ = ["assemble", "route_of"]

#: Ways up to so many times the straight line are looked for to tell a detour from no way at all.
_FAR = 100.0


def route_of(index: RoadIndex, legs: Legs) -> Route:
    """The route of legs on directed roads."""
    back = (legs.roads & 1).astype(np.bool_)
    lengths = index.graph.lengths[legs.roads]
    begin, end = np.where(back, lengths - legs.begin, legs.begin), np.where(back, lengths - legs.end, legs.end)
    return Route(legs.roads >> 1, ~back, begin, end)


def assemble(index: RoadIndex, work: Work, track: str, chain: Chain, scales: Scales) -> Match:
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
    samples = len(chain.stretch.times)
    leg, metres, distance = place_samples(
        chain.stretch.positions, chain.used, chain.leg, chain.metres, chain.legs, index.roads, index.graph
    )  # fmt: skip
    spans = _spans(chain)
    reasons = [_reason(index, work, chain, scales, a, b) for a, b in _between(spans, len(chain.used))]
    confidence = np.where(leg >= 0, np.interp(np.arange(samples), chain.used, chain.confidence), 0.0)
    piece, number, along = np.full(samples, -1, np.int32), np.full(samples, -1, np.int32), np.full(samples, np.nan)
    pieces = []
    for i, (first, last) in enumerate(spans):
        low, high = int(chain.leg[first]), int(chain.leg[last]) + 1
        legs = Legs(chain.legs.roads[low:high], chain.legs.begin[low:high], chain.legs.end[low:high], chain.legs.piece[low:high])
        a, b = int(chain.used[first]), int(chain.used[last])
        here = slice(a, b + 1)
        piece[here], number[here] = i, leg[here] - low
        along[here] = np.concatenate(([0.0], np.cumsum(legs.end - legs.begin)))[number[here]] + metres[here] - legs.begin[number[here]]
        sure = float(confidence[here].mean())
        pieces.append(Piece(a, b, route_of(index, legs), draw(legs, index.roads, index.graph), sure, reasons[i + 1] or "end of track"))
    breaks = _breaks(chain, spans, reasons)
    edge, forward, offset = _on_roads(index, chain, leg, metres)
    return Match(
        track, tuple(pieces), breaks, piece, number, edge, forward, offset, along, distance, confidence, scales
    )  # fmt: skip


def _on_roads(
    index: RoadIndex, chain: Chain, leg: NDArray[np.int64], metres: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.float64]]:
    """Road, direction and offset of every sample."""
    on = leg >= 0
    roads = np.zeros(len(leg), np.int32)
    roads[on] = chain.legs.roads[leg[on]]
    back = (roads & 1).astype(np.bool_)
    edge = np.where(on, roads >> 1, -1).astype(np.int32)
    return edge, on & ~back, np.where(back, index.graph.lengths[roads] - metres, metres)


def _spans(chain: Chain) -> list[tuple[int, int]]:
    """First and last layer of each piece."""
    on = chain.leg >= 0
    if not on.any():
        return []
    piece = np.where(on, chain.legs.piece[np.maximum(chain.leg, 0)], -1)
    change = np.flatnonzero(np.diff(piece)) + 1
    firsts, lasts = np.concatenate(([0], change)), np.concatenate((change, [len(piece)])) - 1
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if piece[a] >= 0]


def _between(spans: list[tuple[int, int]], layers: int) -> list[tuple[int, int]]:
    """Layers before the first piece, between pieces and after the last one: the last on a piece and the next on one."""
    ends = [-1, *(last for _, last in spans)]
    return list(zip(ends, [*(first for first, _ in spans), layers], strict=True))


def _breaks(chain: Chain, spans: list[tuple[int, int]], reasons: list[str]) -> tuple[Break, ...]:
    layers, samples = len(chain.used), len(chain.stretch.times)
    out = []
    for (a, b), reason in zip(_between(spans, layers), reasons, strict=True):
        if reason:
            out.append(Break(int(chain.used[a]) if a >= 0 else -1, int(chain.used[b]) if b < layers else samples, reason))
    return tuple(out)


def _reason(index: RoadIndex, work: Work, chain: Chain, scales: Scales, a: int, b: int) -> str:
    """Why no piece leads from layer a to layer b; nothing where the track begins or ends with a piece."""
    if b - a == 1 and (a < 0 or b == len(chain.used)):
        return ""
    if b - a > 1:
        return "no road near" if chain.alone[a + 1 : b].any() else "off road"
    if chain.kinds[b] == GAP:
        return "gap" if chain.stretch.silent[chain.used[a] : chain.used[b]].any() else "too fast"
    return _obstacle(index, work, chain, scales, a, b)


def _obstacle(index: RoadIndex, work: Work, chain: Chain, scales: Scales, a: int, b: int) -> str:
    """Why no way was taken from layer a to layer b, both on roads."""
    i, j = chain.used[a], chain.used[b]
    straight = apart(chain.stretch.positions, i, j)
    road, target = int(chain.roads[a]), int(chain.roads[b])
    if road in {target, target ^ 1}:
        return "detour"
    rest = float(index.graph.lengths[road] - chain.metres[a])
    free = model_of(scales)._replace(turn=0.0, u_turn=0.0)
    goal, far = chain.stretch.positions[j], _FAR * (straight + reach(scales))
    found = find_way(road, rest, target, far, far, goal, math.inf, index.graph, free, work)
    return "detour" if len(found) else "no route"
