import numpy as np
import pytest

from gpszip.mapping.race import Counter, Race, distinct, improve_smallest, plan_race, spread_trial
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.trials import Solution, Trial, TrialResult
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
    found = improve_smallest(LocalValue(Serial(), search), solutions(sizes, knots), work)
    return found, search.work


@pytest.mark.parametrize("slots", [1, 700, 5_000, 40_000, 10**7])
def test_each_effort_looks_at_more_trials(slots):
    races = [plan_race(effort, slots) for effort in range(1, 10)]
    assert races[:5] == [None] * 5
    for lower, higher in zip(races[5:], races[6:], strict=False):
        assert lower.looks < higher.looks
        assert lower.searches <= higher.searches
        assert lower.work < higher.work
    assert all(1 <= race.searches <= race.looks for race in races[5:])


class Valley:
    """In the place of a search: sizes grow with the distance from the steps that suit best."""

    suits = Trial(1.2, 1.3, 0.0)

    def __init__(self):
        self.seen = []

    @property
    def explorer(self):
        return self

    def run(self, trial, start=None):
        if start is None:
            self.seen.append(trial)
        size = (
            100
            + 100 * abs(np.log(trial.space / self.suits.space))
            + abs(100 * np.log(trial.time / self.suits.time))
        )
        return TrialResult(GRID, Outcome(solutions([size], 3)[0].outcome.walks, size, 1.0))

    def rate(self, result):
        return result.outcome.size

    def improve(self, solution, work):
        return solution


def race(looks, first=None):
    valley = Valley()
    counter = Counter(2 * looks, None)
    shared = LocalValue(Serial(), valley)
    best = Race(looks, looks, 0).run(shared, valley, Trial(1.0, 1.0, 1.2), first, counter)
    return valley.seen, best


def test_a_higher_effort_looks_at_all_trials_of_a_lower_one():
    assert race(30)[0][:8] == race(8)[0]


def test_later_trials_lie_around_the_best():
    seen, best = race(40)
    sizes = [Valley().run(trial).outcome.size for trial in seen]
    assert best.outcome.size == min(sizes)
    assert min(sizes) < min(sizes[:4]) - 5
    assert np.mean(sizes[20:]) < np.mean(sizes[:4])


def test_the_smallest_once_encoded_wins():
    # Walks of the race have 3 knots each, whatever size the search gives them.
    short, long = solutions([900], 2)[0], solutions([1], 40)[0]
    assert race(4, short)[1] is short
    assert race(4, long)[1] is not long


def test_trials_spread_around_the_chosen_steps():
    chosen = Trial(0.8, 1.4, 2.0)
    trials = [spread_trial(chosen, [], number) for number in range(60)]
    factors = [[trial.space / 0.8, trial.time / 1.4] for trial in trials]
    space, time = np.log(factors).T
    trade, scale = (time - space) / 2, (time + space) / 2
    assert trade[0] == pytest.approx(0)
    assert len(set(trials)) == 60
    # As many below as above, in all of the range, and farther where sizes change little.
    for logs, largest in ((trade, 1.7), (scale - np.log(1.05), 1.17)):
        assert abs((logs > 0).mean() - 0.5) < 0.05
        assert 0.95 * np.log(largest) < np.abs(logs).max() <= np.log(largest)


def test_trials_near_the_best_lie_in_smaller_ranges():
    best = [Trial(0.8, 1.4, 2.0), Trial(1.0, 1.0, 0.0)]
    near = [spread_trial(Trial(9.0, 9.0, 0.0), best, number) for number in (1, 2, 3)]
    for number, trial in enumerate(near, 1):
        centre = best[number % 2]
        assert abs(np.log(trial.space / centre.space)) < np.log(1.7 * 1.2) / 2
        assert abs(np.log(trial.time / centre.time)) < np.log(1.7 * 1.2) / 2


@pytest.mark.parametrize("knots", [2, 80, 300, 1000, 5000])
@pytest.mark.parametrize("work", [0, 300_000, 4_500_000])
def test_local_searches_keep_within_the_work(knots, work):
    found, given = improve([90, 91, 92, 95, 99], knots, work)
    sizes = [each.outcome.size for each in found]
    assert sum(given) <= work
    assert sizes == sorted(sizes)
    assert sizes[0] < 90 if given else sizes[0] == 90


def test_little_work_goes_to_the_smallest_solution_only():
    _, given = improve([90, 91, 92], 400, 300_000)
    assert given == [300_000]


def test_many_knots_are_left_alone():
    assert improve([900], 2000, 300_000)[1] == []


def test_nothing_comes_of_no_solution():
    assert improve([], 10, 1_000_000) == ([], [])


def test_equal_solutions_count_once():
    assert [each.outcome.size for each in distinct(solutions([9, 7, 9], 3))] == [7, 9]


def test_a_counter_reaches_its_total():
    calls = []
    counter = Counter(4, lambda done, total: calls.append((done, total)))
    assert counter.follow(iter("ab")) == ["a", "b"]
    counter.finish()
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
