"""The most likely way between two places on roads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpszip.kernels.match_roads import Model
from gpszip.kernels.match_search import find_way
from gpszip.kernels.match_trace import Legs
from gpszip.matching.assembling import route_of
from gpszip.matching.index import RoadIndex, index_network, workspace
from gpszip.model.match import Route
from gpszip.model import Network

__all__ = ["Place", "Router"]

#: Metres that a half turn and turning round are worth against a longer way, as shares of the way's bound.
_TURN, _U_TURN = 0.01, 0.05


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
    """Finds likely ways over one network; prepare it once and ask often, from one thread.

    Parameters
    ----------
    network : Network or RoadIndex
        The roads.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]])
    >>> corner = Network(
    ...     nodes, np.array([0, 1], np.int32), np.array([1, 2], np.int32), np.array([0, 2, 4]), nodes[[0, 1, 1, 2]],
    ...     np.ones(2, bool), np.ones(2, bool), np.full(2, np.nan),
    ... )
    >>> way = Router(corner).route(Place(1, 50.0), Place(0, 30.0), longest=200.0)
    >>> way.edges.tolist(), way.forward.tolist(), way.begin.tolist(), way.end.tolist()
    ([1, 0], [False, False], [50.0, 100.0], [0.0, 30.0])
    """

    def __init__(self, network: Network | RoadIndex) -> None:
        self.index = network if isinstance(network, RoadIndex) else index_network(network)
        self._work = workspace(self.index)

    def route(self, start: Place, end: Place, *, longest: float) -> Route | None:
        """The way from one place to another that costs least: metres, and a little for turning off and more for turning round.

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
        model = _model(longest)
        best: tuple[float, Legs] | None = None
        for a in self._directed(start):
            for b in self._directed(end):
                found = self._way(a, self._metres(start, a), b, self._metres(end, b), longest, model)
                if found is not None and (best is None or found[0] < best[0]):
                    best = found
        return None if best is None else route_of(self.index, best[1])

    def _directed(self, place: Place) -> list[int]:
        ways = (0, 1) if place.forward is None else (0,) if place.forward else (1,)
        return [2 * place.edge + way for way in ways if self.index.graph.open[2 * place.edge + way]]

    def _metres(self, place: Place, directed: int) -> float:
        length = float(self.index.graph.lengths[directed])
        offset = min(max(place.offset, 0.0), length)
        return length - offset if directed & 1 else offset

    def _way(self, a: int, begin: float, b: int, end: float, longest: float, model: Model) -> tuple[float, Legs] | None:
        """Price in metres and legs of the cheapest way between two directed places."""
        graph, work = self.index.graph, self._work
        length = float(graph.lengths[a])
        offers: list[tuple[float, Legs]] = []
        if a == b and end >= begin:
            offers.append((end - begin, _legs([a], [begin], [end])))
        if a == b ^ 1:  # turn round where that is shortest
            turn = max(begin, length - end)
            offers.append((abs(length - end - begin) + model.beta * model.u_turn, _legs([a, b], [begin, length - turn], [turn, end])))
        bound = longest + model.beta * (model.turn + model.u_turn)
        way = find_way(a, length - begin, b, bound, graph, model, work)
        if len(way):
            roads = [a, *way.tolist()]
            offers.append(
                (float(work.price[b]) + end, _legs(roads, [begin] + [0.0] * len(way), [*graph.lengths[roads[:-1]].tolist(), end]))
            )
        offers = [offer for offer in offers if float((offer[1].end - offer[1].begin).sum()) <= longest]
        return min(offers, key=lambda offer: offer[0], default=None)


def _model(longest: float) -> Model:
    """Prices of turns; nothing else of it is asked."""
    none = (0.0,) * 7
    return Model(1.0, longest, 0.0, 0.0, 0.0, _TURN, _U_TURN, 0.0, 0.0, 1, *none[:4])


def _legs(roads: list[int], begin: list[float], end: list[float]) -> Legs:
    return Legs(np.array(roads, np.int32), np.array(begin), np.array(end), np.zeros(len(roads), np.int64))
