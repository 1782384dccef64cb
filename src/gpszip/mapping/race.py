"""A race of trials, for efforts above the default: many begin, and the best go on.

First looks go to step sizes everywhere, and around the best so far. The race follows Jamieson and
Talwalkar (2016): from heat to heat, what one trial may cost grows, and the number of trials falls.
Work is counted in slots and encoded knots, not in seconds, so that the same log gives the same
bytes on any machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gpszip.codec.modes import encode_smallest
from gpszip.mapping.trials import NEVER, Search, Solution, Trial, TrialResult
from gpszip.run.executor import SharedValue

__all__ = ["MIN_EFFORT", "Counter", "Race", "plan_race"]

#: Least effort with a race.
MIN_EFFORT = 6

#: Trials that get a first look where the log is small, at efforts 6 to 9.
_MOST_LOOKS = (8, 14, 24, 40)
#: The same where it is large: so many at least.
_FEWEST_LOOKS = (1, 2, 4, 7)
#: Slots that all first looks may take together. 5,000 take about 0.05 s.
_SLOTS = (130_000, 220_000, 400_000, 900_000)
#: Knots that all local searches may encode. A million take 2 to 3 s.
_WORK = (500_000, 2_200_000, 4_200_000, 7_200_000)

#: Shares of the trials that are searched after a first look where the log is large, and where it is
#: small: ranks of looks correlate with those of the walks at last by 0.94 for a taxi of 4,281
#: points, by 0.4 for a robot with 80 knots.
_SEARCHED = (1 / 4, 2 / 3)
#: Slots of first looks for each one that searches of more than the least share may take.
_LOOKS_PER_SEARCH = 5


class _Heat(NamedTuple):
    """Local searches of the smallest solutions, which end when so much is encoded.

    Parameters
    ----------
    per_knot, per_pair : float
        Each encodes ``per_knot`` K or ``per_pair`` K^2 knots, whichever is more, of a solution with
        K knots: changes are encoded with the nearest knots, and those that look good with all.
    share : float
        Share of the work left that all take together.
    most : int
        Largest number of solutions.
    """

    per_knot: float
    per_pair: float
    share: float = 1.0
    most: int = 1

    def count_work(self, knots: int) -> int:
        """Knots to encode for one solution."""
        return int(knots * max(self.per_knot, self.per_pair * knots))


#: Smallest solutions that are encoded in all modes: modes save a byte or two of one and none of
#: another.
_ENCODED = 3

#: Heats of local search. The last one goes on until little is left to improve.
_HEATS = (
    _Heat(200, 0.5, share=0.35, most=16),
    _Heat(1000, 1.5, share=0.5, most=6),
    _Heat(5000, 6.0, share=1.0, most=2),
)
#: Least work of the last heat: of a taxi with 1,800 knots, 0.33 K^2 saved 0.2 % in 2 s; of one with
#: 490, 0.6 K^2 saved 2.8 % in 0.5 s.
_LEAST_HEAT = _Heat(160, 0.5)

#: Largest factor by which trials make the space step coarser and the time step finer, or the other
#: way round: either error grows as the other one falls, so that sizes change little.
_TRADE = 1.7
#: Largest factor by which they make both steps finer or coarser: sizes change more.
_SCALE = 1.17
#: Factor on both steps in the middle of these ranges: walks are often smallest on steps a little
#: coarser than those chosen after few rounds.
_MIDDLE = 1.05
#: Steps of the R2 sequence (Roberts, 2018) by which trials spread evenly between these factors.
_R2_STEPS = (0.5698402909980532, 0.7548776662466927)
#: Leader radii of trials, one after the other.
_LEADER_RADII = (0.0, 1.2, 2.0, 0.7, 1.2)

#: Trials that are looked at together.
_BATCH = 4
#: Shares of the logarithmic ranges over which the trials of a batch spread, after the first one:
#: all but one lie around the best so far.
_REACHES = (1.0, 0.5, 0.25, 0.5)
#: Trials seen so far for each one around which further ones lie.
_LOOKS_PER_CENTRE = 5


@dataclass(eq=False)
class Counter:
    """Counts the searches of a log.

    Parameters
    ----------
    total : int
        Number of all.
    progress : callable, optional
        Called with the number done and that of all.
    done : int, default 0
        Number done.
    """

    total: int
    progress: Callable[[int, int], None] | None
    done: int = 0

    def follow(self, results: Iterable[TrialResult]) -> list[TrialResult]:
        """Return results as a list, and count them as they come."""
        found = []
        for result in results:
            found.append(result)
            self._count()
        return found

    def finish(self) -> None:
        """Count what was planned but not needed."""
        while self.done < self.total:
            self._count()

    def _count(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, self.total)


@dataclass(frozen=True)
class Race:
    """How much a race may take.

    Parameters
    ----------
    looks : int
        Trials that get a first look.
    searches : int
        The best of them, which are searched to the end.
    work : int
        Knots that all local searches may encode.
    """

    looks: int
    searches: int
    work: int

    @property
    def steps(self) -> int:
        """Searches of both kinds."""
        return self.looks + self.searches

    def run(
        self,
        shared: SharedValue[Search],
        explorer: Search,
        chosen: Trial,
        first: Solution | None,
        counter: Counter,
    ) -> Solution | None:
        """Return the smallest solution of the race, or the one that is known already.

        Parameters
        ----------
        shared : SharedValue
            The search, at the workers.
        explorer : Search
            The one for first looks, which rates them.
        chosen : Trial
            Step sizes around which the trials lie.
        first : Solution, optional
            A solution that is known already.
        counter : Counter
            Counts the searches.
        """
        # Look at trials, and search the best of them to the end.
        seen = self._look_around(shared, explorer, chosen, counter)
        best = [view for view in seen if view.size < NEVER][: self.searches]
        jobs = [(view.trial, view.result) for view in best]
        results = counter.follow(shared.map(_search, jobs))
        found = [Solution(grid, outcome) for grid, outcome in results if outcome is not None]

        # Improve the smallest of them, heat by heat. The known one had its local search: another
        # one saved a byte at most.
        found = improve_smallest(shared, distinct(found), self.work)
        return find_smallest([first, *found[:_ENCODED]] if first else found[:_ENCODED])

    def _look_around(
        self,
        shared: SharedValue[Search],
        explorer: Search,
        chosen: Trial,
        counter: Counter,
    ) -> list[_View]:
        """Look at trials everywhere and around the best ones; return all, the smallest first.

        A higher effort looks at all trials of a lower one, and at more.
        """
        seen: list[_View] = []
        for begin in range(0, self.looks, _BATCH):
            numbers = range(begin, min(begin + _BATCH, self.looks))
            best = [view.trial for view in seen[: -(-len(seen) // _LOOKS_PER_CENTRE)]]
            trials = [spread_trial(chosen, best, number) for number in numbers]
            results = counter.follow(shared.map(_look, trials))
            seen += [
                _View(trial, result, explorer.rate(result))
                for trial, result in zip(trials, results, strict=True)
            ]
            seen.sort(key=lambda view: view.size)
        return seen


class _View(NamedTuple):
    """What a first look at a trial shows."""

    trial: Trial
    result: TrialResult
    size: float


def plan_race(effort: int, slots: int) -> Race | None:
    """Return the race for a log of so many slots; None where the effort allows none.

    Examples
    --------
    >>> plan_race(5, 800) is None
    True
    >>> plan_race(9, 800).looks, plan_race(9, 30_000).looks, plan_race(9, 10_000_000).looks
    (40, 30, 7)
    """
    if effort < MIN_EFFORT:
        return None
    level = effort - MIN_EFFORT
    looks = min(max(_SLOTS[level] // slots, _FEWEST_LOOKS[level]), _MOST_LOOKS[level])
    least, most = (math.ceil(share * looks) for share in _SEARCHED)
    searches = min(max(_SLOTS[level] // (_LOOKS_PER_SEARCH * slots), least), most)
    return Race(looks, searches, _WORK[level])


def spread_trial(chosen: Trial, best: Sequence[Trial], number: int) -> Trial:
    """Trial of this number: trials spread evenly, however many there are.

    Number i lies at the fractions 1/2 + i s of the logarithmic ranges, s the steps of the sequence;
    number 0 is their middle.

    Parameters
    ----------
    chosen : Trial
        The step sizes chosen.
    best : sequence of Trial
        The best trials so far, around which most trials lie, in smaller ranges; none at first.
    number : int
        From 0.
    """
    reach = _REACHES[number % len(_REACHES)] if best else 1.0
    centre = best[number % len(best)] if reach < 1 else chosen
    trade, scale = (
        factor ** (reach * (2 * math.modf(0.5 + number * step)[0] - 1))
        for factor, step in zip((_TRADE, _SCALE), _R2_STEPS, strict=True)
    )
    scale *= _MIDDLE if reach == 1 else 1.0
    radius = _LEADER_RADII[number % len(_LEADER_RADII)]
    return Trial(centre.space * scale / trade, centre.time * scale * trade, radius)


def improve_smallest(
    shared: SharedValue[Search], solutions: list[Solution], work: int
) -> list[Solution]:
    """Return the solutions after heats of local search, the smallest first.

    A heat is left out if the work doesn't allow it for two solutions; the last one then takes what
    there is.

    Parameters
    ----------
    shared : SharedValue
        The search, at the workers.
    solutions : list of Solution
        The smallest first.
    work : int
        Knots that may be encoded in all.
    """
    for heat in _HEATS if solutions else ():
        # Find how many solutions the work allows.
        knots = sum(len(walk.nodes) for walk in solutions[0].outcome.walks.walks)
        allowed = int(heat.share * work)
        each = heat.count_work(knots)
        if heat is _HEATS[-1] and allowed >= _LEAST_HEAT.count_work(knots):
            each = min(each, allowed)
        count = min(allowed // max(each, 1), heat.most, len(solutions))
        if count < 2 and heat is not _HEATS[-1]:
            continue

        # Improve these, and rank all again.
        jobs = [(solution, each) for solution in solutions[:count]]
        solutions = distinct([*shared.map(_improve, jobs), *solutions[count:]])
        work -= count * each
    return solutions


def find_smallest(solutions: Sequence[Solution]) -> Solution | None:
    """Return the solution of fewest bytes once encoded in modes, the first of equal ones."""
    if len(solutions) < 2:
        return next(iter(solutions), None)
    costs = [
        outcome.cost - outcome.size + len(encode_smallest(outcome.walks, grid=grid))
        for grid, outcome in solutions
    ]
    return solutions[costs.index(min(costs))]


def distinct(solutions: Sequence[Solution]) -> list[Solution]:
    """Drop solutions of equal size and error; return the others, the smallest first."""
    kept: dict[tuple[float, float], Solution] = {}
    for solution in sorted(solutions, key=lambda solution: solution.outcome.cost):
        kept.setdefault((solution.outcome.cost, solution.outcome.error), solution)
    return list(kept.values())


def _look(search: Search, trial: Trial) -> TrialResult:
    return search.explorer.run(trial)


def _search(search: Search, job: tuple[Trial, TrialResult]) -> TrialResult:
    return search.run(*job)


def _improve(search: Search, job: tuple[Solution, int]) -> Solution:
    return search.improve(*job)
