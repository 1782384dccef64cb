"""Archives whose walks lie on the map of another archive."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import CorruptArchiveError, MapError, OptionError
from gpszip.geo.planes import choose_plane, to_geographic, to_plane
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.testing import drives

BOUND = 8.0


def buses(count, seed):
    return [
        Track(name, times, positions)
        for name, (times, positions) in drives(
            vehicles=count, duration=300.0, period=5.0, seed=seed
        ).items()
    ]


@pytest.fixture(scope="module")
def fleet():
    """24 buses for 5 minutes, a sample every 5 s, in the streets of one town."""
    return buses(24, seed=5)


@pytest.fixture(scope="module")
def city(fleet):
    return gpszip.compress(fleet[:16], rmse=BOUND, effort=1)


@pytest.fixture(scope="module")
def later(fleet, city):
    return gpszip.compress(fleet[16:], rmse=BOUND, map=city, effort=1)


def distances(archive, tracks):
    """Distances of all samples to the archive's positions."""
    by_track = [
        np.linalg.norm(
            archive.position(track.id, track.times, metres=True) - track.positions, axis=1
        )
        for track in tracks
    ]
    return np.concatenate(by_track)


def test_a_map_makes_later_archives_smaller_and_the_bound_holds(fleet, city, later):
    reopened = gpszip.open(later.to_bytes(), map=city)
    assert reopened.ids == tuple(track.id for track in fleet[16:])
    assert np.sqrt((distances(reopened, fleet[16:]) ** 2).mean()) <= BOUND
    assert len(later.to_bytes()) < 0.9 * len(
        gpszip.compress(fleet[16:], rmse=BOUND, effort=1).to_bytes()
    )
    assert reopened.grid == city.grid
    assert reopened.error_bound.metres == BOUND


def test_a_missing_or_wrong_map_is_refused(tmp_path, fleet, city, later):
    data = later.to_bytes()
    with pytest.raises(MapError, match=f"lies on the map {city.hash.hex()}, kept elsewhere"):
        gpszip.open(data).decompress()
    other = gpszip.compress(fleet[:3], rmse=BOUND, effort=1)
    with pytest.raises(
        MapError, match=f"{city.hash.hex()}, and another one, {other.hash.hex()}, was given"
    ):
        gpszip.open(data, map=other)
    with pytest.raises(MapError, match="lies on another map itself"):
        gpszip.open(data, map=later)


def test_the_map_is_found_in_the_same_folder(tmp_path, city, later):
    later.save(tmp_path / "later.gpsz")
    (tmp_path / "broken.gpsz").write_bytes(b"\xa7Z\x02")
    with pytest.raises(MapError):
        gpszip.open(tmp_path / "later.gpsz").decompress()
    city.save(tmp_path / "the city.gpsz")
    tracks = gpszip.open(tmp_path / "later.gpsz").decompress()
    assert [track.id for track in tracks] == [track.id for track in later.decompress()]


def test_neither_names_nor_kept_columns_change_the_hash_of_a_map(fleet, city):
    renamed = [
        Track(f"x{i}", track.times, track.positions, attributes={"speed": track.times})
        for i, track in enumerate(fleet[:16])
    ]
    assert gpszip.compress(renamed, rmse=BOUND, effort=1, keep="speed").hash == city.hash
    assert gpszip.compress(fleet[:16], rmse=2 * BOUND, effort=1).hash != city.hash


def test_paths_off_the_map_are_reported(fleet, city):
    away = Track("away", fleet[16].times, fleet[16].positions + 20_000.0)
    archive, report = compress([away], Options(rmse=BOUND, effort=1), map=city)
    (line,) = archive.off_map_lines
    # Five minutes at 9 m/s.
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(2700, rel=0.1)
    assert any("1 path lies off the map" in note for note in report.notes)
    # A log from which the map was learned hardly leaves it.
    known = gpszip.compress(fleet[0], rmse=BOUND, map=city, effort=1)
    assert sum(len(line) for line in known.off_map_lines) < 0.3 * len(known.walks[0].nodes)


@pytest.mark.parametrize("bound", [{"rmse": 1.0}, {"max_error": 3.0}])
def test_a_finer_bound_than_that_of_the_map_holds(fleet, city, bound):
    archive = gpszip.compress(fleet[16:18], map=city, effort=1, **bound)
    errors = distances(gpszip.open(archive.to_bytes(), map=city), fleet[16:18])
    assert (np.sqrt((errors**2).mean()) <= 1.0) if "rmse" in bound else (errors.max() <= 3.0)


def test_a_bound_far_below_the_grid_of_the_map_gives_an_archive_without_it(fleet, city):
    track = Track("bus", fleet[16].times[:40], fleet[16].positions[:40])
    archive, report = compress(track, Options(rmse=0.002, effort=1), map=city)
    assert archive.contents.map is None
    assert any("too coarse" in note for note in report.notes)
    errors = distances(gpszip.open(archive.to_bytes()), [track])
    assert np.sqrt((errors**2).mean()) <= 0.002


def test_degrees_are_moved_to_the_plane_of_the_map():
    t = np.arange(200.0)
    lat, lon = 52.5 + 2e-4 * np.abs(t % 80 - 40), 13.4 + 1e-4 * t
    plane_a = choose_plane(lat[:100], lon[:100])
    plane_b = choose_plane(lat[100:] + 0.3, lon[100:])
    first = Track("a", t[:100], to_plane(lat[:100], lon[:100], plane_a), plane=plane_a)
    second = Track("b", t[100:], to_plane(lat[100:], lon[100:], plane_b), plane=plane_b)
    assert plane_a != plane_b
    city = gpszip.compress(first, rmse=2.0, effort=1)
    later = gpszip.compress(second, rmse=2.0, effort=1, map=city)
    archive = gpszip.open(later.to_bytes(), map=city)
    degrees = archive.position("b", second.times)
    errors = to_plane(degrees[:, 0], degrees[:, 1], plane_b) - second.positions
    assert np.sqrt((errors**2).sum(axis=1).mean()) <= 2.01
    far = Track("c", t[:100], first.positions, plane=choose_plane([0.0], [0.0]))
    with pytest.raises(OptionError, match="400 km"):
        gpszip.compress(far, rmse=2.0, map=city)
    assert to_geographic(first.positions, plane_a)[0][0] == pytest.approx(lat[0])


@pytest.mark.parametrize("change", [{"k": 5}, {"times": False}, {"layer": "bz2"}], ids=str)
def test_options_that_contradict_a_map_are_refused(fleet, city, change):
    with pytest.raises(OptionError, match=r"known map .* doesn't go with"):
        gpszip.compress(fleet[16], rmse=None if "k" in change else BOUND, map=city, **change)


def test_unsuitable_maps_are_refused(fleet, city, later):
    with pytest.raises(OptionError, match="3 coordinates"):
        gpszip.compress(Track("a", range(5), np.zeros((5, 3))), rmse=1.0, map=city)
    with pytest.raises(OptionError, match="lies on another map itself"):
        gpszip.compress(fleet[16], rmse=BOUND, map=later)
    with pytest.raises(OptionError, match="without times"):
        gpszip.compress(
            fleet[16], rmse=BOUND, map=gpszip.compress(fleet[0], rmse=BOUND, times=False, effort=1)
        )


def test_a_damaged_archive_on_a_map_is_corrupt(city, later):
    data = bytearray(later.to_bytes())
    data[len(data) // 2] ^= 4
    with pytest.raises(CorruptArchiveError):
        gpszip.open(bytes(data), map=city)


def test_a_track_named_as_that_of_the_map_costs_no_name(fleet):
    first = Track("a rather long name", fleet[0].times, fleet[0].positions)
    again = Track("a rather long name", fleet[0].times + 1e4, fleet[0].positions + 1.0)
    city = gpszip.compress(first, rmse=BOUND, effort=1)
    archive = gpszip.compress(again, rmse=BOUND, map=city, effort=1)
    assert b"rather" not in archive.to_bytes()
    assert archive.contents.ids is None
    assert gpszip.open(archive.to_bytes(), map=city).ids == ("a rather long name",)


def test_columns_are_kept_with_walks_on_a_map(fleet, city):
    track = Track(
        "a",
        fleet[16].times,
        fleet[16].positions,
        attributes={"speed": np.arange(float(len(fleet[16])))},
    )
    archive = gpszip.open(
        gpszip.compress(track, rmse=BOUND, map=city, keep="speed", effort=1).to_bytes(), map=city
    )
    (samples,) = archive.samples()
    np.testing.assert_array_equal(samples.attributes["speed"], track.attributes["speed"])
    np.testing.assert_array_equal(samples.times, track.times)
