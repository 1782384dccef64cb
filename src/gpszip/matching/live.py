"""Where an agent is on the roads, one sample at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError, TrackError
from gpszip.matching.averaging import RunningAverage, Sample
from gpszip.matching.headings import heading_vectors
from gpszip.matching.index import RoadIndex, create_workspace, index_network
from gpszip.matching.kernels.backtrace import nearest_on_road
from gpszip.matching.kernels.candidates import BREAK, JUMP
from gpszip.matching.kernels.live import (
    add_time_step,
    backtrack,
    best_candidate,
    empty_ring,
    find_convergence,
)
from gpszip.matching.parameters import min_spacing, model_parameters
from gpszip.model import Network
from gpszip.model.match import Scales

__all__ = ["FinalisedPosition", "LiveMatcher", "LivePosition", "NextRoad"]

#: Receivers in vehicles at about one sample a second, on the maps that there are of streets (docs/matching.md).
_STREETS = Scales(error=5.8, sigma=36.0, beta=5.9, median_speed=10.0, max_speed=150.0, heading=30.0)

#: Facing nowhere.
_NOWHERE = np.zeros(2)


class NextRoad(NamedTuple):
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


class FinalisedPosition(NamedTuple):
    """Where a sample was, as seen from later ones.

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
    converged : bool
        Whether no later sample could change it: it is what the batch finds. False where the lag was over before all chains agreed.
    """

    time: float
    edge: int
    forward: bool
    offset: float
    distance: float
    linked: bool
    converged: bool


class LivePosition(NamedTuple):
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
    finalised : tuple of Settled
        Where earlier samples were, each told once, as soon as no later one can change it, or when its lag has passed: those that
        lie apart, not each of a standing agent.
    """

    time: float
    edge: int
    forward: bool
    offset: float
    distance: float
    confidence: float
    off_map: bool
    next: tuple[NextRoad, ...]
    finalised: tuple[FinalisedPosition, ...]

    def __repr__(self) -> str:
        road = "off the map" if self.off_map else f"road {self.edge}, {self.offset:.1f} m"
        return (
            f"LivePosition({self.time:.10g} s, {road}, confidence {self.confidence:.2f}, "
            f"{len(self.next)} next, {len(self.finalised)} finalised)"
        )


class LiveMatcher:
    """Follows one agent over a network, with the model of :func:`gpszip.match`; work and memory don't grow with the log.

    A sample that leaps far away is off the roads and breaks the way; only the batch knows whether the next ones come back.

    Parameters
    ----------
    network : Network or RoadIndex
        The roads; an index is shared by the matchers of many agents.
    scales : Scales, optional
        What the model knows of the log, such as ``gpszip.match(earlier, network).scales``. By default those of vehicles with
        a receiver, on roads in degrees.
    lag : int, default 100
        Samples are settled as soon as no later one can change them, at the latest after so many that lie apart.
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
    >>> matcher = LiveMatcher(corner, Scales(error=2.0, sigma=3.0, beta=3.0, median_speed=9.0, max_speed=40.0), lag=2)
    >>> here = [matcher.push(t, [9.0 * t, 0.5]) for t in range(8)][-1]
    >>> here.edge, here.forward, here.offset, [(one.edge, one.forward) for one in here.next], here.finalised[0].offset
    (0, True, 63.0, [(0, False), (1, True)], 45.0)
    """

    def __init__(
        self,
        network: Network | RoadIndex,
        scales: Scales | None = None,
        *,
        lag: int = 100,
        gap: float = 120.0,
    ) -> None:
        self.index = network if isinstance(network, RoadIndex) else index_network(network)
        if scales is None and self.index.network.plane is None:
            raise OptionError(
                "roads on a plane of their own have no usual scales; give those of gpszip.match(earlier, network).scales"
            )
        if lag < 1 or not gap > 0:
            raise OptionError(f"lag is {lag} and gap {gap:g}; both must be positive")
        self.scales = scales or _STREETS
        self._lag, self._gap = lag, gap
        self._model, self._apart = model_parameters(self.scales), min_spacing(self.scales)
        self._work = create_workspace(self.index)
        self._ring = empty_ring(lag + 2, 2 * self._model.max_candidates + 1)
        self._times = [0.0] * (lag + 2)
        self._places: list[list[float]] = [[]] * (lag + 2)
        self._used = self._run = 0  # layers so far, and of these since the last silence
        # the last sample: time, place, where it faced, and whether it has a layer
        self._last: tuple[float, NDArray[np.float64], NDArray[np.float64], bool] | None = None
        self._at: LivePosition | None = None
        self._means, self._newest = RunningAverage(self.scales.averaging_window), -math.inf
        self._told = 0  # layers that have been settled
        self._next: dict[int, tuple[NextRoad, ...]] = {}

    def push(self, time: float, position: ArrayLike, heading: float | None = None) -> LivePosition:
        """Take in a sample and tell where the agent is.

        Parameters
        ----------
        time : float
            Seconds, later than the one before.
        position : array_like, shape (d,)
            Metres on the plane of the network.
        heading : float, optional
            Where the agent faces, in degrees clockwise from north (y on a plane of its own); NaN is as good as none. It counts as far
            as the scales have a spread of headings.

        Raises
        ------
        TrackError
            If time stands still or goes back, or a number is not finite; the sample is not taken in.
        """
        place = np.array(position, dtype=np.float64)[: self.index.dimension]
        if len(place) < self.index.dimension:
            place = np.append(place, np.zeros(self.index.dimension - len(place)))
        if not (math.isfinite(time) and all(map(math.isfinite, place.tolist()))):
            raise TrackError(f"sample at {time:g} s is not finite; drop it")
        if time <= self._newest:
            raise TrackError(f"time {time:g} does not follow {self._newest:g}; drop the sample")
        ended = self._means.finish() if time - self._newest > self._gap else []
        self._newest = time
        finalised = self._heard(
            [*ended, *self._means.push((time, place, self._facing(heading, place)))]
        )
        now = (
            self._at if self._at is not None and self._at.time == time else self._near(time, place)
        )
        return now._replace(finalised=finalised) if finalised else now

    def finish(self) -> tuple[FinalisedPosition, ...]:
        """Tell where the rest of the samples were; what is pushed from here on begins anew."""
        finalised = self._heard(self._means.finish())
        if self._last is not None and not self._last[3]:
            self._end(*self._last[:3])
        rest = (
            self._tell(self._used - 1, best_candidate(self._ring, self._used - 1), converged=True)
            if self._used
            else ()
        )
        self._last = self._at = None
        self._newest = -math.inf
        self._used = self._run = self._told = 0
        return finalised + rest

    def _heard(self, samples: list[Sample]) -> tuple[FinalisedPosition, ...]:
        """Take in samples, and tell what they settle."""
        finalised: tuple[FinalisedPosition, ...] = ()
        for time, place, facing in samples:
            layers = self._used
            self._taken(time, place, facing)
            finalised += self._settle() if self._used > layers else ()
        return finalised

    def _facing(self, heading: float | None, place: NDArray[np.float64]) -> NDArray[np.float64]:
        if heading is None or not math.isfinite(heading):
            return _NOWHERE
        (vector,) = heading_vectors(np.array([heading]), place[None], self.index.network.plane)
        return np.asarray(vector)

    def _taken(
        self, time: float, place: NDArray[np.float64], facing: NDArray[np.float64]
    ) -> LivePosition:
        if self._last is None:
            return self._layer(time, place, facing, is_gap=True)
        last, where, faced, used = self._last
        if time - last > self._gap:
            if not used:
                self._end(last, where, faced)
            return self._layer(time, place, facing, is_gap=True)
        if self._distance(place) >= self._apart:
            return self._layer(time, place, facing, is_gap=False)
        self._last = (time, place, facing, False)
        return self._between(time, place)

    def _distance(self, place: NDArray[np.float64]) -> float:
        """From the sample of the last layer, rounded as in the batch: at a crossing the last bit decides between two names of one place."""
        square = 0.0
        for one, other in zip(
            place.tolist(), self._places[(self._used - 1) % len(self._times)], strict=True
        ):
            square += (one - other) * (one - other)
        return math.sqrt(square)

    def _end(self, time: float, place: NDArray[np.float64], facing: NDArray[np.float64]) -> None:
        """Give the last sample before a silence its layer; it stands for the one just before it."""
        if self._run > 1:
            self._used -= 1
            self._run -= 1
        self._layer(time, place, facing, is_gap=False)

    def _layer(
        self, time: float, place: NDArray[np.float64], facing: NDArray[np.float64], *, is_gap: bool
    ) -> LivePosition:
        number, slot = self._used, self._used % len(self._times)
        straight, seconds = 0.0, math.inf
        if not is_gap:
            straight, seconds = (
                self._distance(place),
                time - self._times[(number - 1) % len(self._times)],
            )
        index = self.index
        road, metres, distance, share, kind = add_time_step(
            self._ring, number, place, facing, straight, seconds, index.roads, index.road_grid, index.graph, self._model, self._work
        )  # fmt: skip
        self._times[slot], self._places[slot] = time, place.tolist()
        self._used, self._run, self._last = (
            number + 1,
            1 if is_gap else self._run + 1,
            (time, place, facing, True),
        )
        before = self._at
        if (
            before is not None
            and kind not in {BREAK, JUMP}
            and before.edge == road >> 1
            and before.forward == (not road & 1)
        ):
            metres = max(
                metres, self._metres(road, before.offset)
            )  # a little back is standing still
        self._at = self._whereabouts(time, road, metres, distance, share)
        return self._at

    def _settle(self) -> tuple[FinalisedPosition, ...]:
        """Tell the layers on which all chains agree, and those whose lag has passed."""
        last = self._used - 1
        # the end of a run of samples may yet take the place of its last layer, see _end
        layer, candidate = find_convergence(
            self._ring, last if self._run == 1 else last - 1, self._told
        )
        sure = self._tell(layer, candidate, converged=True) if layer >= 0 else ()
        late = self._used - self._lag
        if late <= self._told:
            return sure
        chain = backtrack(self._ring, last, best_candidate(self._ring, last), late - 1)
        return sure + self._tell(
            late - 1, int(chain[0]) % len(self._ring.transition_costs), converged=False
        )

    def _tell(
        self, layer: int, candidate: int, *, converged: bool
    ) -> tuple[FinalisedPosition, ...]:
        """Tell all layers up to one that have not been told yet, on the cheapest chain to a candidate there."""
        first, self._told = self._told, layer + 1
        chain = backtrack(self._ring, layer, candidate, first).tolist()
        return tuple(
            self._one_settled(first + i, place, converged) for i, place in enumerate(chain)
        )

    def _one_settled(self, layer: int, place: int, converged: bool) -> FinalisedPosition:
        layers, time = self._ring.candidates, self._times[layer % len(self._times)]
        road = int(layers.roads[place])
        if road < 0:
            return FinalisedPosition(time, -1, False, math.nan, math.nan, False, converged)
        offset, linked = (
            self._metres(road, float(layers.metres[place])),
            bool(layers.transitions[place] < JUMP),
        )
        return FinalisedPosition(
            time, road >> 1, not road & 1, offset, float(layers.distances[place]), linked, converged
        )

    def _metres(self, road: int, metres: float) -> float:
        """From metres along a directed road to metres from the road's start, and back."""
        return float(self.index.graph.lengths[road]) - metres if road & 1 else metres

    def _between(self, time: float, place: NDArray[np.float64]) -> LivePosition:
        """A sample near the last one that has a layer: on the same road."""
        self._at = self._near(time, place)
        return self._at

    def _near(self, time: float, place: NDArray[np.float64]) -> LivePosition:
        """Where a sample is on the road on which the agent was last, not before that place."""
        at = self._at
        assert at is not None
        if at.off_map:
            return at._replace(time=time)
        road = 2 * at.edge + (not at.forward)
        low = self._metres(road, at.offset)
        metres, distance = nearest_on_road(
            place,
            road,
            low,
            float(self.index.graph.lengths[road]),
            self.index.roads,
            self.index.graph,
        )
        return LivePosition(
            time,
            at.edge,
            at.forward,
            self._metres(road, metres),
            distance,
            at.confidence,
            False,
            at.next,
            (),
        )

    def _whereabouts(
        self, time: float, road: int, metres: float, distance: float, share: float
    ) -> LivePosition:
        if road < 0:
            return LivePosition(time, -1, False, math.nan, math.nan, share, True, (), ())
        following = self._next.get(road)
        if following is None:
            following = self._next[road] = self._following(road)
        return LivePosition(
            time,
            road >> 1,
            not road & 1,
            self._metres(road, metres),
            distance,
            share,
            False,
            following,
            (),
        )

    def _following(self, road: int) -> tuple[NextRoad, ...]:
        """Roads that leave from the end of a directed road, each as likely as the model's price of the turn tells."""
        graph, model = self.index.graph, self._model
        node = graph.heads[road]
        outs = graph.outs[graph.begins[node] : graph.begins[node + 1]]
        cosines = -(graph.headings[outs] @ graph.headings[road ^ 1])
        weights = np.exp(
            -np.where(outs == road ^ 1, model.u_turn_cost, 0.5 * model.turn_cost * (1.0 - cosines))
        )
        shares = weights / weights.sum() if len(outs) else weights
        return tuple(
            NextRoad(int(out) >> 1, not int(out) & 1, float(share))
            for out, share in zip(outs, shares, strict=True)
        )
