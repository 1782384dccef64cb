"""Live matching: where an agent is on the roads, one sample at a time."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

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
from gpszip.model.prediction import NextRoad

__all__ = ["FinalisedPosition", "LiveMatcher", "LivePosition", "NextRoad"]

#: Scales of receivers in vehicles at about one sample a second, on today's maps of streets
#: (docs/matching.md).
_STREETS = Scales(error=5.8, sigma=36.0, beta=5.9, median_speed=10.0, max_speed=150.0, heading=30.0)

#: Heading of a sample that has none.
_NO_HEADING = np.zeros(2)

Floats = NDArray[np.float64]


class FinalisedPosition(NamedTuple):
    """The position of an earlier sample, given the samples after it.

    Parameters
    ----------
    time : float
        Time of the sample in seconds.
    edge : int
        Road of the network, -1 for none.
    forward : bool
        Whether it was travelled from its start to its end.
    offset : float
        Metres from the road's start, NaN for none.
    distance : float
        Metres from the sample to its position on the road, NaN for none.
    linked : bool
        Whether a path leads there from the sample finalised before.
    converged : bool
        Whether no later sample can change it: it is what :func:`gpszip.match` finds. False where
        the lag passed before all paths agreed.
    """

    time: float
    edge: int
    forward: bool
    offset: float
    distance: float
    linked: bool
    converged: bool


class LivePosition(NamedTuple):
    """The current position of the agent.

    Parameters
    ----------
    time : float
        Time of the sample in seconds.
    edge : int
        Road of the network, -1 for none.
    forward : bool
        Whether it is travelled from its start to its end.
    offset : float
        Metres from the road's start, NaN for none.
    distance : float
        Metres from the sample to its position on the road, NaN for none.
    confidence : float
        Probability of the road in this direction, or of being off all roads, given the samples so
        far.
    off_map : bool
        Whether the agent is on no road.
    next : tuple of NextRoad
        Roads that leave the end of this one.
    finalised : tuple of FinalisedPosition
        Positions of earlier samples, each reported once: as soon as no later sample can change it,
        or when its lag has passed. Samples of a standing agent, which lie near each other, are left
        out.
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


class _LastSample(NamedTuple):
    """The last sample taken in, and whether it makes a time step."""

    time: float
    position: Floats
    heading: Floats
    has_step: bool


class LiveMatcher:
    """Follows one agent over a network, one sample at a time.

    The model is that of :func:`gpszip.match`. Time and memory for a sample don't grow with the log.
    An outlier is off the roads and breaks the route, since only later samples tell whether the
    agent comes back.

    Parameters
    ----------
    network : Network or RoadIndex
        The roads; the matchers of many agents can share an index.
    scales : Scales, optional
        Scales of the model, such as ``gpszip.match(earlier, network).scales``. By default those of
        vehicles with a receiver, for roads in degrees.
    lag : int, default 100
        Number of time steps after which a position is finalised, if it does not converge before.
    gap : float, default 120.0
        Seconds above which an interval is a gap, which breaks the route.

    Raises
    ------
    OptionError
        If the roads are not in degrees and no scales are given.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]])
    >>> starts, ends, offsets = np.array([0, 1], np.int32), np.array([1, 2], np.int32), [0, 2, 4]
    >>> both, speeds = np.ones(2, bool), np.full(2, np.nan)
    >>> corner = Network(
    ...     nodes, starts, ends, np.array(offsets), nodes[[0, 1, 1, 2]], both, both, speeds
    ... )
    >>> scales = Scales(error=2.0, sigma=3.0, beta=3.0, median_speed=9.0, max_speed=40.0)
    >>> matcher = LiveMatcher(corner, scales, lag=2)
    >>> here = [matcher.push(t, [9.0 * t, 0.5]) for t in range(8)][-1]
    >>> here.edge, here.forward, here.offset, here.finalised[0].offset
    (0, True, 63.0, 45.0)
    >>> [(road.edge, road.forward) for road in here.next]
    [(0, False), (1, True)]
    """

    def __init__(
        self,
        network: Network | RoadIndex,
        scales: Scales | None = None,
        *,
        lag: int = 100,
        gap: float = 120.0,
    ) -> None:
        # Index the roads, and check the options.
        self.index = network if isinstance(network, RoadIndex) else index_network(network)
        if scales is None and self.index.network.plane is None:
            raise OptionError(
                "roads on a plane of their own have no default scales; "
                "give those of gpszip.match(earlier, network).scales"
            )
        if lag < 1 or not gap > 0:
            raise OptionError(f"lag is {lag} and gap {gap:g}; both must be positive")

        # The model.
        self.scales = scales or _STREETS
        self._lag, self._gap = lag, gap
        self._model = model_parameters(self.scales)
        self._min_spacing = min_spacing(self.scales)
        self._work = create_workspace(self.index)

        # The last time steps: step k is at k % (lag + 2).
        self._ring = empty_ring(lag + 2, 2 * self._model.max_candidates + 1)
        self._step_times = [0.0] * (lag + 2)
        self._step_positions: list[list[float]] = [[]] * (lag + 2)
        self._steps = 0
        self._steps_since_gap = 0
        self._finalised_steps = 0

        # The last samples.
        self._average = RunningAverage(self.scales.averaging_window)
        self._newest_time = -math.inf
        self._last: _LastSample | None = None
        self._position: LivePosition | None = None

        # Roads that leave the end of each directed road.
        self._next_roads: dict[int, tuple[NextRoad, ...]] = {}

    def push(self, time: float, position: ArrayLike, heading: float | None = None) -> LivePosition:
        """Take in a sample and return where the agent is.

        Parameters
        ----------
        time : float
            Seconds, later than the sample before.
        position : array_like, shape (d,)
            Metres on the plane of the network.
        heading : float, optional
            Direction in which the agent faces, in degrees clockwise from north (from the y axis on
            a plane of its own); NaN for none. It is used if the scales have a spread of headings.

        Raises
        ------
        TrackError
            If time stands still or goes back, or a number is not finite. The sample is not taken
            in.
        """
        # Check the sample.
        point = np.array(position, dtype=np.float64)[: self.index.dimension]
        if len(point) < self.index.dimension:
            point = np.append(point, np.zeros(self.index.dimension - len(point)))
        if not (math.isfinite(time) and all(map(math.isfinite, point.tolist()))):
            raise TrackError(f"sample at {time:.15g} s is not finite; drop it")
        if time <= self._newest_time:
            raise TrackError(
                f"time {time:.15g} is not later than {self._newest_time:.15g}; drop the sample"
            )

        # Match all samples whose means are known now.
        is_after_gap = time - self._newest_time > self._gap
        ready = self._average.finish() if is_after_gap else []
        self._newest_time = time
        ready += self._average.push((time, point, self._heading_vector(heading, point)))
        finalised = self._match_samples(ready)

        # Where its own mean is not known yet, match the sample to the last road.
        here = self._position
        if here is None or here.time != time:
            here = self._match_to_last_road(time, point)
        return here._replace(finalised=finalised) if finalised else here

    def finish(self) -> tuple[FinalisedPosition, ...]:
        """Finalise the remaining samples; what is pushed afterwards is a new track."""
        finalised = self._match_samples(self._average.finish())
        if self._last is not None and not self._last.has_step:
            self._add_end_of_run(self._last)
        if self._steps:
            newest = self._steps - 1
            finalised += self._finalise(newest, best_candidate(self._ring, newest), converged=True)

        self._last = self._position = None
        self._newest_time = -math.inf
        self._steps = self._steps_since_gap = self._finalised_steps = 0
        return finalised

    def state(self) -> dict[str, Any]:
        """Return where the matcher stands as a value of JSON: :meth:`restore` goes on from there.

        It holds the time steps that are not finalised, a few hundred bytes each. Roads that may
        come next are told again from the sample after it on.
        """
        # One step more than is read: the last one may be replaced by the end of its run.
        first = max(0, min(self._finalised_steps, self._steps - 2) - 1)
        steps = range(max(first, self._steps - len(self._step_times)), self._steps)
        slots = [step % len(self._step_times) for step in steps]
        here = self._position
        return {
            "steps": [self._steps, self._steps_since_gap, self._finalised_steps],
            "times": [self._step_times[slot] for slot in slots],
            "positions": [self._step_positions[slot] for slot in slots],
            "candidates": [self._packed(slot) for slot in slots],
            "newest": self._newest_time if math.isfinite(self._newest_time) else None,
            "last": None if self._last is None else _sample_row(*self._last[:3]),
            "has_step": self._last is not None and self._last.has_step,
            "here": None if here is None else [*here[:7]],
            "average": self._average.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on where :meth:`state` was taken, of a matcher with the same roads and options."""
        # The time steps.
        self._steps, self._steps_since_gap, self._finalised_steps = state["steps"]
        rows = zip(state["times"], state["positions"], state["candidates"], strict=True)
        for step, (time, position, packed) in enumerate(rows, self._steps - len(state["times"])):
            slot = step % len(self._step_times)
            self._step_times[slot], self._step_positions[slot] = time, list(position)
            self._unpack(slot, packed)

        # The last samples.
        self._newest_time = -math.inf if state["newest"] is None else state["newest"]
        self._last = self._position = None
        if state["last"] is not None:
            self._last = _LastSample(*_read_sample(state["last"]), has_step=state["has_step"])
        if state["here"] is not None:
            self._position = LivePosition._make([*state["here"], (), ()])
        self._average.restore(state["average"])

    def _packed(self, slot: int) -> str:
        """The candidates of a time step as text."""
        ring = self._ring
        low = slot * len(ring.transition_costs)
        rows = slice(low, low + int(ring.counts[slot]))
        columns = [column[rows].tobytes() for column in (*ring.candidates, ring.log_forward)]
        return base64.b85encode(b"".join(columns)).decode("ascii")

    def _unpack(self, slot: int, packed: str) -> None:
        """Take over what :meth:`_packed` returned."""
        ring, data = self._ring, base64.b85decode(packed)
        columns = (*ring.candidates, ring.log_forward)
        count = len(data) // sum(column.itemsize for column in columns)
        low, begin = slot * len(ring.transition_costs), 0
        ring.counts[slot] = count
        for column in columns:
            column[low : low + count] = np.frombuffer(data, column.dtype, count, begin)
            begin += count * column.itemsize

    def _match_samples(self, samples: list[Sample]) -> tuple[FinalisedPosition, ...]:
        """Match samples in turn; return the positions that they finalise."""
        finalised: tuple[FinalisedPosition, ...] = ()
        for sample in samples:
            steps = self._steps
            self._position = self._match_sample(*sample)
            if self._steps > steps:
                finalised += self._finalise_converged()
        return finalised

    def _heading_vector(self, heading: float | None, position: Floats) -> Floats:
        if heading is None or not math.isfinite(heading):
            return _NO_HEADING
        plane = self.index.network.plane
        (vector,) = heading_vectors(np.array([heading]), position[None], plane)
        return np.asarray(vector)

    def _match_sample(self, time: float, position: Floats, heading: Floats) -> LivePosition:
        """Match a sample: as a time step, or on the last road where it is near the last step."""
        last = self._last
        if last is None:
            return self._add_step(time, position, heading, is_after_gap=True)
        if time - last.time > self._gap:
            if not last.has_step:
                self._add_end_of_run(last)
            return self._add_step(time, position, heading, is_after_gap=True)
        if self._distance_to_last_step(position) >= self._min_spacing:
            return self._add_step(time, position, heading, is_after_gap=False)
        self._last = _LastSample(time, position, heading, has_step=False)
        return self._match_to_last_road(time, position)

    def _distance_to_last_step(self, position: Floats) -> float:
        """Distance to the sample of the last time step, with the rounding errors of the batch.

        At a crossing, the last bit decides between two roads that meet there.
        """
        last_position = self._step_positions[(self._steps - 1) % len(self._step_times)]
        square = 0.0
        for a, b in zip(position.tolist(), last_position, strict=True):
            square += (a - b) * (a - b)
        return math.sqrt(square)

    def _add_end_of_run(self, sample: _LastSample) -> None:
        """Add the last sample before a gap as a time step; it replaces the one just before it."""
        if self._steps_since_gap > 1:
            self._steps -= 1
            self._steps_since_gap -= 1
        self._position = self._add_step(
            sample.time, sample.position, sample.heading, is_after_gap=False
        )

    def _add_step(
        self, time: float, position: Floats, heading: Floats, *, is_after_gap: bool
    ) -> LivePosition:
        """Add a time step to the trellis; return the position of its best candidate."""
        # Extend the trellis by the time step; infinite seconds make a break after a gap.
        step, slots = self._steps, len(self._step_times)
        straight, seconds = 0.0, math.inf
        if not is_after_gap:
            straight = self._distance_to_last_step(position)
            # a float, since the kernel would be compiled anew for integers
            seconds = float(time - self._step_times[(step - 1) % slots])
        best = add_time_step(
            self._ring,
            step,
            position,
            heading,
            straight,
            seconds,
            self.index.roads,
            self.index.road_grid,
            self.index.graph,
            self._model,
            self._work,
        )
        self._step_times[step % slots] = time
        self._step_positions[step % slots] = position.tolist()
        self._steps = step + 1
        self._steps_since_gap = 1 if is_after_gap else self._steps_since_gap + 1
        self._last = _LastSample(time, position, heading, has_step=True)

        # An agent that seems to go a little back on its road stands still.
        metres = best.metres
        before = self._position
        if (
            before is not None
            and best.transition not in {BREAK, JUMP}
            and before.edge == best.road >> 1
            and before.forward == (not best.road & 1)
        ):
            metres = max(metres, self._flip_metres(best.road, before.offset))
        return self._live_position(time, best.road, metres, best.distance, best.probability)

    def _finalise_converged(self) -> tuple[FinalisedPosition, ...]:
        """Finalise the time steps at which all paths agree, and those whose lag has passed."""
        # Convergence; the newest step may yet be replaced by the end of its run (_add_end_of_run).
        newest = self._steps - 1
        fixed = newest if self._steps_since_gap == 1 else newest - 1
        step, candidate = find_convergence(self._ring, fixed, self._finalised_steps)
        finalised = self._finalise(step, candidate, converged=True) if step >= 0 else ()

        # Lag.
        late = self._steps - self._lag
        if late <= self._finalised_steps:
            return finalised
        best = best_candidate(self._ring, newest)
        index = int(backtrack(self._ring, newest, best, late - 1)[0])
        candidate = index % len(self._ring.transition_costs)
        return finalised + self._finalise(late - 1, candidate, converged=False)

    def _finalise(
        self, step: int, candidate: int, *, converged: bool
    ) -> tuple[FinalisedPosition, ...]:
        """Finalise all time steps up to one, on the cheapest path to a candidate of it."""
        first, self._finalised_steps = self._finalised_steps, step + 1
        path = backtrack(self._ring, step, candidate, first).tolist()
        return tuple(
            self._finalised_position(first + k, index, converged) for k, index in enumerate(path)
        )

    def _finalised_position(self, step: int, index: int, converged: bool) -> FinalisedPosition:
        """The position of a time step at a candidate, by its index in the ring."""
        candidates = self._ring.candidates
        time = self._step_times[step % len(self._step_times)]
        road = int(candidates.roads[index])
        if road < 0:
            return FinalisedPosition(time, -1, False, math.nan, math.nan, False, converged)
        return FinalisedPosition(
            time=time,
            edge=road >> 1,
            forward=not road & 1,
            offset=self._flip_metres(road, float(candidates.metres[index])),
            distance=float(candidates.distances[index]),
            linked=bool(candidates.transitions[index] < JUMP),
            converged=converged,
        )

    def _flip_metres(self, road: int, metres: float) -> float:
        """Convert metres along a directed road to metres from the road's start, or back."""
        return float(self.index.graph.lengths[road]) - metres if road & 1 else metres

    def _match_to_last_road(self, time: float, position: Floats) -> LivePosition:
        """The nearest position on the last road, not before the last position."""
        # The nearest position on the rest of the road; an agent off the roads stays off them.
        last = self._position
        assert last is not None
        if last.off_map:
            return last._replace(time=time)
        road = 2 * last.edge + (not last.forward)
        metres, distance = nearest_on_road(
            position,
            road,
            self._flip_metres(road, last.offset),
            float(self.index.graph.lengths[road]),
            self.index.roads,
            self.index.graph,
        )
        return last._replace(
            time=time, offset=self._flip_metres(road, metres), distance=distance, finalised=()
        )

    def _live_position(
        self, time: float, road: int, metres: float, distance: float, probability: float
    ) -> LivePosition:
        """The position at metres along a directed road, with the roads that may come next."""
        if road < 0:
            return LivePosition(time, -1, False, math.nan, math.nan, probability, True, (), ())
        following = self._roads_after(road, time)
        return LivePosition(
            time=time,
            edge=road >> 1,
            forward=not road & 1,
            offset=self._flip_metres(road, metres),
            distance=distance,
            confidence=probability,
            off_map=False,
            next=following,
            finalised=(),
        )

    def _roads_after(self, road: int, time: float) -> tuple[NextRoad, ...]:  # noqa: ARG002
        """Roads that may come next, found once for each directed road."""
        following = self._next_roads.get(road)
        if following is None:
            following = self._next_roads[road] = self._find_next_roads(road)
        return following

    def _best_roads(self) -> list[int]:
        """Directed roads of the most likely path since its last break, as far as steps are kept."""
        # The path up to the newest time step.
        newest = self._steps - 1
        first = max(0, self._steps - self._lag, self._steps - self._steps_since_gap)
        path = backtrack(self._ring, newest, best_candidate(self._ring, newest), first)
        roads = self._ring.candidates.roads[path].tolist()
        transitions = self._ring.candidates.transitions[path].tolist()

        # Each road once, from the last break on.
        travelled: list[int] = []
        for road, transition in zip(roads, transitions, strict=True):
            if road < 0 or transition >= JUMP:
                travelled = []
            if road >= 0 and (not travelled or travelled[-1] != road):
                travelled.append(road)
        return travelled

    def _find_next_roads(self, road: int) -> tuple[NextRoad, ...]:
        """Roads that leave the end of a directed road; the model's turn costs give probabilities.

        The cost of a turn by an angle is ``turn_cost * (1 - cos(angle)) / 2``.
        """
        graph, model = self.index.graph, self._model
        node = graph.heads[road]
        roads = graph.out_roads[graph.out_starts[node] : graph.out_starts[node + 1]]
        cosines = -(graph.directions[roads] @ graph.directions[road ^ 1])
        turn_costs = np.where(
            roads == road ^ 1, model.u_turn_cost, 0.5 * model.turn_cost * (1.0 - cosines)
        )
        weights = np.exp(-turn_costs)
        probabilities = weights / weights.sum() if len(roads) else weights
        return tuple(
            NextRoad(int(out) >> 1, not int(out) & 1, float(probability))
            for out, probability in zip(roads, probabilities, strict=True)
        )


def _sample_row(time: float, position: Floats, heading: Floats) -> list[Any]:
    return [time, position.tolist(), heading.tolist()]


def _read_sample(row: list[Any]) -> Sample:
    time, position, heading = row
    return time, np.array(position, np.float64), np.array(heading, np.float64)
