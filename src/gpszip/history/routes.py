"""Routes over a learned map: the fastest, the shortest, or the most travelled one.

A state of the search is a directed edge, so that a route turns back at a node only where that is
the only way on. Only directions that somebody travelled are open. The cost of an edge is its
expected seconds at the hour at which it is reached, its metres, or its metres divided by its
traversals.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.history.travel_time import TravelTime, TravelTimes
from gpszip.history.traversals import History
from gpszip.model import Network
from gpszip.model.text import count_text

__all__ = ["CRITERIA", "PlannedRoute", "Position", "find_position", "find_routes"]

#: What routes may minimise.
CRITERIA = ("time", "length", "traversals")

#: Metres from the map beyond which no route begins or ends, and the same as a share of its extent.
_MAX_DISTANCE = 250.0
_MAX_SHARE = 0.2

#: Factor by which edges of a route cost more when an alternative is sought.
_PENALTY = 1.5

#: Share of its metres that an alternative may have in common with each route before it.
_MAX_COMMON = 0.7

#: Cost of an alternative at most, relative to the best route.
_MAX_COST = 1.6

#: Searches for each alternative that is wanted.
_TRIES = 4

#: Seconds of a day and of an hour.
_DAY = 86_400.0
_HOUR = 3600.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Position:
    """A position on the map.

    Parameters
    ----------
    edge : int
        The edge.
    offset : float
        Metres from its start.
    distance : float
        Metres from the place that was asked for.
    """

    edge: int
    offset: float
    distance: float


@dataclass(frozen=True, eq=False, repr=False)
class PlannedRoute:
    """A route over a learned map.

    Parameters
    ----------
    edges : int64 array, shape (n,)
        Edges of the clean map, in the order of travel.
    forward : bool array, shape (n,)
        Whether each is travelled from its start to its end.
    begin, end : float64 array, shape (n,)
        Metres from the edge's start at which each begins and ends.
    line : float64 array, shape (p, d)
        Vertices in metres.
    traversals : int
        Traversals of its least travelled edge, in that direction.
    arrival : TravelTime or None
        Seconds with a band of 80 %; None without times in the log.
    """

    edges: NDArray[np.int64]
    forward: NDArray[np.bool_]
    begin: Floats
    end: Floats
    line: Floats
    traversals: int
    arrival: TravelTime | None

    def __repr__(self) -> str:
        time = "" if self.arrival is None else f", {self.arrival.seconds:,.0f} s"
        return f"PlannedRoute({count_text(len(self), 'edge')}, {self.length:,.0f} m{time})"

    def __len__(self) -> int:
        return len(self.edges)

    @property
    def lengths(self) -> Floats:
        """Metres on each edge."""
        lengths: Floats = np.abs(self.end - self.begin)
        return lengths

    @property
    def length(self) -> float:
        """Metres in all."""
        return float(self.lengths.sum())


def find_position(
    network: Network,
    place: ArrayLike,
    what: str = "the place",
    open_edges: NDArray[np.bool_] | None = None,
) -> Position:
    """The position on the map nearest to a place.

    Parameters
    ----------
    network : Network
        The edges.
    place : array_like, shape (2,)
        Metres on the plane of the network.
    what : str
        What to call the place in an error.
    open_edges : bool array, shape (E,), optional
        Edges on which it may lie; by default all.

    Raises
    ------
    OptionError
        If it is farther than 250 m from the map, or than a fifth of its extent.

    Examples
    --------
    >>> nodes, one = np.array([[0.0, 0.0], [100.0, 0.0]]), np.ones(1, bool)
    >>> road = Network(nodes, np.array([0]), np.array([1]), np.array([0, 2]), nodes, one, one,
    ...                np.full(1, np.nan))
    >>> find_position(road, [30.0, 4.0])
    Position(edge=0, offset=30.0, distance=4.0)
    """
    # Nearest point of each segment.
    points, here = network.points[:, :2], np.asarray(place, np.float64)[:2]
    first = np.setdiff1d(np.arange(len(points)), network.offsets[1:] - 1)
    begin, step = points[first], points[first + 1] - points[first]
    square = np.maximum((step**2).sum(axis=1), 1e-12)
    share = np.clip(((here - begin) * step).sum(axis=1) / square, 0.0, 1.0)
    distance = np.linalg.norm(begin + share[:, None] * step - here, axis=1)
    if open_edges is not None:
        edges = np.searchsorted(network.offsets, first, side="right") - 1
        distance = np.where(open_edges[edges], distance, np.inf)
    best = int(distance.argmin())

    # Refuse what is off the map.
    extent = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    limit = min(_MAX_DISTANCE, _MAX_SHARE * extent)
    if distance[best] > limit:
        raise OptionError(
            f"{what} is {distance[best]:,.0f} m from the map",
            remedy=f"name a place within {limit:,.3g} m of it",
        )
    vertex = int(first[best])
    edge = int(np.searchsorted(network.offsets, vertex, side="right") - 1)
    offset = network.along[vertex] + share[best] * np.sqrt(square[best])
    return Position(edge, float(offset), float(distance[best]))


def find_routes(
    history: History,
    stops: Sequence[Position],
    *,
    by: str = "time",
    times: TravelTimes | None = None,
    depart: float | None = None,
    alternatives: int = 0,
) -> tuple[PlannedRoute, ...]:
    """Find routes from stop to stop over directions that were travelled.

    Parameters
    ----------
    history : History
        The map and its traversals.
    stops : sequence of Position
        Where the route begins, passes and ends; two or more.
    by : str, default "time"
        One of :data:`CRITERIA`.
    times : TravelTimes, optional
        Needed for ``time``; otherwise it tells the arrival.
    depart : float, optional
        Time of departure in seconds, in the log's zero; by default means over the day count.
    alternatives : int, default 0
        Alternatives to look for, between two stops. They share at most 70 % of their metres with
        each other and cost at most 60 % more than the best route.

    Returns
    -------
    tuple of PlannedRoute
        The best one first.

    Raises
    ------
    OptionError
        If there is no such criterion, times are needed and missing, or no route leads there.
    """
    # Refuse what can't be asked.
    if by not in CRITERIA:
        raise OptionError(f"{by!r} is nothing to plan by", remedy=f"give {', '.join(CRITERIA)}")
    if by == "time" and times is None:
        raise OptionError(
            "no track has times, so that no route is fastest", remedy="plan by length"
        )
    search = _Search(history, by, times, depart)

    # From stop to stop; each leg departs when the one before arrives.
    legs, elapsed = [], 0.0
    for number, (start, goal) in enumerate(pairwise(stops)):
        found = search.path(start, goal, elapsed, {})
        if found is None:
            raise OptionError(
                f"no route leads from stop {number + 1} to stop {number + 2} in directions that "
                "were travelled",
                remedy="name places between which somebody travelled",
            )
        legs += found
        elapsed = search.seconds(legs)
    routes = [search.route(legs)]

    # Alternatives avoid the edges of the routes tried before.
    penalties: dict[int, float] = {}
    best, tried = search.cost(legs), legs
    for _ in range(_TRIES * alternatives if len(stops) == 2 else 0):
        for edge in {directed // 2 for directed, _, _ in tried}:
            penalties[edge] = penalties.get(edge, 1.0) * _PENALTY
        other = search.path(stops[0], stops[1], 0.0, penalties)
        if other is None or len(routes) > alternatives:
            break
        tried, route = other, search.route(other)
        is_new = all(_common(route, known) <= _MAX_COMMON for known in routes)
        if is_new and search.cost(other) <= _MAX_COST * best:
            routes.append(route)
    return tuple(routes)


def _common(route: PlannedRoute, other: PlannedRoute) -> float:
    """Share of the metres of the shorter route that both have in common, by their edges."""
    both = np.isin(route.edges, other.edges)
    shorter = min(route.length, other.length)
    return float(route.lengths[both].sum()) / shorter if shorter else 1.0


#: A directed edge, and the metres from its beginning at which travel on it begins and ends.
_Leg = tuple[int, float, float]


class _Search:
    """Dijkstra's search over directed edges."""

    def __init__(
        self, history: History, by: str, times: TravelTimes | None, depart: float | None
    ) -> None:
        # Which directions are open, and how often they were travelled: nobody travels a jump.
        self._network, rows = history.network, history.traversals
        size = 2 * len(self._network)
        self._counts = np.bincount(rows.directed[~rows.jumps], minlength=size)
        self._lengths = np.repeat(self._network.lengths, 2)
        self._by, self._times, self._depart = by, times, depart
        self._local = (
            None if times is None or depart is None else float(times.calendar.local([depart])[0])
        )

        # Cost of a metre; of seconds, in each hour.
        if by == "length":
            self._rates = np.ones((size, 1))
        elif by == "traversals":
            self._rates = 1.0 / np.maximum(self._counts, 1)[:, None]
        else:
            assert times is not None
            rates = times.rates
            self._rates = rates.mean(axis=1, keepdims=True) if self._local is None else rates

        # Open directed edges that begin at each node.
        tails = np.stack([self._network.starts, self._network.ends], axis=1).reshape(-1)
        self._heads = np.stack([self._network.ends, self._network.starts], axis=1).reshape(-1)
        self._out: list[list[int]] = [[] for _ in range(len(self._network.nodes))]
        for directed in np.flatnonzero(self._counts).tolist():
            self._out[int(tails[directed])].append(directed)

    def path(
        self, start: Position, goal: Position, elapsed: float, penalties: dict[int, float]
    ) -> list[_Leg] | None:
        """Cheapest legs from a position to another, departing after some seconds."""
        # Both directions from the start, as far as they are open.
        settled: dict[int, int] = {}
        queue: list[tuple[float, int, int]] = []
        direct: list[tuple[float, int]] = []
        begins = {2 * start.edge: start.offset, 2 * start.edge + 1: self._rest(start)}
        goals = {2 * goal.edge: goal.offset, 2 * goal.edge + 1: self._rest(goal)}
        for directed, begin in begins.items():
            if not self._counts[directed]:
                continue
            end = goals.get(directed, -1.0)
            if end >= begin:
                direct.append((self._leg_cost(directed, end - begin, elapsed, penalties), directed))
            cost = self._leg_cost(directed, self._lengths[directed] - begin, elapsed, penalties)
            heapq.heappush(queue, (cost, directed, -1))

        # Reach the goal over the cheapest directed edge.
        best_cost, best_last = min(direct, default=(np.inf, -1))
        best_before, is_direct = -1, best_last >= 0
        while queue and queue[0][0] < best_cost:
            cost, directed, before = heapq.heappop(queue)
            if directed in settled:
                continue
            settled[directed] = before
            for after in self._ways_on(directed):
                if after in goals:
                    total = cost + self._leg_cost(after, goals[after], elapsed + cost, penalties)
                    if total < best_cost:
                        best_cost, best_last, best_before = total, after, directed
                        is_direct = False
                if after not in settled:
                    step = self._leg_cost(after, self._lengths[after], elapsed + cost, penalties)
                    heapq.heappush(queue, (cost + step, after, directed))
        if best_last < 0:
            return None
        if is_direct:
            return [(best_last, begins[best_last], goals[best_last])]

        # Follow the edges back to the start.
        legs: list[_Leg] = [(best_last, 0.0, goals[best_last])]
        directed = best_before
        while directed >= 0:
            before = settled[directed]
            begin = begins[directed] if before < 0 else 0.0
            legs.append((directed, begin, float(self._lengths[directed])))
            directed = before
        return legs[::-1]

    def cost(self, legs: Sequence[_Leg]) -> float:
        """Cost of legs without penalties."""
        total = 0.0
        for directed, begin, end in legs:
            total += self._leg_cost(directed, end - begin, total, {})
        return total

    def seconds(self, legs: Sequence[_Leg]) -> float:
        """Expected seconds of legs; 0 without times."""
        arrival = self.route(legs).arrival
        return 0.0 if arrival is None else arrival.seconds

    def route(self, legs: Sequence[_Leg]) -> PlannedRoute:
        """Build the route of legs; those without a length are left out."""
        # Metres from the start of each edge.
        kept = [leg for leg in legs if leg[2] - leg[1] > 1e-9] or list(legs[:1])
        directed = np.array([leg[0] for leg in kept], np.int64)
        begin, end = np.array([leg[1:] for leg in kept], np.float64).T
        edges, forward = directed // 2, directed % 2 == 0
        length = self._network.lengths[edges]
        begin = np.where(forward, begin, length - begin)
        end = np.where(forward, end, length - end)

        # Its line and its times.
        parts = [
            _cut(self._network, *leg)
            for leg in zip(edges.tolist(), begin.tolist(), end.tolist(), strict=True)
        ]
        line = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        arrival = None
        if self._times is not None:
            arrival = self._times.arrival(edges, forward, self._depart, metres=np.abs(end - begin))
        least = int(self._counts[directed].min())
        return PlannedRoute(edges, forward, begin, end, line, least, arrival)

    def _rest(self, position: Position) -> float:
        """Metres from the end of its edge to a position."""
        return float(self._network.lengths[position.edge]) - position.offset

    def _leg_cost(
        self, directed: int, metres: float, elapsed: float, penalties: dict[int, float]
    ) -> float:
        # The hour counts only for times of a departure.
        hour = 0
        if self._by == "time" and self._local is not None:
            hour = int((self._local + elapsed) % _DAY // _HOUR)
        penalty = penalties.get(directed // 2, 1.0)
        return float(self._rates[directed, hour]) * metres * penalty

    def _ways_on(self, directed: int) -> list[int]:
        """Open directed edges after another one; back on it only at a dead end."""
        ways = self._out[int(self._heads[directed])]
        others = [way for way in ways if way != directed ^ 1]
        return others or ways


def _cut(network: Network, edge: int, begin: float, end: float) -> Floats:
    """Vertices of an edge between two offsets, in the order of travel."""
    # Vertices strictly between, and both ends.
    rows = slice(network.offsets[edge], network.offsets[edge + 1])
    along, points = network.along[rows], network.points[rows]
    low, high = min(begin, end), max(begin, end)
    at = np.concatenate([[low], along[(along > low) & (along < high)], [high]])
    line = np.stack([np.interp(at, along, axis) for axis in points.T], axis=1)
    return line if begin <= end else line[::-1]
