"""The connected map of a log: step sizes and starts are tried, and the smallest map wins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import encode
from gpszip.errors import OptionError
from gpszip.mapping.local_search import (
    WORK_BY_EFFORT,
    improve_walks,
    is_worthwhile,
    select_best_outcomes,
)
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
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.model.grid import STEP_SIZES, step_index, step_size
from gpszip.run.executor import Executor, SharedValue, local_executor, share_value

__all__ = ["RMSE_PER_MAX_ERROR", "SLOTS_BY_EFFORT", "learn_map", "suggest_time_step"]

#: Root mean square error with which the walks for a maximum begin, as a share of the maximum.
RMSE_PER_MAX_ERROR = 0.4

#: Step indices from a step size to its double: every eighth index is 1, 2, 4, ... or 1/2, 1/4, ...
_OCTAVE = 8

#: Size that stands for a bound that is not kept.
_NEVER = 1 << 62


@dataclass(frozen=True)
class _Trial:
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


class _TrialResult(NamedTuple):
    """What a search finds: the grid, and the outcome if the bound is kept."""

    grid: QuantisationGrid
    outcome: Outcome | None


class _Solution(NamedTuple):
    """An outcome that keeps the bound, with its grid."""

    grid: QuantisationGrid
    outcome: Outcome


#: Trial with which the pattern search for step sizes begins.
_FIRST = _Trial(1.2, 2.0, 1.2)

#: Factors on space and time by which the pattern search moves.
_MOVES = ((1 / 1.5, 1 / 1.5), (1.0, 1 / 1.6), (1.0, 1.6), (1 / 1.4, 1.0), (1.4, 1.0))

#: Factor on both steps of the second trial.
_FINER = 1 / 1.5

#: Largest number of moves of the pattern search, after its first trials.
_MAX_MOVES = 2
#: The same at the highest effort.
_THOROUGH_MOVES = 4
#: The same where speed counts and the log is not large.
_FASTEST_MOVES = 1

#: Factors on the space and time steps found, in the order in which starts take them.
_STEP_FACTORS = (
    (1.0, 1.0),
    (0.87, 1.0),
    (1.0, 1.2),
    (0.87, 1.2),
    (1.15, 1.0),
    (1.15, 1.2),
    (1.0, 0.83),
    (0.87, 0.83),
)
#: Leader radii of starts, one after the other.
_LEADER_RADII = (1.2, 0.0, 2.0, 0.7)

#: Effort at which walks of few rounds do on a dense log.
_FASTEST_EFFORT = 1
#: Effort of the search that a thorough one is compared with.
_DEFAULT_EFFORT = 5
#: Effort at which the pattern search is thorough.
_THOROUGH_EFFORT = 9

#: Slots that all starts of one log may take together, at efforts 1 to 9.
SLOTS_BY_EFFORT = (0, 4_000, 8_000, 14_000, 25_000, 60_000, 150_000, 500_000, 2_000_000)

#: Samples from which on a log is large: of 72,439 points of buses, step sizes after a single move
#: take 4.7 % more bytes.
_LARGE_LOG = 20_000

#: Largest number of starts, at efforts 1 to 9.
_MAX_STARTS = (1, 2, 4, 6, 9, 14, 20, 28, 32)

#: Samples of the subsample on which step sizes are chosen.
_SUBSAMPLE = 12_000
#: Slots above which the subsample is smaller.
_SUBSAMPLE_SLOTS = 40_000
#: Samples that the subsample always has.
_MIN_SUBSAMPLE = 4000

#: Rounds of a search that only compares step sizes, on all of the log.
_ROUGH_ROUNDS = 8
#: The same on a subsample.
_SUBSAMPLE_ROUNDS = 6
#: The same on many slots: with 8, a fleet of 16,340 points takes 2 s more for the same choice.
_QUICK_ROUNDS = 4
#: Rounds of a search from the walks of another one.
_WARM_ROUNDS = 3
#: Rounds that may follow until the error is near its target: the price may have far to go.
_MORE_WARM_ROUNDS = 6
#: Rounds of a search from the walks of another one on many slots: at the same price, step sizes
#: compare after a single round.
_QUICK_WARM_ROUNDS = 1
#: Slots from which on step sizes are compared quickly: below, it saves less than 0.3 s.
_QUICK_SLOTS = 5000
#: Rounds of the only start of a large log, and of the first start from the walks of the choice, at
#: efforts 1 to 9.
_FINAL_ROUNDS = (6, 7, 8, 10, 12, 16, 20, 24, 24)
#: The last of them, on all slots next to knots.
_DENSE_ROUNDS = (1, 2, 3, 4, 5, 5, 5, 5, 5)
#: Slots that a round of the only start of a large log offers for each knot, at efforts 1 to 9: with
#: all, a fleet of 16,340 points takes 5 times as long, and no fewer bytes.
_SLOTS_PER_KNOT = (3.0, 3.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, math.inf)
#: Error, in targets, up to which outcomes are compared when step sizes are chosen.
_ROUGH_TOLERANCE = 1.25
#: Rounds of each start of a small log.
_ROUNDS = 16
#: The same at the highest effort.
_THOROUGH_ROUNDS = 24
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

#: Share of its full work from which on a local search is run: at a twentieth, it saved 0.3 % of the
#: bytes in 0.8 s, at a sixth, 5 %.
_MIN_WORK_SHARE = 0.1

#: Factor on step sizes before they are rounded down to the next index, half an index on average.
_ROUNDING = 1.04

#: Coordinates and times this little below a whole number, in metres or seconds, count as whole.
_WHOLE_TOLERANCE = 1e-6


def learn_map(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    effort: int = 5,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[QuantisationGrid, GridWalks] | None:
    """Learn a connected map, and the tracks' walks on it, within a bound on the error.

    A pattern search on a subsample chooses the step sizes; then maps are learned from several
    starts, and the best ones improved by local search.

    Parameters
    ----------
    tracks : sequence of Track
        At least one, all of the same dimension and on the same plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse : float, optional
        Root mean square of the synchronised distance over all samples of all tracks, in metres.
    max_error : float, optional
        Largest distance of any sample, in metres. At least one of the two bounds must be given.
    effort : int, default 5
        From 1 (one start) to 9 (up to 32): how many slots all starts together may take.
    executor : Executor, optional
        Runs the searches; their results do not depend on it.
    progress : callable, optional
        Called with the number of searches done, and the number of all.

    Returns
    -------
    (QuantisationGrid, GridWalks) or None
        The smallest map with its walks; None if none kept the bound. Of two bounds, the looser one
        may be missed by little where the tighter one is a maximum.
    """
    # Without a bound, the smallest map would be a single node.
    if rmse is None and max_error is None:
        raise OptionError("a map needs a bound on its error: give rmse or max_error")

    # Of two bounds, aim at the tighter one.
    if rmse is not None and max_error is not None:
        if rmse < RMSE_PER_MAX_ERROR * max_error:
            # Few samples are beyond the maximum: it takes few knots to bring them back.
            loose = learn_map(
                tracks, gaps, rmse=rmse, effort=effort, executor=executor, progress=progress
            )
            return None if loose is None else enforce_max_error(tracks, *loose, max_error)
        rmse = None
    search = _Search(
        tuple(tracks),
        tuple(gaps),
        RMSE_PER_MAX_ERROR * max_error if max_error is not None else rmse or 0.0,
        max_error,
        work=WORK_BY_EFFORT[effort - 1],
        effort=effort,
        is_thorough=effort == _THOROUGH_EFFORT,
        is_of_large_log=sum(len(track) for track in tracks) >= _LARGE_LOG,
    )
    solution = _find_solution(search, executor, progress)

    # A thorough search ends with more bytes now and then: of 10,319 points of a drone, with 220
    # instead of 216. The search of the default takes a tenth of its time.
    if search.is_thorough:
        quick_search = replace(
            search,
            work=WORK_BY_EFFORT[_DEFAULT_EFFORT - 1],
            effort=_DEFAULT_EFFORT,
            is_thorough=False,
        )
        quick = _find_solution(quick_search, executor, None)
        solution = _select_smallest(each for each in (solution, quick) if each is not None)
    return None if solution is None else (solution.grid, solution.outcome.walks)


def _find_solution(
    search: _Search,
    executor: Executor | None,
    progress: Callable[[int, int], None] | None,
) -> _Solution | None:
    """Return the smallest solution that keeps the bound; None if there is none."""
    # Choose step sizes on a subsample, which is done before processes would have started.
    effort = search.effort
    sample = _choose_subsample(search)
    with share_value(local_executor(executor), sample) as shared_sample:
        chosen, result = _choose_steps(sample, shared_sample)

    # The walks on all of the log are those from which the first start begins.
    trials = _list_trials(chosen, effort, search.count_slots(chosen))
    is_whole = sample.samples == search.samples and not search.is_thorough
    starts = [result if is_whole else None, *[None] * (len(trials) - 1)]

    # One start spreads its own work over the executor.
    if len(trials) == 1:
        single = replace(
            search,
            rounds=_FINAL_ROUNDS[effort - 1],
            is_hasty=True,
            extra_rounds=_EXTRA_ROUNDS if search.max_error is None else 0,
            inner=local_executor(executor),
        )
        solutions = _collect_solutions([single.run(trials[0], starts[0])], 1, progress)
        return _select_smallest(
            single.improve_walks(solution) for solution in _select_finalists(solutions, effort)
        )

    # Several starts run at once.
    rounds = _THOROUGH_ROUNDS if search.is_thorough else _ROUNDS
    with share_value(executor, replace(search, rounds=rounds)) as shared:
        jobs = list(zip(trials, starts, strict=True))
        solutions = _collect_solutions(shared.map(_run, jobs), len(jobs), progress)
        return _select_smallest(shared.map(_improve_walks, _select_finalists(solutions, effort)))


def _collect_solutions(
    results: Iterable[_TrialResult], count: int, progress: Callable[[int, int], None] | None
) -> list[_Solution]:
    """Return the results that keep the bound, and report progress."""
    solutions: list[_Solution] = []
    for done, (grid, outcome) in enumerate(results, 1):
        if outcome is not None:
            solutions.append(_Solution(grid, outcome))
        if progress is not None:
            progress(done, count)
    return solutions


def _select_finalists(solutions: list[_Solution], effort: int) -> list[_Solution]:
    """Return the solutions that a local search is to improve."""
    grids = {id(outcome): grid for grid, outcome in solutions}
    best = select_best_outcomes((outcome for _, outcome in solutions), effort)
    return [_Solution(grids[id(outcome)], outcome) for outcome in best]


def _select_smallest(solutions: Iterable[_Solution]) -> _Solution | None:
    return min(solutions, key=lambda solution: solution.outcome.cost, default=None)


@dataclass(frozen=True)
class _Search:
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
    is_thorough : bool
        Step sizes are chosen by searches that begin anew, and compared within the bound.
    is_of_large_log : bool
        The log, or that of which this is a subsample, is large.
    inner : Executor, optional
        Spreads the work of one search.
    work : int
        Knots that a local search may encode.
    effort : int
        From 1 to 9.
    """

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    rmse: float
    max_error: float | None = None
    rounds: int = 0
    is_rough: bool = False
    is_quick: bool = False
    is_hasty: bool = False
    is_thorough: bool = False
    is_of_large_log: bool = False
    extra_rounds: int = 0
    inner: Executor | None = None
    work: int = 0
    effort: int = 5

    @property
    def samples(self) -> int:
        return sum(len(track) for track in self.tracks)

    @property
    def moves(self) -> int:
        """Largest number of moves of the pattern search."""
        if self.is_thorough:
            return _THOROUGH_MOVES
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

    def grid(self, trial: _Trial) -> QuantisationGrid:
        """Quantisation grid of a trial."""
        grid = _build_grid(self.tracks, self.rmse, self.speed, trial)
        if self.max_error is None or not self.has_whole_seconds:
            return grid
        # Under a maximum, time steps of 1, 2, 4, ... or 1/2, 1/4, ... seconds: a knot at the very
        # time of a sample can come as near to it as it needs, wherever its neighbours are.
        octaves = min(round(grid.time / _OCTAVE), STEP_SIZES // _OCTAVE - 1)
        return replace(grid, time=_OCTAVE * octaves)

    def plan(self, trial: _Trial, grid: QuantisationGrid, is_warm: bool) -> Plan:
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
        is_loose = self.is_rough and not self.is_thorough
        return Plan(
            target=RMSE_AIM * self.rmse / unit,
            leader_radius=trial.leader_radius,
            rounds=rounds,
            extra_rounds=extra_rounds,
            maximum=None if self.max_error is None else MAX_ERROR_AIM * self.max_error / unit,
            give_up_ratio=_GIVE_UP_RATIO if self.is_hasty and self.is_rough else math.inf,
            beam=self._choose_beam(is_loose),
            encode_alternate_rounds=self.is_hasty and self.max_error is None,
            tolerance=_ROUGH_TOLERANCE if is_loose and self.max_error is None else 1.0,
            slots_per_knot=self._choose_slots_per_knot(),
            dense_rounds=_DENSE_ROUNDS[self.effort - 1],
            many_knots=_MANY_KNOTS if self.is_hasty and not self.is_rough else None,
        )

    def _choose_beam(self, is_loose: bool) -> float:
        """Bits beyond the cheapest node of a slot above which another node is left out."""
        if self.is_rough:
            return _ROUGH_BEAM if self.is_hasty or is_loose else math.inf
        return _BEAM if self.is_hasty else math.inf

    def _choose_slots_per_knot(self) -> float:
        """Slots that a round offers for each knot."""
        if self.is_rough:
            return _SLOTS_PER_KNOT[0] if self.is_quick else math.inf
        return _SLOTS_PER_KNOT[self.effort - 1] if self.is_hasty else math.inf

    def run(self, trial: _Trial, start: _TrialResult | None = None) -> _TrialResult:
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
            return _TrialResult(grid, outcome)
        return self._enforce_max_error(grid, outcome, self.max_error)

    def _enforce_max_error(
        self, grid: QuantisationGrid, outcome: Outcome, max_error: float
    ) -> _TrialResult:
        """Bring the segments that miss the maximum within it."""
        changed = enforce_max_error(self.tracks, grid, outcome.walks, max_error)
        if changed is None:
            return _TrialResult(grid, None)
        grid, walks = changed
        return _TrialResult(grid, replace(outcome, walks=walks, size=len(encode(walks)), misses=0))

    def improve_walks(self, solution: _Solution) -> _Solution:
        """Improve an outcome by local search, if the work allows it."""
        grid, outcome = solution
        share = 0.0 if self.is_thorough else _MIN_WORK_SHARE
        if not is_worthwhile(outcome, self.work, share):
            return solution
        unit = step_size(grid.space)
        improved = improve_walks(
            build_time_grid(self.tracks, self.gaps, grid),
            outcome,
            target=self.rmse / unit,
            maximum=None if self.max_error is None else LOCAL_MAX_ERROR_AIM * self.max_error / unit,
            work=self.work,
        )
        return _Solution(grid, improved)

    def rate(self, result: _TrialResult) -> float:
        """Bytes by which results of a rough search compare."""
        grid, outcome = result
        if outcome is None:
            return _NEVER
        if self.is_thorough or self.max_error is not None:
            return outcome.cost
        return outcome.cost_at(RMSE_AIM * self.rmse / step_size(grid.space), self.samples)

    def count_slots(self, trial: _Trial) -> int:
        return count_slots(self.tracks, self.gaps, self.grid(trial))

    def subsample(self, samples: int) -> _Search:
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


def _choose_subsample(search: _Search) -> _Search:
    """Return a search of a subsample that takes little time."""
    subsample = search.subsample(_SUBSAMPLE)
    time_grid = build_time_grid(
        subsample.tracks, subsample.gaps, subsample.grid(_FIRST), sparse=True
    )
    slots = len(time_grid.time_steps)
    if slots > _SUBSAMPLE_SLOTS:
        subsample = search.subsample(max(_SUBSAMPLE * _SUBSAMPLE_SLOTS // slots, _MIN_SUBSAMPLE))

    # Many slots are searched in few rounds.
    if slots < _QUICK_SLOTS or search.is_thorough:
        return subsample
    return replace(subsample, rounds=_QUICK_ROUNDS, is_quick=True)


def _run(search: _Search, job: tuple[_Trial, _TrialResult | None]) -> _TrialResult:
    return search.run(*job)


def _improve_walks(search: _Search, solution: _Solution) -> _Solution:
    return search.improve_walks(solution)


def _choose_steps(search: _Search, shared: SharedValue[_Search]) -> tuple[_Trial, _TrialResult]:
    """Choose step sizes by a pattern search on the encoded size.

    Unless it is thorough, each trial begins with the walks of the best one so far.

    Parameters
    ----------
    search : _Search
        A rough search.
    shared : SharedValue
        The same at the workers.

    Returns
    -------
    _Trial
        Step sizes and leader radius.
    _TrialResult
        What this trial led to.
    """
    results: dict[_Trial, _TrialResult] = {}

    # Trials whose result is known already are not run again.
    def run(trials: list[_Trial], start: _TrialResult | None) -> None:
        new = [trial for trial in trials if trial not in results]
        results.update(zip(new, shared.map(_run, [(trial, start) for trial in new]), strict=True))

    # Begin with two scales, each from private chains: walks that begin on one of them keep its
    # number of knots.
    best = _FIRST
    if not search.is_thorough:
        finer = _Trial(best.space * _FINER, best.time * _FINER, best.leader_radius)
        run([best, finer], None)
        best = min((best, finer), key=lambda trial: search.rate(results[trial]))

    # Move to the smallest neighbour, until none is smaller than the centre.
    for _ in range(search.moves):
        around = [
            _Trial(best.space * space, best.time * time, best.leader_radius)
            for space, time in _MOVES
        ]
        if search.is_thorough:
            run([best, *around], None)
        else:
            run(around, results[best])
        size = search.rate(results[best])
        sizes = [search.rate(results[trial]) for trial in around]
        if min(sizes) >= size and size < _NEVER:
            break
        # Where nothing keeps the bound yet, the first move makes both steps finer.
        best = around[sizes.index(min(sizes))] if min(sizes) < _NEVER else around[0]
    return best, results[best]


def _list_trials(chosen: _Trial, effort: int, slots: int) -> list[_Trial]:
    """Trials around the chosen step sizes: the fewer slots the log has, the more trials."""
    count = max(1, min(_MAX_STARTS[effort - 1], SLOTS_BY_EFFORT[effort - 1] // slots))
    radii = len(_LEADER_RADII)
    starts = [
        (*factors, _LEADER_RADII[(number + shift) % radii])
        for shift in range(radii)
        for number, factors in enumerate(_STEP_FACTORS)
    ]
    return [
        _Trial(chosen.space * space, chosen.time * time, leader_radius)
        for space, time, leader_radius in starts[:count]
    ]


def _build_grid(
    tracks: Sequence[Track], rmse: float, speed: float, trial: _Trial
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
    return _FIRST.time * size / _mean_speed(tracks, gaps, size)


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
