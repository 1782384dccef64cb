"""Archives that grow batch by batch."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.live.stream.compressor import StreamCompressor
from gpszip.live.stream.rows import StreamRows
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.testing import patrol

RMSE, MAXIMUM = 0.3, 1.2
OPTIONS = Options(rmse=RMSE, max_error=MAXIMUM, effort=1)


@pytest.fixture(scope="module")
def day():
    """Every 16th sample of a patrol: 1600 samples."""
    track = patrol(25_600, seed=4)
    return track.times[::16], track.positions[::16]


def rows(times, positions, name="0", *, geographic=False):
    return StreamRows({name: (times, positions)}, geographic)


def in_batches(compressor, day, size, first=0, last=None):
    times, positions = day
    for start in range(first, len(times) if last is None else last, size):
        stop = min(start + size, len(times) if last is None else last)
        compressor.add(rows(times[start:stop], positions[start:stop]))
    return compressor


def errors(archive, times, positions, name="0"):
    return np.linalg.norm(archive.position(name, times, metres=True) - positions, axis=1)


@pytest.fixture(scope="module")
def streamed(day):
    return in_batches(StreamCompressor(OPTIONS, first_samples=400), day, 150)


def test_the_bound_holds_over_all_batches(streamed, day):
    archive = gpszip.open(streamed.archive.to_bytes())
    found = errors(archive, *day)
    assert np.sqrt(np.mean(found**2)) <= RMSE
    assert found.max() <= MAXIMUM
    np.testing.assert_allclose(streamed.errors, [np.sqrt(np.mean(found**2)), found.max()])
    assert (streamed.points, streamed.counts) == (len(day[0]), {})


def test_a_track_goes_on_over_all_batches(streamed, day):
    [name] = streamed.archive.ids
    walk = streamed.archive.walk(name)
    assert not walk.gaps.any()
    # Ends are kept to a sampling interval.
    np.testing.assert_allclose(walk.time_ranges, [[day[0][0], day[0][-1]]], atol=1.24)


def test_batches_take_few_bytes_more_than_all_at_once(streamed, day):
    at_once, _ = compress(Track("0", *day), OPTIONS)
    assert streamed.archive.size < 1.4 * at_once.size


def test_samples_that_are_kept_are_bounded(day):
    compressor = StreamCompressor(OPTIONS, first_samples=300, window_samples=60)
    in_batches(compressor, day, 150, last=900)
    assert sum(map(len, compressor._window.values())) <= 60
    found = errors(compressor.archive, day[0][:900], day[1][:900])
    assert np.sqrt(np.mean(found**2)) <= RMSE
    assert compressor.archive.ids == ("0",)


def test_an_archive_is_continued_and_what_it_holds_is_no_news(day):
    first = in_batches(StreamCompressor(OPTIONS), day, 300, last=300)
    again = StreamCompressor(Options(effort=1), gpszip.open(first.archive.to_bytes()))
    in_batches(again, day, 200, first=100, last=500)
    assert again.archive.ids == ("0",)
    assert again.points == 200
    assert again.counts == {"rows that the archive holds already": 200}
    assert errors(again.archive, day[0][:500], day[1][:500]).max() <= MAXIMUM


def test_a_clock_that_goes_back_starts_a_track(day):
    times, positions = day[0][:200], day[1][:200]
    compressor = StreamCompressor(OPTIONS)
    compressor.add(rows(np.r_[times[:100], times[:50]], np.r_[positions[:100], positions[100:150]]))
    compressor.add(rows(times[50:100], positions[150:200]))
    assert compressor.archive.ids == ("0", "0-2")
    assert errors(compressor.archive, times[:100], positions[100:200], "0-2").max() <= MAXIMUM
    assert compressor.counts == {"tracks started where time goes back": 1}


def test_late_rows_are_counted_or_sorted(day):
    times, positions = day[0][:60], day[1][:60]
    order = np.r_[0:30, 31:50, 30, 50:60]
    left_out, sorted_ = StreamCompressor(OPTIONS), StreamCompressor(OPTIONS, sort=True)
    for compressor in (left_out, sorted_):
        for part in np.split(order, 3):
            compressor.add(rows(times[part], positions[part]))
    assert left_out.points == 59
    assert list(left_out.counts.values()) == [1]
    assert sorted_.points == 60
    assert sorted_.counts == {"rows put in the order of time": 1}
    assert errors(sorted_.archive, times, positions).max() <= MAXIMUM


def test_repeated_rows_are_counted(day):
    times, positions = day[0][:20], day[1][:20]
    compressor = StreamCompressor(OPTIONS)
    compressor.add(rows(np.repeat(times, 2), np.repeat(positions, 2, axis=0)))
    assert compressor.points == 20
    assert compressor.counts == {"rows at the time of the one before left out": 20}
    assert compressor.add(rows(times[-1:], positions[-1:])) is False


def test_rows_far_from_the_map_are_left_out():
    compressor = StreamCompressor(Options(max_error=50.0, effort=1))
    north = 48 + np.arange(20) * 1e-4
    degrees = np.stack([north, np.full(20, 11.0)], axis=1)
    compressor.add(rows(np.arange(20.0), degrees, geographic=True))
    degrees[::2] = 60.0, 11.0
    compressor.add(rows(np.arange(20.0, 40.0), degrees, geographic=True))
    assert compressor.points == 30
    assert list(compressor.counts.values()) == [10]


def test_outliers_are_dropped_if_that_is_asked_for():
    positions = np.stack([np.arange(60.0), np.zeros(60)], axis=1)
    positions[30] = 900.0, 900.0
    compressor = StreamCompressor(OPTIONS, clean=True)
    compressor.add(rows(np.arange(60.0), positions))
    assert (compressor.points, compressor.counts) == (59, {"outliers dropped": 1})


def test_other_coordinates_are_refused():
    compressor = StreamCompressor(OPTIONS)
    compressor.add(rows(np.arange(3.0), np.zeros((3, 2))))
    with pytest.raises(OptionError, match="other coordinates than the archive"):
        compressor.add(rows(np.arange(3.0, 6.0), np.zeros((3, 2)), geographic=True))


@pytest.mark.parametrize("far", [5e10, 1e13, 1e300])
def test_rows_that_no_map_within_the_bound_reaches_cost_no_others(far):
    times = np.arange(60.0)
    positions = np.stack([times, times % 7], axis=1)
    positions[::7, 0] = far
    compressor = StreamCompressor(OPTIONS, first_samples=20)
    in_batches(compressor, (times, positions), 20)
    assert compressor.points == 51
    assert sum(compressor.counts.values()) == 9
    assert set(compressor.counts) <= set(compressor.LOSSES)
