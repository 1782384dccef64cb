"""Walks as predictions of logs."""

from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.archive.exact import find_trails
from gpszip.archive.trails import ArchiveTrails, plain_degrees
from gpszip.model.grid import Plane
from gpszip.model.projection import to_geographic


@pytest.mark.parametrize("lat", [0, 21, -38, 60, 75])
@pytest.mark.parametrize("radius", [20_000, 100_000, 300_000])
def test_degrees_agree_with_the_projection(lat, radius):
    plane = Plane(((lat * 10**7, -1221_000_000), (lat * 10**7, 1799_900_000)))
    positions = np.random.default_rng(lat + 90).uniform(-radius, radius, (400, 2))
    positions[200:, 0] += Plane.SPREAD
    found = plain_degrees(positions, plane)
    lat_there, lon_there = to_geographic(positions, plane)
    turns = np.abs(found[:, 1] - lon_there)
    metres = np.stack(
        [
            111_000 * np.abs(found[:, 0] - lat_there),
            111_000 * np.minimum(turns, 360 - turns) * np.cos(np.radians(lat_there)),
        ]
    )
    assert metres.max() < (0.01 if radius < 300_000 else 10)
    assert np.abs(found[:, 1]).max() <= 180


def test_positions_at_a_pole_are_numbers_or_nothing():
    plane = Plane(((900_000_000, 0),))
    positions = np.random.default_rng(1).uniform(-3e5, 3e5, (50, 2))
    assert plain_degrees(positions, plane).shape == (50, 2)


PLANE = Plane(((470_000_000, 80_000_000),))


@pytest.fixture(scope="module")
def archive():
    """Two tracks with gaps and stops, in degrees."""
    random = np.random.default_rng(2)
    tracks = []
    for name in "ab":
        times = np.cumsum(random.choice([1.0, 2.0], 200))
        times[120:] += 5000
        east = np.cumsum(random.uniform(0, 20, 200)) * (np.arange(200) % 100 < 80)
        positions = np.stack([2 * east, 0.1 * east], axis=1)
        tracks.append(gpszip.Track(name, times, positions, plane=PLANE))
    return tracks, gpszip.compress(tracks, rmse=5, gap=60, effort=1)


def test_trails_are_the_walks(archive):
    tracks, archive = archive
    trails = find_trails(archive)
    assert (trails.names, trails.axes) == (("a", "b"), 2)
    for number, (track, walk) in enumerate(zip(tracks, archive.walks, strict=True)):
        trail = trails.trail(number)
        # Pieces begin and end with the log.
        ends = track.times[[0, 119, 120, 199]]
        assert np.allclose(trail.times[trail.is_end], ends, atol=0.05)
        others = ~trail.is_end
        assert np.array_equal(trail.times[others], walk.times[others])
        assert np.array_equal(trail.is_gap[1:], walk.gaps)
        nodes = np.stack(to_geographic(archive.road_map.nodes[walk.nodes], PLANE), axis=1)
        assert np.allclose(trail.positions, nodes, atol=1e-9)
        same = (trail.positions[1:] == trail.positions[:-1]).all(axis=1)
        assert np.array_equal(trail.is_stay[1:], same & ~walk.gaps)


def test_positions_far_off_their_plane_raise_no_warning(archive):
    _, archive = archive
    grid = replace(archive.grid, origin=(10**18, 10**18))
    forged = replace(archive, contents=replace(archive.contents, grid=grid))
    assert len(find_trails(forged).trail(0).positions) == len(archive.walk("a").nodes)


def test_archives_without_times_have_no_trails(archive):
    tracks, _ = archive
    shapes = gpszip.compress(tracks, rmse=5, times=False, effort=1)
    found = find_trails(shapes)
    assert (found.names, found.trail(0)) == (shapes.ids, None)


def test_a_track_without_times_has_no_trail():
    line = [[float(t), 0.0] for t in range(9)]
    tracks = [gpszip.Track(name, range(9), line, timed=name == "a") for name in "ab"]
    trails = ArchiveTrails(gpszip.compress(tracks, rmse=5, effort=1))
    assert trails.trail(0) is not None
    assert trails.trail(1) is None


def test_a_walk_on_a_known_map_predicts_nothing(archive):
    tracks, known = archive
    walks = gpszip.compress(tracks[:1], rmse=5, map=known, effort=1)
    found = find_trails(walks)
    assert (found.names, found.trail(0)) == (walks.ids, None)
