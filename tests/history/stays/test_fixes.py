"""Which fixes of a track tell where it was."""

import numpy as np

from gpszip.history.stays.fixes import Fixes, add_travel, choose_fixes


def kept(times, positions, accuracy=None, **options):
    return choose_fixes(times, positions, accuracy, **options).times.tolist()


def test_errors_are_those_that_are_stated_or_common_ones():
    fixes = choose_fixes(range(4), np.zeros((4, 2)), [0.0, np.nan, 1.0, 30.0], noise=12.0)
    assert fixes.noise.tolist() == [12, 12, 5, 30]


def test_poor_fixes_stay_where_there_are_no_better_ones():
    places = np.zeros((6, 2))
    times = [0, 100, 1000, 2000, 2100, 2200]
    accuracy = [10, 900, 900, 150, 20, 400]
    assert kept(times, places, accuracy) == [0, 1000, 2100]

    # three times as good is no longer much better
    assert kept([0, 10], np.zeros((2, 2)), [50, 150]) == [0, 10]


def test_repeated_positions_before_an_impossible_step_are_left_out():
    x = [0, 100, 100, 100, 3000, 3010]
    places = np.stack([x, np.zeros(6)], axis=1)
    assert kept(range(6), places) == [0, 1, 4, 5]

    # a phone that lies still and then leaves
    x = [0, 100, 100, 100, 110, 120]
    assert len(kept(range(6), np.stack([x, np.zeros(6)], axis=1))) == 6


def test_few_fixes_far_away_are_left_out():
    for run in (1, 2, 3, 4):
        x = np.zeros(20)
        x[5 : 5 + run] = 900 + np.arange(run)
        left = kept(10.0 * np.arange(20), np.stack([x, x], axis=1))
        assert left == [10.0 * i for i in range(20) if not 5 <= i < 5 + run]

    # five are too many, and so are two in ten minutes
    x = np.arange(20) % 2 * 3.0
    x[5:10] = 600 + np.arange(5)
    assert len(kept(10.0 * np.arange(20), np.stack([x, x], axis=1))) == 20
    x = np.arange(20) % 2 * 3.0
    x[5:7] = 900, 950
    assert len(kept(200.0 * np.arange(20), np.stack([x, x], axis=1))) == 20


def test_errors_of_fixes_around_allow_for_steps():
    x = np.zeros(9)
    x[4] = 900.0
    places, times = np.stack([x, 0 * x], axis=1), 60.0 * np.arange(9)
    assert len(kept(times, places, np.full(9, 95.0))) == 8
    assert len(kept(times, places, np.full(9, 200.0))) == 9


def test_a_wrong_place_for_minutes_is_left_out_on_the_way_too():
    times = 5.0 * np.arange(400)
    rng = np.random.default_rng(1)
    walk = np.stack([1.4 * times, rng.normal(0, 3, 400)], axis=1)
    elsewhere = rng.normal((-1500.0, 800.0), 10, (400, 2))
    wrong = (times > 300) & (times < 650)
    assert kept(times, np.where(wrong[:, None], elsewhere, walk)) == times[~wrong].tolist()

    # longer than a quarter of an hour, or up to the end, it may be the right place
    for wrong in ((times > 300) & (times < 1300), times > 1500):
        assert len(kept(times, np.where(wrong[:, None], elsewhere, walk))) == 400


def test_travel_is_added_where_a_step_is_travel():
    # a step to a place, a long stay, a jump, a slow change
    times = np.array([0.0, 200.0, 5000.0, 5005.0, 9000.0])
    x = np.array([0.0, 2000.0, 2010.0, 5000.0, 6000.0])
    fixes = Fixes(times, x[:, None], np.full(5, 10.0))
    filled = add_travel(fixes, 300.0)
    assert filled.times.tolist() == [0, 50, 100, 150, 200, 5000, 5005, 9000]
    assert filled.positions[:4, 0].tolist() == [0, 500, 1000, 1500]
    assert len(add_travel(fixes, 0.0)) == 5
