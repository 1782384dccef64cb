"""The stays and trips of one track.

A track is cut into halts, where its fixes stay in place, and moves between them. A move is a trip
if it was seen to lead away from a place by more than the errors of its fixes. When it began and
ended is estimated from how long its first and last steps take, as a phone that lies still may be
silent until it is well on its way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.history.fixes import MAX_SPEED, Fixes
from gpszip.history.stays import Halt, find_halts

__all__ = ["Doubt", "Move", "Settings", "Stop", "Timeline", "build_timeline"]

#: Length of a way as a multiple of the straight line: 1.3 in towns, by roads or on foot.
_WAY_FACTOR = 1.3

#: Metres per second of a walk.
_WALKING_SPEED = 1.3

#: Metres of straight lines, and the speeds in m/s at which ways of up to this length are travelled
#: with waits: on foot, through a town by car, bicycle or bus, and by motorway or train.
_USUAL_SPEEDS = ((1000.0, _WALKING_SPEED), (30_000.0, 8.0), (math.inf, 25.0))

#: Metres per second squared by which travellers speed up and slow down at most, on average over a
#: way from rest to rest: buses and trains at about 1.
_MAX_ACCELERATION = 1.0

#: A gap is travel if a way of its displacement takes this share of it or more.
_TRAVEL_SHARE = 0.5

#: Seconds of a gap beyond which nothing is said about where the track was, even if it is at one
#: place before and after: whoever is away for longer sleeps elsewhere.
_MAX_GAP = 86_400.0

#: Seconds of fixes at a place from which the track was seen to be still there.
_SEEN_STILL = 60.0

#: Seconds before and after a gap in which its speed is measured.
_SPEED_TIME = 180.0

#: Rounds in which single fixes are left out; more change hardly anything.
_MAX_ROUNDS = 4

#: Fixes on the way that a trip has at least: a single one may be an error.
_MIN_ROUTE_FIXES = 2

#: Seconds of a stop at the far end of a round trip that is its goal. A red light is shorter.
_TURN_TIME = 120.0

#: A stop lies at the far end of a round trip if its distance from where the trip began is this
#: share of the largest one, or more.
_FAR_SHARE = 0.9

#: The straight line from begin to end of two moves, as a share of those of both: a stop lies on the
#: way above the upper one; the way turned back at the stop below the lower one.
_ON_THE_WAY = 0.7
_TURNED_BACK = 0.3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """What counts as a stay and as a trip.

    Parameters
    ----------
    min_stay : float
        Seconds; shorter stops are no stays.
    max_pause : float
        Seconds; shorter stays on the way of a trip don't end it.
    radius : float
        Metres around the centre of a place that belong to it.
    """

    min_stay: float = 300.0
    max_pause: float = 900.0
    radius: float = 100.0


@dataclass(frozen=True, eq=False)
class Stop:
    """A stop of a track at a place.

    Parameters
    ----------
    start, end : float
        Seconds; estimated where the track was silent.
    first_seen, last_seen : float
        Times of the first and the last fix at the place.
    halt : Halt
        The fixes at the place.
    pause : bool
        Whether the trip goes on after it.
    """

    start: float
    end: float
    first_seen: float
    last_seen: float
    halt: Halt
    pause: bool = False

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end - self.start


@dataclass(frozen=True, eq=False)
class Move:
    """A trip: from the stop before it to the stop after it, if the track has them.

    Parameters
    ----------
    start, end : float
        Seconds.
    begin, finish : float64 array, shape (d,)
        Metres: where it begins and ends.
    origin, goal : int or None
        Numbers of the stops at its ends; None where the track begins or ends on the way.
    """

    start: float
    end: float
    begin: Floats
    finish: Floats
    origin: int | None
    goal: int | None


@dataclass(frozen=True, eq=False)
class Doubt:
    """A single fix far off between gaps: an error, or a stay that nothing else confirms.

    Parameters
    ----------
    time : float
        Seconds.
    position : float64 array, shape (d,)
        Metres.
    """

    time: float
    position: Floats


@dataclass(frozen=True, eq=False)
class Timeline:
    """Stops and trips of one track, each in the order of time.

    Parameters
    ----------
    fixes : Fixes
        The fixes that were used.
    stops : tuple of Stop
        All stays.
    moves : tuple of Move
        Trips; a pause lies within one.
    doubtful : tuple of Doubt
        Single fixes far off between gaps, which are left out.
    unseen : int
        Changes of place between stops that were not seen.
    open : bool
        Whether places that are known may tell more.
    """

    fixes: Fixes
    stops: tuple[Stop, ...]
    moves: tuple[Move, ...]
    doubtful: tuple[Doubt, ...]
    unseen: int
    open: bool


def build_timeline(fixes: Fixes, settings: Settings, places: Floats | None = None) -> Timeline:
    """Find the stays and trips of a track.

    Parameters
    ----------
    fixes : Fixes
        At least one.
    settings : Settings
        What counts as which.
    places : float64 array, shape (k, d), optional
        Centres of places that are known from other stays. A single fix between gaps at one of them
        is no error, and a track that was seen there last or first stayed there.

    Returns
    -------
    Timeline

    Examples
    --------
    >>> times = np.arange(0.0, 3001, 10)
    >>> x = np.interp(times, [0, 1000, 2000, 3000], [0, 0, 5000, 5000])
    >>> line = build_timeline(Fixes(times, x[:, None], np.full(301, 10.0)), Settings())
    >>> [(round(stop.start), round(stop.end)) for stop in line.stops]
    [(0, 1000), (2000, 3000)]
    >>> [(round(move.start), round(move.end)) for move in line.moves]
    [(1000, 2000)]
    """
    # Halts, without single fixes that nothing confirms: without these, other ones may be single.
    doubtful: list[Doubt] = []
    for _ in range(_MAX_ROUNDS):
        halts = _find_halts(fixes, settings)
        alone = [
            halt.first
            for halt in halts
            if _is_alone(fixes, halt, settings) and not _is_known(halt, places, settings)
        ]
        if not alone or len(alone) == len(fixes):
            break
        doubtful += [Doubt(float(fixes.times[row]), fixes.positions[row]) for row in alone]
        fixes = fixes.take(~np.isin(np.arange(len(fixes)), alone))

    # Times of stops, and moves between them.
    stops = _estimate_times(fixes, halts, settings, places)
    moves, unseen = _find_moves(fixes, stops, settings)
    stops, moves = _join_over_pauses(stops, moves, settings)
    is_open = bool(doubtful) or any(halt.first == halt.last for halt in halts)
    return Timeline(fixes, tuple(stops), tuple(moves), tuple(doubtful), unseen, is_open)


def _find_halts(fixes: Fixes, settings: Settings) -> list[Halt]:
    """Return halts, with short ones at the far end of round trips, and both ends of long gaps."""
    halts = find_halts(fixes, settings.min_stay, settings.radius) if len(fixes) > 1 else []
    halts = _add_gaps(fixes, halts, settings)
    halts = _merge_halts(fixes, halts, settings)
    halts = _drop_jumps(fixes, halts, settings)
    return _add_turns(fixes, halts, settings)


# Halts.


def _add_gaps(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Add both ends of gaps on the way that are too long for what was travelled meanwhile."""
    # Steps outside of halts.
    gaps = np.diff(fixes.times)
    rows = np.flatnonzero(gaps >= settings.max_pause)
    firsts = np.array([halt.first for halt in halts], np.int64)
    lasts = np.array([halt.last for halt in halts], np.int64)
    owner = np.searchsorted(firsts, rows, side="right") - 1
    inside = (owner >= 0) & (rows < lasts[owner]) if len(halts) else np.zeros(len(rows), bool)

    ends = set()
    for row in rows[~inside].tolist():
        if gaps[row] > _MAX_GAP or _travel_time(fixes, row) < _TRAVEL_SHARE * gaps[row]:
            ends |= {row, row + 1}
    ends -= {row for halt in halts for row in (halt.first, halt.last)}
    singles = [_single(fixes, row, settings) for row in sorted(ends)]
    return sorted([*halts, *singles], key=lambda halt: halt.first)


def _single(fixes: Fixes, row: int, settings: Settings) -> Halt:
    noise = float(fixes.noise[row])
    return Halt(row, row, fixes.positions[row], noise, settings.radius / 2 + noise)


def _merge_halts(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Merge successive halts at one place, unless the track was seen away from it meanwhile."""
    merged: list[Halt] = []
    for halt in halts:
        if (
            merged
            and _is_same(merged[-1], halt, settings)
            and fixes.times[halt.first] - fixes.times[merged[-1].last] <= _MAX_GAP
            and not _leaves(fixes, merged[-1], halt, settings)
        ):
            merged[-1] = _merged(fixes, merged[-1], halt)
        else:
            merged.append(halt)
    return merged


def _is_same(one: Halt, other: Halt, settings: Settings) -> bool:
    noise = max(one.noise, other.noise)
    return _distance(one.centre, other.centre) <= settings.radius + noise


def _merged(fixes: Fixes, one: Halt, other: Halt) -> Halt:
    """Return the halt of two at one place, whose centres count by their time."""
    # Halts of single fixes have no duration.
    times = [float(fixes.times[each.last] - fixes.times[each.first]) + 1.0 for each in (one, other)]
    share = times[0] / sum(times)
    return Halt(
        one.first,
        other.last,
        share * one.centre + (1 - share) * other.centre,
        max(one.noise, other.noise),
        max(one.reach, other.reach),
        share * one.spread + (1 - share) * other.spread,
    )


def _leaves(fixes: Fixes, one: Halt, other: Halt, settings: Settings) -> bool:
    """Whether fixes between two halts lead away from the first, and not just to one spot.

    Fixes of one spot may be an error that lasts, such as the place of another WiFi.
    """
    rows = slice(one.last + 1, other.first)
    positions, noise = fixes.positions[rows], fixes.noise[rows]
    far = _distances(positions, one.centre) - noise > settings.radius
    if far.sum() < _MIN_ROUTE_FIXES:
        return False
    outside, noise = positions[far], noise[far]
    spot = np.median(outside, axis=0)
    return bool((_distances(outside, spot) - noise > settings.radius / 2).any())


def _drop_jumps(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Drop halts to which the track jumps from a place, and back to it.

    Nothing was seen on the way there and back, and it was faster than it can be, or the halt is
    shorter than a pause: an error that lasts.
    """
    kept: list[Halt] = []
    for halt in halts:
        if len(kept) > 1 and _is_error(fixes, kept[-2], kept[-1], halt, settings):
            kept.pop()
            kept[-1] = _merged(fixes, kept[-1], halt)
        else:
            kept.append(halt)
    return kept


def _is_error(fixes: Fixes, one: Halt, halt: Halt, other: Halt, settings: Settings) -> bool:
    """Whether a halt between two at one place is an error."""
    if not _is_same(one, other, settings) or fixes.times[other.first] - fixes.times[one.last] > (
        _MAX_GAP
    ):
        return False
    # Nothing was seen on the way.
    if _is_seen(fixes, one, halt, settings) or _is_seen(fixes, halt, other, settings):
        return False
    is_jump = _is_jump(fixes, one, halt) and _is_jump(fixes, halt, other)
    duration = fixes.times[halt.last] - fixes.times[halt.first]
    return is_jump or (halt.first != halt.last and bool(duration < settings.max_pause))


def _is_seen(fixes: Fixes, one: Halt, other: Halt, settings: Settings) -> bool:
    """Whether a fix between two halts is at neither of both places."""
    rows = slice(one.last + 1, other.first)
    positions, reach = fixes.positions[rows], settings.radius + fixes.noise[rows]
    away = [_distances(positions, halt.centre) > reach for halt in (one, other)]
    return bool((away[0] & away[1]).any())


def _is_jump(fixes: Fixes, one: Halt, other: Halt) -> bool:
    """Whether nobody gets from one halt to the other in the time between, from rest to rest."""
    duration = float(fixes.times[other.first] - fixes.times[one.last])
    noise = float(fixes.noise[one.last] + fixes.noise[other.first])
    way = _distance(fixes.positions[one.last], fixes.positions[other.first]) - noise
    return way > 0 and duration < max(2 * math.sqrt(way / _MAX_ACCELERATION), way / MAX_SPEED)


def _add_turns(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Add short halts at the far end of round trips, which are their goals."""
    if settings.min_stay <= _TURN_TIME or len(fixes) < 2:
        return halts
    radius = settings.radius
    short = find_halts(fixes, _TURN_TIME, radius * _TURN_TIME / settings.min_stay)
    firsts = np.array([halt.first for halt in short], np.int64)

    # Between two halts at one place, or from the first fix to the last if there is none.
    added = list(halts)
    bounds = list(pairwise(halts))
    if not halts and len(fixes) > 1:
        bounds = [(_single(fixes, 0, settings), _single(fixes, len(fixes) - 1, settings))]
    if halts and halts[0].first > 0:
        bounds.append((_single(fixes, 0, settings), halts[0]))
    if halts and halts[-1].last < len(fixes) - 1:
        bounds.append((halts[-1], _single(fixes, len(fixes) - 1, settings)))
    for one, other in bounds:
        rows = slice(one.last + 1, other.first)
        if rows.stop - rows.start < 2 * _MIN_ROUTE_FIXES:
            continue
        farthest = float(_distances(fixes.positions[rows], one.centre).max())
        low, high = np.searchsorted(firsts, [rows.start, rows.stop])
        ends = [
            halt
            for halt in short[low:high]
            if halt.last < rows.stop
            and _distance(halt.centre, one.centre) >= max(_FAR_SHARE * farthest, 3 * radius)
            and _directness(one.centre, halt.centre, other.centre) < _TURNED_BACK
        ]
        if ends:
            added.append(max(ends, key=lambda end: fixes.times[end.last] - fixes.times[end.first]))
    return sorted(added, key=lambda halt: halt.first)


def _directness(begin: Floats, middle: Floats, end: Floats) -> float:
    way = _distance(begin, middle) + _distance(middle, end)
    return _distance(begin, end) / way if way > 0 else 0.0


def _is_alone(fixes: Fixes, halt: Halt, settings: Settings) -> bool:
    """Whether a halt is a single fix with gaps, or the end of the track, on both sides."""
    if halt.first != halt.last:
        return False
    row, last = halt.first, len(fixes) - 1
    before = math.inf if row == 0 else fixes.times[row] - fixes.times[row - 1]
    after = math.inf if row == last else fixes.times[row + 1] - fixes.times[row]
    return bool(min(before, after) >= settings.min_stay)


def _is_known(halt: Halt, places: Floats | None, settings: Settings) -> bool:
    """Whether a halt is at a place that is known."""
    if places is None or not len(places):
        return False
    return bool(_distances(places, halt.centre).min() <= settings.radius + halt.noise)


# Times.


def _estimate_times(
    fixes: Fixes, halts: list[Halt], settings: Settings, places: Floats | None
) -> list[Stop]:
    """Return the stops with estimated times; those that turn out too short are left out."""
    # As they were seen.
    begins = [float(fixes.times[halt.first]) for halt in halts]
    ends = [float(fixes.times[halt.last]) for halt in halts]
    seen = [end - begin for begin, end in zip(begins, ends, strict=True)]
    is_still = [
        duration >= _SEEN_STILL or _is_known(halt, places, settings)
        for duration, halt in zip(seen, halts, strict=True)
    ]

    # When each is left and reached.
    for i, halt in enumerate(halts):
        if i + 1 < len(halts) and halts[i + 1].first == halt.last + 1:
            ends[i], begins[i + 1] = _share_gap(fixes, halt.last, is_still[i], is_still[i + 1])
            continue
        if halt.last + 1 < len(fixes):
            ends[i] = _departure(fixes, halt)
        if i + 1 < len(halts):
            begins[i + 1] = _arrival(fixes, halts[i + 1])
    if halts and halts[0].first > 0:
        begins[0] = _arrival(fixes, halts[0])

    return [
        Stop(begin, end, float(fixes.times[halt.first]), float(fixes.times[halt.last]), halt)
        for begin, end, duration, halt in zip(begins, ends, seen, halts, strict=True)
        if end - begin >= settings.min_stay or duration >= _TURN_TIME
    ]


def _departure(fixes: Fixes, halt: Halt) -> float:
    """Time at which a halt is left: as long before the next fix as the way to there takes."""
    row = halt.last
    way = _distance(fixes.positions[row + 1], halt.centre)
    duration = _WAY_FACTOR * way / _speed_after(fixes, row + 1)
    before, after = fixes.times[row], fixes.times[row + 1]
    return float(max(before, after - duration)) if after - before <= _MAX_GAP else float(before)


def _arrival(fixes: Fixes, halt: Halt) -> float:
    """Time at which a halt is reached: as long after the fix before as the way from there takes."""
    row = halt.first
    way = _distance(fixes.positions[row - 1], halt.centre)
    duration = _WAY_FACTOR * way / _speed_before(fixes, row - 1)
    before, after = fixes.times[row - 1], fixes.times[row]
    return float(min(after, before + duration)) if after - before <= _MAX_GAP else float(after)


def _share_gap(
    fixes: Fixes, row: int, still_before: bool, still_after: bool
) -> tuple[float, float]:
    """When the place before a gap is left, and the one after it is reached.

    Parameters
    ----------
    fixes : Fixes
        A track.
    row : int
        Number of the last fix before the gap.
    still_before, still_after : bool
        Whether the track was seen to be still before the gap, and after it.
    """
    before, after = float(fixes.times[row]), float(fixes.times[row + 1])
    if after - before > _MAX_GAP:
        return before, after
    travel = min(_travel_time(fixes, row), after - before)
    spare = after - before - travel

    # Whoever is on the way goes on to where it is seen next.
    if still_before and still_after:
        return before + spare / 2, after - spare / 2
    if still_before:
        return after - travel, after
    return before, before + travel


def _travel_time(fixes: Fixes, row: int) -> float:
    """Seconds that the way between two successive fixes takes at the speed around it."""
    way = _distance(fixes.positions[row], fixes.positions[row + 1])
    speeds = (_speed_before(fixes, row), _speed_after(fixes, row + 1), _usual_speed(way))
    return _WAY_FACTOR * way / max(speeds)


def _usual_speed(way: float) -> float:
    return next(speed for longest, speed in _USUAL_SPEEDS if way <= longest)


def _speed_before(fixes: Fixes, row: int) -> float:
    """Speed of the fixes up to one, but that of a walk at least."""
    first = int(np.searchsorted(fixes.times, fixes.times[row] - _SPEED_TIME))
    return max(_speed(fixes, first, row), _WALKING_SPEED)


def _speed_after(fixes: Fixes, row: int) -> float:
    """Speed of the fixes from one on, but that of a walk at least."""
    last = int(np.searchsorted(fixes.times, fixes.times[row] + _SPEED_TIME, side="right")) - 1
    return max(_speed(fixes, row, last), _WALKING_SPEED)


def _speed(fixes: Fixes, first: int, last: int) -> float:
    if first >= last:
        return 0.0
    way = _distance(fixes.positions[first], fixes.positions[last])
    noise = float(fixes.noise[first] + fixes.noise[last])
    speed = max(way - noise, 0.0) / float(fixes.times[last] - fixes.times[first])
    return speed if speed <= MAX_SPEED else 0.0


# Moves.


def _find_moves(fixes: Fixes, stops: list[Stop], settings: Settings) -> tuple[list[Move], int]:
    """Return the moves between stops that are trips, and the number of those not seen."""
    moves, unseen = list[Move](), 0
    for i in range(len(stops) + 1):
        one, other = (stops[i - 1] if i else None), (stops[i] if i < len(stops) else None)
        move = _find_trip(fixes, one, other, settings)
        if move is not None:
            goal = i if other is not None else None
            moves.append(Move(*move, None if one is None else i - 1, goal))
        elif one is not None and other is not None:
            unseen += not _is_same(one.halt, other.halt, settings)
    return moves, unseen


def _find_trip(
    fixes: Fixes, one: Stop | None, other: Stop | None, settings: Settings
) -> tuple[float, float, Floats, Floats] | None:
    """Return times and positions of begin and end of the trip between two stops, if there is one.

    Without a stop, the track begins or ends on the way.
    """
    # Where it begins and ends, and when.
    first = _edge_halt(fixes, 0, settings) if one is None else one.halt
    last = _edge_halt(fixes, len(fixes) - 1, settings) if other is None else other.halt
    if first.last >= last.first:
        return None
    start = float(fixes.times[first.last]) if one is None else one.end
    end = float(fixes.times[last.first]) if other is None else other.start

    # Fixes on the way lead away from both ends, and from where it began by more than their errors.
    rows = slice(first.last + 1, last.first)
    positions, noise = fixes.positions[rows], fixes.noise[rows]
    from_first, from_last = (_distances(positions, halt.centre) for halt in (first, last))
    on_the_way = (from_first > first.reach) & (from_last > last.reach)
    farthest = float((from_first - noise).max(initial=0.0))
    way = _distance(first.centre, last.centre) - first.noise - last.noise
    if max(farthest, way) <= settings.radius:
        return None
    trip = (start, end, first.centre, last.centre)
    if int(on_the_way.sum()) >= _MIN_ROUTE_FIXES:
        return trip

    # Else the two ends must say it.
    known = one is not None and other is not None
    fills = known and not _is_jump(fixes, first, last) and _fills(fixes, first, last)
    return trip if fills and way > settings.radius else None


def _edge_halt(fixes: Fixes, row: int, settings: Settings) -> Halt:
    """Return the fixes at the first or the last position of a track that are in place there."""
    centre, noise = fixes.positions[row], float(fixes.noise[row])
    reach = settings.radius / 2 + noise
    away = np.flatnonzero(_distances(fixes.positions, centre) > reach + fixes.noise)
    if not len(away):
        return Halt(0, len(fixes) - 1, centre, noise, reach)
    if row == 0:
        return Halt(0, int(away[0]) - 1, centre, noise, reach)
    return Halt(int(away[-1]) + 1, row, centre, noise, reach)


def _fills(fixes: Fixes, one: Halt, other: Halt) -> bool:
    """Whether the way from one halt to the next takes a good part of the time between them."""
    way = _distance(one.centre, other.centre)
    gap = float(fixes.times[other.first] - fixes.times[one.last])
    return gap <= _MAX_GAP and _WAY_FACTOR * way / _usual_speed(way) >= _TRAVEL_SHARE * gap


def _join_over_pauses(
    stops: list[Stop], moves: list[Move], settings: Settings
) -> tuple[list[Stop], list[Move]]:
    """Join trips that go on in their direction after a short stop, which becomes a pause."""
    stops, joined = list(stops), list[Move]()
    for move in moves:
        before = joined[-1] if joined else None
        stop = None if move.origin is None else stops[move.origin]
        if (
            before is not None
            and stop is not None
            and move.origin is not None
            and before.goal == move.origin
            and stop.duration < settings.max_pause
            and _directness(before.begin, stop.halt.centre, move.finish) >= _ON_THE_WAY
        ):
            stops[move.origin] = replace(stop, pause=True)
            joined[-1] = replace(before, end=move.end, finish=move.finish, goal=move.goal)
        else:
            joined.append(move)
    return stops, joined


def _distance(one: Floats, other: Floats) -> float:
    return math.dist(one, other)


def _distances(positions: Floats, centre: Floats) -> Floats:
    distances: Floats = np.sqrt(((positions - centre) ** 2).sum(axis=1))
    return distances
