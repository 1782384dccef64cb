"""Alternative paths between two positions on roads: all plausible ones, not only the cheapest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.model.network import Network

if TYPE_CHECKING:
    from gpszip.matching.kernels.alternatives import SearchTree

__all__ = ["PathFinder", "RoadPath", "RoadPosition", "TravelCosts"]

#: Cost bound at which the search for a path ends, as a multiple of the first bound.
_MAX_BOUND = 64

#: First cost bound, as a multiple of the cost of the straight line.
_FIRST_BOUND = 4

#: Length in metres by which is divided at least.
_MIN_LENGTH = 1e-9

#: Decimals of a cost, in seconds, up to which two paths cost the same.
_COST_DECIMALS = 6

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


@dataclass(frozen=True)
class TravelCosts:
    """Costs of a path, in seconds.

    Parameters
    ----------
    roads : float64 array, shape (2 E,)
        Travelling each directed road: 2e is road e from its start to its end, 2e + 1 back.
    turn_cost : float
        Turning off by a right angle at a crossing.
    u_turn_cost : float
        Turning round.
    """

    roads: Floats
    turn_cost: float
    u_turn_cost: float


@dataclass(frozen=True)
class RoadPosition:
    """A position on a directed road where a path may begin or end.

    Parameters
    ----------
    road : int
        Directed road.
    offset : float
        Metres from the start of the road, whatever the direction.
    penalty : float
        Cost in seconds of beginning or ending here, for a position that is less likely.
    """

    road: int
    offset: float
    penalty: float = 0.0


@dataclass(frozen=True, eq=False)
class RoadPath:
    """A path over directed roads.

    Parameters
    ----------
    roads : int32 array, shape (r,)
        Directed roads in the order of travel.
    begin, end : float
        Metres from the start of the first road, and of the last, at which it begins and ends.
    cost : float
        Seconds of travel, turns included.
    penalty : float
        Penalties in seconds of the positions at which it begins and ends.
    """

    roads: NDArray[np.int32]
    begin: float
    end: float
    cost: float
    penalty: float = 0.0


class _SearchStart(NamedTuple):
    """Cost from a position to the end of a directed road (or back to its beginning)."""

    cost: float
    position: RoadPosition


#: Where a search begins, by directed road.
_SearchStarts = dict[int, _SearchStart]


class PathFinder:
    """Finds alternative paths on one network; made once, used for many gaps.

    Parameters
    ----------
    network : Network
        The roads.
    """

    def __init__(self, network: Network) -> None:
        # Nodes at both ends of directed roads.
        self.network = network
        tails = np.stack((network.starts, network.ends), axis=1).ravel().astype(np.int32)
        heads = tails.reshape(-1, 2)[:, ::-1].ravel().copy()
        self._tails, self._heads = tails, heads

        # Open directed roads by node.
        is_open = np.stack((network.forward, network.backward), axis=1).ravel()
        open_roads = np.flatnonzero(is_open)
        self._out_roads = _list_roads_by_node(tails, open_roads, len(network.nodes))
        self._in_roads = _list_roads_by_node(heads, open_roads, len(network.nodes))

        self._is_crossing = np.bincount(tails, minlength=len(network.nodes)) > 2
        self._directions = _start_directions(network)
        self.lengths = np.repeat(network.lengths, 2)

    def find_paths(
        self,
        starts: Sequence[RoadPosition],
        ends: Sequence[RoadPosition],
        costs: TravelCosts,
        *,
        slack: float,
        max_paths: int,
    ) -> list[RoadPath]:
        """Find paths from any of some positions to any of others, cheapest first.

        Besides the cheapest path these are the cheapest paths through each road that visit no
        crossing twice. Where the cheapest path turns round, they are those that don't: an agent may
        go on to the next roundabout and come back.

        Parameters
        ----------
        starts, ends : sequence of RoadPosition
            Where the paths may begin and end.
        costs : TravelCosts
            Costs of travel.
        slack : float
            Seconds; no path costs more than twice the cheapest and this.
        max_paths : int
            Most paths to find.
        """
        # Trees from the starts and to the ends, with a bound that grows until it is enough.
        start_costs = self._search_starts(starts, costs, leaving=True)
        end_costs = self._search_starts(ends, costs, leaving=False)
        first_bound = bound = (
            _FIRST_BOUND * _straight_cost(self.network, costs, starts[0], ends[0]) + slack
        )
        while True:
            trees = self._grow_trees(start_costs, end_costs, costs, bound)
            cheapest = trees.cheapest()
            if 2 * cheapest + slack <= bound or bound > _MAX_BOUND * first_bound:
                break
            bound = 2 * cheapest + slack if np.isfinite(cheapest) else 4 * bound

        # Paths that leave the first road, and those that don't.
        limit = min(2 * cheapest + slack, bound)
        paths = [
            *self._paths_on_one_road(starts, ends, costs),
            *self._paths_through_roads(trees, start_costs, end_costs, limit, max_paths),
        ]
        return sorted(paths, key=lambda path: path.cost + path.penalty)[:max_paths]

    def _grow_trees(
        self,
        start_costs: _SearchStarts,
        end_costs: _SearchStarts,
        costs: TravelCosts,
        bound: float,
    ) -> _Trees:
        """Search forward from all starts, and backward from all ends."""
        from gpszip.matching.kernels.alternatives import shortest_path_tree

        # The kernel takes the cost of a half turn.
        half_turn_cost = 2 * costs.turn_cost
        forward = shortest_path_tree(
            *_to_arrays(start_costs),
            bound,
            costs.roads,
            *self._out_roads,
            self._heads,
            self._is_crossing,
            self._directions,
            half_turn_cost,
            costs.u_turn_cost,
            backward=False,
        )
        backward = shortest_path_tree(
            *_to_arrays(end_costs),
            bound,
            costs.roads,
            *self._in_roads,
            self._tails,
            self._is_crossing,
            self._directions,
            half_turn_cost,
            costs.u_turn_cost,
            backward=True,
        )
        return _Trees(forward, backward, costs)

    def _search_starts(
        self, positions: Sequence[RoadPosition], costs: TravelCosts, *, leaving: bool
    ) -> _SearchStarts:
        """Costs of leaving (or reaching) positions, in both directions of their roads.

        The cost is that of the rest of the road, of turning round, and the penalty.
        """
        # Each position gives its directed road, and the opposite one after a half turn.
        found: _SearchStarts = {}
        for position in positions:
            length = max(float(self.lengths[position.road]), _MIN_LENGTH)

            # The road itself, and turned round if it is open.
            choices = [(position.road, 0.0)]
            opposite = self.network.backward if position.road % 2 == 0 else self.network.forward
            if opposite[position.road >> 1]:
                choices.append((position.road ^ 1, costs.u_turn_cost))

            # Keep the cheapest entry of each directed road, over all positions on it.
            for road, turn in choices:
                is_backward = road % 2 == 1
                metres = position.offset if is_backward == leaving else length - position.offset
                cost = float(costs.roads[road]) * metres / length + turn + position.penalty
                if road not in found or cost < found[road].cost:
                    found[road] = _SearchStart(cost, position)
        return found

    def _paths_through_roads(
        self,
        trees: _Trees,
        start_costs: _SearchStarts,
        end_costs: _SearchStarts,
        bound: float,
        max_paths: int,
    ) -> list[RoadPath]:
        """The cheapest paths through each road that no cheaper path covers."""
        # Take roads by the cost of the cheapest path through each, without those of earlier paths.
        paths: list[RoadPath] = []
        covered: set[int] = set()
        cheapest_turns_round = False
        for road, cost in trees.roads_by_cost():
            if cost > bound or len(paths) >= max_paths:
                break
            if road in covered:
                continue
            roads = trees.path_through(road)
            covered.update(roads)

            # The cheapest path, then simple ones, or those that don't turn round.
            never_turns = _never_turns_round(roads, start_costs, end_costs)
            is_wanted = (
                not paths or self._is_simple(roads) or (cheapest_turns_round and never_turns)
            )
            if len(roads) > 1 and is_wanted:
                if not paths:
                    cheapest_turns_round = not never_turns
                begin, end = start_costs[roads[0]].position, end_costs[roads[-1]].position
                penalty = begin.penalty + end.penalty
                paths.append(
                    RoadPath(
                        np.array(roads, np.int32), begin.offset, end.offset, cost - penalty, penalty
                    )
                )
        return paths

    def _paths_on_one_road(
        self, starts: Sequence[RoadPosition], ends: Sequence[RoadPosition], costs: TravelCosts
    ) -> list[RoadPath]:
        """The paths between starts and ends on the same road."""
        # Pair starts and ends on the same road; such a path has one direction of travel.
        paths = []
        for start in starts:
            for end in ends:
                # The direction must be open.
                is_forward = end.offset >= start.offset
                is_open = self.network.forward if is_forward else self.network.backward
                if start.road >> 1 != end.road >> 1 or not is_open[start.road >> 1]:
                    continue

                # Turning round at the start or end to travel in it.
                road = (start.road & ~1) | (not is_forward)
                length = max(float(self.lengths[road]), _MIN_LENGTH)
                share = abs(end.offset - start.offset) / length
                turns = (road != start.road) + (road != end.road)
                paths.append(
                    RoadPath(
                        np.array([road], np.int32),
                        start.offset,
                        end.offset,
                        float(costs.roads[road]) * share + turns * costs.u_turn_cost,
                        start.penalty + end.penalty,
                    )
                )
        return paths

    def _is_simple(self, roads: Sequence[int]) -> bool:
        """Whether a path visits no crossing and no road twice."""
        crossings = self._heads[list(roads[:-1])]
        return len(np.unique(crossings)) == len(crossings) and len(
            {road >> 1 for road in roads}
        ) == len(roads)

    def travel_time(self, path: RoadPath, costs: TravelCosts) -> float:
        """Seconds of travel on a path, without turns."""
        # Share of each road that is travelled.
        length = np.maximum(self.lengths[path.roads], _MIN_LENGTH)
        share = np.ones(len(path.roads))
        share[0] = (path.begin if path.roads[0] % 2 else length[0] - path.begin) / length[0]
        share[-1] -= (path.end if path.roads[-1] % 2 else length[-1] - path.end) / length[-1]
        return float((costs.roads[path.roads] * share).sum())

    def line(self, path: RoadPath) -> tuple[Floats, Longs]:
        """Vertices of a path in metres, shape (P, d), and the index in the path of each one's road.

        A vertex between two roads comes twice.
        """
        # Collect the vertices road by road.
        network = self.network
        lines, owners = [], []
        for number, road in enumerate(path.roads.tolist()):
            # Vertices of the road, by offset.
            first, last = network.offsets[road >> 1], network.offsets[(road >> 1) + 1]
            along, points = network.along[first:last], network.points[first:last]

            # Offsets at which it is entered and left, and of the vertices between them.
            is_backward = road % 2
            enter = path.begin if number == 0 else (along[-1] if is_backward else 0.0)
            leave = (
                path.end if number == len(path.roads) - 1 else (0.0 if is_backward else along[-1])
            )
            inner = along[(along > min(enter, leave)) & (along < max(enter, leave))]
            offsets = np.concatenate(([enter], inner[:: -1 if enter > leave else 1], [leave]))

            # Interpolate the position in metres at each offset.
            lines.append(np.stack([np.interp(offsets, along, axis) for axis in points.T], axis=1))
            owners.append(np.full(len(offsets), number))
        return np.concatenate(lines), np.concatenate(owners)


class _Trees:
    """A shortest-path tree forward from the starts, and one backward from the ends."""

    def __init__(self, forward: SearchTree, backward: SearchTree, costs: TravelCosts) -> None:
        self._before = dict(zip(forward.roads.tolist(), forward.parents.tolist(), strict=True))
        self._behind = dict(zip(backward.roads.tolist(), backward.parents.tolist(), strict=True))

        # Cost through each road that both trees reach; both include the road itself.
        self._roads, i, j = np.intersect1d(
            forward.roads, backward.roads, assume_unique=True, return_indices=True
        )
        self._costs: Floats = forward.costs[i] + backward.costs[j] - costs.roads[self._roads]

    def cheapest(self) -> float:
        """Cost of the cheapest path, infinite if there is none."""
        return float(self._costs.min()) if len(self._costs) else float("inf")

    def roads_by_cost(self) -> list[tuple[int, float]]:
        """Roads with the cost of the cheapest path through each, cheapest first."""
        order = np.lexsort((self._roads, np.round(self._costs, _COST_DECIMALS)))
        return list(zip(self._roads[order].tolist(), self._costs[order].tolist(), strict=True))

    def path_through(self, road: int) -> list[int]:
        """The cheapest path through a road, as directed roads."""
        before, behind = [], []
        parent = self._before[road]
        while parent >= 0:
            before.append(parent)
            parent = self._before[parent]
        parent = self._behind[road]
        while parent >= 0:
            behind.append(parent)
            parent = self._behind[parent]
        return [*before[::-1], road, *behind]


def _never_turns_round(
    roads: Sequence[int], start_costs: _SearchStarts, end_costs: _SearchStarts
) -> bool:
    """Whether a path never turns round, nor uses a road twice in one direction."""
    turns_at_end = (
        roads[0] != start_costs[roads[0]].position.road
        or roads[-1] != end_costs[roads[-1]].position.road
    )
    turns_between = any(a == b ^ 1 for a, b in pairwise(roads))
    return not turns_at_end and not turns_between and len(set(roads)) == len(roads)


def _to_arrays(starts: _SearchStarts) -> tuple[Longs, Floats]:
    """Directed roads and costs, as the kernel takes them."""
    return np.array(list(starts), np.int64), np.array([start.cost for start in starts.values()])


def _straight_cost(
    network: Network, costs: TravelCosts, start: RoadPosition, end: RoadPosition
) -> float:
    """Seconds for the straight line between the starts of two roads, at the mean pace."""
    points = [network.points[network.offsets[position.road >> 1]] for position in (start, end)]
    straight = float(np.linalg.norm(points[1] - points[0]))
    pace = float(costs.roads.sum() / max(2 * network.lengths.sum(), _MIN_LENGTH))
    return straight * pace


def _list_roads_by_node(
    nodes: NDArray[np.int32], open_roads: NDArray[np.intp], count: int
) -> tuple[Longs, NDArray[np.int32]]:
    """List open directed roads by the node at one end, in compressed sparse rows."""
    order = open_roads[np.argsort(nodes[open_roads], kind="stable")]
    starts = np.searchsorted(nodes[order], np.arange(count + 1)).astype(np.int64)
    return starts, order.astype(np.int32)


def _start_directions(network: Network) -> Floats:
    """Unit vectors at the beginning of directed roads, shape (2 E, 2); zero without a length."""
    first, last = network.offsets[:-1], network.offsets[1:] - 1
    points = network.points[:, :2]
    steps = np.stack(
        (points[first + 1] - points[first], points[last - 1] - points[last]), axis=1
    ).reshape(-1, 2)
    length = np.sqrt((steps**2).sum(axis=1, keepdims=True))
    return np.ascontiguousarray(
        np.divide(steps, length, out=np.zeros_like(steps), where=length > 0)
    )
