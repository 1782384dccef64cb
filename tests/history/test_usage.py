"""Usage of edges: counts against loops, planted hours and speeds, zones, and errors."""

from dataclasses import fields, replace
from datetime import UTC
from zoneinfo import ZoneInfo

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.history.agents import cluster_values
from gpszip.history.calendar import Calendar
from gpszip.history.transitions import learn_transitions
from gpszip.history.travel_time import learn_travel_times
from gpszip.history.traversals import History
from gpszip.history.usage import measure_usage, traversal_speeds
from history_rows import drives, street

#: A Monday at midnight, UTC.
MONDAY = 1_704_067_200.0


def test_planted_hours_and_speeds() -> None:
    # Ten cars at 8 h at 10 m/s, four at 9 h at 5 m/s, on Monday and Tuesday.
    rows = []
    for car in range(14):
        enter = MONDAY + 86_400 * (car % 2) + (8 if car < 10 else 9) * 3600 + 60 * car
        rows.append((car, 0, True, enter, enter + (10 if car < 10 else 20)))
    used = measure_usage(History(street(), drives(rows)))
    assert used.by == ("hour", "weekday")
    table = zip(
        *(used[c].tolist() for c in ("hour", "weekday", "traversals", "speed")), strict=True
    )
    assert list(table) == [(8, 0, 5, 10), (8, 1, 5, 10), (9, 0, 2, 5), (9, 1, 2, 5)]
    assert used["forward"].all()
    assert (used["edge"] == 0).all()
    assert (used["first"].min(), used["last"].max()) == (
        min(row[3] for row in rows),
        max(row[4] for row in rows),
    )


def test_jumps_of_the_receiver_have_no_speed() -> None:
    # Ten passes at 10 m/s, and one of 100 m in a tenth of a second.
    rows = drives([(0, 0, True, MONDAY + 60 * i, MONDAY + 60 * i + 10) for i in range(10)])
    jump = drives([(0, 1, True, MONDAY, MONDAY + 0.1)])
    both = replace(
        rows,
        max_speed=40.0,
        **{
            field.name: np.concatenate([getattr(rows, field.name), getattr(jump, field.name)])
            for field in fields(rows)
            if field.name not in {"ids", "max_speed"}
        },
    )
    assert both.jumps.tolist() == [False] * 10 + [True]
    speeds = traversal_speeds(both)
    assert speeds[:10] == pytest.approx(10.0)
    assert np.isnan(speeds[10])

    # They count as traversals, and rows that are taken know the limit.
    used = measure_usage(History(street(), both), by=())
    assert used["traversals"].tolist() == [10, 1]
    np.testing.assert_allclose(used["speed"], [10.0, np.nan])
    # Nobody travelled their metres, and they take no time.
    assert used["metres"].tolist() == [1000.0, 0.0]
    np.testing.assert_allclose(used["duration"], [10.0, np.nan])
    seconds = learn_travel_times(History(street(), both)).seconds([1], [True])
    assert seconds == pytest.approx(10.0, rel=0.1)
    assert both.take(np.array([10])).jumps.all()


def test_parts_are_local() -> None:
    rows = drives([(0, 0, True, MONDAY + 23.5 * 3600, MONDAY + 23.6 * 3600)])
    history = History(street(), rows)
    berlin = measure_usage(history, ["hour", "weekday", "month", "period", "date"], "Europe/Berlin")
    assert [berlin[part][0] for part in ("hour", "weekday", "month")] == [0, 1, 1]
    assert [berlin[part][0] for part in ("period", "date")] == ["night", "2024-01-02"]
    assert berlin.timezone == "Europe/Berlin"
    assert measure_usage(history)["hour"].tolist() == [23]


def test_local_times_follow_the_zone() -> None:
    times = MONDAY + np.arange(0, 366 * 86_400, 3_333.0)
    zone = ZoneInfo("America/St_Johns")
    local = Calendar(zone, "America/St_Johns", "option").hours(times)
    for time, hour in zip(times[::97], local[::97], strict=True):
        from datetime import datetime

        shown = datetime.fromtimestamp(time, zone)
        assert hour == pytest.approx(shown.hour + shown.minute / 60 + shown.second / 3600)


def test_counts_are_those_of_a_loop(van_history: History) -> None:
    network, rows = van_history.network, van_history.traversals
    used = measure_usage(van_history, ["hour"])
    counts: dict[tuple[int, bool, int], list[float]] = {}
    for i in range(len(rows)):
        key = (int(rows.edge[i]), bool(rows.forward[i]), int(rows.enter[i] // 3600 % 24))
        counts.setdefault(key, []).append(rows.metres[i])
    keys = list(
        zip(used["edge"].tolist(), used["forward"].tolist(), used["hour"].tolist(), strict=True)
    )
    assert set(keys) == set(counts)
    for key, traversals, metres in zip(keys, used["traversals"], used["metres"], strict=True):
        half = network.lengths[key[0]] / 2
        assert traversals == sum(length >= half for length in counts[key])
        assert metres == pytest.approx(sum(counts[key]))
    assert used["dwell"].sum() == pytest.approx(rows.standing.sum())


def test_repeated_shares() -> None:
    # Car 0 on both edges, car 1 back over one of them, and car 0 once more.
    rows = [(0, 0, True, 0, 9), (0, 1, True, 9, 18), (0, 1, False, 90, 99), (1, 1, False, 50, 59)]
    used = measure_usage(History(street(), drives(rows)), [])
    assert used.repeated == pytest.approx(0.5)
    assert used.repeated_by_track == pytest.approx(0.25)


def test_markov_model_is_that_of_a_loop(van_history: History) -> None:
    network, rows = van_history.network, van_history.traversals
    model = learn_transitions(van_history.network, van_history.traversals)
    counts: dict[tuple[int, int], int] = {}
    for i in range(1, len(rows)):
        if not rows.starts[i]:
            pair = tuple((2 * rows.edge[[i - 1, i]] + ~rows.forward[[i - 1, i]]).tolist())
            counts[pair] = counts.get(pair, 0) + 1
    assert (
        dict(
            zip(
                zip(model.before.tolist(), model.after.tolist(), strict=True),
                model.counts.tolist(),
                strict=True,
            )
        )
        == counts
    )

    # Probabilities of all ways out of a node sum up to 1.
    heads = np.stack([network.ends, network.starts], axis=1).reshape(-1)
    tails = np.stack([network.starts, network.ends], axis=1).reshape(-1)
    for directed in range(len(heads)):
        after = np.flatnonzero(tails == heads[directed])
        total = model.probability(np.full(len(after), directed), after).sum()
        assert total == pytest.approx(1.0)
    likelihood = model.likelihood(rows)
    assert likelihood.transitions == sum(counts.values())
    assert 0 < likelihood.bits_per_transition < 2


def test_clusters_are_those_of_all_splits() -> None:
    values = np.random.default_rng(2).normal(0, 0.3, 12)
    ordered = np.sort(values)

    def cost(cuts: list[int]) -> float:
        return sum(((part - part.mean()) ** 2).sum() for part in np.split(ordered, cuts))

    best = {1: cost([])}
    best[2] = min(cost([i]) for i in range(1, 12))
    best[3] = min(cost([i, j]) for i in range(1, 11) for j in range(i + 1, 12))
    best[4] = min(
        cost([i, j, k]) for i in range(1, 10) for j in range(i + 1, 11) for k in range(j + 1, 12)
    )
    value = {k: 12 * np.log(max(c / 12, 0.05**2)) + 2 * k * np.log(12) for k, c in best.items()}
    number = cluster_values(values)
    chosen = min(value, key=value.__getitem__)
    assert number.max() + 1 == chosen
    parts = [values[number == i] for i in range(chosen)]
    assert sum(((p - p.mean()) ** 2).sum() for p in parts) == pytest.approx(best[chosen])


def test_fast_and_slow_agents_are_told_apart() -> None:
    rows = []
    for car in range(8):
        for lap in range(8):
            enter = 1000.0 * lap + car
            rows.append((car, lap % 2, True, enter, enter + (10 if car % 2 else 14) + 0.1 * car))
    agents = measure_usage(History(street(), drives(rows)), []).agents
    assert [agent.cluster for agent in agents] == [0, 1] * 4


def test_what_can_not_be_counted() -> None:
    history = History(street(), drives([(0, 0, True, 0, 9)]))
    with pytest.raises(OptionError, match="no part of time"):
        measure_usage(history, ["minute"])
    with pytest.raises(OptionError, match="no month"):
        measure_usage(history, ["month"])
    with pytest.raises(OptionError, match="no dates"):
        measure_usage(history, ["hour"], "UTC")
    dated = History(street(), drives([(0, 0, True, MONDAY, MONDAY + 9)]))
    with pytest.raises(OptionError, match="no time zone"):
        measure_usage(dated, ["hour"], "Mars/Olympus")
    shape = gpszip.Track("plan", [0, 50, 100], [[0, 0], [50, 0], [100, 0]], timed=False)
    with pytest.raises(OptionError, match="no track has times"):
        gpszip.usage(shape)
    assert gpszip.usage(shape, by=[])["traversals"].sum() >= 1


def test_calendar_of_a_day() -> None:
    utc = Calendar(UTC, "UTC", "default")
    assert utc.at(8.0, MONDAY + 9 * 3600) == MONDAY + 8 * 3600
    assert utc.at(10.0, MONDAY + 9 * 3600) == MONDAY - 14 * 3600
