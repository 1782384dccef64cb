import json

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.view.facts import bytes_by_part
from gpszip.view.inputs import put_on_plane
from gpszip.view.scene import ShownArchive, build_scene, log_scene, map_scene
from view.unpacking import unpack, unpack_lines

START = 1_700_000_000.0


def laps(n=300, start=START):
    """Metres on a rectangle, with a detour on the last lap."""
    angle = np.arange(n) * 0.1
    positions = np.column_stack([300 * np.cos(angle), 200 * np.sin(angle)])
    positions[-n // 10 :, 0] += np.linspace(0, 200, len(positions[-n // 10 :]))
    return start + np.arange(n), positions


def gps_track(id="lap", north=0.0):
    """Laps on the earth."""
    times, positions = laps()
    lat, lon = 52.5 + north + positions[:, 1] / 111_000, 13.4 + positions[:, 0] / 67_000
    plane = choose_plane(lat, lon)
    return gpszip.Track(id, times, to_plane(lat, lon, plane), plane=plane)


def scene_of(archive, tracks=(), **options):
    return build_scene([ShownArchive(archive, "a.gpsz", tracks, 1000)], title="a", **options)


@pytest.fixture(scope="module")
def archive():
    return gpszip.compress(gps_track(), rmse=4.0, effort=1)


def test_the_scene_holds_map_and_walks(archive):
    scene = scene_of(archive)
    (shown,) = scene["archives"]

    # The map as archived.
    edges = archive.road_map
    x, y = unpack(shown["nodes"]["x"]), unpack(shown["nodes"]["y"])
    known = slice(0, len(edges.nodes))
    np.testing.assert_allclose(x[known], edges.nodes[:, 0], atol=0.3)
    np.testing.assert_allclose(y[known], edges.nodes[:, 1], atol=0.3)
    np.testing.assert_array_equal(unpack(shown["edges"]["from"]), edges.edges[:, 0])
    np.testing.assert_array_equal(unpack(shown["edges"]["to"]), edges.edges[:, 1])
    np.testing.assert_array_equal(unpack(shown["edges"]["forward"]), edges.forward)
    np.testing.assert_array_equal(unpack(shown["edges"]["backward"]), edges.backward)

    # Walks, and the clean map.
    (piece,) = archive.decompress()
    knots = unpack(shown["knots"]["node"]).astype(int)
    np.testing.assert_allclose(unpack(shown["knots"]["time"]), piece.times, atol=1e-3)
    np.testing.assert_allclose(x[knots], piece.positions[:, 0], atol=0.3)
    np.testing.assert_allclose(y[knots], piece.positions[:, 1], atol=0.3)
    np.testing.assert_array_equal(knots[1:-1], archive.walk("lap").nodes[1:-1])
    assert not unpack(shown["knots"]["gap"]).any()
    clean = archive.clean_map()
    lines = unpack_lines(shown["clean"])
    assert len(lines) == len(clean)
    for number, line in enumerate(lines):
        np.testing.assert_allclose(line, clean[number][:, :2], atol=0.3)

    # The rest.
    assert (scene["geographic"], scene["epoch"]) == (True, "unix")
    assert scene["planes"] == [[lat / 1e7, lon / 1e7] for lat, lon in archive.grid.plane.centers]
    assert shown["tracks"]["ids"] == ["lap"]
    assert shown["raw"] is shown["kept"] is shown["routes"] is shown["new_edges"] is None
    json.dumps(scene, allow_nan=False)


def test_samples_stand_beside_their_errors(archive):
    track = gps_track()
    (shown,) = scene_of(archive, [track])["archives"]
    raw = shown["raw"]
    np.testing.assert_allclose(unpack(raw["x"]), track.positions[:, 0], atol=0.3)
    np.testing.assert_allclose(unpack(raw["time"]), track.times, atol=1e-3)

    # Errors are those of the archive's positions.
    decoded = archive.position("lap", track.times, metres=True)
    errors = np.linalg.norm(decoded - track.positions, axis=1)
    np.testing.assert_allclose(unpack(raw["error"]), errors, atol=0.01)
    assert shown["rmse"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert shown["max_error"] == pytest.approx(errors.max())
    assert (raw["total"], raw["drawn"], shown["points"]) == (300, 300, 300)
    assert ["Points of the log", "300"] in shown["facts"]
    assert ["Largest error", shown["max_error"]] in shown["facts"]


def test_long_logs_are_thinned_to_their_largest_errors(archive):
    track = gps_track()
    (shown,) = scene_of(archive, [track], max_samples=50)["archives"]
    raw = shown["raw"]
    assert (raw["total"], raw["drawn"]) == (300, 50)
    assert unpack(raw["error"]).max() == pytest.approx(shown["max_error"], abs=0.01)


def test_a_second_archive_lies_on_the_plane_of_the_first(archive):
    other = gpszip.compress(gps_track(north=0.01), rmse=4.0, effort=1)
    assert other.grid.plane != archive.grid.plane
    subjects = [
        ShownArchive(archive, "a", [gps_track()]),
        ShownArchive(other, "b", [gps_track(north=0.01)]),
    ]
    first, second = build_scene(subjects, title="a")["archives"]

    # A hundredth of a degree further north.
    for part in ("nodes", "raw"):
        shift = np.mean(unpack(second[part]["y"])) - np.mean(unpack(first[part]["y"]))
        assert shift == pytest.approx(1112.6, abs=20.0)


def test_archives_far_apart_are_refused(archive):
    times, positions = laps()
    lat, lon = -33.9 + positions[:, 1] / 111_000, 151.2 + positions[:, 0] / 92_000
    plane = choose_plane(lat, lon)
    track = gpszip.Track("lap", times, to_plane(lat, lon, plane), plane=plane)
    sydney = gpszip.compress(track, rmse=4.0, effort=1)
    with pytest.raises(OptionError, match="sydney lies more than 400 km from the map"):
        build_scene([ShownArchive(archive, "b"), ShownArchive(sydney, "sydney")], title="a")


def test_edges_off_a_known_map_are_shown():
    times, positions = laps()
    city = gpszip.compress(gpszip.Track("a", times, positions), max_error=5.0, effort=1)
    north = np.column_stack([positions[:, 0], positions[:, 1] + np.linspace(0, 900, 300)])
    trip = gpszip.compress(gpszip.Track("b", times, north), max_error=5.0, effort=1, map=city)
    (shown,) = scene_of(trip)["archives"]
    lines = unpack_lines(shown["new_edges"])
    assert len(lines) == len(trip.off_map_lines) > 0
    np.testing.assert_allclose(lines[0], trip.off_map_lines[0], atol=0.3)


def test_kept_columns_are_charted_and_texts_are_not():
    times, positions = laps(60)
    attributes = {
        "ele": np.where(np.arange(60) % 5 == 0, np.nan, np.arange(60.0)),
        "note": np.array(["x"] * 60),
    }
    track = gpszip.Track("a", times, positions, attributes=attributes)
    archive = gpszip.compress(track, rmse=4.0, effort=1, keep=["ele", "note"])
    (shown,) = scene_of(archive)["archives"]
    kept = shown["kept"]
    assert list(kept["columns"]) == ["ele"]
    np.testing.assert_allclose(unpack(kept["columns"]["ele"]), attributes["ele"], atol=1e-2)
    np.testing.assert_allclose(unpack(kept["time"]), times, atol=1e-3)
    assert unpack(kept["offsets"]).tolist() == [0, 60]


def test_walks_without_times_count_metres():
    _, positions = laps(60)
    track = gpszip.Track("shape", np.arange(60.0), positions, timed=False)
    archive = gpszip.compress(track, rmse=4.0, effort=1)
    scene = scene_of(archive, [track])
    (shown,) = scene["archives"]
    line = archive.decompress()[0].positions
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert scene["epoch"] is None
    assert shown["tracks"]["timed"] == [False]
    assert unpack(shown["knots"]["time"])[-1] == pytest.approx(length, abs=0.01)
    assert np.isnan(unpack(shown["raw"]["error"])).all()


@pytest.mark.parametrize("dimension", [1, 3])
def test_other_dimensions(dimension):
    times, positions = laps(60, start=0.0)
    positions = np.column_stack([positions, np.arange(60.0)])[:, :dimension]
    track = gpszip.Track("a", times, positions)
    archive = gpszip.compress(track, max_error=2.0, effort=1)
    scene = scene_of(archive, [track])
    (shown,) = scene["archives"]
    assert scene["epoch"] == "log"
    assert shown["dimension"] == dimension
    assert ("z" in shown["nodes"]) == (dimension == 3)
    assert len(unpack(shown["raw"]["y"])) == 60


def test_a_single_point():
    archive = gpszip.compress(gpszip.Track("a", [5.0], [[1.0, 2.0]]), max_error=0.1)
    (shown,) = scene_of(archive, [gpszip.Track("a", [5.0], [[1.0, 2.0]])])["archives"]
    assert set(unpack(shown["knots"]["time"])) == {5.0}
    assert unpack(shown["raw"]["x"]) == pytest.approx([1.0], abs=0.01)


def test_bytes_of_the_parts_sum_up_to_the_archive(archive):
    parts = dict(bytes_by_part(archive))
    assert sum(parts.values()) == archive.size
    assert parts["times"] > 0
    assert parts["paths"] > 0
    assert parts["positions of nodes"] > 0


def test_maps_and_logs_have_scenes_of_their_own(archive):
    shown = map_scene(archive.road_map, title="m")["archives"][0]
    assert len(unpack(shown["nodes"]["x"])) == len(archive.road_map.nodes)
    assert shown["bytes"] is None
    shown = log_scene([gps_track()], title="l")["archives"][0]
    assert unpack(shown["raw"]["time"])[-1] == pytest.approx(START + 299, abs=1e-3)
    assert unpack(shown["knots"]["node"]).tolist() == []


def test_tracks_with_other_coordinates_are_refused(archive):
    times, positions = laps(20)
    with pytest.raises(OptionError, match="the log is in x, y, the archive in lat, lon"):
        put_on_plane([gpszip.Track("b", times, positions)], archive)
