"""How unusual the trips of a log are, given an archive of earlier ones.

The score of a trip adds up bits, each a factor of two in probability:

- its route: the part of it whose turns and whose way are the most surprising
  (:mod:`gpszip.history.unusual.route_surprise`);
- travel off the map: 14 bits, and one more for each 100 m;
- its slowest or fastest minute, and its most unusual stop, as far as they exceed what one of
  thousands shows, and 4 bits each at most: paces and stops vary for many reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import to_geographic
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.prediction.read_route import tell_route
from gpszip.history.traversals import History, Traversals
from gpszip.history.trips import lead_to_places, spans_of_tracks
from gpszip.history.unusual.absences import find_absences
from gpszip.history.unusual.log_trips import LogTrip, list_trips
from gpszip.history.unusual.pass_index import index_passes
from gpszip.history.unusual.route_surprise import Part, direction_bits, surprising_parts, turn_bits
from gpszip.history.unusual.usual import learn_paces, learn_stops, pace_groups
from gpszip.matching.reach import choose_reach
from gpszip.model import Plane, Track
from gpszip.model.unusual import Anomaly, Unusual, UnusualTrip

__all__ = ["Usual", "find_unusual"]

#: Bits of leaving the map, and metres off it for a bit more.
_OFF_MAP_BITS, _OFF_MAP_METRES = 14.0, 100.0

#: Most bits of travel off the map.
_MAX_OFF_MAP = 60.0

#: Bits of a minute's pace, and of a stop, that one of thousands of them has; only more counts.
_USUAL_PACE, _USUAL_STOP = 12.0, 8.0

#: Most bits that pace and stop each add to a score. On shuttle buses with detours, unlimited bits
#: take the area under the ROC curve from .974 to .960, and these to .971.
_MAX_ADDED = 4.0

#: Seconds of standing that are a stop, and no light.
_MIN_STOP = 120.0

#: Bits from which a route is worth a word.
_TOLD_BITS = 6.0

Ints = NDArray[np.int64]


def find_unusual(
    usual: Usual,
    tracks: Sequence[Track],
    traversals: Traversals,
) -> Unusual:
    """Score the trips of a log.

    Parameters
    ----------
    usual : Usual
        What is usual in the archive.
    tracks : sequence of Track
        The log, with times, on the plane of the archive.
    traversals : Traversals
        Traversals of the log on the archive's network; ``track`` are indices of ``tracks``.

    Returns
    -------
    Unusual
        Each trip with its score and its unusual parts, in the order of the log.
    """
    found = spans_of_tracks(tracks, usual.by_places)
    listed = list_trips(tracks, traversals, found, choose_reach(usual.network))
    trips = [
        usual.score(trip, tracks[trip.track].id, traversals, tracks[trip.track].plane)
        for trip in listed
    ]
    absences = find_absences(usual.rows, tracks, traversals, usual.predictor.calendar)
    return Unusual(tuple(trips), absences, usual.network.plane is not None)


class Usual:
    """What is usual in an archive: turns, paths, paces and stops.

    Parameters
    ----------
    history : History
        Of the archive.
    timezone : str, optional
        Time zone of hours; by default that of the place, else UTC.
    """

    def __init__(self, history: History, timezone: str | None = None) -> None:
        self._history = history
        self.network, self.rows = history.network, history.traversals
        rows = self.rows
        self.predictor = Predictor(history, timezone=timezone)
        self.model = self.predictor.model
        self.index = index_passes(rows.directed, rows.starts, 2 * len(self.network))
        self.paces = learn_paces(self.network, rows, self.hours(rows))
        self.stops = learn_stops(self.network, rows)

    @cached_property
    def by_places(self) -> bool:
        """Whether trips lead from place to place."""
        return lead_to_places(self._history)

    def hours(self, rows: Traversals) -> Ints:
        """Hour of the day of each traversal, shape (n,); -1 where times are no dates."""
        return self.predictor.hours_of(rows.enter)

    def score(
        self, trip: LogTrip, name: str, rows: Traversals, plane: Plane | None = None
    ) -> UnusualTrip:
        """Score a trip of the agent of a name.

        Parameters
        ----------
        trip : LogTrip
            The trip.
        name : str
            Name of its track.
        rows : Traversals
            Those that ``trip.rows`` count.
        plane : Plane, optional
            On which the trip's positions off the map lie.
        """
        own = rows.take(trip.rows)

        # Parts of its routes, its pace, its stops, and its travel off the map.
        routes = self._routes(name, own)
        paces = self._paces(name, own)
        stops = self._stops(name, own)
        off_map = [
            Anomaly(
                name,
                "off the map",
                part.start,
                part.end,
                min(_MAX_OFF_MAP, _OFF_MAP_BITS + part.metres / _OFF_MAP_METRES),
                f"off the map for {part.metres:,.0f} m",
                _place(part.position, plane),
            )
            for part in trip.off_map
        ]

        # The score, and what tells the most.
        score = max((part.bits for part in routes), default=0.0)
        score += sum(part.bits for part in off_map)
        for parts, usual in ((paces, _USUAL_PACE), (stops, _USUAL_STOP)):
            score += min(_MAX_ADDED, max((part.bits - usual for part in parts), default=0.0))
        told = [*(part for part in routes if part.bits >= _TOLD_BITS), *off_map, *paces, *stops]
        told.sort(key=_weight, reverse=True)
        reason = told[0].reason if told else "nothing unusual"
        return UnusualTrip(name, trip.start, trip.end, score, reason, tuple(told))

    def _routes(self, name: str, rows: Traversals) -> list[Anomaly]:
        """Surprising parts of each connected route of a trip."""
        if not len(rows):
            return []
        hours = [None if hour < 0 else hour for hour in self.hours(rows).tolist()]
        agent = self.predictor.agent_number(name)
        bounds = [*np.flatnonzero(rows.starts).tolist(), len(rows)]
        found = []
        for first, after in pairwise(bounds):
            route = rows.directed[first:after].tolist()
            bits = turn_bits(self.model, route, hours[first:after], agent)
            bits = [
                each + direction_bits(self.index, edge)
                for each, edge in zip(bits, route, strict=True)
            ]
            found += [
                self._tell_part(name, rows, first, route, bits, part)
                for part in surprising_parts(self.index, route, bits)
            ]
        return found

    def _tell_part(
        self,
        name: str,
        rows: Traversals,
        begin: int,
        route: list[int],
        bits: list[float],
        part: Part,
    ) -> Anomaly:
        """Say what is surprising about a part of a route that begins with a traversal."""
        # Edges in a direction that nobody took, though many took the other.
        edges = route[part.first + 1 : part.last + 1]
        wrong = [edge for edge in edges if direction_bits(self.index, edge)]
        rarest = max(range(part.first + 1, part.last + 1), key=lambda i: bits[i])
        kind = "wrong direction" if wrong else "route"
        if wrong:
            others = self.index.passes(wrong[0] ^ 1)
            reason = (
                f"wrong direction on edge {wrong[0] >> 1}, which {others:,} passed the other way"
            )
        elif part.paths > part.turns:
            support = self.index.count_paths(route, part.first, part.last)
            reason = f"another way: {support.same:,} of {support.all:,} went by these edges"
        else:
            chance = 2.0 ** -bits[rarest]
            reason = f"rare turn onto edge {route[rarest] >> 1}, probability {chance:.2g}"

        middle = begin + (part.first + part.last + 1) // 2
        return Anomaly(
            name,
            kind,
            float(rows.enter[begin + part.first + 1]),
            float(rows.leave[begin + part.last]),
            part.bits,
            reason,
            self._middle_of(int(rows.edge[middle])),
            tell_route(edges),
        )

    def _paces(self, name: str, rows: Traversals) -> list[Anomaly]:
        """Minutes of a trip at an unusual speed."""
        if self.paces is None or not len(rows):
            return []
        groups = pace_groups(self.network, rows, self.hours(rows), self.paces)
        minutes = [
            _Minutes(first, last, observed, expected, self.paces.bits(observed / expected))
            for first, last, observed, expected in zip(*(g.tolist() for g in groups), strict=True)
        ]

        # Unusual minutes in a row are one anomaly.
        found = []
        for kind, run in groupby(minutes, key=_kind_of_pace):
            together = list(run)
            if kind:
                took = sum(each.observed for each in together)
                usual = sum(each.expected for each in together)
                reason = f"{kind}: {took:,.0f} s of travel, usual are {usual:,.0f} s"
                bits = max(each.bits for each in together)
                first, last = together[0].first, together[-1].last
                found.append(self._between(name, kind, rows, first, last, bits, reason))
        return found

    def _stops(self, name: str, rows: Traversals) -> list[Anomaly]:
        """Stops of a trip where others don't stop."""
        found = []
        for row in np.flatnonzero(np.nan_to_num(rows.standing) >= _MIN_STOP).tolist():
            seconds = float(rows.standing[row])
            bits = self.stops.bits(int(rows.directed[row]), seconds)
            if bits > _USUAL_STOP:
                reason = f"stop of {seconds / 60:,.0f} min on edge {int(rows.edge[row])}"
                found.append(self._between(name, "stop", rows, row, row, bits, reason))
        return found

    def _between(
        self,
        name: str,
        kind: str,
        rows: Traversals,
        first: int,
        last: int,
        bits: float,
        reason: str,
    ) -> Anomaly:
        """An anomaly from one traversal to another."""
        middle = int(rows.edge[(first + last) // 2])
        return Anomaly(
            name,
            kind,
            float(rows.enter[first]),
            float(rows.leave[last]),
            bits,
            reason,
            self._middle_of(middle),
            tell_route(rows.directed[first : last + 1].tolist()),
        )

    def _middle_of(self, edge: int) -> tuple[float, ...]:
        """Position of the middle of an edge."""
        return _place(self.network.middle(edge), self.network.plane)


def _place(position: NDArray[np.float64], plane: Plane | None) -> tuple[float, ...]:
    """A position for people: latitude and longitude, or x and y."""
    if plane is None:
        return tuple(position.tolist())
    lat, lon = to_geographic(position[None, :2], plane)
    return float(lat[0]), float(lon[0])


def _weight(part: Anomaly) -> float:
    """What a part adds to a score; equals by their bits."""
    usual = {"slow": _USUAL_PACE, "fast": _USUAL_PACE, "stop": _USUAL_STOP}.get(part.kind)
    if usual is None:
        return part.bits
    return min(_MAX_ADDED, part.bits - usual) + 1e-6 * part.bits


class _Minutes(NamedTuple):
    """A part of a drive of a minute or more: traversals, seconds, and bits of its pace."""

    first: int
    last: int
    observed: float
    expected: float
    bits: float


def _kind_of_pace(minutes: _Minutes) -> str:
    """Whether a part is unusually slow or fast; empty for neither."""
    if minutes.bits <= _USUAL_PACE:
        return ""
    return "slow" if minutes.observed > minutes.expected else "fast"
