import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from gpszip.geo.planes import (
    PLANE_RADIUS,
    choose_plane,
    plane_changes,
    plane_indices,
    to_geographic,
    to_plane,
)
from gpszip.model import Plane

GEOD = Geod(ellps="WGS84")


def degrees_around(lat, lon, n, metres, seed=0):
    """Draw samples around a position, which may be a pole or on the antimeridian."""
    rng = np.random.default_rng(seed)
    to_lon, to_lat, _ = GEOD.fwd(
        np.full(n, lon), np.full(n, lat), rng.uniform(0, 360, n), rng.uniform(0, metres, n)
    )
    return np.asarray(to_lat), np.asarray(to_lon)


def separation(lat, lon, other_lat, other_lon):
    return np.asarray(GEOD.inv(lon, lat, other_lon, other_lat)[2])


@pytest.mark.parametrize(
    ("lat", "lon"),
    [(0, 0), (48.2, 16.4), (-17.8, 180), (65, -179.99), (90, 0), (89.9, 120), (-90, 0), (-75, -60)],
)
def test_one_plane_covers_a_city_anywhere_on_earth(lat, lon):
    lats, lons = degrees_around(lat, lon, 500, 30_000)
    plane = choose_plane(lats, lons)
    assert len(plane.centers) == 1
    positions = to_plane(lats, lons, plane)
    back = to_geographic(positions, plane)
    assert separation(lats, lons, *back).max() < 1e-4
    on_plane = np.linalg.norm(positions[1:] - positions[:-1], axis=1)
    on_earth = separation(lats[1:], lons[1:], lats[:-1], lons[:-1])
    assert np.allclose(on_plane, on_earth, rtol=2e-5, atol=1e-3)


def test_lengths_within_the_radius_are_true_to_two_permille():
    lats, lons = degrees_around(45, 7, 200, PLANE_RADIUS - 1000)
    plane = Plane(((450000000, 70000000),))
    on_plane = to_plane(lats + 1e-4, lons, plane) - to_plane(lats, lons, plane)
    on_earth = separation(lats, lons, lats + 1e-4, lons)
    assert np.allclose(np.linalg.norm(on_plane, axis=1), on_earth, rtol=2.1e-3)


def test_a_single_distant_sample_does_not_move_the_centre():
    lats, lons = degrees_around(40, 116, 101, 5_000)
    without = choose_plane(lats, lons).centers
    with_distant = choose_plane(np.append(lats, -30.0), np.append(lons, 20.0)).centers
    assert len(without) == 1
    assert len(with_distant) == 2
    before, after = np.array([without[0], with_distant[0]]) / 1e7
    assert separation(*before, *after) < 200
    assert with_distant[1] == (-300000000, 200000000)


def test_distant_regions_lie_on_planes_far_from_each_other():
    lats, lons = np.concatenate(
        [
            degrees_around(52, 13, 50, 1000),
            degrees_around(-34, 151, 40, 1000),
            degrees_around(52, 13, 9, 1000),
        ],
        axis=1,
    )
    plane = choose_plane(lats, lons)
    positions = to_plane(lats, lons, plane)
    assert plane_indices(positions, plane).tolist() == [0] * 50 + [1] * 40 + [0] * 9
    assert np.flatnonzero(plane_changes(positions, plane)).tolist() == [49, 89]
    assert np.linalg.norm(positions[0] - positions[60]) > 3e7
    assert separation(lats, lons, *to_geographic(positions, plane)).max() < 1e-4


def test_two_distant_halves_have_no_plane_between_them():
    plane = choose_plane([50.0, 50.0, 40.0, 40.0], [0.0, 0.0, -74.0, -74.0])
    assert plane.centers == ((500000000, 0), (400000000, -740000000))


@given(st.lists(st.tuples(st.floats(-90, 90), st.floats(-180, 180)), min_size=1, max_size=30))
def test_every_sample_survives_a_round_trip(points):
    lats, lons = np.array(points).T
    plane = choose_plane(lats, lons)
    positions = to_plane(lats, lons, plane)
    from_centers = positions - plane_indices(positions, plane)[:, None] * [Plane.SPREAD, 0]
    assert np.linalg.norm(from_centers, axis=1).max() < 1.01 * PLANE_RADIUS
    assert separation(lats, lons, *to_geographic(positions, plane)).max() < 1e-3


def test_a_log_in_metres_has_no_changes_of_plane():
    assert not plane_changes([[0.0, 0.0], [1e9, 0.0]], None).any()
    assert len(plane_changes([[0.0, 0.0]], None)) == 0


def plain_centers(lat, lon):
    """Centres of planes in degrees: the median direction, then the first sample outside of all."""
    phi, theta = np.radians(lat), np.radians(lon)
    directions = np.array([np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)])

    def is_outside(center):
        phi, theta = np.radians(center)
        axis = np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)
        return np.arccos(np.clip(axis @ directions, -1, 1)) * 6_371_000 > 400_000

    x, y, z = np.median(directions, axis=1)
    median = np.degrees([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)]).round(2)
    uncovered, centers = is_outside(median), [median.tolist()]
    if uncovered.all():
        centers = []
    while uncovered.any():
        first = int(uncovered.argmax())
        centers.append([round(float(lat[first]), 2), round(float(lon[first]), 2)])
        uncovered &= is_outside(centers[-1])
        uncovered[first] = False
    return centers


@pytest.mark.parametrize("seed", range(30))
def test_many_samples_get_the_planes_of_the_plain_twin(seed):
    rng = np.random.default_rng(seed)
    lat, lon = rng.uniform(-88, 88), rng.uniform(-180, 180)
    extent = float(rng.choice([1e-3, 0.05, 1.0, 6.0]))
    degrees = np.array([lat, lon]) + rng.uniform(-extent, extent, (12_000, 2))
    lats, lons = np.clip(degrees[:, 0], -90, 90), (degrees[:, 1] + 180) % 360 - 180
    centers = np.array(choose_plane(lats, lons).centers) / 1e7
    assert centers.round(2).tolist() == plain_centers(lats, lons)
