import numpy as np
import pytest

from gpszip.mapping.race import Counter, distinct, improve_smallest, plan_race, spread_trials
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.trials import Solution, Trial
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.run.executor import LocalValue, Serial

GRID = QuantisationGrid((0, 0), 0, 100, 100)


class Saver:
    """In the place of a search: notes the work that it is given, and saves a byte each time."""

    def __init__(self):
        self.work = []

    def improve(self, solution, work):
        self.work.append(work)
        outcome = solution.outcome
        return Solution(GRID, Outcome(outcome.walks, outcome.size - 1, outcome.error))


def solutions(sizes, knots):
    walk = GridWalk(np.arange(knots), np.arange(knots), np.zeros(knots - 1, bool))
    walks = GridWalks(np.zeros((knots, 2), np.int64), (walk,))
    return [Solution(GRID, Outcome(walks, size, 1.0)) for size in sizes]


def improve(sizes, knots, work):
    search = Saver()
    best = improve_smallest(LocalValue(Serial(), search), solutions(sizes, knots), work)
    return best, search.work


@pytest.mark.parametrize("slots", [1, 700, 5_000, 40_000, 10**7])
def test_each_effort_looks_at_more_trials(slots):
    races = [plan_race(effort, slots) for effort in range(1, 10)]
    assert races[:5] == [None] * 5
    for lower, higher in zip(races[5:], races[6:], strict=False):
        assert lower.looks < higher.looks
        assert lower.searches <= higher.searches
        assert lower.work < higher.work
    assert all(1 <= race.searches <= race.looks for race in races[5:])


def test_trials_of_a_higher_effort_begin_with_those_of_a_lower_one():
    chosen = Trial(0.8, 1.4, 2.0)
    assert spread_trials(chosen, 30)[:8] == spread_trials(chosen, 8)


def test_trials_spread_around_the_chosen_steps():
    chosen = Trial(0.8, 1.4, 2.0)
    trials = spread_trials(chosen, 60)
    factors = np.log([[trial.space / 0.8, trial.time / 1.4] for trial in trials])
    assert (trials[0].space, trials[0].time) == (chosen.space, chosen.time)
    assert len(set(trials)) == 60
    # As many below as above, more near the chosen steps than far away, and none very far.
    assert np.abs((factors > 0).mean(axis=0) - 0.5).max() < 0.05
    assert (np.abs(factors) < np.log([1.6, 1.8]) / 2).mean() > 0.55
    assert (np.abs(factors) <= np.log([1.6, 1.8])).all()


@pytest.mark.parametrize("knots", [2, 80, 300, 1000, 5000])
@pytest.mark.parametrize("work", [0, 300_000, 4_500_000])
def test_local_searches_keep_within_the_work(knots, work):
    best, given = improve([90, 91, 92, 95, 99], knots, work)
    assert sum(given) <= work
    assert best.outcome.size < 90 if given else best.outcome.size == 90


def test_little_work_goes_to_the_smallest_solution_only():
    _, given = improve([90, 91, 92], 400, 300_000)
    assert given == [300_000]


def test_many_knots_are_left_alone():
    assert improve([900], 2000, 300_000)[1] == []


def test_nothing_comes_of_no_solution():
    assert improve([], 10, 1_000_000) == (None, [])


def test_equal_solutions_count_once():
    assert [each.outcome.size for each in distinct(solutions([9, 7, 9], 3))] == [7, 9]


def test_a_counter_reaches_its_total():
    calls = []
    counter = Counter(4, lambda done, total: calls.append((done, total)))
    assert counter.follow(iter("ab")) == ["a", "b"]
    counter.finish()
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
