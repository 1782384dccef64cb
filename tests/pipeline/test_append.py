"""Logs are appended to archives."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import BoundError, InputError, OptionError
from gpszip.model import GridWalk, Options, Track
from gpszip.pipeline.append import _continue_walk, append
from gpszip.pipeline.compress import compress
from gpszip.testing import patrol

RMSE = 0.3


@pytest.fixture(scope="module")
def day():
    """Every 16th sample of a patrol: 3000 samples."""
    track = patrol(48000, seed=4)
    return Track(
        "robot", track.times[::16], track.positions[::16], attributes={"battery": np.arange(3000)}
    )


def slice_track(track, first, last, name=None):
    """Samples of a track from ``first`` to before ``last``, with their columns."""
    columns = {key: values[first:last] for key, values in track.attributes.items()}
    return Track(
        name or track.id, track.times[first:last], track.positions[first:last], attributes=columns
    )


def rmse(archive, track):
    errors = archive.position(track.id, track.times, metres=True) - track.positions
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def morning(day):
    return compress([slice_track(day, 0, 1500)], Options(rmse=RMSE, effort=2))[0]


def test_an_appended_track_continues_where_it_ended(day, morning):
    longer, report = append(morning, slice_track(day, 1500, 3000), Options(effort=2))
    longer = gpszip.open(longer.to_bytes())
    assert longer.ids == ("robot",)
    assert rmse(longer, slice_track(day, 0, 1500)) <= RMSE
    assert rmse(longer, slice_track(day, 1500, 3000)) <= RMSE
    assert (report.points, report.bytes_out) == (1500, len(longer.to_bytes()))
    assert not longer.walk("robot").gaps.any()
    # The old knots are the same.
    old, new = morning.walk("robot"), longer.walk("robot")
    np.testing.assert_array_equal(new.times[: len(old.times)], old.times)
    np.testing.assert_allclose(
        longer.road_map.nodes[new.nodes[: len(old.nodes)]], morning.road_map.nodes[old.nodes]
    )


def test_tracks_that_end_far_from_their_samples_are_continued_within_the_bound():
    """The last knot of a short track is 1.5 m off, on time steps of several seconds."""
    tracks = [patrol(4000, seed=5, id="one"), patrol(2000, seed=5, id="two")]
    middle = float(np.median(np.concatenate([track.times for track in tracks])))
    early = [slice_track(track, 0, int((track.times < middle).sum())) for track in tracks]
    late = [slice_track(track, int((track.times < middle).sum()), len(track)) for track in tracks]
    archive, _ = compress(early, Options(rmse=0.4, effort=3))
    longer, report = append(archive, late, Options(effort=3))
    assert longer.grid.time < archive.grid.time
    assert report.rmse <= 0.4
    squares = sum(rmse(longer, track) ** 2 * len(track) for track in late)
    assert np.sqrt(squares / sum(map(len, late))) <= 0.4


def test_the_start_of_a_continued_walk_can_be_kept():
    before = GridWalk(np.array([0, 1], np.int32), np.array([0, 10]), np.zeros(1, bool))
    after = GridWalk(np.array([2, 3], np.int32), np.array([10, 30]), np.zeros(1, bool))
    joined = _continue_walk("a", before, after, 100.0, keep_start=False)
    assert (joined.nodes.tolist(), joined.time_steps.tolist()) == ([0, 1, 3], [0, 10, 30])
    joined = _continue_walk("a", before, after, 100.0, keep_start=True)
    assert (joined.nodes.tolist(), joined.time_steps.tolist()) == ([0, 1, 2, 3], [0, 10, 11, 30])

    # Without a free time step between, the start can't be kept.
    short = GridWalk(after.nodes, np.array([10, 11]), after.gaps)
    joined = _continue_walk("a", before, short, 100.0, keep_start=True)
    assert (joined.nodes.tolist(), joined.time_steps.tolist()) == ([0, 1, 3], [0, 10, 11])


def test_appending_is_not_much_larger_than_compressing_at_once(day):
    archive = compress([slice_track(day, 0, 600)], Options(rmse=RMSE, effort=1))[0]
    for first in (600, 1200):
        archive, _ = append(archive, slice_track(day, first, first + 600), Options(effort=1))
    at_once = compress([slice_track(day, 0, 1800)], Options(rmse=RMSE, effort=1))[0]
    assert len(archive.to_bytes()) < 1.2 * len(at_once.to_bytes())


def test_a_long_interval_before_appended_samples_is_a_gap(day, morning):
    later = Track("robot", day.times[1500:2000] + 7200.0, day.positions[1500:2000])
    longer, _ = append(morning, later, Options(effort=1, gap=600.0))
    assert longer.walk("robot").gaps.sum() == 1
    assert np.isnan(longer.position("robot", later.times[0] - 3600.0)).all()
    assert rmse(longer, later) <= RMSE


def test_tracks_of_new_names_are_added(day, morning):
    other = slice_track(day, 1500, 2200, "other")
    longer, _ = append(morning, [other, slice_track(day, 1500, 2000)], Options(effort=1))
    assert longer.ids == ("robot", "other")
    # The bound holds for both together.
    assert (
        rmse(longer, other) ** 2 * 700 + rmse(longer, slice_track(day, 1500, 2000)) ** 2 * 500
    ) / 1200 <= RMSE**2


def test_overlapping_times_are_refused(day, morning):
    with pytest.raises(OptionError, match="'robot' overlaps in time"):
        append(morning, slice_track(day, 1400, 2000))
    with pytest.raises(OptionError, match="'robot' overlaps in time"):
        append(morning, Track("robot", day.times[:500] - 1e4, day.positions[:500]))


def test_appending_keeps_a_maximum_error(day):
    archive = compress([slice_track(day, 0, 1000)], Options(max_error=1.0, effort=1))[0]
    longer, _ = append(archive, slice_track(day, 1000, 1600), Options(effort=1))
    for track in (slice_track(day, 0, 1000), slice_track(day, 1000, 1600)):
        assert (
            np.linalg.norm(longer.position("robot", track.times) - track.positions, axis=1).max()
            <= 1.0
        )
    assert longer.error_bound.maximum
    assert longer.error_bound.metres == 1.0
    weaker, _ = append(archive, slice_track(day, 1000, 1600), Options(rmse=RMSE, effort=1))
    assert (weaker.error_bound.maximum, weaker.error_bound.metres) == (False, 1.0)
    assert weaker.error_bound.max_error is None


def test_a_maximum_and_both_bounds_make_both_bounds(day):
    archive, _ = compress([slice_track(day, 0, 500)], Options(rmse=0.5, max_error=2.0, effort=1))
    longer, _ = append(
        archive, slice_track(day, 600, 900, "other"), Options(max_error=1.0, effort=1)
    )
    bound = longer.error_bound
    assert (bound.maximum, bound.metres, bound.max_error) == (False, 1.0, 2.0)


def test_kept_columns_are_appended(day):
    archive = compress(
        [slice_track(day, 0, 1000)], Options(rmse=RMSE, keep=("battery",), effort=1)
    )[0]
    longer, _ = append(
        archive,
        [slice_track(day, 1000, 1500), slice_track(day, 1000, 1300, "b")],
        Options(effort=1),
    )
    robot, b = gpszip.open(longer.to_bytes()).samples()
    np.testing.assert_array_equal(robot.times, day.times[:1500])
    np.testing.assert_array_equal(robot.attributes["battery"], np.arange(1500))
    np.testing.assert_array_equal(b.attributes["battery"], np.arange(1000, 1300))
    bare = Track("robot", day.times[1000:1500], day.positions[1000:1500])
    with pytest.raises(OptionError, match="no column 'battery' to keep"):
        append(archive, bare)
    with pytest.raises(OptionError, match="keeps no columns"):
        append(
            compress([bare], Options(rmse=RMSE, effort=1))[0],
            slice_track(day, 1500, 1600),
            Options(keep=("battery",)),
        )


def test_a_size_is_refused(day, morning):
    with pytest.raises(OptionError, match="give rmse or max_error"):
        append(morning, slice_track(day, 1500, 1600), Options(size=100))


def test_a_far_finer_bound_is_refused(day, morning):
    with pytest.raises(BoundError, match="too coarse"):
        append(morning, slice_track(day, 1500, 1560), Options(rmse=1e-4, effort=1))


def test_no_tracks_are_refused(morning):
    with pytest.raises(InputError, match="no tracks"):
        append(morning, [])


def test_a_log_that_begins_within_the_last_time_step_is_appended():
    # The first walk ends at a full time step, at or after its last sample.
    track = patrol(32000, seed=8)
    times, positions = track.times[::16], track.positions[::16]
    halves = [
        Track("0", times[:1000], positions[:1000]),
        Track("0", times[1000:], positions[1000:]),
    ]
    for shift in (0.0, 0.3, 0.7):
        first = Track("0", halves[0].times + shift, halves[0].positions)
        archive, _ = append(
            compress(first, Options(rmse=RMSE, effort=1))[0], halves[1], Options(effort=1)
        )
        assert archive.walk("0").times[0] <= first.times[0]
        assert rmse(archive, halves[1]) <= RMSE


@pytest.mark.parametrize(("count", "every"), [(1, 1), (1, 4), (3, 16), (10, 1)])
def test_a_few_samples_continue_a_walk_whose_last_knot_lies_after_them(count, every):
    """The last knot lies up to a time step after the last sample, the new ones before it."""
    track = patrol(1200 * every, seed=8)
    track = Track("robot", track.times[::every], track.positions[::every])
    archive, _ = compress([slice_track(track, 0, 900)], Options(rmse=RMSE, effort=1))
    later = slice_track(track, 900, 900 + count)
    longer, report = append(archive, later, Options(effort=1))
    assert report.rmse <= RMSE
    assert rmse(longer, later) <= RMSE
    assert longer.walk("robot").time_ranges[-1, 1] >= later.times[-1] - 1e-3
    assert not longer.walk("robot").gaps.any()


def test_batches_of_a_patrol_are_appended_one_after_the_other(day):
    """Where the last knot lies on a time step, its rounded time may be just before it."""
    archive, _ = compress([slice_track(day, 0, 300)], Options(rmse=RMSE, effort=1))
    for first in range(300, 900, 75):
        archive, _ = append(archive, slice_track(day, first, first + 75), Options(effort=1))
    assert archive.ids == ("robot",)
    assert not archive.walk("robot").gaps.any()
    assert rmse(archive, slice_track(day, 0, 900)) <= RMSE
