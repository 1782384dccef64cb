"""The stays, trips and places of all tracks of a log or an archive."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.geo.planes import plane_changes
from gpszip.history.local_time import find_zone, hour_rows, zone_of_place
from gpszip.history.stays.fixes import DEFAULT_NOISE, MIN_NOISE, add_travel, choose_fixes
from gpszip.history.stays.measure import Travel, measure_travel
from gpszip.history.stays.places import group_stops
from gpszip.history.stays.roles import Role, find_roles, usual_hours
from gpszip.history.stays.timeline import build_timeline
from gpszip.history.stays.values import Move, Settings, Stop, Timeline, TripSpans
from gpszip.model.grid import Plane
from gpszip.model.projection import map_coordinates
from gpszip.model.timestamps import counts_from_1970
from gpszip.model.trips import Place, Stay, Trip, Trips

__all__ = ["TrackSamples", "collect_spans", "collect_trips", "track_timeline"]

#: Weight in seconds of the end of a trip without a stay, among stays of at least minutes.
_END_WEIGHT = 1.0

#: Error of a sample that states none, as a share of the radius of places, at most.
_NOISE_SHARE = 0.15

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TrackSamples:
    """Samples of a track, or knots between which it is linear.

    Parameters
    ----------
    id : str
        Name of the track.
    times : float64 array, shape (n,)
        Seconds, strictly increasing.
    positions : float64 array, shape (n, d)
        Metres.
    accuracy : float64 array, shape (n,), optional
        Errors that the log states, in metres; NaN or 0 where it states none.
    added_noise : float
        Error in metres that compression has added, at most or as a root mean square.
    seen_travel : float
        Seconds up to which a step is travel that was seen, as between the knots of an archive.
    """

    id: str
    times: Floats
    positions: Floats
    accuracy: Floats | None = None
    added_noise: float = 0.0
    seen_travel: float = 0.0


@dataclass(frozen=True, eq=False)
class _History:
    """Stops and moves of one track, without its fixes; ``travel`` is empty unless measured."""

    id: str
    stops: tuple[Stop, ...]
    moves: tuple[Move, ...]
    travel: tuple[Travel, ...]
    unseen: int
    doubtful: int
    open: bool


def collect_trips(
    tracks: Iterable[TrackSamples],
    plane: Plane | None,
    settings: Settings,
    timezone: str | None = None,
) -> Trips:
    """Find the stays and trips of all tracks, and the places that they have in common.

    Parameters
    ----------
    tracks : iterable of TrackSamples
        Something that can be iterated twice. Memory holds one track at a time, and the lines of all
        trips.
    plane : Plane or None
        Where positions lie on the earth.
    settings : Settings
        What counts as a stay and as a trip.
    timezone : str, optional
        Name of the time zone of local hours; by default that of the place where most time is
        spent, if the package timezonefinder is there to tell it, else UTC, by which no place has a
        role.

    Returns
    -------
    Trips

    Raises
    ------
    OptionError
        If there is no such time zone, or a setting is no positive number.
    """
    if timezone is not None:
        find_zone(timezone)
    histories = _read_histories(tracks, plane, settings, with_travel=True)
    return _Collection(histories, plane, settings, timezone).trips()


def collect_spans(
    tracks: Iterable[TrackSamples], plane: Plane | None, settings: Settings
) -> TripSpans:
    """Find when the trips of all tracks are: those of :func:`collect_trips`, without the rest.

    Parameters
    ----------
    tracks, plane, settings
        As for :func:`collect_trips`.
    """
    histories = _read_histories(tracks, plane, settings, with_travel=False)
    return TripSpans(
        frozenset(each.id for each in histories if each.stops or each.moves),
        tuple((each.id, move.start, move.end) for each in histories for move in each.moves),
    )


def _read_histories(
    tracks: Iterable[TrackSamples], plane: Plane | None, settings: Settings, *, with_travel: bool
) -> list[_History]:
    """Stops and moves of each track."""
    _check(settings)

    # Each track by itself; then those anew for which places tell more at which stays were seen.
    parts = _Parts(tracks, plane)
    histories = [_read_history(track, settings, None, with_travel) for track in parts]
    seen = [
        stop
        for each in histories
        for stop in each.stops
        if stop.last_seen - stop.first_seen >= settings.min_stay
    ]
    _, centres = _group(seen, settings)
    if len(centres) and any(each.open for each in histories):
        histories = [
            _read_history(track, settings, centres, with_travel) if before.open else before
            for track, before in zip(parts, histories, strict=True)
        ]
    return histories


@dataclass(frozen=True, eq=False)
class _Parts:
    """Tracks, cut where they go on on another plane, to which there is no distance."""

    tracks: Iterable[TrackSamples]
    plane: Plane | None

    def __iter__(self) -> Iterator[TrackSamples]:
        for track in self.tracks:
            cuts = np.flatnonzero(plane_changes(track.positions, self.plane)) + 1
            for rows in np.split(np.arange(len(track.times)), cuts) if len(cuts) else [...]:
                yield replace(
                    track,
                    times=track.times[rows],
                    positions=track.positions[rows],
                    accuracy=None if track.accuracy is None else track.accuracy[rows],
                )


def _check(settings: Settings) -> None:
    for name in ("min_stay", "max_pause", "radius"):
        value = getattr(settings, name)
        if not 0 < value < math.inf:
            raise OptionError(f"{name} is {value:g}", remedy="it must be a positive number")


def track_timeline(
    track: TrackSamples, settings: Settings, places: Floats | None = None, *, goes_on: bool = False
) -> Timeline:
    """Find the stays and trips of one track.

    Parameters
    ----------
    track : TrackSamples
        At least one sample, on one plane.
    settings : Settings
        What counts as a stay and as a trip.
    places : float64 array, shape (k, d), optional
        Centres of places that are known from other stays.
    goes_on : bool, default False
        Whether the track goes on after its last sample, as while its fixes come.
    """
    # Errors are those of phones, unless places are small: then the receiver must be a better one.
    noise = math.hypot(min(DEFAULT_NOISE, _NOISE_SHARE * settings.radius), track.added_noise)
    least = math.hypot(min(MIN_NOISE, _NOISE_SHARE * settings.radius), track.added_noise)
    fixes = choose_fixes(track.times, track.positions, track.accuracy, noise=noise, min_noise=least)
    fixes = add_travel(fixes, track.seen_travel)
    return build_timeline(fixes, settings, places, goes_on=goes_on)


def _read_history(
    track: TrackSamples, settings: Settings, places: Floats | None, with_travel: bool
) -> _History:
    line = track_timeline(track, settings, places)
    travel = tuple(
        measure_travel(line.fixes, move.start, move.end, move.begin, move.finish)
        for move in (line.moves if with_travel else ())
    )
    return _History(
        track.id, line.stops, line.moves, travel, line.unseen, len(line.doubtful), line.open
    )


def _group(stops: Sequence[Stop], settings: Settings) -> tuple[Integers, Floats]:
    """Group stops to places by the time spent there."""
    if not stops:
        return np.zeros(0, np.int64), np.zeros((0, 2))
    return group_stops(
        [stop.halt.centre for stop in stops],
        [max(stop.duration, _END_WEIGHT) for stop in stops],
        [stop.halt.noise for stop in stops],
        settings.radius,
    )


class _Collection:
    """Histories of all tracks while their places are found."""

    def __init__(
        self,
        histories: Sequence[_History],
        plane: Plane | None,
        settings: Settings,
        timezone: str | None,
    ) -> None:
        self.histories, self.plane, self.timezone = histories, plane, timezone

        # Stops, and ends of trips without a stop, by their places.
        self.stops = [stop for each in histories for stop in each.stops]
        self.owner = np.repeat(np.arange(len(histories)), [len(each.stops) for each in histories])
        ends = [
            position
            for each in histories
            for move in each.moves
            for position, stop in ((move.begin, move.origin), (move.finish, move.goal))
            if stop is None
        ]
        positions = np.array([*(stop.halt.centre for stop in self.stops), *ends])
        weights = [max(stop.duration, _END_WEIGHT) for stop in self.stops]
        noise = [stop.halt.noise for stop in self.stops]
        self.label, self.centres = group_stops(
            positions,
            [*weights, *[_END_WEIGHT] * len(ends)],
            [*noise, *[0.0] * len(ends)],
            settings.radius,
        )
        self.of_stop = self.label[: len(self.stops)]
        self.of_end = iter((self.label[len(self.stops) :] + 1).tolist())
        self.starts = np.array([stop.start for stop in self.stops])
        self.ends = np.array([stop.end for stop in self.stops])

    def trips(self) -> Trips:
        """Return what was found."""
        stays, trips = self._stays(), self._trips()
        zone_name, zone_from = self._zone()
        unseen = sum(each.unseen for each in self.histories)
        doubtful = sum(each.doubtful for each in self.histories)
        return Trips(
            stays,
            trips,
            self._places(trips, zone_name, zone_from),
            zone_name,
            zone_from,
            self.plane is not None,
            unseen,
            doubtful,
        )

    def _stays(self) -> tuple[Stay, ...]:
        if not self.stops:
            return ()
        positions = self._coordinates(np.array([stop.halt.centre for stop in self.stops]))
        return tuple(
            Stay(
                self.histories[owner].id,
                stop.start,
                stop.end,
                stop.first_seen,
                stop.last_seen,
                place + 1,
                position,
                stop.halt.spread,
                stop.pause,
            )
            for owner, stop, place, position in zip(
                self.owner.tolist(), self.stops, self.of_stop.tolist(), positions, strict=True
            )
        )

    def _trips(self) -> tuple[Trip, ...]:
        trips, first = [], 0
        for each in self.histories:
            # Numbers of the places of its stops.
            places = (self.of_stop[first : first + len(each.stops)] + 1).tolist()
            first += len(each.stops)

            # Moves between them.
            for move, travel in zip(each.moves, each.travel, strict=True):
                # Ends without a stop come in the order in which they were grouped.
                origin = next(self.of_end) if move.origin is None else places[move.origin]
                goal = next(self.of_end) if move.goal is None else places[move.goal]
                line = map_coordinates(travel.line, self.plane)
                begin, finish = self._coordinates(np.array([move.begin, move.finish]))
                trips.append(
                    Trip(
                        each.id,
                        move.start,
                        move.end,
                        origin,
                        goal,
                        begin,
                        finish,
                        travel.length,
                        travel.moving,
                        line,
                    )
                )
        return tuple(trips)

    def _zone(self) -> tuple[str, str]:
        """Name of the time zone, and who said it."""
        times = self.starts.tolist() or [
            move.start for each in self.histories for move in each.moves
        ]
        if not times or not counts_from_1970(min(times)):
            return "", ""
        if self.timezone is not None:
            return self.timezone, "option"
        if self.plane is not None and len(self.centres):
            ((lat, lon, *_),) = self._coordinates(self.centres[:1])
            name = zone_of_place(lat, lon)
            if name is not None:
                return name, "place"
        return "UTC", "default"

    def _places(self, trips: Sequence[Trip], zone_name: str, zone_from: str) -> tuple[Place, ...]:
        count = len(self.centres)
        if not count:
            return ()

        # Time at each place by hours of local clocks.
        hours, weekdays = np.zeros((count, 24)), np.zeros((count, 7))
        roles, usual = [Role("", "")] * count, [""] * count
        if zone_name:
            stop, duration, hour, day = hour_rows(self.starts, self.ends, find_zone(zone_name))
            place, owner = self.of_stop[stop], self.owner[stop]
            np.add.at(hours, (place, hour), duration)
            np.add.at(weekdays, (place, (day + 3) % 7), duration)
            # Nights of a zone that nobody named may be days where the log is from.
            if zone_from != "default":
                roles = find_roles(place, owner, duration, hour, day, count)
            order = np.argsort(place, kind="stable")
            bounds = np.searchsorted(place[order], np.arange(count + 1))
            for number in range(count):
                rows = order[bounds[number] : bounds[number + 1]]
                usual[number] = usual_hours(duration[rows], hour[rows], day[rows], owner[rows])

        # Visits, and how far they lie apart.
        dwell = np.bincount(self.of_stop, self.ends - self.starts, count)
        visits = np.bincount(self.of_stop, minlength=count)
        first, last = np.full(count, math.inf), np.full(count, -math.inf)
        np.minimum.at(first, self.of_stop, self.starts)
        np.maximum.at(last, self.of_stop, self.ends)
        departures = np.bincount([trip.origin for trip in trips], minlength=count + 1)
        arrivals = np.bincount([trip.goal for trip in trips], minlength=count + 1)
        return tuple(
            Place(
                number + 1,
                position,
                spread,
                int(visits[number]),
                float(dwell[number]),
                float(first[number]) if visits[number] else math.nan,
                float(last[number]) if visits[number] else math.nan,
                int(departures[number + 1]),
                int(arrivals[number + 1]),
                tuple(hours[number].tolist()) if zone_name else (),
                tuple(weekdays[number].tolist()) if zone_name else (),
                usual[number],
                *roles[number],
            )
            for number, (position, spread) in enumerate(
                zip(self._coordinates(self.centres), self._spreads().tolist(), strict=True)
            )
        )

    def _spreads(self) -> Floats:
        """Root mean square distance of the stays at each place from its centre, by their time."""
        if not self.stops:
            return np.zeros(len(self.centres))
        centres = np.array([stop.halt.centre for stop in self.stops])
        own = np.array([stop.halt.spread for stop in self.stops])
        squares = ((centres - self.centres[self.of_stop]) ** 2).sum(axis=1) + own**2
        weights = np.maximum(self.ends - self.starts, _END_WEIGHT)
        mass = np.bincount(self.of_stop, weights, len(self.centres))
        total = np.bincount(self.of_stop, weights * squares, len(self.centres))
        spreads: Floats = np.sqrt(total / np.maximum(mass, _END_WEIGHT))
        return spreads

    def _coordinates(self, positions: Floats) -> list[tuple[float, ...]]:
        return [tuple(row) for row in map_coordinates(positions, self.plane).tolist()]
