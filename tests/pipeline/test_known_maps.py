"""Archives whose walks lie on a map that is kept elsewhere."""

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
            vehicles=count, duration=600.0, period=5.0, seed=seed
        ).items()
    ]


@pytest.fixture(scope="module")
def fleet():
    """24 buses for 10 minutes, a sample every 5 s, in the streets of one town."""
    return buses(24, seed=5)


@pytest.fixture(scope="module")
def city(fleet):
    return gpszip.compress(fleet[:16], rmse=BOUND, effort=2)


@pytest.fixture(scope="module")
def later(fleet, city):
    return gpszip.compress(fleet[16:], rmse=BOUND, map=city, effort=2)


def errors(archive, tracks):
    off = [
        np.linalg.norm(
            archive.position(track.id, track.times, metres=True) - track.positions, axis=1
        )
        for track in tracks
    ]
    return np.concatenate(off)


def test_later_logs_are_smaller_on_a_map_and_keep_the_bound(fleet, city, later):
    back = gpszip.open(later.to_bytes(), map=city)
    assert back.ids == tuple(track.id for track in fleet[16:])
    assert np.sqrt((errors(back, fleet[16:]) ** 2).mean()) <= BOUND
    assert len(later.to_bytes()) < 0.9 * len(
        gpszip.compress(fleet[16:], rmse=BOUND, effort=2).to_bytes()
    )
    assert back.grid == city.grid
    assert back.error_bound.metres == BOUND


def test_the_map_is_needed_and_checked(tmp_path, fleet, city, later):
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
    found = gpszip.open(tmp_path / "later.gpsz").decompress()
    assert [track.id for track in found] == [track.id for track in later.decompress()]


def test_neither_names_nor_kept_columns_change_what_a_map_is_called(fleet, city):
    renamed = [
        Track(f"x{i}", track.times, track.positions, attributes={"speed": track.times})
        for i, track in enumerate(fleet[:16])
    ]
    assert gpszip.compress(renamed, rmse=BOUND, effort=2, keep="speed").hash == city.hash
    assert gpszip.compress(fleet[:16], rmse=2 * BOUND, effort=1).hash != city.hash


def test_paths_off_the_map_are_reported(fleet, city):
    away = Track("away", fleet[16].times, fleet[16].positions + 20_000.0)
    archive, report = compress([away], Options(rmse=BOUND, effort=1), map=city)
    (way,) = archive.off_map_lines
    # ten minutes at 9 m/s
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() == pytest.approx(5400, rel=0.1)
    assert any("1 path lies off the map" in note for note in report.notes)
    # a log that the map was made of hardly leaves it
    known = gpszip.compress(fleet[0], rmse=BOUND, map=city, effort=1)
    assert sum(len(way) for way in known.off_map_lines) < 0.3 * len(known.walks[0].nodes)


@pytest.mark.parametrize("bound", [{"rmse": 1.0}, {"max_error": 3.0}])
def test_a_finer_bound_than_the_maps_is_held(fleet, city, bound):
    archive = gpszip.compress(fleet[16:18], map=city, effort=1, **bound)
    off = errors(gpszip.open(archive.to_bytes(), map=city), fleet[16:18])
    assert (np.sqrt((off**2).mean()) <= 1.0) if "rmse" in bound else (off.max() <= 3.0)


def test_a_bound_far_below_the_maps_lattice_gives_an_archive_of_its_own(fleet, city):
    archive, report = compress(_start(fleet[16], 40), Options(rmse=0.002, effort=1), map=city)
    assert archive.contents.map is None
    assert any("too coarse" in note for note in report.notes)
    assert (
        np.sqrt((errors(gpszip.open(archive.to_bytes()), [_start(fleet[16], 40)]) ** 2).mean())
        <= 0.002
    )


def _start(track, count):
    return Track(track.id, track.times[:count], track.positions[:count])


def test_degrees_come_on_the_plane_of_the_map():
    t = np.arange(200.0)
    lat, lon = 52.5 + 2e-4 * np.abs(t % 80 - 40), 13.4 + 1e-4 * t
    here, there = choose_plane(lat[:100], lon[:100]), choose_plane(lat[100:] + 0.3, lon[100:])
    one = Track("a", t[:100], to_plane(lat[:100], lon[:100], here), plane=here)
    two = Track("b", t[100:], to_plane(lat[100:], lon[100:], there), plane=there)
    assert here != there
    city = gpszip.compress(one, rmse=2.0)
    archive = gpszip.open(gpszip.compress(two, rmse=2.0, map=city).to_bytes(), map=city)
    found = archive.position("b", two.times)
    off = to_plane(found[:, 0], found[:, 1], there) - two.positions
    assert np.sqrt((off**2).sum(axis=1).mean()) <= 2.01
    far = Track("c", t[:100], one.positions, plane=choose_plane([0.0], [0.0]))
    with pytest.raises(OptionError, match="400 km"):
        gpszip.compress(far, rmse=2.0, map=city)
    assert to_geographic(one.positions, here)[0][0] == pytest.approx(lat[0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"k": 5}, "don't go with a map"),
        ({"times": False}, "don't go with a map"),
        ({"layer": "bz2"}, "don't go with a map"),
    ],
)
def test_options_that_no_map_goes_with(fleet, city, change, says):
    with pytest.raises(OptionError, match=says):
        gpszip.compress(fleet[16], rmse=None if "k" in change else BOUND, map=city, **change)


def test_maps_of_other_places_and_kinds_are_refused(fleet, city, later):
    with pytest.raises(OptionError, match="3 coordinates"):
        gpszip.compress(Track("a", range(5), np.zeros((5, 3))), rmse=1.0, map=city)
    with pytest.raises(OptionError, match="lies on another map itself"):
        gpszip.compress(fleet[16], rmse=BOUND, map=later)
    with pytest.raises(OptionError, match="without times"):
        gpszip.compress(
            fleet[16], rmse=BOUND, map=gpszip.compress(fleet[0], rmse=BOUND, times=False, effort=1)
        )


def test_a_torn_archive_on_a_map_is_corrupt(city, later):
    data = bytearray(later.to_bytes())
    data[len(data) // 2] ^= 4
    with pytest.raises(CorruptArchiveError):
        gpszip.open(bytes(data), map=city)


def test_one_track_called_as_the_maps_costs_no_name(fleet):
    first = Track("a rather long name", fleet[0].times, fleet[0].positions)
    again = Track("a rather long name", fleet[0].times + 1e4, fleet[0].positions + 1.0)
    city = gpszip.compress(first, rmse=BOUND, effort=1)
    archive = gpszip.compress(again, rmse=BOUND, map=city, effort=1)
    assert b"rather" not in archive.to_bytes()
    assert archive.contents.ids is None
    assert gpszip.open(archive.to_bytes(), map=city).ids == ("a rather long name",)


def test_kept_columns_lie_beside_walks_on_a_map(fleet, city):
    track = Track(
        "a",
        fleet[16].times,
        fleet[16].positions,
        attributes={"speed": np.arange(float(len(fleet[16])))},
    )
    archive = gpszip.open(
        gpszip.compress(track, rmse=BOUND, map=city, keep="speed", effort=1).to_bytes(), map=city
    )
    (back,) = archive.samples()
    np.testing.assert_array_equal(back.attributes["speed"], track.attributes["speed"])
    np.testing.assert_array_equal(back.times, track.times)
