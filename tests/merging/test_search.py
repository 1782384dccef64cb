"""Merges of archives by their bytes; curves are sampled densely, without the code under test."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gpszip.archive import new_archive, open_archive, with_error_bound
from gpszip.errors import BoundError, OptionError
from gpszip.geo.common_plane import to_common_plane
from gpszip.geo.planes import choose_plane, to_geographic, to_plane
from gpszip.model import GridWalk, GridWalks, Options, Plane, QuantisationGrid, Track
from gpszip.model.error_bound import rounded_bound
from gpszip.model.merge_options import MergeOptions
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.run import Serial, Threads
from gpszip.testing.city import drives


def town(vehicles=6, seed=3, start=0.0):
    logs = drives(
        6,
        vehicles=vehicles,
        period=15.0,
        duration=450.0,
        seed=seed,
        noise=4.0,
        block=120.0,
        speed=9.0,
    )
    pairs = logs.values() if isinstance(logs, dict) else logs
    return [
        Track(f"bus {i}", start + np.asarray(times), np.asarray(positions))
        for i, (times, positions) in enumerate(pairs)
    ]


@pytest.fixture(scope="module")
def logs():
    return town()


@pytest.fixture(scope="module")
def fleets(logs):
    return [compress(logs[i : i + 2], Options(rmse=5.0, effort=3))[0] for i in (0, 2, 4)]


@pytest.fixture(scope="module")
def two_merged(fleets, little_work):
    """The first two fleets in one archive, and the report."""
    return merge(fleets[:2])


@pytest.fixture(scope="module")
def two_and_one_merged(fleets, two_merged):
    """The third fleet merged into the archive of the first two, and the report."""
    return merge([two_merged[0], fleets[2]])


@pytest.fixture(scope="module")
def all_merged(fleets, little_work):
    """All fleets in one archive, and the report."""
    return merge(fleets, executor=Threads(2))


def farthest(before, after, names=None):
    """Largest distance between the curves of two archives, at many times and all knots."""
    largest = 0.0
    for number, name in enumerate(before.ids):
        walk, new = before.walk(name), after.walk(name if names is None else names[number])
        cuts = [0, *(np.flatnonzero(walk.gaps) + 1), len(walk.nodes)]
        for first, end in pairwise(cuts):
            low, high = walk.times[first], walk.times[end - 1]
            if walk.time_ranges is not None:
                low, high = np.clip(
                    walk.time_ranges[np.searchsorted(walk.time_ranges[:, 1], low)], low, high
                )
            when = np.union1d(
                np.linspace(low, high, 2000), np.concatenate([walk.times[first:end], new.times])
            )
            when = when[(when >= low) & (when <= high)]
            expected = before.position(name, when)
            actual = after.position(new.id, when)
            assert not np.isnan(actual).any()
            if before.grid.plane is not None:
                plane = before.grid.plane
                expected, actual = to_plane(*expected.T, plane), to_plane(*actual.T, plane)
            largest = max(largest, float(np.linalg.norm(actual - expected, axis=1).max()))
    return largest


def rmse(archive, tracks):
    squares = [
        ((archive.position(track.id, track.times, metres=True) - track.positions) ** 2).sum(axis=1)
        for track in tracks
    ]
    return math.sqrt(np.concatenate(squares).mean())


def test_two_archives_become_a_smaller_one_with_all_tracks(logs, fleets, two_merged):
    made, report = two_merged
    assert made.ids == ("bus 0", "bus 1", "bus 2", "bus 3")
    assert (
        len(made.to_bytes())
        == report.bytes_out
        < report.bytes_in
        == sum(len(one.to_bytes()) for one in fleets[:2])
    )
    assert max(len(one.road_map.nodes) for one in fleets[:2]) < report.nodes_in
    assert report.nodes < report.nodes_in
    for archive, moved in zip(fleets, report.deviations, strict=False):
        assert moved.rms <= 5.0 == report.limit
        assert farthest(archive, made) <= moved.maximum * (1 + 1e-9)
    assert made.error_bound.metres <= 10.0
    assert rmse(made, logs[:4]) <= made.error_bound.metres


@pytest.mark.parametrize("limit", [2.5, 6.0])
def test_no_curve_is_moved_farther_than_allowed(fleets, limit):
    made, report = merge(fleets, MergeOptions(max_deviation=limit))
    assert max(farthest(archive, made) for archive in fleets) <= limit * (1 + 1e-9)
    assert report.deviation.maximum <= limit


def test_the_error_bound_grows_by_the_limit_on_a_maximum(logs):
    fleets = [compress(logs[i : i + 2], Options(max_error=12.0, effort=1))[0] for i in (0, 2)]
    made, report = merge(fleets)
    assert report.limits_maximum
    assert made.error_bound.maximum
    assert made.error_bound.metres <= 24.1
    largest = max(
        np.linalg.norm(made.position(t.id, t.times, metres=True) - t.positions, axis=1).max()
        for t in logs[:4]
    )
    assert largest <= made.error_bound.metres
    assert max(farthest(archive, made) for archive in fleets) <= 12.0


def test_a_maximum_and_a_mean_give_a_mean_as_error_bound(logs, fleets):
    other, _ = compress(logs[2:4], Options(max_error=12.0, effort=1))
    made, report = merge([fleets[0], other])
    assert report.limits_maximum
    assert report.limit == 5.0
    assert not made.error_bound.maximum
    assert rmse(made, logs[:4]) <= made.error_bound.metres <= 17.1


def frequent_fleets():
    """Three archives of two vehicles each, with a sample every second."""
    logs = drives(
        6, vehicles=6, period=1.0, duration=200.0, seed=5, noise=4.0, block=120.0, speed=9.0
    )
    pairs = logs.values() if isinstance(logs, dict) else logs
    tracks = [
        Track(f"bus {i}", np.asarray(times), np.asarray(positions))
        for i, (times, positions) in enumerate(pairs)
    ]
    return [compress(tracks[i::3], Options(rmse=8.0, effort=1))[0] for i in range(3)]


def test_the_order_of_merging_hardly_changes_the_size(fleets, full_work):
    one, two, three = fleets
    sizes = [len(merge(group)[0].to_bytes()) for group in ((merge([one, two])[0], three), fleets)]
    assert max(sizes) <= 1.05 * min(sizes)


def test_the_order_hardly_changes_the_size_of_frequent_samples():
    one, two, three = archives = frequent_fleets()
    option = MergeOptions(deviation=8.0)
    left, right = (merge(pair, option)[0] for pair in ((one, two), (two, three)))
    sizes = [
        len(merge(group, option)[0].to_bytes()) for group in ((left, three), (one, right), archives)
    ]
    assert max(sizes) <= 1.05 * min(sizes)


def test_archives_keep_the_error_bound_before_any_merge(two_merged, two_and_one_merged):
    both, _ = two_merged
    made, report = two_and_one_merged
    assert both.error_bound.before == made.error_bound.before == report.limit == 5.0
    assert (
        both.error_bound.metres < made.error_bound.metres <= 1.05 * (both.error_bound.metres + 5.0)
    )
    moved, fresh = report.deviations
    assert moved.rms <= 0.76 * 5.0 < 5.0 >= fresh.rms


def test_the_executor_does_not_change_the_bytes(fleets, all_merged):
    assert merge(fleets, executor=Serial())[0].to_bytes() == all_merged[0].to_bytes()


def test_gaps_stay_gaps():
    walk = GridWalk(
        np.array([0, 1, 1, 0], np.int32), np.array([0, 30, 34, 60]), np.array([False, True, False])
    )
    grids = [QuantisationGrid((0, 0), 0, 128, 128), QuantisationGrid((300, 700), 350, 128, 131)]
    parts = [
        new_archive(grid, [name], GridWalks(np.array([[0, 0], [90, 0]]), (walk,)))
        for grid, name in zip(grids, "ab", strict=True)
    ]
    made, report = merge(parts, MergeOptions(deviation=3.0))
    assert [int(one.gaps.sum()) for one in made.walks] == [1, 1]
    assert report.deviation.rms <= 3.0
    assert np.isnan(made.position("a", 32.0)).all()


def test_archives_on_different_grids_are_merged(logs):
    shifted = [
        Track(f"far {track.id}", track.times + 0.37, track.positions + np.array([0.21, -0.4]))
        for track in logs[2:4]
    ]
    parts = [
        compress(logs[:2], Options(rmse=5.0, effort=1))[0],
        compress(shifted, Options(rmse=2.0, effort=1))[0],
    ]
    assert parts[0].grid.space != parts[1].grid.space
    made, report = merge(parts)
    assert report.limit == 2.0
    assert all(moved.rms <= 2.0 for moved in report.deviations)
    assert rmse(made, shifted) <= 4.0


def on_earth(track, lat, lon, plane=None):
    scale = np.array([111_320.0, 111_320.0 * math.cos(math.radians(lat))])
    degrees = np.array([lat, lon]) + track.positions[:, ::-1] / scale
    plane = choose_plane(*degrees.T) if plane is None else plane
    return replace(track, positions=to_plane(*degrees.T, plane), plane=plane)


@pytest.mark.parametrize(("lat", "lon"), [(48.3, 11.9), (48.0, 14.0), (-33.9, 151.2)])
def test_archives_on_different_planes_share_one_or_keep_both(logs, lat, lon):
    near = on_earth(logs[0], 48.0, 11.0)
    far = on_earth(logs[1], lat, lon)
    parts = [compress([track], Options(rmse=5.0, effort=1))[0] for track in (near, far)]
    assert parts[0].grid.plane != parts[1].grid.plane
    made, report = merge(parts)
    assert len(made.grid.plane.centers) == (2 if lat < 0 else 1)
    for archive, moved in zip(parts, report.deviations, strict=True):
        assert farthest(archive, made) <= moved.maximum * 1.003 + 0.1
    degrees = made.position(far.id, far.times)
    offsets = to_plane(*degrees.T, far.plane) - far.positions
    assert math.sqrt((offsets**2).sum(axis=1).mean()) <= made.error_bound.metres <= 1.05 * 10.1


def test_pieces_stay_on_one_plane_and_positions_on_it_do_not_change():
    near, far = Plane(((480_000_000, 110_000_000),)), Plane(((480_000_000, 150_000_000),))
    one = np.array([[0.0, 0.0], [10.0, 5.0], [7.0, 7.0]])
    two = np.array([[-290_000.0, 0.0], [0.0, 0.0], [250_000.0, 3.0], [250_010.0, 3.0]])
    starts = [np.array([0]), np.array([0, 2])]
    plane, (first, second), moved = to_common_plane([near, far], [one, two], starts)
    # The plane of the largest log comes first.
    assert plane.centers[0] == far.centers[0]
    np.testing.assert_array_equal(second, two)
    assert moved[0].all()
    assert not moved[1].any()
    np.testing.assert_allclose(
        np.stack(to_geographic(first, plane)), np.stack(to_geographic(one, near)), atol=1e-9
    )


def test_kept_columns_are_merged(logs):
    def with_speed(track, **columns):
        return replace(track, attributes={"speed": np.arange(len(track)) / 4, **columns})

    first = [with_speed(logs[0]), with_speed(logs[1])]
    second = [with_speed(logs[2], note=np.array(["x"] * len(logs[2]), dtype=object))]
    parts = [
        compress(first, Options(rmse=5.0, effort=1, keep=("speed",)))[0],
        compress(second, Options(rmse=5.0, effort=1, keep=("speed", "note")))[0],
    ]
    made, report = merge(parts)
    for track in (*first, *second):
        np.testing.assert_array_equal(made.sample_times(track.id), track.times)
        np.testing.assert_array_equal(made.attributes(track.id)["speed"], track.attributes["speed"])
    assert set(made.attributes(logs[2].id)["note"]) == {"x"}
    assert set(made.attributes(logs[0].id)["note"]) == {""}
    assert any("note" in note for note in report.notes)
    assert len(made.samples()) == 3
    mixed, _ = merge([parts[0], hand_made(("bare",))], MergeOptions(deviation=5.0))
    assert len(mixed.samples(logs[0].id)) == 1
    assert len(mixed.sample_times("bare")) == 0


def test_tracks_of_one_name_are_refused_renamed_or_joined():
    morning, evening = town(1)[0], town(1, seed=4, start=40_000.0)[0]
    parts = [
        compress([replace(track, id="bus")], Options(rmse=5.0, effort=1))[0]
        for track in (morning, evening)
    ]
    with pytest.raises(OptionError, match="track 'bus' is in am and in pm"):
        merge(parts, names=["am", "pm"])
    apart, _ = merge(parts, MergeOptions(same_id="prefix"), names=["am", "pm"])
    assert apart.ids == ("am:bus", "pm:bus")
    joined, report = merge(parts[::-1], MergeOptions(same_id="join"), names=["pm", "am"])
    assert joined.ids == ("bus",)
    assert int(joined.walks[0].gaps.sum()) == 1
    assert np.isnan(joined.position("bus", 20_000.0)).all()
    for archive in parts:
        assert farthest(archive, joined) <= report.deviation.maximum * (1 + 1e-9)
    late = compress(
        [replace(evening, id="bus", times=evening.times - 39_800.0)], Options(rmse=5.0, effort=1)
    )[0]
    with pytest.raises(OptionError, match="one agent can't be at two places"):
        merge([parts[0], late], MergeOptions(same_id="join"))


def test_halves_of_one_track_are_joined_where_they_touch(logs):
    track, half = logs[0], len(logs[0]) // 2
    parts = [
        compress(
            [Track("bus", track.times[rows], track.positions[rows])], Options(rmse=5.0, effort=1)
        )[0]
        for rows in (slice(0, half), slice(half, None))
    ]
    joined, _ = merge(parts, MergeOptions(same_id="join"))
    assert rmse(joined, [replace(track, id="bus")]) <= joined.error_bound.metres


def hand_made(ids=("a",), plane=None, timed=True, dimension=2):
    cells = np.array([0, 10]) if timed else np.zeros(2, np.int64)
    walk = GridWalk(np.array([0, 1], np.int32), cells, np.array([False]))
    nodes = np.array([[0] * dimension, [50] * dimension])[: 2 * len(ids)]
    return new_archive(
        QuantisationGrid((0,) * dimension, 0, 128, 128, plane),
        ids,
        GridWalks(nodes, (walk,) * len(ids), timed),
    )


def test_archives_that_cannot_be_merged_are_refused_by_name():
    plain, earth = hand_made(), hand_made(("b",), Plane(((480_000_000, 110_000_000),)))
    with pytest.raises(OptionError, match="two or more"):
        merge([plain])
    with pytest.raises(OptionError, match="A is in x and y, B in latitude and longitude"):
        merge([plain, earth], names=["A", "B"])
    with pytest.raises(OptionError, match="B has 3 coordinates, A 2"):
        merge([plain, hand_made(("b",), dimension=3)], names=["A", "B"])
    with pytest.raises(OptionError, match="B: holds no tracks"):
        merge([plain, hand_made(())], names=["A", "B"])
    with pytest.raises(OptionError, match="give one"):
        MergeOptions(deviation=1.0, max_deviation=2.0)
    with pytest.raises(OptionError, match="positive"):
        MergeOptions(max_deviation=-1.0)


def test_archives_without_an_error_bound_move_by_at_most_a_grid_step():
    made, report = merge([hand_made(("a",)), hand_made(("b",))])
    assert report.limit == 1.0
    assert made.error_bound is None
    assert "states no error bound" in " ".join(report.notes)
    assert len(made.road_map.nodes) == 2


def test_equal_archives_are_merged_without_deviation():
    parts = [
        with_error_bound(hand_made((name,)), rounded_bound(0.01, maximum=True)) for name in "ab"
    ]
    made, report = merge(parts)
    assert report.deviation.maximum == 0.0
    assert made.error_bound.metres == 0.01
    assert open_archive(made.to_bytes()).error_bound == made.error_bound


def test_a_limit_below_the_finest_grid_is_refused():
    first = hand_made(("a",))
    second = new_archive(QuantisationGrid((333, 0), 123, 1, 1), ["b"], hand_made().grid_walks)
    with pytest.raises(BoundError, match="can't be held"):
        merge([first, second], MergeOptions(max_deviation=1e-7))
