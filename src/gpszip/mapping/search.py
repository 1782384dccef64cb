"""The connected map of a log: step sizes and starts are tried, and the smallest map wins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.mapping.local_search import WORK_BY_EFFORT, is_worthwhile, select_best_outcomes
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.race import Counter, plan_race
from gpszip.mapping.time_grid import build_time_grid
from gpszip.mapping.trials import FIRST_TRIAL, NEVER, Search, Solution, Trial, TrialResult
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.run.executor import Executor, SharedValue, local_executor, share_value

__all__ = ["RMSE_PER_MAX_ERROR", "learn_map"]

#: Root mean square error with which the walks for a maximum begin, as a share of the maximum.
RMSE_PER_MAX_ERROR = 0.4

#: Factors on space and time by which the pattern search moves.
_MOVES = ((1 / 1.5, 1 / 1.5), (1.0, 1 / 1.6), (1.0, 1.6), (1 / 1.4, 1.0), (1.4, 1.0))

#: Factor on both steps of the second trial.
_FINER = 1 / 1.5

#: Rounds of each start of a small log.
_ROUNDS = 16

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

#: Highest effort of the search by itself: the others add a race.
_DEFAULT_EFFORT = 5

#: Slots that all starts of one log may take together, at efforts 1 to 5.
_SLOTS_BY_EFFORT = (0, 4_000, 8_000, 14_000, 25_000)
#: Largest number of starts, at efforts 1 to 5.
_MAX_STARTS = (1, 2, 4, 6, 9)

#: Slots from which on speed counts in a race, too.
_HASTY_SLOTS = 100_000

#: Share of its full work from which on a local search is run: at a twentieth, it saved 0.3 % of the
#: bytes in 0.8 s, at a sixth, 5 %.
_MIN_WORK_SHARE = 0.1

#: Samples from which on a log is large: of 72,439 points of buses, step sizes after a single move
#: take 4.7 % more bytes.
_LARGE_LOG = 20_000

#: Samples of the subsample on which step sizes are chosen.
_SUBSAMPLE = 12_000
#: Slots above which the subsample is smaller.
_SUBSAMPLE_SLOTS = 40_000
#: Samples that the subsample always has.
_MIN_SUBSAMPLE = 4000

#: Rounds of a search that compares step sizes on many slots: with 8, a fleet of 16,340 points takes
#: 2 s more for the same choice.
_QUICK_ROUNDS = 4
#: Slots from which on step sizes are compared quickly: below, it saves less than 0.3 s.
_QUICK_SLOTS = 5000


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
        From 1 (one start) to 9. Above 5, a race of further trials follows.
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
    search = Search(
        tuple(tracks),
        tuple(gaps),
        RMSE_PER_MAX_ERROR * max_error if max_error is not None else rmse or 0.0,
        max_error,
        rounds=_ROUNDS,
        effort=min(effort, _DEFAULT_EFFORT),
        is_of_large_log=sum(len(track) for track in tracks) >= _LARGE_LOG,
    )
    solution = _find_solution(search, effort, executor, progress)
    return None if solution is None else (solution.grid, solution.outcome.walks)


def _find_solution(
    search: Search,
    effort: int,
    executor: Executor | None,
    progress: Callable[[int, int], None] | None,
) -> Solution | None:
    """Return the smallest solution that keeps the bound; None if there is none."""
    # Choose step sizes on a subsample, which is done before processes would have started.
    sample = _choose_subsample(search)
    with share_value(local_executor(executor), sample) as shared_sample:
        chosen, result = _choose_steps(sample, shared_sample)

    # The walks on all of the log are those from which the first start begins.
    slots = search.count_slots(chosen)
    trials = _list_trials(chosen, search.effort, slots)
    starts: list[TrialResult | None] = [None] * len(trials)
    if sample.samples == search.samples:
        starts[0] = result

    # Several starts run at once; one spreads its own work over the executor.
    race = plan_race(effort, slots)
    counter = Counter(len(trials) + (race.steps if race else 0), progress)
    first = search if len(trials) > 1 else search.hasty(local_executor(executor))
    with share_value(None if first.is_hasty else executor, first) as shared:
        results = counter.follow(shared.map(_run, zip(trials, starts, strict=True)))
        finalists = _select_finalists(
            [Solution(grid, found) for grid, found in results if found is not None], search.effort
        )
        best = min(shared.map(_improve_walks, finalists), key=_cost_of, default=None)

    # A race follows at high efforts.
    if race is not None:
        racer = search if slots < _HASTY_SLOTS else search.hasty(local_executor(executor))
        with share_value(None if racer.is_hasty else executor, racer) as shared:
            best = race.run(shared, racer.explorer, chosen, best, counter)
    counter.finish()
    return best


def _select_finalists(solutions: list[Solution], effort: int) -> list[Solution]:
    """Return the solutions that a local search is to improve."""
    grids = {id(outcome): grid for grid, outcome in solutions}
    best = select_best_outcomes((outcome for _, outcome in solutions), effort)
    return [Solution(grids[id(outcome)], outcome) for outcome in best]


def _cost_of(solution: Solution) -> float:
    return solution.outcome.cost


def _choose_subsample(search: Search) -> Search:
    """Return a search of a subsample that takes little time."""
    subsample = search.subsample(_SUBSAMPLE)
    time_grid = build_time_grid(
        subsample.tracks, subsample.gaps, subsample.grid(FIRST_TRIAL), sparse=True
    )
    slots = len(time_grid.time_steps)
    if slots > _SUBSAMPLE_SLOTS:
        subsample = search.subsample(max(_SUBSAMPLE * _SUBSAMPLE_SLOTS // slots, _MIN_SUBSAMPLE))

    # Many slots are searched in few rounds.
    if slots < _QUICK_SLOTS:
        return subsample
    return replace(subsample, rounds=_QUICK_ROUNDS, is_quick=True)


def _choose_steps(search: Search, shared: SharedValue[Search]) -> tuple[Trial, TrialResult]:
    """Choose step sizes by a pattern search on the encoded size.

    Each trial begins with the walks of the best one so far.

    Parameters
    ----------
    search : Search
        A rough search.
    shared : SharedValue
        The same at the workers.

    Returns
    -------
    Trial
        Step sizes and leader radius.
    TrialResult
        What this trial led to.
    """
    results: dict[Trial, TrialResult] = {}

    # Trials whose result is known already are not run again.
    def run(trials: list[Trial], start: TrialResult | None) -> None:
        new = [trial for trial in trials if trial not in results]
        results.update(zip(new, shared.map(_run, [(trial, start) for trial in new]), strict=True))

    # Begin with two scales, each from private chains: walks that begin on one of them keep its
    # number of knots.
    finer = Trial(FIRST_TRIAL.space * _FINER, FIRST_TRIAL.time * _FINER, FIRST_TRIAL.leader_radius)
    run([FIRST_TRIAL, finer], None)
    best = min((FIRST_TRIAL, finer), key=lambda trial: search.rate(results[trial]))

    # Move to the smallest neighbour, until none is smaller than the centre.
    for _ in range(search.moves):
        around = [
            Trial(best.space * space, best.time * time, best.leader_radius)
            for space, time in _MOVES
        ]
        run(around, results[best])
        size = search.rate(results[best])
        sizes = [search.rate(results[trial]) for trial in around]
        if min(sizes) >= size and size < NEVER:
            break
        # Where nothing keeps the bound yet, the first move makes both steps finer.
        best = around[sizes.index(min(sizes))] if min(sizes) < NEVER else around[0]
    return best, results[best]


def _list_trials(chosen: Trial, effort: int, slots: int) -> list[Trial]:
    """Trials around the chosen step sizes: the fewer slots the log has, the more trials."""
    count = max(1, min(_MAX_STARTS[effort - 1], _SLOTS_BY_EFFORT[effort - 1] // slots))
    radii = len(_LEADER_RADII)
    starts = [
        (*factors, _LEADER_RADII[number % radii]) for number, factors in enumerate(_STEP_FACTORS)
    ]
    return [
        Trial(chosen.space * space, chosen.time * time, leader_radius)
        for space, time, leader_radius in [*starts, (1.0, 1.0, 0.0)][:count]
    ]


def _run(search: Search, job: tuple[Trial, TrialResult | None]) -> TrialResult:
    return search.run(*job)


def _improve_walks(search: Search, solution: Solution) -> Solution:
    """Improve a solution by local search, if the work allows it."""
    work = WORK_BY_EFFORT[search.effort - 1]
    if not is_worthwhile(solution.outcome, work, _MIN_WORK_SHARE):
        return solution
    return search.improve(solution, work)
