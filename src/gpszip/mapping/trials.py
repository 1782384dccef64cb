"""One search for a map: the step sizes and the start of a trial, and the rounds from there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import encode
from gpszip.mapping.local_search import improve_walks
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import (
    LOCAL_MAX_ERROR_AIM,
    MAX_ERROR_AIM,
    RMSE_AIM,
    Plan,
    is_dense,
)
from gpszip.mapping.rounds import Outcome, fit, start_from
from gpszip.mapping.time_grid import build_time_grid, count_slots, sparsify
from gpszip.model import QuantisationGrid, Track
from gpszip.model.grid import STEP_SIZES, step_index, step_size
from gpszip.run.executor import Executor

__all__ = [
    "FIRST_TRIAL",
    "NEVER",
    "Search",
    "Solution",
    "Trial",
    "TrialResult",
    "suggest_time_step",
]

#: Effort at which walks of few rounds do on a dense log.
_FASTEST_EFFORT = 1

#: The same on a subsample.
_SUBSAMPLE_ROUNDS = 6

#: Rounds of a search that only compares step sizes, on all of the log.
_ROUGH_ROUNDS = 8

#: Rounds of a search from the walks of another one.
_WARM_ROUNDS = 3

#: Rounds that may follow until the error is near its target: the price may have far to go.
_MORE_WARM_ROUNDS = 6

#: Rounds of a first look at a trial.
_EXPLORE_ROUNDS = 5

#: Rounds of a search from the walks of another one on many slots: at the same price, step sizes
#: compare after a single round.
_QUICK_WARM_ROUNDS = 1

#: Rounds of the only start of a large log, and of the first start from the walks of the choice, at
#: efforts 1 to 5.
_FINAL_ROUNDS = (6, 7, 8, 10, 12)

#: The last of them, on all slots next to knots.
_DENSE_ROUNDS = (1, 2, 3, 4, 5)

#: Slots that a round of the only start of a large log offers for each knot, at efforts 1 to 5: with
#: all, a fleet of 16,340 points takes 5 times as long, and no fewer bytes.
_SLOTS_PER_KNOT = (3.0, 3.0, 3.0, 4.0, 5.0)

#: Error, in targets, up to which outcomes are compared when step sizes are chosen.
_ROUGH_TOLERANCE = 1.25

#: Rounds that may follow on a large log.
_EXTRA_ROUNDS = 5

#: On large logs: bits beyond a slot's cheapest node above which another node is left out.
_BEAM = 3.0

#: The same where step sizes are compared.
_ROUGH_BEAM = 6.0

#: Knots from which on the rounds of a large log end once an outcome uses up the error allowed.
_MANY_KNOTS = 20_000

#: On subsamples: ratio of the error to its target above which step sizes are given up that hardly
#: bring it down.
_GIVE_UP_RATIO = 1.2

#: Largest number of moves of the pattern search, after its first trials.
_MAX_MOVES = 2

#: The same where speed counts and the log is not large.
_FASTEST_MOVES = 1

#: Step indices from a step size to its double: every eighth index is 1, 2, 4, ... or 1/2, 1/4, ...
_OCTAVE = 8

#: Size that stands for a bound that is not kept.
NEVER = 1 << 62

#: Factor on step sizes before they are rounded down to the next index, half an index on average.
_ROUNDING = 1.04

#: Coordinates and times this little below a whole number, in metres or seconds, count as whole.
_WHOLE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Trial:
    """Step sizes and start of one search.

    Parameters
    ----------
    space : float
        Space step in targets.
    time : float
        Time step, in the seconds in which the log's mean speed covers a space step.
    leader_radius : float
        Radius in targets within which the first knots share a node.
    """

    space: float
    time: float
    leader_radius: float


class TrialResult(NamedTuple):
    """What a search finds: the grid, and the outcome if the bound is kept."""

    grid: QuantisationGrid
    outcome: Outcome | None


class Solution(NamedTuple):
    """An outcome that keeps the bound, with its grid."""

    grid: QuantisationGrid
    outcome: Outcome


#: Trial with which the pattern search for step sizes begins.
FIRST_TRIAL = Trial(1.2, 2.0, 1.2)


@dataclass(frozen=True)
class Search:
    """What all searches of one log share.

    Parameters
    ----------
    tracks, gaps : tuples
        The log.
    rmse : float
        Root mean square error to reach, in metres.
    max_error : float, optional
        Largest distance of a sample, in metres.
    rounds, extra_rounds : int
        Rounds, and those that may follow.
    is_rough : bool
        Only step sizes are compared, on sparse time grids.
    is_quick : bool
        Step sizes are compared after few rounds, on some of the slots.
    is_hasty : bool
        The log is large: speed counts.
    is_of_large_log : bool
        The log, or that of which this is a subsample, is large.
    inner : Executor, optional
        Spreads the work of one search.
    effort : int
        From 1 to 5: a race adds what higher efforts take.
    """

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    rmse: float
    max_error: float | None = None
    rounds: int = 0
    is_rough: bool = False
    is_quick: bool = False
    is_hasty: bool = False
    is_of_large_log: bool = False
    extra_rounds: int = 0
    inner: Executor | None = None
    effort: int = 5

    @property
    def samples(self) -> int:
        """Number of samples."""
        return sum(len(track) for track in self.tracks)

    @property
    def moves(self) -> int:
        """Largest number of moves of the pattern search."""
        is_fastest = self.effort == _FASTEST_EFFORT and not self.is_of_large_log
        return _FASTEST_MOVES if is_fastest and self.is_quick else _MAX_MOVES

    @cached_property
    def speed(self) -> float:
        """Mean speed in m/s."""
        return _mean_speed(self.tracks, self.gaps, self.rmse)

    @cached_property
    def has_whole_seconds(self) -> bool:
        """Whether all samples are at whole seconds."""
        return all(bool((track.times == np.rint(track.times)).all()) for track in self.tracks)

    def grid(self, trial: Trial) -> QuantisationGrid:
        """Quantisation grid of a trial."""
        grid = _build_grid(self.tracks, self.rmse, self.speed, trial)
        if self.max_error is None or not self.has_whole_seconds:
            return grid
        # Under a maximum, time steps of 1, 2, 4, ... or 1/2, 1/4, ... seconds: a knot at the very
        # time of a sample can come as near to it as it needs, wherever its neighbours are.
        octaves = min(round(grid.time / _OCTAVE), STEP_SIZES // _OCTAVE - 1)
        return replace(grid, time=_OCTAVE * octaves)

    def plan(self, trial: Trial, grid: QuantisationGrid, is_warm: bool) -> Plan:
        """Plan of a trial that begins with walks of another one, or anew."""
        # A warm search takes fewer rounds, and a rough one some more until it is near the target.
        rounds, extra_rounds = self.rounds, self.extra_rounds
        if is_warm:
            warm_rounds = _QUICK_WARM_ROUNDS if self.is_quick else _WARM_ROUNDS
            rounds = warm_rounds if self.is_rough else _FINAL_ROUNDS[self.effort - 1]
        if is_warm and self.max_error is None:
            more_rounds = 0 if self.is_quick else _MORE_WARM_ROUNDS
            extra_rounds = more_rounds if self.is_rough else _EXTRA_ROUNDS

        # Aim a little below the bounds, since rounding adds error; plans count in grid steps.
        unit = step_size(grid.space)
        return Plan(
            target=RMSE_AIM * self.rmse / unit,
            leader_radius=trial.leader_radius,
            rounds=rounds,
            extra_rounds=extra_rounds,
            maximum=None if self.max_error is None else MAX_ERROR_AIM * self.max_error / unit,
            give_up_ratio=_GIVE_UP_RATIO if self.is_hasty and self.is_rough else math.inf,
            beam=self._choose_beam(),
            encode_alternate_rounds=self.is_hasty and self.max_error is None,
            tolerance=_ROUGH_TOLERANCE if self.is_rough and self.max_error is None else 1.0,
            slots_per_knot=self._choose_slots_per_knot(),
            dense_rounds=_DENSE_ROUNDS[self.effort - 1],
            many_knots=_MANY_KNOTS if self.is_hasty and not self.is_rough else None,
        )

    def _choose_beam(self) -> float:
        """Bits beyond the cheapest node of a slot above which another node is left out."""
        if self.is_rough:
            return _ROUGH_BEAM
        return _BEAM if self.is_hasty else math.inf

    def _choose_slots_per_knot(self) -> float:
        """Slots that a round offers for each knot."""
        if self.is_rough:
            return _SLOTS_PER_KNOT[0] if self.is_quick else math.inf
        return _SLOTS_PER_KNOT[self.effort - 1] if self.is_hasty else math.inf

    @cached_property
    def explorer(self) -> Search:
        """The search for a first look at a trial: few rounds, on some of the slots."""
        return replace(
            self, rounds=_EXPLORE_ROUNDS, extra_rounds=0, is_rough=True, is_quick=self.is_hasty
        )

    def hasty(self, inner: Executor) -> Search:
        """Return the search of a large log, each trial of which spreads its own work."""
        return replace(
            self,
            rounds=_FINAL_ROUNDS[self.effort - 1],
            is_hasty=True,
            extra_rounds=_EXTRA_ROUNDS if self.max_error is None else 0,
            inner=inner,
        )

    def run(self, trial: Trial, start: TrialResult | None = None) -> TrialResult:
        """Learn a map with the step sizes of a trial, from its start or from another's outcome."""
        # Build the slots; rough trials have the sparse ones only.
        grid = self.grid(trial)
        time_grid = build_time_grid(self.tracks, self.gaps, grid, sparse=self.is_rough)
        sparse_grid = None if self.is_rough else sparsify(time_grid)

        # Walks on another grid move to the nearest slots of this one.
        first_walks = None
        if start is not None and start.outcome is not None:
            first_walks = start_from(
                start.outcome,
                time_grid if sparse_grid is None else sparse_grid,
                step_size(start.grid.time) / step_size(grid.time),
                step_size(start.grid.space) / step_size(grid.space),
            )
        # A dense log takes fewer rounds where speed counts.
        plan = self.plan(trial, grid, first_walks is not None)
        is_fastest = self.effort == _FASTEST_EFFORT and not self.is_rough
        if is_fastest and is_dense(self.samples, len(time_grid.time_steps)):
            plan = plan.hurried()
        outcome = fit(
            time_grid,
            len(self.tracks),
            plan,
            sparse_grid=sparse_grid,
            start=first_walks,
            executor=self.inner,
        )

        # To compare step sizes, a few misses of the maximum do not matter.
        if self.is_rough or outcome is None or self.max_error is None:
            return TrialResult(grid, outcome)
        return self._enforce_max_error(grid, outcome, self.max_error)

    def _enforce_max_error(
        self, grid: QuantisationGrid, outcome: Outcome, max_error: float
    ) -> TrialResult:
        """Bring the segments that miss the maximum within it."""
        changed = enforce_max_error(self.tracks, grid, outcome.walks, max_error)
        if changed is None:
            return TrialResult(grid, None)
        grid, walks = changed
        return TrialResult(grid, replace(outcome, walks=walks, size=len(encode(walks)), misses=0))

    def improve(self, solution: Solution, work: int) -> Solution:
        """Improve an outcome by a local search that may encode so many knots."""
        grid, outcome = solution
        unit = step_size(grid.space)
        improved = improve_walks(
            build_time_grid(self.tracks, self.gaps, grid),
            outcome,
            target=self.rmse / unit,
            maximum=None if self.max_error is None else LOCAL_MAX_ERROR_AIM * self.max_error / unit,
            work=work,
        )
        return Solution(grid, improved)

    def rate(self, result: TrialResult) -> float:
        """Bytes by which results of a rough search compare."""
        grid, outcome = result
        if outcome is None:
            return NEVER
        if self.max_error is not None:
            return outcome.cost
        return outcome.cost_at(RMSE_AIM * self.rmse / step_size(grid.space), self.samples)

    def count_slots(self, trial: Trial) -> int:
        """Count the slots of a trial's grid."""
        return count_slots(self.tracks, self.gaps, self.grid(trial))

    def subsample(self, samples: int) -> Search:
        """Return a rough search of about ``samples`` samples: complete tracks, evenly chosen.

        Where one track has more samples, its start.
        """
        # A small log is searched as a whole.
        if self.samples <= samples:
            return replace(self, rounds=_ROUGH_ROUNDS, is_rough=True)

        # Take every so many tracks, until there are enough samples.
        stride = max(1, min(len(self.tracks), self.samples // samples))
        tracks, gaps, remaining = [], [], samples
        for track, gap in list(zip(self.tracks, self.gaps, strict=True))[::stride]:
            count = min(len(track), remaining)
            if count > 0:
                tracks.append(_cut_track(track, count))
                gaps.append(gap[: count - 1])
                remaining -= count
        return replace(
            self,
            tracks=tuple(tracks),
            gaps=tuple(gaps),
            rounds=_SUBSAMPLE_ROUNDS,
            is_rough=True,
            is_hasty=True,
        )


def _cut_track(track: Track, count: int) -> Track:
    """The first ``count`` samples of a track."""
    weights = None if track.weights is None else track.weights[:count]
    return Track(track.id, track.times[:count], track.positions[:count], weights, plane=track.plane)


def _build_grid(
    tracks: Sequence[Track], rmse: float, speed: float, trial: Trial
) -> QuantisationGrid:
    """Grid with a trial's step sizes, from the first sample of the log on."""
    space = step_index(_ROUNDING * trial.space * rmse)
    time = step_index(_ROUNDING * trial.time * step_size(space) / speed)
    first = min(tracks, key=lambda track: float(track.times[0]))

    # Whole metres and seconds save more bytes in the header than they cost at the first node.
    origin = tuple(1000 * math.floor(float(x) + _WHOLE_TOLERANCE) for x in first.positions[0])
    epoch = 1000 * math.floor(float(first.times[0]) + _WHOLE_TOLERANCE)
    return QuantisationGrid(origin, epoch, space, time, first.plane)


def suggest_time_step(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], space: int
) -> float:
    """Time step in seconds with which the search for step sizes begins.

    It is about the time in which tracks travel two space steps.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    space : int
        Index of the space step.
    """
    size = step_size(space)
    return FIRST_TRIAL.time * size / _mean_speed(tracks, gaps, size)


def _mean_speed(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], scale: float) -> float:
    """Mean speed outside gaps in m/s.

    Only steps of at least ``scale`` metres count as travelled, so that noise does not.
    """
    distance = duration = 0.0
    for track, gap in zip(tracks, gaps, strict=True):
        duration += float(np.diff(track.times)[~gap].sum())
        distance += _travelled_distance(track.positions, gap, scale)
    return max(distance, 1e-3 * scale) / max(duration, 1e-3)


def _travelled_distance(
    positions: NDArray[np.float64], gap: NDArray[np.bool_], scale: float
) -> float:
    """Distance travelled in steps of at least ``scale``, in metres.

    Samples are decimated until the median of the steps that move is that long.
    """
    stride = 1
    while True:
        steps = np.sqrt((np.diff(positions[::stride], axis=0) ** 2).sum(axis=1))
        has_gap = np.add.reduceat(gap, np.arange(0, len(gap), stride)) > 0 if len(gap) else gap
        steps = steps[~has_gap[: len(steps)]]
        moving = steps[steps > 0.2 * scale]
        if (len(moving) >= 20 and np.median(moving) >= scale) or stride > len(positions) // 20:
            return float(steps[steps > 0.5 * scale].sum())
        stride *= 2
