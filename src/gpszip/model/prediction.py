"""Predictions of where an agent goes, and when it arrives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

__all__ = ["Destination", "LikelyNode", "LikelyRoute", "NextRoad", "Outlook", "TripArrival"]


class NextRoad(NamedTuple):
    """A road that may come next.

    Parameters
    ----------
    edge : int
        Road of the network.
    forward : bool
        Whether it would be travelled from its start to its end.
    probability : float
        By what followed before (:class:`gpszip.Predictor`), or by the angle of the turn.
    """

    edge: int
    forward: bool
    probability: float


class LikelyRoute(NamedTuple):
    """Roads that may come next, one after the other.

    Parameters
    ----------
    edges : tuple of (int, bool)
        Roads of the network, and whether each would be travelled from its start to its end.
    probability : float
        Probability that exactly these come next.
    """

    edges: tuple[tuple[int, bool], ...]
    probability: float


class LikelyNode(NamedTuple):
    """A node at which a trip may end.

    Parameters
    ----------
    node : int
        Node of the network.
    probability : float
        Share of the trips like this one that ended there.
    """

    node: int
    probability: float


@dataclass(frozen=True)
class TripArrival:
    """When an agent arrives.

    Parameters
    ----------
    seconds : float
        Seconds from now; half of all arrivals are earlier.
    low, high : float
        Seconds of the 80 % band: a tenth of all arrivals is earlier, and a tenth later.
    metres : float
        Length of the route that remains.
    route : tuple of (int, bool)
        The route that remains: edges, and whether each is travelled from its start to its end.
    """

    seconds: float
    low: float
    high: float
    metres: float
    route: tuple[tuple[int, bool], ...]


@dataclass(frozen=True)
class Destination:
    """A place at which a trip may end, and when.

    Parameters
    ----------
    node : int
        Node of the network.
    probability : float
        Share of the trips like this one that ended there.
    position : tuple of float
        Latitude and longitude, or x and y in metres.
    arrival : TripArrival or None
        When the agent arrives; None if no way leads there, or the archive has no times.
    """

    node: int
    probability: float
    position: tuple[float, ...]
    arrival: TripArrival | None


@dataclass(frozen=True)
class Outlook:
    """Where an agent goes from its last position.

    Parameters
    ----------
    track : str
        Name of the track.
    time : float
        Seconds of its last position; NaN for a track without times.
    edge : int
        Edge that it travels; -1 if it is off the map, and then nothing is known.
    forward : bool
        Whether it travels the edge from its start to its end.
    next : tuple of NextRoad
        Edges that may follow, the likeliest first.
    routes : tuple of LikelyRoute
        Likeliest routes over the next edges.
    destinations : tuple of Destination
        Where the trip may end, the likeliest first.
    """

    track: str
    time: float
    edge: int
    forward: bool
    next: tuple[NextRoad, ...]
    routes: tuple[LikelyRoute, ...]
    destinations: tuple[Destination, ...]
