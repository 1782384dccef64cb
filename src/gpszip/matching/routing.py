"""The most likely way between two places on roads."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.matching.result import Route
from gpszip.model.network import Network

__all__ = ["Place", "Router"]


@dataclass(frozen=True)
class Place:
    """A place on a road.

    Parameters
    ----------
    edge : int
        Road of the network.
    offset : float
        Metres from the road's start along it.
    forward : bool, optional
        Direction of travel there, from the road's start to its end or the other way; None where it isn't known.
    """

    edge: int
    offset: float
    forward: bool | None = None


class Router:
    """Finds likely ways over one network; prepare it once and ask often.

    Parameters
    ----------
    network : Network
        The roads.
    """

    def __init__(self, network: Network) -> None:
        self.network = network

    def route(self, start: Place, end: Place, *, longest: float) -> Route | None:
        """The way from one place to another that costs least: metres, and a little for turning off and much for turning round.

        Parameters
        ----------
        start, end : Place
            Where it begins and ends.
        longest : float
            No way of more than so many metres is looked for.

        Returns
        -------
        Route or None
            None if there is none within that length.
        """
        raise NotImplementedError
