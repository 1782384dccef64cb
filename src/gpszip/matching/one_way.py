"""Travel against one-way roads: which samples do it, and on which roads.

A track is matched on the directions that are open. Where that leaves doubts, a window about them is
matched again with all roads open in both directions. Samples that fit a road in its closed
direction, and no road in an open one, travel against it: they are wrong-way samples.
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

#: Time steps before and after a doubt that are matched again. Roads within 10 errors are
#: candidates, and time steps lie 2.5 errors apart, so that four of them leave the search radius of
#: a wrong road; twice as many let the path converge.
_MARGIN = 8

#: Distance from its road, in errors, beyond which a sample is in doubt.
_DOUBTFUL_DISTANCE = 4.0

#: Distance from a road, in errors, within which a sample fits its closed direction.
_FITTING_DISTANCE = 3.0

#: Least length of travel against a road, in errors. Errors of manoeuvres beside the road make
#: shorter ones.
_MIN_LENGTH = 8.0

#: Distance, in errors, by which a road in an open direction must be farther than the closed one to
#: be refuted.
_FARTHER = 2.5

#: Least advance of a path, as a share of the straight line between its samples, that is not stuck.
_MIN_ADVANCE = 0.5

#: Length of a path in straight lines above which it goes round about.
_ROUND_ABOUT = 2.0

#: Speed on a path that goes round about above which it was not travelled, as a multiple of the
#: track's highest speed on straighter paths and of the brisk speed of the log.
_MIN_IMPLAUSIBLE_SPEED_RATIO = 2.0

#: Rounds in which the rest of the samples is matched and searched for lone pieces.
_ROUNDS = 3

#: Longest run of time steps that look legal within travel against a road.
_MAX_HOLE = 2

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Steps:
    """The time steps of a track, as matched on the open directions.

    Parameters
    ----------
    sample_indices : int64 array, shape (k,)
        Their samples.
    is_matched : bool array, shape (k,)
        Whether they lie on a piece.
    distance : float64 array, shape (k,)
        Metres to their positions on the roads, NaN for none.
    is_stuck : bool array, shape (k,)
        Whether no path moves on as the samples do, neither from the time step before nor to the
        next one.
    is_jump : bool array, shape (k,)
        Whether no path leads there from the time step before, although both lie on roads.
    no_road_near : bool array, shape (k,)
        Whether no road is near.
    """

    sample_indices: Longs
    is_matched: Bools
    distance: Floats
    is_stuck: Bools
    is_jump: Bools
    no_road_near: Bools


@dataclass(frozen=True, eq=False)
class _Rematch:
    """A window of a track matched with all roads open in both directions, by samples of the track.

    Parameters
    ----------
    first : int
        First sample of the window.
    leg : int64 array, shape (m,)
        Leg of each of its samples, -1 for none.
    distance : float64 array, shape (m,)
        Metres to the road.
    piece : int64 array, shape (m,)
        Piece of each sample, -1 for none.
    is_closed : bool array, shape (L,)
        Legs in a closed direction.
    closed_metres : float64 array, shape (m,)
        Metres travelled in closed directions up to each sample.
    edges : int64 array, shape (L,)
        Road of each leg.
    """

    first: int
    leg: Longs
    distance: Floats
    piece: Longs
    is_closed: Bools
    closed_metres: Floats
    edges: Longs

    def is_wrong_way(self, samples: Longs) -> Bools:
        """Whether samples lie on a leg in a closed direction."""
        is_closed = np.append(self.is_closed, False)  # the last one is for leg -1
        wrong_way: Bools = is_closed[self.leg[samples - self.first]]
        return wrong_way

    def wrong_way_roads(self, a: int, b: int) -> tuple[int, ...]:
        """Roads travelled in a closed direction from sample a to sample b, in order."""
        legs = np.arange(self.leg[a - self.first], self.leg[b - self.first] + 1)
        return tuple(dict.fromkeys(self.edges[legs[self.is_closed[legs]]].tolist()))

    def closed_metres_between(self, a: int, b: int) -> float:
        """Metres travelled in closed directions from sample a to sample b."""
        return float(self.closed_metres[b - self.first] - self.closed_metres[a - self.first])


def remove_wrong_way_travel(
    index: RoadIndex,
    opened: RoadIndex,
    work: Workspace,
    observations: Observations,
    path: ViterbiPath,
    match: Match,
) -> Match:
    """Take samples that travel against one-way roads off the match of a track.

    Parameters
    ----------
    index, opened : RoadIndex
        The roads as they may be travelled, and the same with all of them open in both directions.
    work : Workspace
        Arrays for searches on either.
    observations : Observations
        The track.
    path : ViterbiPath
        Its Viterbi path on open directions.
    match : Match
        The match built from the path.

    Returns
    -------
    Match
        The match of the other samples. Wrong-way samples are breaks with the reason ``"one-way"``
        and the roads; so are breaks that only a path against a road would bridge.
    """
    runs, bridges = _find_wrong_way_travel(index, opened, work, path, match)
    for _ in range(_ROUNDS if runs else 0):
        # Match the other samples.
        is_wrong_way = np.zeros(len(observations.times), np.bool_)
        for run in runs:
            is_wrong_way[run.after + 1 : run.before] = True
        match = _match_others(index, work, observations, match, is_wrong_way, runs)

        # Pieces beside them that stand still belong to them.
        lone = _find_lone_pieces(observations, match, is_wrong_way)
        if not lone:
            break
        runs = [*runs, *lone]
    return _rename_breaks(match, bridges)


def _find_lone_pieces(observations: Observations, match: Match, is_wrong_way: Bools) -> list[Break]:
    """Find pieces without length beside wrong-way samples that come from elsewhere, or go there."""
    lone = []
    for piece in match.pieces:
        neighbours = [
            k
            for k in (piece.first - 1, piece.last + 1)
            if 0 <= k < len(is_wrong_way) and is_wrong_way[k]
        ]
        moved = np.linalg.norm(
            observations.positions[neighbours] - observations.positions[piece.first], axis=1
        )
        spacing = min_spacing(match.scales)
        if neighbours and moved.max() > spacing and piece.length <= _MIN_ADVANCE * spacing:
            lone.append(Break(piece.first - 1, piece.last + 1, "one-way"))
    return lone


def _find_wrong_way_travel(
    index: RoadIndex, opened: RoadIndex, work: Workspace, path: ViterbiPath, match: Match
) -> tuple[list[Break], list[Break]]:
    """Find runs of wrong-way samples, and breaks between two samples that travel against a road."""
    # Match windows about doubtful time steps again, with all roads open in both directions.
    scales = match.scales
    steps = _describe_steps(path, match)
    runs: list[Break] = []
    bridges: list[Break] = []
    for low, high in _windows(_is_doubtful(steps, scales)):
        first, last = steps.sample_indices[low], steps.sample_indices[high]
        rematch = _rematch_window(index, opened, work, path.observations, first, last, scales)
        window = np.arange(low, high + 1)

        # Runs of time steps that fit closed directions only.
        is_refuted = _is_refuted(steps, rematch, window, scales)
        piece = rematch.piece[steps.sample_indices[window] - rematch.first]
        for i, j in _runs_on_one_piece(is_refuted, piece):
            run = _build_run(steps, rematch, low + i, low + j, (low, high), scales)
            if run is not None:
                runs.append(run)

        # Breaks between two time steps that only a path against a road joins.
        bridges += _find_bridges(steps, rematch, window, scales)
    return runs, bridges


def _describe_steps(path: ViterbiPath, match: Match) -> _Steps:
    """Describe the time steps of a track as matched on the open directions."""
    # The piece of each time step, -1 where it is on none.
    samples = path.sample_indices
    piece = match.piece[samples]
    is_matched = piece >= 0

    # Between which time steps the path moves as the samples do: it neither stands nor hurries.
    straight = np.linalg.norm(np.diff(path.observations.positions[samples], axis=0), axis=1)
    seconds = np.diff(path.observations.times[samples])
    is_same_piece = is_matched[1:] & (piece[1:] == piece[:-1])
    with np.errstate(invalid="ignore"):
        length = np.diff(match.along[samples])
        hurries = is_same_piece & _hurries(length, straight, seconds, match.scales)
        advances = is_same_piece & (length >= _MIN_ADVANCE * straight) & ~hurries

    # Time steps that hardly lie apart tell nothing.
    is_near = straight < min_spacing(match.scales)
    moves_on = advances | (is_same_piece & is_near & ~hurries)
    is_stuck = is_matched & ~(np.append(False, moves_on) | np.append(moves_on, False))

    # Jumps between two time steps that are both on pieces.
    is_jump = (path.transitions == JUMP) & is_matched & np.append(False, is_matched[:-1])
    return _Steps(
        samples, is_matched, match.distance[samples], is_stuck, is_jump, path.no_road_near
    )


def _hurries(length: Floats, straight: Floats, seconds: Floats, scales: Scales) -> Bools:
    """Which paths go round about at a speed that the track shows nowhere else.

    They were not travelled: the speed is twice as high as any on a straighter path of the track,
    and as 19 steps of the log in 20 in straight lines.
    """
    is_round_about = length > _ROUND_ABOUT * straight + backward_tolerance(scales)
    speed = np.divide(length, seconds, out=np.zeros(len(length)), where=seconds > 0)
    direct_speed = speed[~is_round_about & np.isfinite(speed)]
    fast = max(brisk_speed(scales), float(direct_speed.max(initial=0.0)))
    hurries: Bools = is_round_about & (speed > _MIN_IMPLAUSIBLE_SPEED_RATIO * fast)
    return hurries


def _is_doubtful(steps: _Steps, scales: Scales) -> Bools:
    """Time steps whose match may hide travel against a road."""
    is_unmatched = ~steps.is_matched & ~steps.no_road_near
    is_far = steps.is_matched & (np.nan_to_num(steps.distance) > _DOUBTFUL_DISTANCE * scales.error)
    doubtful: Bools = is_unmatched | steps.is_stuck | is_far | steps.is_jump
    return doubtful


def _windows(is_doubtful: Bools) -> Iterator[tuple[int, int]]:
    """First and last time steps of the windows about doubts; windows that touch are one."""
    steps = len(is_doubtful)
    doubts = np.flatnonzero(is_doubtful)
    if not len(doubts) or steps < 2:
        return
    split = np.flatnonzero(np.diff(doubts) > 2 * _MARGIN) + 1
    for group in np.split(doubts, split):
        yield max(int(group[0]) - _MARGIN, 0), min(int(group[-1]) + _MARGIN, steps - 1)


def _rematch_window(
    index: RoadIndex,
    opened: RoadIndex,
    work: Workspace,
    observations: Observations,
    first: int,
    last: int,
    scales: Scales,
) -> _Rematch:
    """Match the samples from first to last with all roads open in both directions."""
    # Find the Viterbi path of the window alone, and where all of its samples lie on it.
    inside = slice(first, last + 1)
    window = Observations(
        observations.positions[inside],
        observations.times[inside],
        observations.is_gap[first:last],
        observations.headings[inside],
    )
    path = find_viterbi_path(opened, work, window, scales, with_confidence=False)
    legs = path.legs
    leg, metres, distance = place_samples(
        window.positions,
        path.sample_indices,
        path.leg,
        path.metres,
        legs,
        opened.roads,
        opened.graph,
    )

    # Metres in closed directions up to each sample.
    is_closed = ~index.graph.is_open[legs.roads]
    closed_lengths = np.where(is_closed, legs.end - legs.begin, 0.0)
    closed_before = np.append(0.0, np.cumsum(closed_lengths))
    on = np.flatnonzero(leg >= 0)
    on_leg = leg[on]
    closed_metres = np.zeros(len(leg))
    closed_metres[on] = closed_before[on_leg] + np.where(
        is_closed[on_leg], metres[on] - legs.begin[on_leg], 0.0
    )

    # The piece of each sample, and the edge of each leg.
    piece = np.full(len(leg), -1, np.int64)
    piece[on] = legs.piece[on_leg]
    edges = (legs.roads >> 1).astype(np.int64)
    return _Rematch(first, leg, distance, piece, is_closed, closed_metres, edges)


def _is_refuted(steps: _Steps, rematch: _Rematch, window: Longs, scales: Scales) -> Bools:
    """Time steps of a window that fit a closed direction, and nothing in an open one."""
    samples = steps.sample_indices[window]
    distance = rematch.distance[samples - rematch.first]
    with np.errstate(invalid="ignore"):
        fits = rematch.is_wrong_way(samples) & (distance <= _FITTING_DISTANCE * scales.error)
        is_farther = steps.distance[window] - distance > _FARTHER * scales.error
    refuted: Bools = fits & (~steps.is_matched[window] | steps.is_stuck[window] | is_farther)
    return refuted | (fits & _is_in_hole(refuted))


def _is_in_hole(is_refuted: Bools) -> Bools:
    """Time steps in short holes between refuted ones."""
    refuted = np.flatnonzero(is_refuted)
    in_hole = np.zeros(len(is_refuted), np.bool_)
    for a, b in zip(refuted[:-1].tolist(), refuted[1:].tolist(), strict=True):
        if 1 < b - a <= _MAX_HOLE + 1:
            in_hole[a + 1 : b] = True
    return in_hole


def _runs_on_one_piece(is_refuted: Bools, piece: Longs) -> Iterator[tuple[int, int]]:
    """First and last of the refuted time steps that follow each other on one piece."""
    key = np.where(is_refuted, piece, -1)
    change = np.flatnonzero(np.diff(key)) + 1
    firsts, ends = np.append(0, change), np.append(change, len(key))
    for a, b in zip(firsts.tolist(), ends.tolist(), strict=True):
        if is_refuted[a]:
            yield a, b - 1


def _build_run(
    steps: _Steps, rematch: _Rematch, i: int, j: int, window: tuple[int, int], scales: Scales
) -> Break | None:
    """Build the break of wrong-way samples about time steps i to j.

    None if they don't travel far enough against a road, or if something else explains them.
    """
    # The time steps beside the run, as far as the path leads there.
    samples = steps.sample_indices
    piece = rematch.piece[samples[i] - rematch.first]

    # A time step belongs to the path if it is in the window and on the piece of the run.
    def is_on_path(k: int) -> bool:
        inside = window[0] <= k <= window[1]
        return inside and bool(rematch.piece[samples[k] - rematch.first] == piece)

    # Metres in closed directions between those time steps; errors alone can make a few.
    before = i - 1 if is_on_path(i - 1) else i
    behind = j + 1 if is_on_path(j + 1) else j
    length = rematch.closed_metres_between(samples[before], samples[behind])
    if length < _MIN_LENGTH * scales.error:
        return None

    # The open directions explain them unless a jump costs less than the emission costs of doing so.
    run = np.arange(i, j + 1)
    if not (~steps.is_matched[run] | steps.is_stuck[run]).any():
        open_distance = steps.distance[run]
        closed_distance = rematch.distance[samples[run] - rematch.first]
        excess = ((open_distance**2 - closed_distance**2) / (2 * scales.sigma**2)).sum()
        if excess < JUMP_COST:
            return None

    # Samples beside the run that travel against a road belong to it, too.
    first, last = _extend_run(steps, rematch, i, j)
    return Break(first - 1, last + 1, "one-way", rematch.wrong_way_roads(first, last))


def _extend_run(steps: _Steps, rematch: _Rematch, i: int, j: int) -> tuple[int, int]:
    """Extend a run of time steps to the wrong-way samples between them and their neighbours."""
    samples = steps.sample_indices
    first, last = int(samples[i]), int(samples[j])
    low = samples[max(i - 1, 0)]
    while (
        first - 1 > low and first > rematch.first and rematch.is_wrong_way(np.array([first - 1]))[0]
    ):
        first -= 1
    high = samples[min(j + 1, len(samples) - 1)]
    while (
        last + 1 < high
        and last - rematch.first + 1 < len(rematch.leg)
        and rematch.is_wrong_way(np.array([last + 1]))[0]
    ):
        last += 1
    return first, last


def _find_bridges(steps: _Steps, rematch: _Rematch, window: Longs, scales: Scales) -> list[Break]:
    """Find breaks between two time steps on open roads that only a path against a road joins."""
    bridges = []
    for k in window[1:][steps.is_jump[window[1:]]].tolist():
        a, b = int(steps.sample_indices[k - 1]), int(steps.sample_indices[k])
        piece_a, piece_b = rematch.piece[a - rematch.first], rematch.piece[b - rematch.first]
        is_joined = piece_a >= 0 and piece_a == piece_b
        if is_joined and rematch.closed_metres_between(a, b) >= min_spacing(scales):
            bridges.append(Break(a, b, "one-way", rematch.wrong_way_roads(a, b)))
    return bridges


def _match_others(
    index: RoadIndex,
    work: Workspace,
    observations: Observations,
    match: Match,
    is_wrong_way: Bools,
    runs: list[Break],
) -> Match:
    """Match the samples that don't travel against a road, and reinsert the others."""
    kept = np.flatnonzero(~is_wrong_way)
    if not len(kept):
        return _match_nothing(match, runs)
    others = remove_samples(observations, is_wrong_way)
    others = replace(others, is_gap=others.is_gap | (np.diff(kept) > 1))
    path = find_viterbi_path(index, work, others, match.scales)
    rematched = build_match(index, work, match.track, path, match.scales)
    rematched = expand_match(rematched, ~is_wrong_way)
    breaks = _combine_breaks(rematched, is_wrong_way, runs)
    return _update_piece_ends(replace(rematched, breaks=tuple(breaks)))


def _match_nothing(match: Match, runs: list[Break]) -> Match:
    """The match of a track whose samples all travel against roads."""
    is_kept = np.zeros(len(match), np.bool_)
    empty = expand_match(replace(match, pieces=(), breaks=()), is_kept)
    return replace(empty, breaks=tuple(_join_runs(runs)))


def _combine_breaks(match: Match, is_wrong_way: Bools, runs: list[Break]) -> list[Break]:
    """Combine the breaks of the other samples with the runs of wrong-way samples.

    A break that holds wrong-way samples is cut there.
    """
    breaks = _join_runs(runs)
    for break_ in match.breaks:
        inside = np.arange(break_.after + 1, break_.before)
        if not is_wrong_way[inside].any():
            breaks.append(break_)
            continue

        # What is left of it on either side.
        rest = inside[~is_wrong_way[inside]]
        reason = "off road" if break_.reason == "gap" else break_.reason
        for group in np.split(rest, np.flatnonzero(np.diff(rest) > 1) + 1):
            if len(group):
                breaks.append(Break(int(group[0]) - 1, int(group[-1]) + 1, reason))
    return sorted(breaks, key=lambda break_: (break_.after, break_.before))


def _join_runs(runs: list[Break]) -> list[Break]:
    """Join runs that touch: a run begins behind the sample ``after``."""
    joined: list[Break] = []
    for run in sorted(runs, key=lambda break_: break_.after):
        if joined and run.after < joined[-1].before:
            last = joined[-1]
            roads = tuple(dict.fromkeys((*last.edges, *run.edges)))
            joined[-1] = Break(last.after, max(last.before, run.before), "one-way", roads)
        else:
            joined.append(run)
    return joined


def _rename_breaks(match: Match, bridges: list[Break]) -> Match:
    """Give the breaks that only a path against a road bridges the reason ``"one-way"``."""
    known = {(bridge.after, bridge.before): bridge for bridge in bridges}
    renamed = tuple(
        known.get((break_.after, break_.before), break_)
        if break_.reason in {"no route", "detour"}
        else break_
        for break_ in match.breaks
    )
    if renamed == match.breaks:
        return match
    return _update_piece_ends(replace(match, breaks=renamed))


def _update_piece_ends(match: Match) -> Match:
    """Set the reason of each piece's end to that of the break behind it."""
    reasons = {break_.after: break_.reason for break_ in reversed(match.breaks)}
    pieces = tuple(
        replace(piece, reason=reasons.get(piece.last, "end of track")) for piece in match.pieces
    )
    return replace(match, pieces=pieces)
