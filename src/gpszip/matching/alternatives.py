"""Ways between two places on roads: not only the cheapest, but all that somebody in his senses might take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.model.network import Network

__all__ = ["PathFinder", "RoadPath", "RoadPosition", "TravelCosts"]

Floats = NDArray[np.float64]

#: The search for a way ends when it has gone so many times as far as a usual way would.
_FARTHEST = 64


@dataclass(frozen=True)
class TravelCosts:
    """What a way costs, in seconds.

    Parameters
    ----------
    roads : float64 array, shape (2 E,)
        Travelling each directed road: 2e is road e from its start to its end, 2e + 1 back.
    turn_cost : float
        Turning off by a right angle where roads cross.
    u_turn_cost : float
        Turning round.
    """

    roads: Floats
    turn_cost: float
    u_turn_cost: float


@dataclass(frozen=True)
class RoadPosition:
    """Where a way may begin or end.

    Parameters
    ----------
    road : int
        Directed road.
    offset : float
        Metres from the start of the road, whatever the direction.
    penalty : float
        Seconds for which this place has to make up, as it is not the likeliest.
    """

    road: int
    offset: float
    penalty: float = 0.0


@dataclass(frozen=True, eq=False)
class RoadPath:
    """A way over directed roads.

    Parameters
    ----------
    roads : int32 array, shape (r,)
        Directed roads in the order of travel.
    begin, end : float
        Metres from the start of the first road, and of the last, at which it begins and ends.
    cost : float
        Seconds of travel, turns included.
    penalty : float
        Seconds more for the places at which it begins and ends.
    """

    roads: NDArray[np.int32]
    begin: float
    end: float
    cost: float
    penalty: float = 0.0


class PathFinder:
    """Finds ways on one network; made once, asked often.

    Parameters
    ----------
    network : Network
        The roads.
    """

    def __init__(self, network: Network) -> None:
        self.network = network
        tails = np.stack((network.starts, network.ends), axis=1).ravel().astype(np.int32)
        heads = tails.reshape(-1, 2)[:, ::-1].ravel().copy()
        open_ = np.flatnonzero(np.stack((network.forward, network.backward), axis=1).ravel())
        self._tails, self._heads = tails, heads
        self._outs, self._ins = (
            _links(tails, open_, len(network.nodes)),
            _links(heads, open_, len(network.nodes)),
        )
        self._crossings = np.bincount(tails, minlength=len(network.nodes)) > 2
        self._headings = _headings(network)
        self.lengths = np.repeat(network.lengths, 2)

    def find_paths(
        self,
        starts: Sequence[RoadPosition],
        ends: Sequence[RoadPosition],
        prices: TravelCosts,
        *,
        slack: float,
        max_paths: int,
    ) -> list[RoadPath]:
        """Ways from one of some places to one of others, cheapest first.

        Besides the cheapest way these are the cheapest ways through each road that visit no crossing twice; or, where the cheapest way
        turns round, those that don't: somebody goes on to the next roundabout, and comes back.

        Parameters
        ----------
        starts, ends : sequence of Place
            Where they may begin and end.
        prices : Prices
            What they cost.
        slack : float
            No way costs more than twice the cheapest and so many seconds.
        max_paths : int
            No more ways than so many.
        """
        from gpszip.matching.kernels.alternatives import shortest_path_tree

        one, other = (
            self._sources(starts, prices, ahead=True),
            self._sources(ends, prices, ahead=False),
        )
        traits = self._crossings, self._headings
        turns = 2 * prices.turn_cost, prices.u_turn_cost
        first = bound = _reach(self.network, prices, starts[0], ends[0]) + slack
        while True:
            there = shortest_path_tree(
                *_columns(one),
                bound,
                prices.roads,
                *self._outs,
                self._heads,
                *traits,
                *turns,
                back=False,
            )
            back = shortest_path_tree(
                *_columns(other),
                bound,
                prices.roads,
                *self._ins,
                self._tails,
                *traits,
                *turns,
                back=True,
            )
            cheapest = _cheapest(there, back, prices)
            if 2 * cheapest + slack <= bound or bound > _FARTHEST * first:
                break
            bound = 2 * cheapest + slack if np.isfinite(cheapest) else 4 * bound
        limit = min(2 * cheapest + slack, bound)
        through = self._through(_Trees(there, back, prices), one, other, limit, max_paths)
        return sorted(
            [*self._along_one_road(starts, ends, prices), *through],
            key=lambda way: way.cost + way.penalty,
        )[:max_paths]

    def _sources(
        self, places: Sequence[RoadPosition], prices: TravelCosts, *, ahead: bool
    ) -> dict[int, tuple[float, RoadPosition]]:
        """Directed roads on which a search begins, with what it takes to leave (or reach) the place there, the doubt included."""
        found: dict[int, tuple[float, RoadPosition]] = {}
        for place in places:
            length = max(float(self.lengths[place.road]), 1e-9)
            turned = self.network.backward if place.road % 2 == 0 else self.network.forward
            for road, price in ((place.road, 0.0), (place.road ^ 1, prices.u_turn_cost))[
                : 1 + bool(turned[place.road >> 1])
            ]:
                rest = place.offset if (road % 2 == 1) == ahead else length - place.offset
                whole = float(prices.roads[road]) * rest / length + price + place.penalty
                if road not in found or whole < found[road][0]:
                    found[road] = (whole, place)
        return found

    def _through(
        self,
        trees: _Trees,
        one: dict[int, tuple[float, RoadPosition]],
        other: dict[int, tuple[float, RoadPosition]],
        bound: float,
        max_paths: int,
    ) -> list[RoadPath]:
        found: list[RoadPath] = []
        covered: set[int] = set()
        turning = False
        for road, price in trees.through():
            if price > bound or len(found) >= max_paths:
                break
            if road in covered:
                continue
            roads = trees.way(road)
            covered.update(roads)
            if len(roads) > 1 and (
                not found or self._simple(roads) or (turning and _drivable(roads, one, other))
            ):
                turning = turning or (not found and not _drivable(roads, one, other))
                begin, end = one[roads[0]][1], other[roads[-1]][1]
                doubt = begin.penalty + end.penalty
                found.append(
                    RoadPath(
                        np.array(roads, np.int32), begin.offset, end.offset, price - doubt, doubt
                    )
                )
        return found

    def _along_one_road(
        self, starts: Sequence[RoadPosition], ends: Sequence[RoadPosition], prices: TravelCosts
    ) -> list[RoadPath]:
        found = []
        for start in starts:
            for end in ends:
                forwards = end.offset >= start.offset
                road = (start.road & ~1) | (not forwards)
                if (
                    start.road >> 1 != end.road >> 1
                    or not (self.network.forward if forwards else self.network.backward)[road >> 1]
                ):
                    continue
                share = abs(end.offset - start.offset) / max(float(self.lengths[road]), 1e-9)
                turns = (road != start.road) + (road != end.road)
                price = float(prices.roads[road]) * share + turns * prices.u_turn_cost
                found.append(
                    RoadPath(
                        np.array([road], np.int32),
                        start.offset,
                        end.offset,
                        price,
                        start.penalty + end.penalty,
                    )
                )
        return found

    def _simple(self, roads: Sequence[int]) -> bool:
        inner = self._heads[list(roads[:-1])]
        return len(np.unique(inner)) == len(inner) and len({road >> 1 for road in roads}) == len(
            roads
        )

    def travel_time(self, way: RoadPath, prices: TravelCosts) -> float:
        """What travelling a way takes without any turns."""
        length = np.maximum(self.lengths[way.roads], 1e-9)
        share = np.ones(len(way.roads))
        share[0] = (way.begin if way.roads[0] % 2 else length[0] - way.begin) / length[0]
        share[-1] -= (way.end if way.roads[-1] % 2 else length[-1] - way.end) / length[-1]
        return float((prices.roads[way.roads] * share).sum())

    def line(self, way: RoadPath) -> tuple[Floats, NDArray[np.int64]]:
        """Vertices of a way in metres, shape (P, d), and the number of the road after each but the last."""
        network = self.network
        pieces, owners = [], []
        for number, road in enumerate(way.roads.tolist()):
            first, last = network.offsets[road >> 1], network.offsets[(road >> 1) + 1]
            along, points = network.along[first:last], network.points[first:last]
            low = way.begin if number == 0 else (along[-1] if road % 2 else 0.0)
            high = way.end if number == len(way.roads) - 1 else (0.0 if road % 2 else along[-1])
            inner = along[(along > min(low, high)) & (along < max(low, high))]
            at = np.concatenate(([low], inner[:: -1 if low > high else 1], [high]))
            pieces.append(np.stack([np.interp(at, along, axis) for axis in points.T], axis=1))
            owners.append(np.full(len(at), number))
        return np.concatenate(pieces), np.concatenate(owners)


class _Trees:
    """What the two searches found."""

    def __init__(self, there: tuple[Any, ...], back: tuple[Any, ...], prices: TravelCosts) -> None:
        self.prices = prices
        self._ahead = dict(zip(there[0].tolist(), there[2].tolist(), strict=True))
        self._beyond = dict(zip(back[0].tolist(), back[2].tolist(), strict=True))
        self._roads, self._price = _both(there, back, prices)

    def through(self) -> list[tuple[int, float]]:
        """Roads with the price of the cheapest way through each, cheapest first."""
        order = np.lexsort((self._roads, np.round(self._price, 6)))
        return list(zip(self._roads[order].tolist(), self._price[order].tolist(), strict=True))

    def way(self, road: int) -> list[int]:
        """The cheapest way through a road."""
        before, after = [], []
        at = self._ahead[road]
        while at >= 0:
            before.append(at)
            at = self._ahead[at]
        at = self._beyond[road]
        while at >= 0:
            after.append(at)
            at = self._beyond[at]
        return [*before[::-1], road, *after]


def _both(
    there: tuple[Any, ...], back: tuple[Any, ...], prices: TravelCosts
) -> tuple[NDArray[np.int32], Floats]:
    roads, i, j = np.intersect1d(there[0], back[0], assume_unique=True, return_indices=True)
    return roads, there[1][i] + back[1][j] - prices.roads[roads]


def _cheapest(there: tuple[Any, ...], back: tuple[Any, ...], prices: TravelCosts) -> float:
    price = _both(there, back, prices)[1]
    return float(price.min()) if len(price) else float("inf")


def _drivable(
    roads: Sequence[int],
    one: dict[int, tuple[float, RoadPosition]],
    other: dict[int, tuple[float, RoadPosition]],
) -> bool:
    """Whether a way never turns round, nor uses a road twice in one direction."""
    ahead = roads[0] == one[roads[0]][1].road and roads[-1] == other[roads[-1]][1].road
    return ahead and len(set(roads)) == len(roads) and all(a != b ^ 1 for a, b in pairwise(roads))


def _columns(sources: dict[int, tuple[float, RoadPosition]]) -> tuple[NDArray[np.int64], Floats]:
    return np.array(list(sources), np.int64), np.array([price for price, _ in sources.values()])


def _reach(network: Network, prices: TravelCosts, start: RoadPosition, end: RoadPosition) -> float:
    """Seconds that the way should take if it were not much longer than the straight line."""
    place = [network.points[network.offsets[one.road >> 1]] for one in (start, end)]
    straight = float(np.linalg.norm(place[1] - place[0]))
    pace = float(prices.roads.sum() / max(2 * network.lengths.sum(), 1e-9))
    return 4 * straight * pace


def _links(
    nodes: NDArray[np.int32], open_: NDArray[np.intp], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    order = open_[np.argsort(nodes[open_], kind="stable")]
    begins = np.searchsorted(nodes[order], np.arange(count + 1)).astype(np.int64)
    return begins, order.astype(np.int32)


def _headings(network: Network) -> Floats:
    """Unit vectors at the beginning of each directed road, shape (2 E, 2)."""
    first, last = network.offsets[:-1], network.offsets[1:] - 1
    points = network.points[:, :2]
    steps = np.stack(
        (points[first + 1] - points[first], points[last - 1] - points[last]), axis=1
    ).reshape(-1, 2)
    length = np.sqrt((steps**2).sum(axis=1, keepdims=True))
    return np.ascontiguousarray(
        np.divide(steps, length, out=np.zeros_like(steps), where=length > 0)
    )
