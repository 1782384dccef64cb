"""Travel times of routes: planted speeds and hours, bands, shrinkage, and errors."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.history.travel_time import learn_travel_times
from gpszip.history.traversals import History, Traversals, read_history
from history_rows import drives, street


def commuters(cars: int, rng: np.random.Generator, spread: float = 0.1) -> Traversals:
    """Drives over ten edges of 100 m each way: 10 s there, 20 s in the morning, 12 s back."""
    rows = []
    for car in range(cars):
        morning = car % 2 == 0
        time = (8 if morning else 15) * 3600 + 86_400.0 * (car // 2) + 60 * rng.random()
        pace = np.exp(rng.normal(0, spread))
        for edge in range(10):
            took = (20 if morning else 10) * pace * np.exp(rng.normal(0, spread))
            rows.append((car, edge, True, time, time + took))
            time += took
        for edge in reversed(range(10)):
            took = 12 * pace * np.exp(rng.normal(0, spread))
            rows.append((car, edge, False, time, time + took))
            time += took
    return drives(rows)


def test_planted_times_come_back() -> None:
    history = History(street(10), commuters(200, np.random.default_rng(1)))
    times = learn_travel_times(history)
    there, back = (np.arange(10), np.ones(10, bool)), (np.arange(10)[::-1], np.zeros(10, bool))
    assert times.seconds(*there, 8.2 * 3600).sum() == pytest.approx(200, rel=0.06)
    assert times.seconds(*there, 15.2 * 3600).sum() == pytest.approx(100, rel=0.06)
    assert times.seconds(*back, 15.2 * 3600).sum() == pytest.approx(120, rel=0.1)
    half = times.seconds(*there, 8.2 * 3600, metres=np.full(10, 50.0)).sum()
    assert half == pytest.approx(100, rel=0.06)


def test_band_holds_four_fifths_of_other_drives() -> None:
    times = learn_travel_times(History(street(10), commuters(300, np.random.default_rng(1))))
    others = commuters(200, np.random.default_rng(2))
    inside = []
    for car in range(200):
        mine = np.flatnonzero(others.track == car)
        arrival = times.arrival(others.edge[mine], others.forward[mine], others.enter[mine[0]])
        took = others.leave[mine[-1]] - others.enter[mine[0]]
        inside.append(arrival.low <= took <= arrival.high)
    assert 0.7 < np.mean(inside) < 0.9


def test_other_drives_are_foreseen_better_than_by_one_speed() -> None:
    history = History(street(10), commuters(60, np.random.default_rng(3)))
    times = learn_travel_times(history)
    others = commuters(100, np.random.default_rng(4))
    one_speed = (history.traversals.leave - history.traversals.enter).mean()
    took = others.leave - others.enter
    expected = np.concatenate(
        [
            times.seconds(others.edge[mine], others.forward[mine], others.enter[mine[0]])
            for mine in (np.flatnonzero(others.track == car) for car in range(100))
        ]
    )
    assert np.abs(expected - took).mean() < 0.6 * np.abs(one_speed - took).mean()


def test_parking_does_not_slow_an_edge() -> None:
    rows = [(car, 0, True, 1000.0 * car, 1000.0 * car + 10) for car in range(20)]
    usual = learn_travel_times(History(street(1), drives(rows))).seconds([0], [True])
    rows[7] = (7, 0, True, 7000.0, 7900.0)
    parked = learn_travel_times(History(street(1), drives(rows))).seconds([0], [True])
    assert parked == pytest.approx(usual)


def test_edges_without_traversals_have_the_usual_speed() -> None:
    rows = [(car, 0, True, 1000.0 * car, 1000.0 * car + 10) for car in range(40)]
    times = learn_travel_times(History(street(3), drives(rows)))
    assert times.seconds([2], [True])[0] == pytest.approx(10, rel=0.1)
    assert times.seconds([0], [False])[0] == pytest.approx(10, rel=0.1)
    assert times.counts.tolist() == [40, 0, 0, 0, 0, 0]


def test_real_traversals(van_history: History) -> None:
    # The mean of all expected times is that of the observed ones.
    rows = van_history.traversals
    times = learn_travel_times(van_history)
    whole = rows.take(rows.metres > 0.9 * van_history.network.lengths[rows.edge])
    expected = [
        times.seconds([e], [f], t)[0]
        for e, f, t in zip(whole.edge, whole.forward, whole.enter, strict=True)
    ]
    assert np.sum(expected) == pytest.approx((whole.leave - whole.enter).sum(), rel=0.25)


def test_pace_so_far_is_drawn_to_one() -> None:
    times = learn_travel_times(History(street(1), drives([(0, 0, True, 0, 10)])))
    assert times.pace_so_far(20, 10) < 1.05
    assert times.pace_so_far(20_000, 10_000) == pytest.approx(2, rel=0.1)


def test_no_times() -> None:
    shape = gpszip.Track("plan", [0, 50, 100], [[0, 0], [50, 0], [100, 0]], timed=False)
    with pytest.raises(OptionError, match="no travel times"):
        learn_travel_times(read_history(gpszip.compress([shape], max_error=1.0)))
