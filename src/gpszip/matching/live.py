"""Where an agent is on the roads, one sample at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError, TrackError
from gpszip.kernels.match_lattice import GAP, JUMP
from gpszip.kernels.match_live import add_layer, empty_ring, settled
from gpszip.kernels.match_trace import nearest_on
from gpszip.matching.index import RoadIndex, index_network, workspace
from gpszip.matching.rules import apart, model_of
from gpszip.model import Network
from gpszip.model.match import Scales

__all__ = ["LiveMatcher", "Next", "Settled", "Whereabouts"]

#: Receivers in vehicles at about one sample a second, on the maps that there are of streets (docs/matching.md).
_STREETS = Scales(error=6.5, sigma=40.0, beta=6.5, usual=10.0, fastest=150.0)


class Next(NamedTuple):
    """A road that may come next.

    Parameters
    ----------
    edge : int
        Road of the network.
    forward : bool
        Whether it would be travelled from its start to its end.
    probability : float
        How likely it is, by how far one must turn off for it.
    """

    edge: int
    forward: bool
    probability: float


class Settled(NamedTuple):
    """Where a sample was, as seen after the lag.

    Parameters
    ----------
    time : float
        Of the sample in seconds.
    edge : int
        Road of the network, -1 for none.
    forward : bool
        Whether it was travelled from its start to its end.
    offset : float
        Metres from the road's start, NaN for none.
    distance : float
        Metres from the sample to its place, NaN for none.
    linked : bool
        Whether a way leads there from the sample settled before.
    """

    time: float
    edge: int
    forward: bool
    offset: float
    distance: float
    linked: bool


class Whereabouts(NamedTuple):
    """Where the agent is now.

    Parameters
    ----------
    time : float
        Seconds, as given.
    edge : int
        Road of the network, -1 for none.
    forward : bool
        Whether it is travelled from its start to its end.
    offset : float
        Metres from the road's start, NaN for none.
    distance : float
        Metres from the sample to its place, NaN for none.
    confidence : float
        Probability of the road in this direction, or of being off all roads, given the samples so far.
    off_map : bool
        Whether the agent is on no road.
    next : tuple of Next
        Roads that leave from the end of this one.
    settled : tuple of Settled
        Where earlier samples were, each told once, when its lag has passed: those that lie apart, not each of a standing agent.
    """

    time: float
    edge: int
    forward: bool
    offset: float
    distance: float
    confidence: float
    off_map: bool
    next: tuple[Next, ...]
    settled: tuple[Settled, ...]


class LiveMatcher:
    """Follows one agent over a network, with the model of :func:`gpszip.match`; work and memory don't grow with the log.

    Parameters
    ----------
    network : Network or RoadIndex
        The roads; an index is shared by the matchers of many agents.
    scales : Scales, optional
        What the model knows of the log, such as ``gpszip.match(earlier, network).scales``. By default those of vehicles with
        a receiver, on roads in degrees.
    lag : int, default 20
        Samples are settled after so many that lie apart.
    gap : float, default 120.0
        Silences longer than this, in seconds, break the way.

    Raises
    ------
    OptionError
        If the roads are on a plane of their own and no scales are given.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]])
    >>> corner = Network(
    ...     nodes, np.array([0, 1], np.int32), np.array([1, 2], np.int32), np.array([0, 2, 4]), nodes[[0, 1, 1, 2]],
    ...     np.ones(2, bool), np.ones(2, bool), np.full(2, np.nan),
    ... )
    >>> matcher = LiveMatcher(corner, Scales(error=2.0, sigma=3.0, beta=3.0, usual=9.0, fastest=40.0), lag=2)
    >>> here = [matcher.push(t, [9.0 * t, 0.5]) for t in range(8)][-1]
    >>> here.edge, here.forward, here.offset, [(one.edge, one.forward) for one in here.next], here.settled[0].offset
    (0, True, 63.0, [(0, False), (1, True)], 45.0)
    """

    def __init__(self, network: Network | RoadIndex, scales: Scales | None = None, *, lag: int = 20, gap: float = 120.0) -> None:
        self.index = network if isinstance(network, RoadIndex) else index_network(network)
        if scales is None and self.index.network.plane is None:
            raise OptionError("roads on a plane of their own have no usual scales; give those of gpszip.match(earlier, network).scales")
        if lag < 1 or not gap > 0:
            raise OptionError(f"lag is {lag} and gap {gap:g}; both must be positive")
        self.scales = scales or _STREETS
        self._lag, self._gap = lag, gap
        self._model, self._apart = model_of(self.scales), apart(self.scales)
        self._work = workspace(self.index)
        self._ring = empty_ring(lag + 2, 2 * self._model.most + 1)
        self._times = [0.0] * (lag + 2)
        self._places = np.zeros((lag + 2, self.index.dimension))
        self._used = self._run = 0  # layers so far, and of these since the last silence
        self._last: tuple[float, NDArray[np.float64], bool] | None = None  # the last sample, and whether it has a layer
        self._at: Whereabouts | None = None
        self._told = 0  # layers that have been settled
        self._next: dict[int, tuple[Next, ...]] = {}

    def push(self, time: float, position: ArrayLike) -> Whereabouts:
        """Take in a sample and tell where the agent is.

        Parameters
        ----------
        time : float
            Seconds, later than the one before.
        position : array_like, shape (d,)
            Metres on the plane of the network.

        Raises
        ------
        TrackError
            If time stands still or goes back, or a number is not finite; the sample is not taken in.
        """
        place = np.zeros(self.index.dimension)
        given = np.asarray(position, dtype=np.float64)[: len(place)]
        place[: len(given)] = given
        if not (math.isfinite(time) and np.isfinite(place).all()):
            raise TrackError(f"sample at {time:g} s is not finite; drop it")
        if self._last is not None and time <= self._last[0]:
            raise TrackError(f"time {time:g} does not follow {self._last[0]:g}; drop the sample")
        now = self._taken(time, place)
        behind = self._used - self._lag
        return now._replace(settled=self._settle(behind)) if behind > self._told else now

    def finish(self) -> tuple[Settled, ...]:
        """Tell where the rest of the samples were; what is pushed from here on begins anew."""
        if self._last is not None and not self._last[2]:
            self._end(*self._last[:2])
        rest = self._settle(self._used)
        self._last = self._at = None
        self._used = self._run = self._told = 0
        return rest

    def _taken(self, time: float, place: NDArray[np.float64]) -> Whereabouts:
        if self._last is None:
            return self._layer(time, place, silent=True)
        last, where, used = self._last
        if time - last > self._gap:
            if not used:
                self._end(last, where)
            return self._layer(time, place, silent=True)
        if self._distance(place) >= self._apart:
            return self._layer(time, place, silent=False)
        self._last = (time, place, False)
        return self._between(time, place)

    def _distance(self, place: NDArray[np.float64]) -> float:
        """From the sample of the last layer, rounded as in the batch: at a crossing the last bit decides between two names of one place."""
        square = 0.0
        for one, other in zip(place.tolist(), self._places[(self._used - 1) % len(self._times)].tolist(), strict=True):
            square += (one - other) * (one - other)
        return math.sqrt(square)

    def _end(self, time: float, place: NDArray[np.float64]) -> None:
        """Give the last sample before a silence its layer; it stands for the one just before it."""
        if self._run > 1:
            self._used -= 1
            self._run -= 1
        self._layer(time, place, silent=False)

    def _layer(self, time: float, place: NDArray[np.float64], *, silent: bool) -> Whereabouts:
        number, slot = self._used, self._used % len(self._times)
        straight, seconds = 0.0, math.inf
        if not silent:
            straight, seconds = self._distance(place), time - self._times[(number - 1) % len(self._times)]
        index = self.index
        road, metres, distance, share, kind = add_layer(
            self._ring, number, place, straight, seconds, index.roads, index.cells, index.graph, self._model, self._work
        )  # fmt: skip
        self._times[slot], self._places[slot] = time, place
        self._used, self._run, self._last = number + 1, 1 if silent else self._run + 1, (time, place, True)
        before = self._at
        if before is not None and kind not in {GAP, JUMP} and before.edge == road >> 1 and before.forward == (not road & 1):
            metres = max(metres, self._metres(road, before.offset))  # a little back is standing still
        self._at = self._whereabouts(time, road, metres, distance, share)
        return self._at

    def _settle(self, until: int) -> tuple[Settled, ...]:
        """Tell the layers before one that have not been told yet."""
        layers = range(self._told, until)
        self._told = max(self._told, until)
        return tuple(self._one_settled(layer) for layer in layers)

    def _one_settled(self, layer: int) -> Settled:
        road, metres, distance, linked = settled(self._ring, self._used - 1, self._used - 1 - layer)
        time = self._times[layer % len(self._times)]
        if road < 0:
            return Settled(time, -1, False, math.nan, math.nan, False)
        return Settled(time, road >> 1, not road & 1, self._metres(road, metres), distance, linked)

    def _metres(self, road: int, metres: float) -> float:
        """From metres along a directed road to metres from the road's start, and back."""
        return float(self.index.graph.lengths[road]) - metres if road & 1 else metres

    def _between(self, time: float, place: NDArray[np.float64]) -> Whereabouts:
        """A sample near the last one that has a layer: on the same road."""
        at = self._at
        assert at is not None
        if at.off_map:
            return at._replace(time=time)
        road = 2 * at.edge + (not at.forward)
        low = self._metres(road, at.offset)
        metres, distance = nearest_on(place, road, low, float(self.index.graph.lengths[road]), self.index.roads, self.index.graph)
        self._at = at._replace(time=time, offset=self._metres(road, metres), distance=distance)
        return self._at

    def _whereabouts(self, time: float, road: int, metres: float, distance: float, share: float) -> Whereabouts:
        if road < 0:
            return Whereabouts(time, -1, False, math.nan, math.nan, share, True, (), ())
        following = self._next.get(road)
        if following is None:
            following = self._next[road] = self._following(road)
        return Whereabouts(time, road >> 1, not road & 1, self._metres(road, metres), distance, share, False, following, ())

    def _following(self, road: int) -> tuple[Next, ...]:
        """Roads that leave from the end of a directed road, each as likely as the model's price of the turn tells."""
        graph, model = self.index.graph, self._model
        node = graph.heads[road]
        outs = graph.outs[graph.begins[node] : graph.begins[node + 1]]
        cosines = -(graph.headings[outs] @ graph.headings[road ^ 1])
        weights = np.exp(-np.where(outs == road ^ 1, model.u_turn, 0.5 * model.turn * (1.0 - cosines)))
        shares = weights / weights.sum() if len(outs) else weights
        return tuple(Next(int(out) >> 1, not int(out) & 1, float(share)) for out, share in zip(outs, shares, strict=True))
