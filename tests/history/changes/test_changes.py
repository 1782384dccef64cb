"""Planted closures, new roads and slow roads are found; nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.history.changes.changes import find_changes
from gpszip.history.changes.choices import list_choices
from gpszip.history.changes.closures import choose_threshold, find_closures
from gpszip.history.traversals import History
from gpszip.testing import close_road, fleet, slow_road, taxis
from history_rows import drives, street, true_traversals

#: Seconds at which roads change.
CHANGE = 20_000.0


@pytest.fixture(scope="module")
def town():
    """Six vehicles on three lines for eleven hours, and a busy road between crossings."""
    log = fleet(6, lines=3, points=8000, blocks=5, seed=4)
    degree = np.bincount(log.road_map.edges.ravel())
    inner = (degree[log.road_map.edges] > 2).all(axis=1)
    busy = np.minimum(log.road_map.forward, log.road_map.backward) * inner
    return log, int(busy.argmax())


def changes_of(log, threshold=None, **kinds):
    rows = true_traversals(log)
    history = History(log.network, rows)
    return find_changes(history, rows.enter >= CHANGE, threshold=threshold, **kinds)


def test_nothing_has_changed(town) -> None:
    log, _ = town
    assert len(changes_of(log)) == 0


def test_a_closed_road_is_found_soon(town) -> None:
    log, road = town
    found = changes_of(close_road(log, road, since=CHANGE))
    closed = found.of_kind("closed")
    assert {(change.edge, change.forward) for change in closed} == {(road, True), (road, False)}
    for change in closed:
        assert CHANGE <= change.since < change.detected
        assert change.evidence >= found.threshold
        assert change.delay < 6000
    assert not found.of_kind("reopened")


def test_a_road_that_is_closed_one_way(town) -> None:
    log, road = town
    found = changes_of(close_road(log, road, since=CHANGE, forward=False))
    (change,) = found.of_kind("one-way")
    assert (change.edge, change.forward) == (road, False)
    assert not found.of_kind("closed")


def test_a_road_that_is_opened_again(town) -> None:
    log, road = town
    found = changes_of(close_road(log, road, since=CHANGE, until=CHANGE + 9000))
    assert {change.edge for change in found.of_kind("reopened")} == {road}
    assert all(change.since >= CHANGE + 9000 for change in found.of_kind("reopened"))
    assert {change.edge for change in found.of_kind("closed")} == {road}


def test_a_new_road(town) -> None:
    log, road = town
    found = changes_of(close_road(log, road, until=CHANGE)).of_kind("new")
    assert {(change.edge, change.forward) for change in found} == {(road, True), (road, False)}
    assert all(CHANGE <= change.since <= change.detected for change in found)


@pytest.mark.parametrize(("factor", "kind"), [(1.8, "slower"), (0.5, "faster")])
def test_a_slow_road(town, factor, kind) -> None:
    log, road = town
    found = changes_of(slow_road(log, road, factor, since=CHANGE))
    assert {change.edge for change in found.of_kind(kind)} == {road}
    for change in found.of_kind(kind):
        assert change.factor == pytest.approx(factor, rel=0.15)
        assert change.since >= CHANGE
    assert not found.of_kind("closed")
    assert {change.kind for change in found.changes} == {kind}


def test_jumps_of_the_receiver_make_no_road_faster() -> None:
    # Ten passes at 10 m/s a day; the next day's are all jumps, at 200 m/s.
    seconds = np.repeat([10.0, 0.5], 10)
    enter = 86_400.0 * np.repeat([0, 1], 10) + 3600.0 * np.tile(np.arange(10), 2)
    rows = drives(
        [(i, 0, True, t, t + took) for i, (t, took) in enumerate(zip(enter, seconds, strict=True))]
    )
    for max_speed, kinds in ((np.inf, {"faster"}), (40.0, set())):
        history = History(street(), replace(rows, max_speed=max_speed))
        found = find_changes(history, enter >= 86_400, threshold=5.0)
        assert {change.kind for change in found.changes} == kinds
        assert np.isnan(found.false_alarms)


def test_closures_of_all_busy_roads(town) -> None:
    # One after the other: few passages are missed, and hardly any other edge is claimed.
    log, _ = town
    rows = true_traversals(log)
    before = rows.enter < CHANGE
    passes = np.bincount(rows.directed[before], minlength=2 * len(log.network))
    after = np.bincount(rows.directed[~before], minlength=2 * len(log.network))
    missed, others = [], 0
    for directed in np.flatnonzero((passes >= 30) & (after >= 15))[:6].tolist():
        try:
            closed = close_road(log, directed // 2, since=CHANGE, forward=directed % 2 == 0)
        except OptionError:
            continue
        now = true_traversals(closed)
        found = find_closures(log.network, now, now.enter >= CHANGE, 9.2)
        mine = found.directed == directed
        others += int((~mine).sum())
        # Passages that would have been until the alarm.
        until = found.detected[mine][0] if mine.any() else np.inf
        missed.append(((rows.directed == directed) & ~before & (rows.enter <= until)).sum())
    assert len(missed) >= 4
    assert np.median(missed) <= 5
    assert np.quantile(missed, 0.9) <= 9
    assert others <= 1


def test_nights_are_no_evidence() -> None:
    # Cars come to a fork by day and take either way; then nobody comes for a week.
    rows = [(car, car % 2, True, 3600.0 * car, 3600.0 * car + 60) for car in range(40)]
    rows += [(40, 0, True, 700_000.0, 700_060.0)]
    traversals = drives(rows)
    found = find_closures(street(2), traversals, traversals.enter >= 100_000.0, 1.0)
    assert not len(found.directed)


def test_probabilities_are_those_of_counts() -> None:
    # After edge 0, cars go on to edge 1 three times and turn back once; a fifth comes.
    rows = []
    for car, way in enumerate([(1, True), (1, True), (0, False), (1, True), (0, False)]):
        time = 1000.0 * car
        rows += [(car, 0, True, time, time + 10), (car, *way, time + 10, time + 20)]
    traversals = drives(rows)
    known = traversals.track < 4
    choices = list_choices(street(2), traversals, known, ~known)
    assert choices.option.tolist() == [1, 2]
    # P_0 is 1 of 2 ways out of the node, two ways were taken: (n + 2 / 2) / (4 + 2).
    assert choices.probability.tolist() == pytest.approx([2 / 6, 4 / 6])
    assert choices.taken.tolist() == [True, False]


def test_threshold_grows_as_false_alarms_are_fewer() -> None:
    log = taxis(8, points=1000, blocks=4, seed=2)
    rows = true_traversals(log)
    before = np.ones(len(rows), bool)
    thresholds = [choose_threshold(log.network, rows, before, rate) for rate in (1e-4, 0.1, 1e4)]
    assert thresholds[0] > thresholds[1] > thresholds[2] == 7.0


def test_archives() -> None:
    # A short log of the same kind, compressed before a road is closed and after.
    base = fleet(4, lines=2, points=1500, blocks=4, seed=5)
    road, change = 8, 3800.0
    middle = base.road_map.nodes[base.road_map.edges[road]].mean(axis=0)
    old = gpszip.compress(base.tracks, rmse=6, effort=1)
    new = gpszip.compress(close_road(base, road, since=0.0).tracks, rmse=6, effort=1)
    found = gpszip.changes(old, new)
    for each in found.of_kind("closed"):
        gap = np.linalg.norm(found.network.road(each.edge) - middle, axis=1).min()
        assert gap < 120
    assert len(found.of_kind("closed")) == 2
    assert len(gpszip.changes(old, since=change)) == 0

    with pytest.raises(OptionError, match="outside of the archive's times"):
        gpszip.changes(old, since=1e6)
    with pytest.raises(OptionError, match="either a second archive or a time"):
        gpszip.changes(old)
    with pytest.raises(OptionError, match="no change"):
        gpszip.changes(old, since=change, kinds=["gone"])
    with pytest.raises(OptionError, match="positive number"):
        gpszip.changes(old, since=change, false_alarms=-1)


def test_no_times() -> None:
    shape = gpszip.Track("plan", [0, 50, 100], [[0, 0], [50, 0], [100, 0]], timed=False)
    with pytest.raises(OptionError, match="nothing is before or after"):
        gpszip.changes(shape, since=10)
