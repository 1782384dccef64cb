"""Filling gaps with the most likely path over roads, at the log's own sampling interval.

Thesis, chapter 5.2.
"""

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

__all__ = ["find_all_gaps", "patch"]

# Costs of a path.

#: Seconds for turning off by a right angle: few, since maps lack links and matching errs at
#: crossings.
_TURN_COST = 3.0

#: Seconds for turning round.
_U_TURN_COST = 20.0

#: Number of alternative paths that are compared.
_MAX_PATHS = 40

#: Most seconds by which a path may cost more than twice the cheapest.
_MAX_SLACK = 60.0

# Likelihood of a path.

#: Seconds that a path must cost more than another to be less likely by a factor of e ...
_COST_SCALE = 8.0

#: ... and as a share of the gap, which is added to them.
_COST_SCALE_SHARE = 0.1

#: Mean share of a gap that is spent waiting.
_MEAN_WAIT = 0.5

#: Standard deviation of the logarithm by which an agent is faster than its mean.
_HURRY = 0.3

#: Logarithm by which a road beside the matched one is less likely at the end of a gap.
_OTHER_ROAD_COST = 4.0

#: Logarithm by which a road is less likely that leads against the direction of travel there.
_OPPOSITE_COST = 4.0

#: Distance, in errors, within which other roads count at the end of a gap.
_OTHER_ROAD_RADIUS = 3.0

#: Distance, in errors, from the end of a gap at which the matched route is believed.
_BACK_OFF = 2.0

#: Distance, in errors, of a movement that shows a direction of travel.
_MIN_MOVE = 2.0

#: Samples beside a gap among which that movement is looked for.
_DIRECTION_SAMPLES = 60

#: Distance, in errors, along a path within which the sample at its end lies on it.
_CUT_RADIUS = 6.0

# Errors of the samples.

#: Ratio of the standard deviation of a normal distribution to its median absolute value.
_MEDIAN_TO_SIGMA = 1.4826

#: Least error in metres.
_MIN_ERROR = 0.1

#: Samples below which a track's motion is that of the log.
_MIN_MOTION_SAMPLES = 60

# Times along a path.

#: Seconds beside a gap over which its speed is measured, at least.
_SPEED_SECONDS = 3.0

#: The same in sampling intervals.
_SPEED_INTERVALS = 1.5

#: The same in errors, at the mean speed.
_SPEED_ERRORS = 4.0

#: Metres from the ends of a path over which that speed is compared with the roads' own.
_END_METRES = 12.0

#: Step in metres at which speeds along a path are computed ...
_SPEED_STEP = 2.0

#: ... or the most steps, on a long one.
_MAX_SPEED_STEPS = 2000

#: Least speed along a path, as a share of the mean speed.
_MIN_SPEED = 0.05

# Gaps that are left open.

#: An agent with more time than this many times its travel time, and the seconds below, may have
#: been anywhere.
_MAX_WAIT = 3.0

#: See above.
_MAX_WAIT_SECONDS = 600.0

#: Travel time, in gaps, above which a path was not taken: the network lacks a road.
_MAX_LATENESS = 2.0

#: Speed, in top speeds, above which a path was not taken.
_MAX_HASTE = 1.3

#: Most samples added in a gap; a longer one is not due to lost samples.
_MAX_SAMPLES = 1_000_000

# Least divisors.

#: Metres of a road.
_MIN_ROAD_LENGTH = 1e-3

#: Metres of a line segment.
_MIN_SEGMENT_LENGTH = 1e-9

#: Square metres of a line segment's squared length.
_MIN_SQUARE = 1e-12

#: Side of a gap: before it.
_BEFORE = -1

#: Side of a gap: after it.
_AFTER = 1

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


def patch(
    tracks: Sequence[Track] | Track,
    network: Network,
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill the gaps of tracks with the most likely paths over roads.

    Of all plausible paths between the roads at both ends of a gap, the one is taken that best
    explains the time: it is quick, and neither too short nor too long for the speeds in the log.
    Along it the agent goes from the speed before the gap to that after it, as fast as the roads
    allow, slower in bends, and for as long as the gap takes.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        The log.
    network : Network
        Roads on the same plane.
    gap : float, optional
        Seconds above which an interval is a gap; estimated from the log by default.
    ignore_oneway : bool, default False
        Whether all roads may be travelled in both directions, as by pedestrians and cyclists.

    Returns
    -------
    Patching

    Raises
    ------
    InputError
        If a track has no times.
    OptionError
        If there is no track or no road, tracks and roads lie on different planes, or the gap is not
        positive.
    """
    # Find the gaps; a log without any stays as it is, and is not matched.
    log = [tracks] if isinstance(tracks, Track) else list(tracks)
    gap, long_intervals = find_all_gaps(log, network, gap)
    if ignore_oneway:
        network = network.two_way()
    if not any(map(np.any, long_intervals)):
        return Patching(tuple(log), (), gap)

    # Roads of the log, and how its agents move.
    matches = match(log, network, gap=gap)
    error = _robust_error(np.concatenate([matched.distance for matched in matches]))
    log_motion = measure_motion(log, gap, error)
    motion = [
        measure_motion([track], gap, error) if len(track) > _MIN_MOTION_SAMPLES else log_motion
        for track in log
    ]
    slowness = estimate_road_slowness(log, list(matches), motion, network, gap)

    # Each gap of each track.
    finder, nearby_roads = PathFinder(network), NearbyRoads(network)
    patches: list[Patch] = []
    for number, (track, matched) in enumerate(zip(log, matches, strict=True)):
        gaps = np.flatnonzero(long_intervals[number])
        if not len(gaps):
            continue
        filler = _GapFiller(finder, nearby_roads, track, matched, motion[number], slowness, gap)
        changes_plane = plane_changes(track.positions, track.plane)
        patches += [
            filler.fill(number, int(after), changes_plane=bool(changes_plane[after]))
            for after in gaps
        ]
    return Patching(tuple(log), tuple(patches), gap)


def find_all_gaps(
    tracks: Sequence[Track], network: Network, gap: float | None = None
) -> tuple[float, list[NDArray[np.bool_]]]:
    """Find the gaps that patching would try to fill.

    Parameters and exceptions are those of :func:`patch`.

    Returns
    -------
    float
        Seconds above which an interval is a gap.
    list of bool array, shape (n - 1,)
        Which intervals of each track are gaps.
    """
    _check(tracks, network)
    gap = estimate_gap(tracks) if gap is None else gap
    if not gap > 0:
        raise OptionError(f"a gap of {gap:g} s; it must be a positive number of seconds")
    return gap, [find_long_intervals(track.times, gap) for track in tracks]


def _check(tracks: Sequence[Track], network: Network) -> None:
    """Check that the gaps of tracks can be filled on a network."""
    # There must be tracks and roads, on one plane, and times to tell gaps by.
    if not tracks or not len(network):
        raise OptionError("patching needs at least one track and one road")
    if any(track.plane != network.plane for track in tracks):
        raise OptionError(
            "the roads are not on the plane of the tracks; read them with near=tracks"
        )
    untimed = [track.id for track in tracks if not track.timed]
    if untimed:
        which = (
            f"track {untimed[0]!r} has"
            if len(untimed) == 1
            else f"{len(untimed):,} tracks, the first of them {untimed[0]!r}, have"
        )
        raise InputError(
            f"{which} no times, so there are no gaps to fill; "
            "leave such tracks out, or match them instead"
        )


class _GapFiller:
    """Fills the gaps of one track. A gap is named by the sample after which it lies."""

    def __init__(
        self,
        finder: PathFinder,
        nearby_roads: NearbyRoads,
        track: Track,
        match: Match,
        motion: MotionStatistics,
        slowness: Floats,
        gap: float,
    ) -> None:
        # The roads, and the track as matched to them.
        self.finder = finder
        self.nearby_roads = nearby_roads
        self.track = track
        self.match = match
        self.motion = motion

        # Sampling interval of the log.
        steps = np.diff(track.times)
        steps = steps[steps <= gap]
        self.interval = float(np.median(steps)) if len(steps) else gap

        # Seconds on each directed road, and speeds.
        road_lengths = np.maximum(finder.lengths, _MIN_ROAD_LENGTH)
        self.travel_time = slowness * road_lengths / motion.mean_speed
        self.road_speed = finder.lengths / self.travel_time

        # Headings, unless the match ignores them, and the error of samples in metres.
        uses_headings = math.isfinite(match.scales.heading)
        self.headings = read_headings(track) if uses_headings else np.zeros((len(track), 2))
        self.error = _robust_error(match.distance)

    def fill(self, number: int, after: int, *, changes_plane: bool) -> Patch:
        """Fill a gap of the track with this number, or say why not."""
        # Gaps that no path fills.
        seconds = float(self.track.times[after + 1] - self.track.times[after])
        reason = (
            "it leads to another part of the world"
            if changes_plane
            else self._reason_to_skip(after, seconds)
        )
        if reason:
            return self._leave_open(number, after, seconds, reason)
        paths = self._find_paths(after, seconds)
        if isinstance(paths, str):
            return self._leave_open(number, after, seconds, paths)

        # The most likely path.
        log_likelihoods = np.array([self._log_likelihood(path, after, seconds) for path in paths])
        best = paths[int(log_likelihoods.argmax())]
        line, owner = self._cut(best, after)
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        reason = self._reason_to_reject(best, length, seconds)
        if reason:
            return self._leave_open(number, after, seconds, reason)

        # Samples along it.
        times, along = self._sample_times(best, line, owner, length, after, seconds)
        positions, road = _interpolate_line(line, owner, along)
        likelihoods = np.exp(log_likelihoods - log_likelihoods.max())
        confidence = _road_probabilities(paths, likelihoods / likelihoods.sum(), best)[road]
        positions = self._add_other_coordinates(positions, after, times)
        return Patch(number, after, seconds, times, positions, confidence, length)

    def _leave_open(self, number: int, after: int, seconds: float, reason: str) -> Patch:
        nothing = np.empty(0)
        no_positions = np.empty((0, self.track.dimension))
        return Patch(number, after, seconds, nothing, no_positions, nothing, reason=reason)

    def _reason_to_skip(self, after: int, seconds: float) -> str:
        """Why no path is looked for; empty if one is."""
        if seconds / self.interval > _MAX_SAMPLES:
            return "it is too long"
        straight = float(np.linalg.norm(np.diff(self.track.positions[after : after + 2], axis=0)))
        if straight / seconds > _MAX_HASTE * self.motion.top_speed:
            return f"it would take {straight / seconds:.3g} m/s even straight ahead"
        return ""

    def _reason_to_reject(self, path: RoadPath, length: float, seconds: float) -> str:
        """Why the most likely path was not taken; empty if it may have been."""
        top_speed = max(self.motion.top_speed, float(self.road_speed[path.roads].max()))
        if length / seconds > _MAX_HASTE * top_speed:
            return f"the shortest path would take {length / seconds:.3g} m/s"
        travel_time = self._travel_time(path)
        if travel_time > _MAX_LATENESS * seconds + self.interval:
            return f"the shortest path takes {travel_time:.0f} s, and the gap only {seconds:.0f} s"
        if seconds > _MAX_WAIT * travel_time + _MAX_WAIT_SECONDS:
            return (
                f"the path takes {travel_time:.0f} s, and the agent may have been anywhere "
                f"in the rest of {seconds:.0f} s"
            )
        return ""

    def _find_paths(self, after: int, seconds: float) -> list[RoadPath] | str:
        """Find the paths through a gap, or say why there are none.

        They begin a little before the gap and end a little after it, since the last roads are the
        least certain.
        """
        cost_scale = _cost_scale(seconds)
        starts = self._end_positions(after, _BEFORE, cost_scale)
        ends = self._end_positions(after + 1, _AFTER, cost_scale)
        if not starts or not ends:
            return f"it {'ends' if starts else 'begins'} off the roads"
        paths = self.finder.find_paths(
            starts,
            ends,
            TravelCosts(self.travel_time, _TURN_COST, _U_TURN_COST),
            slack=min(_MAX_SLACK, seconds),
            max_paths=_MAX_PATHS,
        )
        return paths or "no path over the roads leads through it"

    def _end_positions(self, sample: int, side: int, cost_scale: float) -> list[RoadPosition]:
        """Where a path may begin or end: where matching says, and on other roads near.

        The penalty of a road is ``cost_scale`` times the cost of its distance and direction.
        """
        # The matched position, and the radius in metres within which other roads are possible.
        is_matched = bool(self.match.edge[sample] >= 0)
        positions = [self._matched_position(sample, side)] if is_matched else []
        radius = _OTHER_ROAD_RADIUS * self.error
        if is_matched:
            radius += float(self.match.distance[sample])
        heading = self._direction_of_travel(sample, side)
        network = self.finder.network

        # Add the open directions of roads near. Distance and another direction than that of travel
        # cost, and so does any position but the matched one.
        for road, offset, distance, direction in zip(
            *self.nearby_roads.near(self.track.positions[sample], radius), strict=True
        ):
            for is_backward, is_open in enumerate((network.forward, network.backward)):
                if not is_open[road]:
                    continue
                turn = 0.0  # 1 - cosine
                if heading is not None:
                    turn = 1 - float(direction @ heading) * (1 - 2 * is_backward)
                cost = (
                    0.5 * (float(distance) / self.error) ** 2
                    + _OPPOSITE_COST * turn / 2
                    + _OTHER_ROAD_COST * is_matched
                )
                positions.append(
                    RoadPosition(2 * int(road) + is_backward, float(offset), cost * cost_scale)
                )
        return positions

    def _direction_of_travel(self, sample: int, side: int) -> Floats | None:
        """Unit vector of travel beside a gap: the heading, or the movement beyond the error."""
        # A heading in the log is the direction of travel.
        if self.headings[sample].any():
            return np.asarray(self.headings[sample])

        # Samples from the gap on.
        positions = self.track.positions[:, :2]
        if side == _BEFORE:
            first = max(sample - _DIRECTION_SAMPLES, 0)
            positions = positions[first : sample + 1][::-1]
        else:
            positions = positions[sample : sample + _DIRECTION_SAMPLES + 1]

        # The first that is far enough.
        distances = np.linalg.norm(positions - positions[0], axis=1)
        far = np.flatnonzero(distances > _MIN_MOVE * self.error)
        if not len(far):
            return None
        step = (positions[far[0]] - positions[0]) * side
        direction: Floats = step / np.linalg.norm(step)
        return direction

    def _matched_position(self, sample: int, side: int) -> RoadPosition:
        """The position on the matched route two errors farther from the gap than the sample."""
        # Distance along the route.
        route = self.match.pieces[self.match.piece[sample]].route
        ends = np.cumsum(route.lengths)
        along = float(
            np.clip(self.match.along[sample] + side * _BACK_OFF * self.error, 0.0, ends[-1])
        )

        # Leg, and offset on its road.
        number = np.searchsorted(ends, along, side="left" if side == _BEFORE else "right")
        leg = min(int(number), len(ends) - 1)
        is_forward = bool(route.forward[leg])
        metres = along - (float(ends[leg - 1]) if leg else 0.0)
        offset = float(route.begin[leg]) + (metres if is_forward else -metres)
        edge = int(route.edges[leg])
        return RoadPosition(
            2 * edge + (not is_forward),
            float(np.clip(offset, 0.0, self.finder.lengths[2 * edge])),
        )

    def _log_likelihood(self, path: RoadPath, after: int, seconds: float) -> float:
        """Logarithm of the likelihood of a path, up to a constant.

        Agents who know the roads take a quick path. The rest of the time they wait, for a time of
        exponential distribution; few are much faster than their mean, by a log-normal distribution.
        """
        # Distance of the samples from the ends of the path; the tails are those of Cauchy's
        # distribution, since receivers err much at the end of a tunnel.
        distance_cost = 0.0
        if path.penalty == 0:
            line, _ = self._cut(path, after)
            steps = self.track.positions[after : after + 2, : line.shape[1]] - line[[0, -1]]
            squares = (steps**2).sum(axis=1) / self.error**2
            distance_cost = float(np.log1p(0.5 * squares).sum())

        # Waiting, or hurry.
        expected = max(self._travel_time(path), self.interval)
        time_cost = (
            (seconds - expected) / (_MEAN_WAIT * seconds)
            if seconds > expected
            else 0.5 * (math.log(expected / seconds) / _HURRY) ** 2
        )
        return -(path.cost + path.penalty) / _cost_scale(seconds) - time_cost - distance_cost

    def _travel_time(self, path: RoadPath) -> float:
        """Seconds of travel on a path, without turns."""
        return self.finder.travel_time(path, TravelCosts(self.travel_time, 0.0, 0.0))

    def _cut(self, path: RoadPath, after: int) -> tuple[Floats, Longs]:
        """The line of a path between the samples beside a gap, and the road of each vertex."""
        line, owner = self.finder.line(path)
        radius = _CUT_RADIUS * self.error
        positions = self.track.positions[:, : line.shape[1]]
        first = _nearest_along(line, positions[after], 0.0, radius)
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        last = max(_nearest_along(line, positions[after + 1], length - radius, length), first)
        return _cut_line(line, owner, first, last)

    def _sample_times(
        self,
        path: RoadPath,
        line: Floats,
        owner: Longs,
        length: float,
        after: int,
        seconds: float,
    ) -> tuple[Floats, Floats]:
        """Times of the samples to add, and their distances along the line.

        1. Find the speed that roads and bends allow along the line.
        2. Integrate it to the time that the agent would take.
        3. Fit that time to the gap, given the speeds at both ends.
        """
        # 1. allowed speed
        along = np.linspace(
            0.0, length, max(int(length / max(_SPEED_STEP, length / _MAX_SPEED_STEPS)), 2)
        )
        _, road = _interpolate_line(line, owner, along)
        speed = self.road_speed[path.roads[road]]
        top_speed = max(float(speed.max()), self.motion.mean_speed)
        speed = np.minimum(speed, bend_speed(line, along, self.motion.acceleration, top_speed))

        # 2. time at that speed
        pace = 1.0 / np.maximum(speed, _MIN_SPEED * self.motion.mean_speed)
        clock = np.append(0.0, np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(along)))

        # 3. progress on that clock: its rate at both ends is the speed over the allowed speed
        few = max(int(np.searchsorted(along, _END_METRES)), 1)
        rate_before = self._speed_beside(after, _BEFORE) * float(pace[:few].mean())
        rate_after = self._speed_beside(after + 1, _AFTER) * float(pace[-few:].mean())
        progress = interpolate_progress(
            seconds,
            float(clock[-1]),
            rate_before,
            rate_after,
            self.motion.correlation_time(seconds),
        )
        since_gap = np.arange(1, math.ceil(seconds / self.interval - 0.5)) * self.interval
        return (
            self.track.times[after] + since_gap,
            np.interp(np.interp(since_gap, *progress), clock, along),
        )

    def _speed_beside(self, sample: int, side: int) -> float:
        """Speed over a few seconds beside a gap."""
        times, along, piece = self.track.times, self.match.along, self.match.piece
        duration = max(
            _SPEED_SECONDS,
            _SPEED_INTERVALS * self.interval,
            _SPEED_ERRORS * self.error / self.motion.mean_speed,
        )
        near = np.flatnonzero(
            (side * (times - times[sample]) >= 0)
            & (np.abs(times - times[sample]) <= duration)
            & (piece == piece[sample])
        )
        if len(near) < 2:
            return self.motion.mean_speed
        first, last = near[0], near[-1]
        return float(abs(along[last] - along[first]) / (times[last] - times[first]))

    def _add_other_coordinates(self, positions: Floats, after: int, times: Floats) -> Floats:
        """Interpolate the coordinates that roads lack, such as heights, over the gap."""
        end_positions = self.track.positions[after : after + 2]
        end_times = self.track.times[after : after + 2]
        on_roads = positions[:, : self.track.dimension]
        others = [
            np.interp(times, end_times, end_positions[:, axis])
            for axis in range(on_roads.shape[1], self.track.dimension)
        ]
        return np.column_stack([on_roads, *others])


def _robust_error(distances: Floats) -> float:
    """Standard deviation of samples from their roads, by the median, which outliers don't move."""
    known = distances[np.isfinite(distances)]
    if not len(known):
        return _MIN_ERROR
    return max(_MEDIAN_TO_SIGMA * float(np.median(known)), _MIN_ERROR)


def _cost_scale(seconds: float) -> float:
    """Seconds that a path must cost more than another to be less likely by a factor of e."""
    return _COST_SCALE + _COST_SCALE_SHARE * seconds


def _measure_along(line: Floats) -> Floats:
    """Metres along a line to each vertex."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _nearest_along(line: Floats, point: Floats, low: float, high: float) -> float:
    """Metres along a line, between two bounds, to where it is nearest to a point."""
    # Metres along the line up to each vertex, and the bounds within its length.
    steps = np.diff(line, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.append(0.0, np.cumsum(lengths))
    low, high = max(low, 0.0), min(high, float(along[-1]))
    if not len(steps) or high <= low:
        return max(low, 0.0)

    # Nearest fraction of each segment, within the bounds.
    fraction = ((point - line[:-1]) * steps).sum(axis=1) / np.maximum(lengths**2, _MIN_SQUARE)
    divisor = np.maximum(lengths, _MIN_SEGMENT_LENGTH)
    least = np.clip((low - along[:-1]) / divisor, 0, 1)
    greatest = np.clip((high - along[:-1]) / divisor, 0, 1)
    fraction = np.clip(fraction, least, greatest)

    # Nearest segment.
    distance = np.linalg.norm(line[:-1] + fraction[:, None] * steps - point, axis=1)
    distance[(along[1:] < low) | (along[:-1] > high)] = np.inf
    best = int(distance.argmin())
    return float(along[best] + fraction[best] * lengths[best])


def _owner_at(owner: Longs, vertices: Floats, along: Floats | float) -> Longs:
    """The owner of the last vertex not beyond each distance along a line."""
    vertex = np.clip(np.searchsorted(vertices, along, side="right") - 1, 0, len(owner) - 1)
    found: Longs = owner[vertex]
    return found


def _cut_line(line: Floats, owner: Longs, first: float, last: float) -> tuple[Floats, Longs]:
    """Cut a line at two distances along it."""
    vertices = _measure_along(line)
    inner = np.flatnonzero((vertices > first) & (vertices < last))
    along = np.concatenate(([first], vertices[inner], [last]))
    points = np.stack([np.interp(along, vertices, axis) for axis in line.T], axis=1)
    first_owner = _owner_at(owner, vertices, first)
    last_owner = owner[inner][-1:] if len(inner) else [first_owner]
    return points, np.concatenate(([first_owner], owner[inner], last_owner))


def _interpolate_line(line: Floats, owner: Longs, along: Floats) -> tuple[Floats, Longs]:
    """Positions at distances along a line, and the owner of each."""
    vertices = _measure_along(line)
    positions = np.stack([np.interp(along, vertices, axis) for axis in line.T], axis=1)
    return positions, _owner_at(owner, vertices, along)


def _road_probabilities(paths: Sequence[RoadPath], probabilities: Floats, best: RoadPath) -> Floats:
    """Probability of each road of the best path: that of all paths that use it."""
    total = np.zeros(len(best.roads))
    for path, probability in zip(paths, probabilities.tolist(), strict=True):
        total += probability * np.isin(best.roads, path.roads)
    return np.minimum(total, 1.0)
