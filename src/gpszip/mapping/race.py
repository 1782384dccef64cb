"""A race of trials, for efforts above the default: many begin, and the best go on.

It follows Jamieson and Talwalkar (2016): from heat to heat, what one trial may cost grows, and the
number of trials falls. Work is counted in slots and encoded knots, not in seconds, so that the same
log gives the same bytes on any machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gpszip.mapping.trials import NEVER, Search, Solution, Trial, TrialResult
from gpszip.run.executor import SharedValue

__all__ = ["MIN_EFFORT", "Counter", "Race", "plan_race"]

#: Least effort with a race.
MIN_EFFORT = 6

#: Trials that get a first look where the log is small, at efforts 6 to 9.
_MOST_LOOKS = (8, 16, 30, 50)
#: The same where it is large: so many at least.
_FEWEST_LOOKS = (1, 2, 4, 7)
#: Slots that all first looks may take together. 5,000 take about 0.05 s.
_SLOTS = (100_000, 180_000, 330_000, 600_000)
#: Knots that all local searches may encode. A million take 2 to 3 s.
_WORK = (300_000, 800_000, 1_800_000, 4_500_000)

#: Trials for each one that is searched after a first look: of six logs, the ranks of looks
#: correlate with those of the walks at last by 0.6 to 0.9.
_LOOKS_PER_SEARCH = 2


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


#: Heats of local search. The last one goes on until little is left to improve.
_HEATS = (
    _Heat(250, 0.5, share=0.3, most=25),
    _Heat(1200, 1.5, share=0.45, most=12),
    _Heat(5000, 6.0, share=1.0, most=4),
)
#: Least work of the last heat: of a taxi with 1,800 knots, 0.33 K^2 saved 0.2 % in 2 s; of one with
#: 490, 0.6 K^2 saved 2.8 % in 0.5 s.
_LEAST_HEAT = _Heat(160, 0.6)

#: Largest factors on the space step and the time step chosen.
_SPREAD = (1.6, 1.8)
#: Steps of the R2 sequence (Roberts, 2018) by which trials spread evenly between these factors.
_R2_STEPS = (0.7548776662466927, 0.5698402909980532)
#: Leader radii of trials, one after the other.
_LEADER_RADII = (0.0, 1.2, 2.0, 0.7, 1.2)
#: Powers of the distances from the chosen trial, in turn: the higher one leads to trials near it.
_POWERS = (1.0, 3.0)


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
        # Look at all trials, and search the best ones to the end.
        trials = spread_trials(chosen, self.looks)
        looks = counter.follow(shared.map(_look, trials))
        sizes = [explorer.rate(look) for look in looks]
        ranking = sorted(range(len(trials)), key=lambda number: (sizes[number], number))
        best = [number for number in ranking if sizes[number] < NEVER][: self.searches]
        jobs = [(trials[number], looks[number]) for number in best]
        results = counter.follow(shared.map(_search, jobs))
        found = [Solution(grid, outcome) for grid, outcome in results if outcome is not None]

        # Improve the smallest heat by heat, among them the known one.
        found = distinct([*found, first] if first else found)
        return improve_smallest(shared, found, self.work)


def plan_race(effort: int, slots: int) -> Race | None:
    """Return the race for a log of so many slots; None where the effort allows none.

    Examples
    --------
    >>> plan_race(5, 800) is None
    True
    >>> plan_race(9, 800).looks, plan_race(9, 30_000).looks, plan_race(9, 10_000_000).looks
    (50, 20, 7)
    """
    if effort < MIN_EFFORT:
        return None
    level = effort - MIN_EFFORT
    looks = min(max(_SLOTS[level] // slots, _FEWEST_LOOKS[level]), _MOST_LOOKS[level])
    return Race(looks, -(-looks // _LOOKS_PER_SEARCH), _WORK[level])


def spread_trials(chosen: Trial, count: int) -> list[Trial]:
    """Trials around the chosen one, spread evenly whatever their number.

    Number i lies at the fractions 1/2 + i s of the logarithmic ranges, s the steps of the sequence;
    number 0 is the chosen one itself. Every other trial lies nearer to it: some logs take fewest
    bytes with steps close to those chosen, others with steps far from them.

    Examples
    --------
    >>> [round(trial.space, 2) for trial in spread_trials(Trial(1.0, 1.0, 0.0), 3)]
    [1.0, 0.95, 0.63]
    """
    trials = []
    for number in range(count):
        power = _POWERS[number % len(_POWERS)]
        space, time = (
            factor ** _bend(2 * math.modf(0.5 + number * step)[0] - 1, power)
            for factor, step in zip(_SPREAD, _R2_STEPS, strict=True)
        )
        radius = _LEADER_RADII[number % len(_LEADER_RADII)]
        trials.append(Trial(chosen.space * space, chosen.time * time, radius))
    return trials


def _bend(distance: float, power: float) -> float:
    """Return the power of a distance, with its sign."""
    return math.copysign(abs(distance) ** power, distance)


def improve_smallest(
    shared: SharedValue[Search], solutions: list[Solution], work: int
) -> Solution | None:
    """Return the smallest solution after heats of local search; None if there is none.

    A heat is left out if the work doesn't allow it for a single solution; the last one then takes
    what there is.

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
        # As many solutions as the work allows.
        knots = sum(len(walk.nodes) for walk in solutions[0].outcome.walks.walks)
        allowed = int(heat.share * work)
        each = heat.count_work(knots)
        if heat is _HEATS[-1] and allowed >= _LEAST_HEAT.count_work(knots):
            each = min(each, allowed)
        count = min(allowed // max(each, 1), heat.most, len(solutions))

        # Improve these, and rank all again.
        jobs = [(solution, each) for solution in solutions[:count]]
        solutions = distinct([*shared.map(_improve, jobs), *solutions[count:]])
        work -= count * each
    return solutions[0] if solutions else None


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
