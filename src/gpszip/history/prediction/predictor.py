"""Predicting where an agent goes next, from what an archive knows."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, open_archive
from gpszip.errors import OptionError
from gpszip.history.calendar import choose_calendar
from gpszip.history.prediction.destinations import DestinationModel, TripEnds, learn_destinations
from gpszip.history.prediction.exits import list_exits
from gpszip.history.prediction.pace_so_far import band_factor
from gpszip.history.prediction.paths import PathSearch, fastest_path
from gpszip.history.prediction.read_route import read_route, tell_route
from gpszip.history.prediction.sequence_model import Passes, SequenceModel, train
from gpszip.history.travel_time import TravelTimes, learn_travel_times
from gpszip.history.traversals import History, read_history
from gpszip.history.trips import TripRows, nearest_ends, trips_of_history
from gpszip.model.match import Route
from gpszip.model.prediction import LikelyNode, LikelyRoute, NextRoad, TripArrival
from gpszip.model.timestamps import Times, to_seconds

__all__ = ["Predictor"]

#: Seconds in which the offset of a time zone stays.
_QUARTER = 900.0

#: Routes that are followed at once by :meth:`Predictor.routes`.
_BEAM = 12

#: Routes less likely than this share of the likeliest are not followed.
_MIN_SHARE = 1e-4

Ints = NDArray[np.int64]

#: Route, hour and agent of a search for paths.
_SearchKey: TypeAlias = tuple[tuple[int, ...], int | None, int | None]


class Predictor:
    """Predicts the next edges, the destination and the arrival of an agent.

    What follows a route is what followed its last edges before, for as many edges as were ever
    travelled like that, mixed with what fewer of them say, with what the route did itself, and with
    what the agent does and is done at this hour. Where nobody went before, the angles of the turns
    decide.

    Nothing of the route asked about is used but what is given: ``predictor.learn`` adds a route
    when it is over.

    Parameters
    ----------
    archive : Archive, path or History
        What is known. Edges are those of its clean map, in the numbers that the routes of
        ``gpszip.match(track, archive)`` have.
    timezone : str, optional
        Time zone of the hours of the day, such as ``Europe/Berlin``; by default that of the place,
        where the package timezonefinder is there to tell it, else UTC.

    Attributes
    ----------
    network : Network
        The edges and nodes.
    agents : tuple of str
        Names of the archive's tracks, each an agent.
    model : SequenceModel
        What follows a route.
    calendar : Calendar
        How times become local hours.
    has_hours : bool
        Whether times of the archive are dates, which have hours.

    Raises
    ------
    InputError
        If nothing moves in the archive.
    OptionError
        If there is no such time zone, or the archive's times are no dates and have none.

    Examples
    --------
    >>> import gpszip
    >>> from gpszip.testing import shuttles
    >>> log = shuttles(2, lines=2, days=1, blocks=3, period=30.0)
    >>> archive = gpszip.compress(log.tracks, rmse=8.0, effort=1)
    >>> predictor = gpszip.Predictor(archive)
    >>> route = gpszip.match(log.tracks[0], archive)[0].pieces[0].route
    >>> so_far = list(zip(route.edges, route.forward))[:40]
    >>> best = predictor.next(so_far, agent="shuttle-0")[0]
    >>> best.probability > 0.5
    True
    >>> predictor.routes(so_far, 1)[0].edges == (best[:2],)
    True
    """

    def __init__(
        self,
        archive: Archive | str | os.PathLike[str] | History,
        *,
        timezone: str | None = None,
    ) -> None:
        # The traversals, route after route in the order of time.
        if not isinstance(archive, History):
            archive = read_history(
                archive if isinstance(archive, Archive) else open_archive(archive)
            )
        history = archive
        self.network, rows = history.network, history.traversals
        self._history = history
        self.agents = rows.ids
        self._agent_numbers = {name: number for number, name in enumerate(rows.ids)}
        self._traversals = rows
        order = _order_of_time(rows.enter, rows.starts)
        self._order = order

        # Hours of the day are known where times are dates.
        self.calendar = choose_calendar(self.network, rows.enter, timezone)
        self.has_hours = bool(self.calendar.name)
        self._quarters: dict[float, int] = {}
        self._hours = self.hours_of(rows.enter)
        self.exits = list_exits(self.network)
        passes = Passes(
            rows.directed[order],
            rows.starts[order],
            self._hours[order],
            rows.track[order].astype(np.int64),
        )
        self.model: SequenceModel = train(self.exits, passes)
        self._last_search: tuple[_SearchKey, PathSearch] | None = None

    def __repr__(self) -> str:
        return (
            f"Predictor({len(self._traversals):,} traversals of {len(self.network):,} edges by "
            f"{len(self.agents):,} agents)"
        )

    def next(
        self,
        route: Route | Iterable[Any],
        time: Times | None = None,
        agent: str | None = None,
    ) -> list[NextRoad]:
        """Edges that may follow a route, with probabilities.

        Parameters
        ----------
        route : Route, or sequence of (int, bool)
            The edges travelled so far, the last one last: edge, and whether it was travelled from
            its start to its end.
        time : float, datetime, numpy.datetime64 or text, optional
            Seconds as in the archive, or a date, for the hour of the day. A date without a time
            zone is in UTC.
        agent : str, optional
            Name of the agent: that of its track in the archive. A name that the archive doesn't
            have says nothing.

        Returns
        -------
        list of NextRoad
            All edges that leave the end of the last one, the likeliest first. Probabilities add up
            to 1. The last one backward, a turn, is one of them.

        Raises
        ------
        OptionError
            If the route is empty, or names an edge that the archive doesn't have; if the time is
            none.
        """
        directed = self._read(route)
        probabilities = self.model.predict(directed, self.hour_of(time), self.agent_number(agent))
        options = self.model.options[directed[-1]]
        ranked = sorted(zip(probabilities, options, strict=True), key=_rank)
        return [NextRoad(edge >> 1, not edge & 1, p) for p, edge in ranked]

    def routes(
        self,
        route: Route | Iterable[Any],
        m: int,
        time: Times | None = None,
        agent: str | None = None,
        *,
        count: int = 5,
    ) -> list[LikelyRoute]:
        """Likeliest routes over the next m edges.

        Parameters
        ----------
        route, time, agent
            As for :meth:`next`.
        m : int
            Number of edges, at least 1.
        count : int, default 5
            Number of routes.

        Returns
        -------
        list of LikelyRoute
            The likeliest first. They are found by a beam search, which follows the 12 likeliest
            routes from edge to edge.

        Raises
        ------
        OptionError
            As for :meth:`next`, or if m or count is below 1.
        """
        if m < 1 or count < 1:
            raise OptionError(f"m is {m} and count {count}; both must be at least 1")
        directed, hour, number = self._read(route), self.hour_of(time), self.agent_number(agent)

        # All routes grow by one edge at a time; the likeliest go on.
        beam: list[tuple[float, list[int]]] = [(1.0, directed)]
        for _ in range(m):
            grown = [
                (p * each, [*so_far, edge])
                for p, so_far in beam
                for each, edge in zip(
                    self.model.predict(so_far, hour, number),
                    self.model.options[so_far[-1]],
                    strict=True,
                )
            ]
            grown.sort(key=_rank)
            floor = _MIN_SHARE * grown[0][0] if grown else 0.0
            beam = [each for each in grown[: max(_BEAM, count)] if each[0] >= floor]
        return [LikelyRoute(tell_route(edges[-m:]), p) for p, edges in beam[:count]]

    def destination(
        self,
        route: Route | Iterable[Any],
        time: Times | None = None,
        agent: str | None = None,
        *,
        count: int | None = None,
    ) -> list[LikelyNode]:
        """Nodes at which the trip may end, with probabilities.

        Trips are those of ``gpszip trips``: one ends with a stay, or with a gap that hides one. The
        node is the one nearest to the last place of the trip on the map. Where less than half of
        the archive's travel leads from place to place, as of a robot in a building, a trip ends
        where an agent stands on an edge for five minutes, and with a gap as long.

        Parameters
        ----------
        route, time, agent
            As for :meth:`next`. The route begins with the trip.
        count : int, optional
            Number of nodes; by default all at which a trip ended.

        Returns
        -------
        list of LikelyNode
            The likeliest first.

        Raises
        ------
        OptionError
            As for :meth:`next`.
        """
        likely = self._destinations.predict(
            self._read(route), self.hour_of(time), self.agent_number(agent)
        )
        return [LikelyNode(node, probability) for node, probability in likely[:count]]

    def arrival(
        self,
        route: Route | Iterable[Any],
        goal: int | Route | Iterable[Any],
        time: Times | None = None,
        agent: str | None = None,
        *,
        times: Sequence[Times] | None = None,
        metres_left: float = 0.0,
    ) -> TripArrival:
        """When the agent arrives, counted from now.

        Expected are the mean seconds of each edge in its direction at its hour, with standing at
        stops and lights, drawn to those of all edges where passes are few. The band is that of
        drives as long in the archive.

        Parameters
        ----------
        route, agent
            As for :meth:`next`.
        goal : int, Route, or sequence of (int, bool)
            Node of the network, to which the likeliest path is taken; or the route that remains,
            which begins where the other one ends.
        time : float, datetime, numpy.datetime64 or text, optional
            Now, in seconds as in the archive, or a date; by default, and where it is NaN, any
            hour.
        times : sequence of the same, optional
            Times at which each edge of the route was entered. With the time, they tell whether
            this trip is slower or faster than usual.
        metres_left : float, default 0
            Metres to the end of the route's last edge; less than 0 counts as 0.

        Returns
        -------
        TripArrival
            With the path.

        Raises
        ------
        OptionError
            As for :meth:`next`; if there is no such node, or no path to it; if the archive has no
            times; if the time is no date, or ``metres_left`` no number.
        """
        if not math.isfinite(metres_left):
            raise OptionError(f"metres_left is {metres_left}; it must be a number of metres")
        route = route if isinstance(route, Route) else list(route)
        directed = self._read(route)
        path = self._find_path(directed, goal, time, agent)
        now = _known_seconds(time)

        # When this trip began: of a long route, only the last edges count.
        begin = None
        if times is not None:
            if len(times) != len(route):
                raise OptionError(f"the route has {len(route)} edges and {len(times)} times")
            begin = _known_seconds(times[len(route) - len(directed)])

        # Its pace so far.
        pace = factor = 1.0
        if begin is not None and now is not None:
            edges, forward = _columns(directed)
            metres = self.network.lengths[edges].copy()
            metres[-1] = max(metres[-1] - metres_left, 0.0)
            seconds = self._times.seconds(edges, forward, begin, metres=metres)
            expected = float(seconds.sum())
            pace = self._times.pace_so_far(max(now - begin, 0.0), expected)
            factor = self._band_factor

        # The rest of the last edge, and of the path.
        edges, forward = _columns([directed[-1], *path])
        metres = self.network.lengths[edges].copy()
        metres[0] = max(metres_left, 0.0)
        length = float(metres.sum())
        if not length:
            return TripArrival(0.0, 0.0, 0.0, 0.0, ())
        told = self._times.arrival(edges, forward, now, metres=metres, pace=pace)
        low = told.seconds * (told.low / told.seconds) ** factor
        high = told.seconds * (told.high / told.seconds) ** factor
        return TripArrival(told.seconds, low, high, length, tell_route(path))

    def learn(
        self,
        route: Route | Iterable[Any],
        times: Sequence[Times] | None = None,
        agent: str | None = None,
    ) -> None:
        """Add a route that is over to what :meth:`next` and :meth:`routes` know.

        Parameters
        ----------
        route : Route, or sequence of (int, bool)
            The edges travelled; of a long route the last 256.
        times : sequence of float, datetime, numpy.datetime64 or text, optional
            Seconds or dates at which each was entered.
        agent : str, optional
            Name of the agent, which may be new.

        Raises
        ------
        OptionError
            If the route is empty, or names an edge that the archive doesn't have, or there are not
            as many times as edges.
        """
        directed, hours = self._read_with_hours(route, times)

        # An agent that is new gets a number.
        if agent is not None and agent not in self._agent_numbers:
            self._agent_numbers[agent] = len(self._agent_numbers)
        self.model.learn(directed, hours, self.agent_number(agent))
        self._last_search = None

    def surprise(
        self,
        route: Route | Iterable[Any],
        times: Sequence[Times] | None = None,
        agent: str | None = None,
    ) -> list[float]:
        """Bits that each edge after the first takes: ``-log2`` of its probability before it came.

        Parameters
        ----------
        route, times, agent
            As for :meth:`learn`.

        Returns
        -------
        list of float
            One for each edge but the first, of a long route of the last 256; never infinite, as
            turns that nobody took are possible.

        Raises
        ------
        OptionError
            As for :meth:`learn`.
        """
        directed, hours = self._read_with_hours(route, times)
        number = self.agent_number(agent)
        bits = []
        for i in range(1, len(directed)):
            probabilities = self.model.predict(directed[:i], hours[i - 1], number)
            taken = self.model.options[directed[i - 1]].index(directed[i])
            bits.append(-math.log2(max(probabilities[taken], 1e-12)))
        return bits

    def _find_path(
        self,
        route: list[int],
        goal: int | Route | Iterable[Any],
        time: Times | None,
        agent: str | None,
    ) -> list[int]:
        """Directed edges from the end of a route to the goal."""
        # The user knows the path.
        if not isinstance(goal, int | np.integer):
            rest = [*tell_route(route[-1:]), *_pairs(goal)]
            options, edges = self.model.options, len(self.network)
            path = read_route(rest, options, edges, longest=len(rest))
            if len(path) < len(rest):
                raise OptionError(
                    "the route that remains does not begin where the other one ends",
                    remedy="give all edges from there on, each beginning where the last one ends",
                )
            return path[1:]

        # The likeliest path, else the fastest.
        if not 0 <= goal < len(self.network.nodes):
            raise OptionError(
                f"there is no node {goal}; the archive has nodes 0 to {len(self.network.nodes) - 1}"
            )
        search = self._search_paths(route, self.hour_of(time), self.agent_number(agent))
        found = search.path_to(int(goal))
        if found is None:
            rates = self._times.rates.mean(axis=1)
            seconds = rates * np.repeat(self.network.lengths, 2)
            found = fastest_path(self.exits, seconds, route[-1], int(goal))
        if found is None:
            raise OptionError(f"no path leads from the route to node {goal}")
        return found

    def _search_paths(self, route: list[int], hour: int | None, agent: int | None) -> PathSearch:
        """Search from a route, which is the last one again for each of its destinations."""
        key = (tuple(route), hour, agent)
        if self._last_search is None or self._last_search[0] != key:
            search = PathSearch(self.model, self.exits, route, hour, agent)
            self._last_search = key, search
        return self._last_search[1]

    @cached_property
    def _times(self) -> TravelTimes:
        """Travel times, which only :meth:`arrival` needs."""
        return learn_travel_times(History(self.network, self._traversals), self.calendar)

    @cached_property
    def _band_factor(self) -> float:
        """How much narrower the band of arrivals is once a trip has shown its pace."""
        return band_factor(self._times, self._traversals)

    @cached_property
    def _trips(self) -> TripRows:
        """Trips of the archive, as slices of its traversals."""
        return trips_of_history(self._history)

    @cached_property
    def _destinations(self) -> DestinationModel:
        """Ends of the archive's trips, which only :meth:`destination` needs."""
        rows, trips = self._traversals, self._trips
        order = self._order[trips.of[self._order] >= 0]
        ends = TripEnds(
            nearest_ends(self.network, rows, trips.after - 1),
            rows.track[trips.first].astype(np.int64),
            self._hours[trips.first],
        )
        return learn_destinations(
            rows.directed[order],
            rows.starts[order] | (np.diff(order, prepend=-2) != 1),
            trips.of[order],
            ends,
            len(self.exits),
        )

    def _read(self, route: Route | Iterable[Any]) -> list[int]:
        return read_route(route, self.model.options, len(self.network))

    def _read_with_hours(
        self, route: Route | Iterable[Any], times: Sequence[Times] | None
    ) -> tuple[list[int], list[int | None]]:
        """Directed edges at the end of a route, and the hours at which they were entered."""
        route = route if isinstance(route, Route) else list(route)
        directed = self._read(route)
        if times is None:
            return directed, [None] * len(directed)
        if len(times) != len(route):
            raise OptionError(f"the route has {len(route)} edges and {len(times)} times")
        return directed, [self.hour_of(time) for time in list(times)[-len(directed) :]]

    def hours_of(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """Local hour of the day of times, shape (n,); -1 where unknown."""
        hours = np.full(len(times), -1, np.int64)
        if self.has_hours:
            known = np.isfinite(times)
            hours[known] = self.calendar.part("hour", times[known])
        return hours

    def hour_of(self, time: Times | None) -> int | None:
        """Local hour of the day, if the archive's times tell it."""
        if time is None:
            return None
        seconds = time if isinstance(time, float) else _in_seconds(time)
        if not self.has_hours or not math.isfinite(seconds):
            return None

        # The zone is looked up once for each quarter of an hour.
        quarter = seconds // _QUARTER
        hour = self._quarters.get(quarter)
        if hour is None:
            hour = int(self.calendar.part("hour", np.array([seconds]))[0])
            self._quarters[quarter] = hour
        return hour

    def agent_number(self, name: str | None) -> int | None:
        """Number of an agent among those of the archive; None for another one."""
        return None if name is None else self._agent_numbers.get(name)


def _columns(directed: list[int]) -> tuple[Ints, NDArray[np.bool_]]:
    """Edges and directions of directed edges as arrays."""
    numbers = np.array(directed, np.int64)
    return numbers >> 1, numbers & 1 == 0


def _pairs(route: Route | Iterable[Any]) -> list[Any]:
    """Edges and directions of a route."""
    if isinstance(route, Route):
        return list(zip(route.edges.tolist(), route.forward.tolist(), strict=True))
    return list(route)


def _rank(each: tuple[float, Any]) -> tuple[float, Any]:
    """Key that sorts by falling probability, and equals by their edges."""
    return -each[0], each[1]


def _in_seconds(time: Times) -> float:
    """Seconds of a single time, as in the archive.

    Examples
    --------
    >>> _in_seconds(np.datetime64("1970-01-02")), _in_seconds(7)
    (86400.0, 7.0)
    """
    seconds = to_seconds(time, name="time")
    if seconds.ndim:
        raise OptionError(f"time is {time!r}; it must be a single time")
    return float(seconds)


def _known_seconds(time: Times | None) -> float | None:
    """Seconds of a single time; None for none, and for one that is not known, such as NaN."""
    seconds = math.nan if time is None else _in_seconds(time)
    return seconds if math.isfinite(seconds) else None


def _order_of_time(enter: NDArray[np.float64], starts: NDArray[np.bool_]) -> Ints:
    """Traversals piece by piece, in the order in which the pieces begin."""
    first = np.flatnonzero(starts)
    begins = np.nan_to_num(enter[first])
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(begins, kind="stable")] = np.arange(len(first))
    return np.argsort(rank[np.cumsum(starts) - 1], kind="stable")
