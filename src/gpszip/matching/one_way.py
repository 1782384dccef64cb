"""Travel against one-way roads: which samples do it, and on which roads.

A track is matched on the directions that are open. Where that leaves doubts, the stretch is matched again with all roads open both
ways. Samples that fit a road in its closed direction, and no road in an open one, travel against it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.assemble import build_match
from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import place_samples
from gpszip.matching.kernels.candidates import JUMP
from gpszip.matching.kernels.roads import Workspace
from gpszip.matching.outliers import expand_match, remove_samples
from gpszip.matching.parameters import JUMP_COST, backward_tolerance, brisk_speed, min_spacing
from gpszip.matching.viterbi import Observations, ViterbiPath, find_viterbi_path
from gpszip.model.match import Break, Match, Scales

__all__ = ["remove_wrong_way_travel"]

#: Layers before and after a doubt that are matched again. Roads within ten errors are candidates, and layers lie 2.5 errors apart,
#: so that four layers leave the reach of a wrong road; twice as many let the way settle.
_AROUND = 8

#: A place on a road so many errors from its sample is in doubt.
_FAR = 4.0

#: A sample fits a closed direction within so many errors of the road.
_FITS = 3.0

#: Shorter travel against a road, in errors, is no more than errors make of manoeuvres beside it.
_LENGTH = 8.0

#: A road in an open direction is refuted where it lies so many errors farther away than the closed one.
_FARTHER = 2.5

#: A way that advances by less than this share of the straight line between two samples stuck still.
_ADVANCES = 0.5

#: A way so many times as long as the straight line was not taken at a speed that is so many times as high as the track shows on
#: straighter ways, and the log in straight lines in 19 steps of 20.
_ROUND_ABOUT, _HURRIED = 2.0, 2.0

#: What is left beside travel against roads is looked at so many times.
_ROUNDS = 3

#: So many layers in a row may look legal within a stretch against a road.
_HOLE = 2

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Layers:
    """What the match on open directions says of the samples that have a layer.

    Parameters
    ----------
    sample_indices : int64 array, shape (k,)
        Their samples.
    on : bool array, shape (k,)
        Whether they lie on a piece.
    distance : float64 array, shape (k,)
        Metres to their place, NaN for none.
    stuck : bool array, shape (k,)
        Whether no way goes on with them as they move, neither from the layer before nor to the next one.
    jumps : bool array, shape (k,)
        Whether no way leads there from the layer before, although both lie on roads.
    no_road_near : bool array, shape (k,)
        Whether no road is near.
    """

    sample_indices: Longs
    on: Bools
    distance: Floats
    stuck: Bools
    jumps: Bools
    no_road_near: Bools


@dataclass(frozen=True, eq=False)
class _Freed:
    """A stretch matched with all roads open both ways, by samples of the whole track.

    Parameters
    ----------
    first : int
        First sample of the stretch.
    leg : int64 array, shape (m,)
        Leg of each of its samples, -1 for none.
    distance : float64 array, shape (m,)
        Metres to the road.
    piece : int64 array, shape (m,)
        Piece of each sample, -1 for none.
    closed : bool array, shape (L,)
        Legs in a closed direction.
    against : float64 array, shape (m,)
        Metres travelled in closed directions so far.
    edges : int64 array, shape (L,)
        Road of each leg.
    """

    first: int
    leg: Longs
    distance: Floats
    piece: Longs
    closed: Bools
    against: Floats
    edges: Longs

    def goes_against(self, samples: Longs) -> Bools:
        """Whether samples lie on a leg in a closed direction."""
        closed = np.append(self.closed, False)  # the last one is for leg -1
        against: Bools = closed[self.leg[samples - self.first]]
        return against

    def roads_against(self, a: int, b: int) -> tuple[int, ...]:
        """Roads travelled in a closed direction from sample a to sample b, in order."""
        legs = np.arange(self.leg[a - self.first], self.leg[b - self.first] + 1)
        return tuple(dict.fromkeys(self.edges[legs[self.closed[legs]]].tolist()))


def remove_wrong_way_travel(
    index: RoadIndex,
    opened: RoadIndex,
    work: Workspace,
    stretch: Observations,
    chain: ViterbiPath,
    found: Match,
) -> Match:
    """Take samples that travel against one-way roads off the match of a track.

    Parameters
    ----------
    index, opened : RoadIndex
        The roads as they may be travelled, and the same with all of them open both ways.
    work : Work
        Room to search either.
    observations : Stretch
        The track.
    chain : Chain
        Its cheapest chain in open directions.
    found : Match
        What was made of the chain.

    Returns
    -------
    Match
        The rest of the samples is matched anew, without those that travel against a road. These are breaks with the reason
        ``"one-way"`` and the roads. So are breaks that only a way against a road would bridge.
    """
    runs, bridges = _find(index, opened, work, chain, found)
    for _ in range(_ROUNDS if runs else 0):
        against = np.zeros(len(stretch.times), np.bool_)
        for run in runs:
            against[run.after + 1 : run.before] = True
        found = _rematched(index, work, stretch, found, against, runs)
        lone = _lone(stretch, found, against)
        if not lone:
            break
        runs = [*runs, *lone]
    return _named(found, bridges)


def _lone(stretch: Observations, found: Match, against: Bools) -> list[Break]:
    """Pieces of no length beside samples that travel against a road: these come from elsewhere, or go there."""
    lone = []
    for piece in found.pieces:
        beside = [
            k for k in (piece.first - 1, piece.last + 1) if 0 <= k < len(against) and against[k]
        ]
        moved = np.linalg.norm(stretch.positions[beside] - stretch.positions[piece.first], axis=1)
        if (
            beside
            and moved.max() > min_spacing(found.scales)
            and piece.length <= _ADVANCES * min_spacing(found.scales)
        ):
            lone.append(Break(piece.first - 1, piece.last + 1, "one-way"))
    return lone


def _find(
    index: RoadIndex, opened: RoadIndex, work: Workspace, chain: ViterbiPath, found: Match
) -> tuple[list[Break], list[Break]]:
    """Runs of samples that travel against a road, and breaks that lie between two samples only."""
    layers = _layers(chain, found)
    runs: list[Break] = []
    bridges: list[Break] = []
    for low, high in _windows(_doubtful(layers, found.scales)):
        freed = _freed(
            index,
            opened,
            work,
            chain.observations,
            layers.sample_indices[low],
            layers.sample_indices[high],
            found.scales,
        )
        here = np.arange(low, high + 1)
        against = _refuted(layers, freed, here, found.scales)
        for i, j in _runs(against, freed.piece[layers.sample_indices[here] - freed.first]):
            run = _run(layers, freed, low + i, low + j, (low, high), found.scales)
            runs += [run] if run is not None else []
        bridges += _bridges(layers, freed, here, found.scales)
    return runs, bridges


def _layers(chain: ViterbiPath, found: Match) -> _Layers:
    used = chain.sample_indices
    piece = found.piece[used]
    on = piece >= 0

    # between which layers the way goes on as the samples do: it neither stands nor hurries round about
    straight = np.linalg.norm(np.diff(chain.observations.positions[used], axis=0), axis=1)
    seconds = np.diff(chain.observations.times[used])
    same = on[1:] & (piece[1:] == piece[:-1])
    with np.errstate(invalid="ignore"):
        way = np.diff(found.along[used])
        hurries = same & _hurries(way, straight, seconds, found.scales)
        advances = same & (way >= _ADVANCES * straight) & ~hurries

    # layers that hardly lie apart tell nothing
    goes_on = advances | (same & (straight < min_spacing(found.scales)) & ~hurries)
    stuck = on & ~(np.append(False, goes_on) | np.append(goes_on, False))

    jumps = (chain.transitions == JUMP) & on & np.append(False, on[:-1])
    return _Layers(used, on, found.distance[used], stuck, jumps, chain.no_road_near)


def _hurries(way: Floats, straight: Floats, seconds: Floats, scales: Scales) -> Bools:
    """Which ways lead round about at a speed that the track shows nowhere else."""
    round_about = way > _ROUND_ABOUT * straight + backward_tolerance(scales)
    speed = np.divide(way, seconds, out=np.zeros(len(way)), where=seconds > 0)
    usual = speed[~round_about & np.isfinite(speed)]
    fast = max(brisk_speed(scales), float(usual.max(initial=0.0)))
    hurries: Bools = round_about & (speed > _HURRIED * fast)
    return hurries


def _doubtful(layers: _Layers, scales: Scales) -> Bools:
    """Layers whose match may hide travel against a road."""
    far = layers.on & (np.nan_to_num(layers.distance) > _FAR * scales.error)
    doubtful: Bools = (~layers.on & ~layers.no_road_near) | layers.stuck | far | layers.jumps
    return doubtful


def _windows(doubtful: Bools) -> Iterator[tuple[int, int]]:
    """First and last layers of stretches about doubts that don't touch."""
    at = np.flatnonzero(doubtful)
    if not len(at) or len(doubtful) < 2:
        return
    split = np.flatnonzero(np.diff(at) > 2 * _AROUND) + 1
    for part in np.split(at, split):
        yield max(int(part[0]) - _AROUND, 0), min(int(part[-1]) + _AROUND, len(doubtful) - 1)


def _freed(
    index: RoadIndex,
    opened: RoadIndex,
    work: Workspace,
    stretch: Observations,
    first: int,
    last: int,
    scales: Scales,
) -> _Freed:
    """Match the samples from first to last with all roads open."""
    part = slice(first, last + 1)
    cut = Observations(
        stretch.positions[part],
        stretch.times[part],
        stretch.is_gap[first:last],
        stretch.headings[part],
    )
    chain = find_viterbi_path(opened, work, cut, scales, with_confidence=False)
    legs = chain.legs
    leg, metres, distance = place_samples(
        cut.positions, chain.sample_indices, chain.leg, chain.metres, legs, opened.roads, opened.graph
    )  # fmt: skip

    # metres against roads up to each sample
    closed = ~index.graph.open[legs.roads]
    lengths = np.where(closed, legs.end - legs.begin, 0.0)
    before = np.append(0.0, np.cumsum(lengths))
    on = leg >= 0
    own = np.zeros(len(leg))
    own[on] = before[leg[on]] + np.where(closed[leg[on]], metres[on] - legs.begin[leg[on]], 0.0)
    piece = np.full(len(leg), -1, np.int64)
    piece[on] = legs.piece[leg[on]]
    return _Freed(first, leg, distance, piece, closed, own, (legs.roads >> 1).astype(np.int64))


def _refuted(layers: _Layers, freed: _Freed, here: Longs, scales: Scales) -> Bools:
    """Layers that fit a closed direction, and nothing in an open one."""
    samples = layers.sample_indices[here]
    distance = freed.distance[samples - freed.first]
    with np.errstate(invalid="ignore"):
        fits = freed.goes_against(samples) & (distance <= _FITS * scales.error)
        farther = layers.distance[here] - distance > _FARTHER * scales.error
    refuted: Bools = fits & (~layers.on[here] | layers.stuck[here] | farther)
    return refuted | (fits & _between(refuted))


def _between(refuted: Bools) -> Bools:
    """Layers in short holes between others."""
    at = np.flatnonzero(refuted)
    holes = np.zeros(len(refuted), np.bool_)
    for a, b in zip(at[:-1].tolist(), at[1:].tolist(), strict=True):
        if 1 < b - a <= _HOLE + 1:
            holes[a + 1 : b] = True
    return holes


def _runs(against: Bools, piece: Longs) -> Iterator[tuple[int, int]]:
    """First and last of those in a row that travel against roads on one piece."""
    key = np.where(against, piece, -1)
    change = np.flatnonzero(np.diff(key)) + 1
    firsts, ends = np.append(0, change), np.append(change, len(key))
    for a, b in zip(firsts.tolist(), ends.tolist(), strict=True):
        if against[a]:
            yield a, b - 1


def _run(
    layers: _Layers, freed: _Freed, i: int, j: int, window: tuple[int, int], scales: Scales
) -> Break | None:
    """Samples about layers i to j that travel against a road, if they do so for long enough and nothing else explains them."""
    # the layers beside the run, as far as a way leads there
    piece = freed.piece[layers.sample_indices[i] - freed.first]
    before, behind = (
        k
        if window[0] <= k <= window[1]
        and freed.piece[layers.sample_indices[k] - freed.first] == piece
        else within
        for k, within in ((i - 1, i), (j + 1, j))
    )
    a, b = layers.sample_indices[before] - freed.first, layers.sample_indices[behind] - freed.first
    if freed.against[b] - freed.against[a] < _LENGTH * scales.error:
        return None

    # what the open directions make of it: nothing, or something so far away that leaving the roads is likelier
    here = np.arange(i, j + 1)
    if not (~layers.on[here] | layers.stuck[here]).any():
        other, own = (
            layers.distance[here],
            freed.distance[layers.sample_indices[here] - freed.first],
        )
        if ((other**2 - own**2) / (2 * scales.sigma**2)).sum() < JUMP_COST:
            return None

    # samples between the layers, too
    first, last = int(layers.sample_indices[i]), int(layers.sample_indices[j])
    while (
        first - 1 > layers.sample_indices[max(i - 1, 0)]
        and first > freed.first
        and freed.goes_against(np.array([first - 1]))[0]
    ):
        first -= 1
    end = layers.sample_indices[min(j + 1, len(layers.sample_indices) - 1)]
    while (
        last + 1 < end
        and last - freed.first + 1 < len(freed.leg)
        and freed.goes_against(np.array([last + 1]))[0]
    ):
        last += 1
    return Break(first - 1, last + 1, "one-way", freed.roads_against(first, last))


def _bridges(layers: _Layers, freed: _Freed, here: Longs, scales: Scales) -> list[Break]:
    """Breaks between two layers on open roads that only a way against a road joins."""
    found = []
    for k in here[1:][layers.jumps[here[1:]]].tolist():
        a, b = int(layers.sample_indices[k - 1]), int(layers.sample_indices[k])
        at, to = a - freed.first, b - freed.first
        joined = freed.piece[at] >= 0 and freed.piece[at] == freed.piece[to]
        if joined and freed.against[to] - freed.against[at] >= min_spacing(scales):
            found.append(Break(a, b, "one-way", freed.roads_against(a, b)))
    return found


def _rematched(
    index: RoadIndex,
    work: Workspace,
    stretch: Observations,
    found: Match,
    against: Bools,
    runs: list[Break],
) -> Match:
    """Match the samples that don't travel against a road, and put the others back among them."""
    kept = np.flatnonzero(~against)
    if not len(kept):
        return _nowhere(found, runs)
    rest = remove_samples(stretch, against)
    rest = replace(rest, is_gap=rest.is_gap | (np.diff(kept) > 1))
    match = build_match(
        index, work, found.track, find_viterbi_path(index, work, rest, found.scales), found.scales
    )
    match = expand_match(match, ~against)
    return _with_ends(replace(match, breaks=tuple(_breaks(match, against, runs))))


def _nowhere(found: Match, runs: list[Break]) -> Match:
    """All samples travel against roads."""
    nothing = np.zeros(len(found), np.bool_)
    empty = expand_match(replace(found, pieces=(), breaks=()), nothing)
    return replace(empty, breaks=tuple(_joined(runs)))


def _breaks(match: Match, against: Bools, runs: list[Break]) -> Iterator[Break]:
    """Breaks of the rest, cut where they hold travel against roads, and those of this travel."""
    there = list(match.breaks)
    out = _joined(runs)
    for one in there:
        inside = np.arange(one.after + 1, one.before)
        if not against[inside].any():
            out.append(one)
            continue
        free = inside[~against[inside]]
        reason = "off road" if one.reason == "gap" else one.reason
        for part in np.split(free, np.flatnonzero(np.diff(free) > 1) + 1):
            if len(part):
                out.append(Break(int(part[0]) - 1, int(part[-1]) + 1, reason))
    yield from sorted(out, key=lambda one: (one.after, one.before))


def _joined(runs: list[Break]) -> list[Break]:
    """Runs of which one follows the other are one."""
    out: list[Break] = []
    for run in sorted(runs, key=lambda one: one.after):
        if (
            out and run.after < out[-1].before
        ):  # they touch, as a run begins behind the sample ``after``
            roads = tuple(dict.fromkeys((*out[-1].edges, *run.edges)))
            out[-1] = Break(out[-1].after, max(out[-1].before, run.before), "one-way", roads)
        else:
            out.append(run)
    return out


def _named(found: Match, bridges: list[Break]) -> Match:
    """The same, with breaks that only a way against a road bridges called so."""
    known = {(one.after, one.before): one for one in bridges}
    renamed = tuple(
        known.get((one.after, one.before), one) if one.reason in {"no route", "detour"} else one
        for one in found.breaks
    )
    return _with_ends(replace(found, breaks=renamed)) if renamed != found.breaks else found


def _with_ends(match: Match) -> Match:
    """The same, with pieces that end for the reasons of the breaks behind them."""
    reasons = {one.after: one.reason for one in reversed(match.breaks)}
    pieces = tuple(
        replace(one, reason=reasons.get(one.last, "end of track")) for one in match.pieces
    )
    return replace(match, pieces=pieces)
