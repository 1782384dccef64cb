"""Filling gaps: the most likely way over roads between the samples around each, at the log's own rhythm (thesis, chapter 5.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.gaps import estimate_gap, find_long_intervals
from gpszip.geo.planes import plane_changes
from gpszip.matching.alternatives import PathFinder, RoadPath, RoadPosition, TravelCosts
from gpszip.matching.headings import read_headings
from gpszip.matching.match import match
from gpszip.matching.nearby_roads import NearbyRoads
from gpszip.matching.road_speeds import estimate_road_slowness
from gpszip.matching.speeds import (
    MotionStatistics,
    bend_speed,
    interpolate_progress,
    measure_motion,
)
from gpszip.model import Network, Patch, Patching, Track
from gpszip.model.match import Match

__all__ = ["patch"]

#: Prices in seconds of turning off by a right angle, and of turning round: little, as maps lack links and matching errs at crossings.
_TURN, _U_TURN = 3.0, 20.0

#: A way that takes so many seconds, and this share of the gap, longer than another is less likely by a factor of e.
_LOSS, _SHARE = 8.0, 0.1

#: Waiting takes this share of a gap, in the mean, and who goes faster than usual does so by this factor (as a logarithm).
_WAIT, _HURRY = 0.5, 0.3

#: How much less likely (as a logarithm) roads near the end of a gap are that matching didn't choose, and going against their direction.
_STRAY, _AGAINST = 4.0, 4.0

#: So many ways are compared; so many seconds tell the speed at an end of a gap, or as many as usually lead so many errors away.
_WAYS, _SECONDS, _AWAY = 40, 3.0, 4.0

#: From the median distance to the road to its standard deviation, and the least that this counts for in metres.
_TO_SIGMA, _LEAST = 1.4826, 0.1

#: An agent that takes longer than so many times what its way takes, and this many seconds more, may have been anywhere.
_IDLE, _IDLER = 3.0, 600.0

#: A way that usually takes so many times as long as the gap wasn't taken: the network lacks a road.
_LATE = 2.0

#: A way that asks for a speed so many times as high as the log's highest wasn't taken.
_HASTE = 1.3

#: A gap in which more points than this would be added is none of lost samples.
_MOST_POINTS = 1_000_000

Floats = NDArray[np.float64]


def patch(
    tracks: Sequence[Track] | Track,
    network: Network,
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill the gaps of tracks with the most likely ways over roads.

    Of all ways between the roads on which a gap begins and ends, that one is taken which best explains the time that passed: it is
    quick, and neither too short nor too long for the speed that the log shows. Along it the agent goes from the speed before the gap
    to that after it, as fast as the roads allow and slower in bends, for as long as the gap takes.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        The log.
    network : Network
        Roads on the same plane.
    gap : float, optional
        Seconds above which a step is a gap; estimated from the log by default.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by those who walk or cycle.

    Returns
    -------
    Patching

    Raises
    ------
    InputError
        If a track has no times.
    OptionError
        If there is no track or no road, tracks and roads lie on different planes, or the gap is not positive.
    """
    several = [tracks] if isinstance(tracks, Track) else list(tracks)
    if not several or not len(network):
        raise OptionError("patching needs at least one track and one road")
    if any(track.plane != network.plane for track in several):
        raise OptionError(
            "the roads are not on the plane of the tracks; read them with near=tracks"
        )
    untimed = [track.id for track in several if not track.timed]
    if untimed:
        which = (
            f"track {untimed[0]!r} has"
            if len(untimed) == 1
            else f"{len(untimed):,} tracks, the first of them {untimed[0]!r}, have"
        )
        raise InputError(
            f"{which} no times, so there are no gaps to fill; leave such tracks out, or match them instead"
        )
    if ignore_oneway:
        network = network.two_way()
    wanted = estimate_gap(several) if gap is None else gap
    if not wanted > 0:
        raise OptionError(f"a gap of {wanted:g} s; it must be a positive number of seconds")
    if not any(find_long_intervals(track.times, wanted).any() for track in several):
        return Patching(tuple(several), (), wanted)
    matches = match(several, network, gap=wanted)
    error = _error(np.concatenate([found.distance for found in matches]))
    everybody = measure_motion(several, wanted, error)
    motion = [_own(measure_motion([track], wanted, error), everybody, track) for track in several]
    slowness = estimate_road_slowness(several, list(matches), motion, network, wanted)
    finder, near = PathFinder(network), NearbyRoads(network)
    patches: list[Patch] = []
    for number, (track, found) in enumerate(zip(several, matches, strict=True)):
        gaps = np.flatnonzero(find_long_intervals(track.times, wanted))
        if not len(gaps):
            continue
        filler = _Filler(finder, near, track, found, motion[number], slowness, wanted)
        apart = plane_changes(track.positions, track.plane)
        patches += [filler.fill(number, int(after), apart=bool(apart[after])) for after in gaps]
    return Patching(tuple(several), tuple(patches), wanted)


def _own(motion: MotionStatistics, everybody: MotionStatistics, track: Track) -> MotionStatistics:
    """One agent's habits, or everybody's where it shows too little of its own."""
    return motion if len(track) > 60 else everybody


class _Filler:
    """Fills the gaps of one track."""

    def __init__(
        self,
        finder: PathFinder,
        near: NearbyRoads,
        track: Track,
        found: Match,
        motion: MotionStatistics,
        slowness: Floats,
        gap: float,
    ) -> None:
        self.finder, self.near, self.track, self.match, self.motion = (
            finder,
            near,
            track,
            found,
            motion,
        )
        steps = np.diff(track.times)
        usual = steps[steps <= gap]
        self.rhythm = float(np.median(usual)) if len(usual) else gap
        self.travel_time = slowness * np.maximum(finder.lengths, 1e-3) / motion.mean_speed
        heeded = math.isfinite(found.scales.heading)
        self.headings = read_headings(track) if heeded else np.zeros((len(track), 2))
        self.error = _error(found.distance)

    def fill(self, number: int, after: int, *, apart: bool) -> Patch:
        """Fill the gap after a sample, or say why not."""
        seconds = float(self.track.times[after + 1] - self.track.times[after])
        reason = (
            "it leads to another part of the world" if apart else self._hopeless(after, seconds)
        )
        if reason:
            return self._open(number, after, seconds, reason)
        ways = self._ways(after, seconds)
        if isinstance(ways, str):
            return self._open(number, after, seconds, ways)
        scores = np.array([self._score(way, after, seconds) for way in ways])
        best = ways[int(scores.argmax())]
        line, owner = self._cut(best, after)
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        reason = self._implausible(best, length, seconds)
        if reason:
            return self._open(number, after, seconds, reason)
        times, at = self._times(best, line, owner, length, after, seconds)
        positions, road = _positions(line, owner, at)
        likely = np.exp(scores - scores.max())
        confidence = _confidence(ways, likely / likely.sum(), best)[road]
        return Patch(
            number, after, seconds, times, self._lifted(positions, after, times), confidence, length
        )

    def _open(self, number: int, after: int, seconds: float, reason: str) -> Patch:
        nothing = np.empty(0)
        return Patch(
            number,
            after,
            seconds,
            nothing,
            np.empty((0, self.track.dimension)),
            nothing,
            reason=reason,
        )

    def _hopeless(self, after: int, seconds: float) -> str:
        if seconds / self.rhythm > _MOST_POINTS:
            return "it is too long"
        straight = float(np.linalg.norm(np.diff(self.track.positions[after : after + 2], axis=0)))
        if straight / seconds > _HASTE * self.motion.top_speed:
            return f"it would take {straight / seconds:.3g} m/s even straight ahead"
        return ""

    def _implausible(self, way: RoadPath, length: float, seconds: float) -> str:
        if length / seconds > _HASTE * max(
            self.motion.top_speed, float((self.finder.lengths / self.travel_time)[way.roads].max())
        ):
            return f"the shortest way would take {length / seconds:.3g} m/s"
        takes = self._takes(way)
        if takes > _LATE * seconds + self.rhythm:
            return f"the shortest way takes {takes:.0f} s, and the gap only {seconds:.0f} s"
        if seconds > _IDLE * takes + _IDLER:
            return f"the way takes {takes:.0f} s, and the agent may have been anywhere in the rest of {seconds:.0f} s"
        return ""

    def _ways(self, after: int, seconds: float) -> list[RoadPath] | str:
        """Ways from a little before the gap to a little after it, since the last roads seen are the least sure."""
        worth = _worth(seconds)
        starts, ends = self._places(after, -1, worth), self._places(after + 1, 1, worth)
        if not starts or not ends:
            return f"it {'ends' if starts else 'begins'} off the roads"
        ways = self.finder.find_paths(
            starts,
            ends,
            TravelCosts(self.travel_time, _TURN, _U_TURN),
            slack=min(60.0, seconds),
            max_paths=_WAYS,
        )
        return ways or "no way over the roads leads through it"

    def _places(self, sample: int, side: int, worth: float) -> list[RoadPosition]:
        """Where the way may have begun (or ended): where matching says, and on other roads near."""
        matched = self.match.edge[sample] >= 0
        likely = [self._matched(sample, side)] if matched else []
        reach = 3 * self.error + (float(self.match.distance[sample]) if matched else 0.0)
        heading = self._heading(sample, side)
        for road, offset, distance, along in zip(
            *self.near.near(self.track.positions[sample], reach), strict=True
        ):
            for against, open_ in enumerate(
                (self.finder.network.forward, self.finder.network.backward)
            ):
                if open_[road]:
                    turned = (
                        1 - float(along @ heading) * (1 - 2 * against)
                        if heading is not None
                        else 0.0
                    )
                    doubt = (
                        0.5 * (float(distance) / self.error) ** 2
                        + _AGAINST * turned / 2
                        + _STRAY * matched
                    )
                    likely.append(
                        RoadPosition(2 * int(road) + against, float(offset), doubt * worth)
                    )
        return likely

    def _heading(self, sample: int, side: int) -> Floats | None:
        """Unit vector of travel beside a gap: what the log tells, or where the agent moved by more than the error."""
        if self.headings[sample].any():
            return np.asarray(self.headings[sample])
        positions = self.track.positions[:, :2]
        near = (
            positions[sample - 60 if sample >= 60 else 0 : sample + 1][::-1]
            if side < 0
            else positions[sample : sample + 61]
        )
        far = np.flatnonzero(np.linalg.norm(near - near[0], axis=1) > 2 * self.error)
        if not len(far):
            return None
        step = (near[far[0]] - near[0]) * side
        unit: Floats = step / np.linalg.norm(step)
        return unit

    def _matched(self, sample: int, side: int) -> RoadPosition:
        """Place on the route, two errors farther from the gap than the sample is."""
        found = self.match
        route = found.pieces[found.piece[sample]].route
        ends = np.cumsum(route.lengths)
        at = float(np.clip(found.along[sample] + side * 2 * self.error, 0.0, ends[-1]))
        leg = min(
            int(np.searchsorted(ends, at, side="left" if side < 0 else "right")), len(ends) - 1
        )
        forward = bool(route.forward[leg])
        share = at - (float(ends[leg - 1]) if leg else 0.0)
        offset = float(route.begin[leg]) + (share if forward else -share)
        edge = int(route.edges[leg])
        return RoadPosition(
            2 * edge + (not forward), float(np.clip(offset, 0.0, self.finder.lengths[2 * edge]))
        )

    def _score(self, way: RoadPath, after: int, seconds: float) -> float:
        """Logarithm of how likely a way is, up to a constant.

        Who knows the roads takes a quick way; the rest of the time is spent waiting, and few are much quicker than usual.
        """
        expected = max(self._takes(way), self.rhythm)
        off = 0.0
        if way.penalty == 0:
            line, _ = self._cut(way, after)
            squares = (
                (self.track.positions[after : after + 2, : line.shape[1]] - line[[0, -1]]) ** 2
            ).sum(axis=1) / self.error**2
            off = float(
                np.log1p(0.5 * squares).sum()
            )  # receivers err much where they come out of a tunnel
        late = (
            (seconds - expected) / (_WAIT * seconds)
            if seconds > expected
            else 0.5 * (math.log(expected / seconds) / _HURRY) ** 2
        )
        return -(way.cost + way.penalty) / _worth(seconds) - late - off

    def _takes(self, way: RoadPath) -> float:
        """Seconds of travel on a way."""
        return self.finder.travel_time(way, TravelCosts(self.travel_time, 0.0, 0.0))

    def _cut(self, way: RoadPath, after: int) -> tuple[Floats, NDArray[np.int64]]:
        """The part of a way between the samples' places on it."""
        line, owner = self.finder.line(way)
        reach = 6 * self.error
        positions = self.track.positions[:, : line.shape[1]]
        first = _nearest(line, positions[after], 0.0, reach)
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        last = max(_nearest(line, positions[after + 1], length - reach, length), first)
        return _between(line, owner, first, last)

    def _times(
        self,
        way: RoadPath,
        line: Floats,
        owner: NDArray[np.int64],
        length: float,
        after: int,
        seconds: float,
    ) -> tuple[Floats, Floats]:
        """Times of the samples to add, and how far along the line they are."""
        times = self.track.times
        when = np.arange(1, math.ceil(seconds / self.rhythm - 0.5)) * self.rhythm
        at = np.linspace(0.0, length, max(int(length / max(2.0, length / 2000)), 2))
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        road = way.roads[
            owner[np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(owner) - 1)]
        ]
        speed = (self.finder.lengths / self.travel_time)[road]
        speed = np.minimum(
            speed,
            bend_speed(
                line, at, self.motion.acceleration, max(float(speed.max()), self.motion.mean_speed)
            ),
        )
        pace = 1.0 / np.maximum(speed, 0.05 * self.motion.mean_speed)
        clock = np.append(0.0, np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(at)))
        few = max(int(np.searchsorted(at, 12.0)), 1)
        before, beyond = (
            self._speed(after + (side > 0), side) * float(pace[part].mean())
            for side, part in _ends(few)
        )
        progress = interpolate_progress(
            seconds, float(clock[-1]), before, beyond, self.motion.correlation_time(seconds)
        )
        return times[after] + when, np.interp(np.interp(when, *progress), clock, at)

    def _speed(self, sample: int, side: int) -> float:
        """Speed over a few seconds beside a gap."""
        times, along, piece = self.track.times, self.match.along, self.match.piece
        reach = max(_SECONDS, 1.5 * self.rhythm, _AWAY * self.error / self.motion.mean_speed)
        near = np.flatnonzero(
            (side * (times - times[sample]) >= 0)
            & (np.abs(times - times[sample]) <= reach)
            & (piece == piece[sample])
        )
        if len(near) < 2:
            return self.motion.mean_speed
        return float(abs(along[near[-1]] - along[near[0]]) / (times[near[-1]] - times[near[0]]))

    def _lifted(self, positions: Floats, after: int, times: Floats) -> Floats:
        """Further coordinates, which roads don't have, straight from one end to the other."""
        ends, when = self.track.positions[after : after + 2], self.track.times[after : after + 2]
        flat = positions[:, : self.track.dimension]
        rest = [
            np.interp(times, when, ends[:, axis])
            for axis in range(flat.shape[1], self.track.dimension)
        ]
        return np.column_stack([flat, *rest])


def _error(distances: Floats) -> float:
    """Standard deviation of samples from their roads, deaf to strays."""
    known = distances[np.isfinite(distances)]
    return max(_TO_SIGMA * float(np.median(known)), _LEAST) if len(known) else _LEAST


def _worth(seconds: float) -> float:
    """Seconds by which a way must be slower than another to be less likely by a factor of e."""
    return _LOSS + _SHARE * seconds


def _ends(few: int) -> tuple[tuple[int, slice], tuple[int, slice]]:
    return (-1, slice(few)), (1, slice(-few, None))


def _nearest(line: Floats, point: Floats, low: float, high: float) -> float:
    """Metres along a line to where it is nearest to a point, of the part between two places."""
    steps = np.diff(line, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    along = np.append(0.0, np.cumsum(sizes))
    low, high = max(low, 0.0), min(high, float(along[-1]))
    if not len(steps) or high <= low:
        return max(low, 0.0)
    share = ((point - line[:-1]) * steps).sum(axis=1) / np.maximum(sizes**2, 1e-12)
    least, most = (
        np.clip((low - along[:-1]) / np.maximum(sizes, 1e-9), 0, 1),
        np.clip((high - along[:-1]) / np.maximum(sizes, 1e-9), 0, 1),
    )
    share = np.clip(share, least, most)
    off = np.linalg.norm(line[:-1] + share[:, None] * steps - point, axis=1)
    off[(along[1:] < low) | (along[:-1] > high)] = np.inf
    best = int(off.argmin())
    return float(along[best] + share[best] * sizes[best])


def _between(
    line: Floats, owner: NDArray[np.int64], first: float, last: float
) -> tuple[Floats, NDArray[np.int64]]:
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    inner = np.flatnonzero((along > first) & (along < last))
    at = np.concatenate(([first], along[inner], [last]))
    points = np.stack([np.interp(at, along, axis) for axis in line.T], axis=1)
    begin = owner[np.clip(np.searchsorted(along, first, side="right") - 1, 0, len(owner) - 1)]
    return points, np.concatenate(
        ([begin], owner[inner], owner[inner][-1:] if len(inner) else [begin])
    )


def _positions(
    line: Floats, owner: NDArray[np.int64], at: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Places along a line, and the number of the road of each."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    road = owner[np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(owner) - 1)]
    return np.stack([np.interp(at, along, axis) for axis in line.T], axis=1), road


def _confidence(ways: Sequence[RoadPath], likely: Floats, best: RoadPath) -> Floats:
    """Probability of each road of the best way: that of all ways that use it."""
    chance = np.zeros(len(best.roads))
    for way, one in zip(ways, likely.tolist(), strict=True):
        chance += one * np.isin(best.roads, way.roads)
    return np.minimum(chance, 1.0)
