"""Projections by power series, compared with PROJ."""

from dataclasses import replace

import numpy as np
import pytest

from gpszip.model import Plane, plane_series
from gpszip.model.plane_series import MAX_DIFFERENCE, MIN_POSITIONS
from gpszip.model.projection import UNITS_PER_DEGREE, project, projection, to_geographic

METRES_PER_DEGREE = 111_500.0


def region(lat, lon, extent, count=MIN_POSITIONS, seed=1):
    rng = np.random.default_rng(seed)
    degrees = [lat, lon] + rng.uniform(-extent, extent, (count, 2)) * [1.0, 1.5]
    return np.clip(degrees[:, 0], -90, 90), (degrees[:, 1] + 180) % 360 - 180


@pytest.mark.parametrize(
    ("lat", "lon", "extent"),
    [
        (48.1, 11.5, 0.1),
        (48.1, 11.5, 2.0),
        (0.0, 0.0, 1e-4),
        (-33.5, 179.95, 0.3),
        (64.0, -180.0, 1.0),
        (-78.0, 30.0, 1.0),
        (79.9, 30.0, 1.0),  # beyond the latitude of a series
        (90.0, 0.0, 1.0),
        (10.0, 20.0, 5.0),  # beyond a plane
    ],
)
def test_positions_agree_with_proj_in_both_directions(lat, lon, extent):
    center = (round(lat * UNITS_PER_DEGREE), round(lon * UNITS_PER_DEGREE))
    lats, lons = region(lat, lon, extent)
    expected = np.stack(projection(center).transform(lons, lats))
    assert np.abs(np.stack(project(lats, lons, center)) - expected).max() <= 2 * MAX_DIFFERENCE

    # And back, at the corners of the region, too.
    x, y = expected
    lon_back, lat_back = projection(center).transform(x, y, direction="INVERSE")
    lat_here, lon_here = to_geographic(expected.T, Plane((center,)))
    east = (lon_here - lon_back + 180) % 360 - 180
    assert np.abs(lat_here - lat_back).max() * METRES_PER_DEGREE <= 2 * MAX_DIFFERENCE
    assert np.abs(east).max() * METRES_PER_DEGREE <= 2 * MAX_DIFFERENCE / np.cos(
        np.radians(min(np.abs(lats).max(), 89.9))
    )
    assert np.abs(lon_here).max() <= 180


@pytest.mark.parametrize(
    ("extent_lat", "extent_lon"),
    [(0.0, 3.0), (1e-13, 3.0), (1e-9, 3.0), (3.0, 0.0), (1e-300, 1e-300), (1e-310, 1e-310)],
)
def test_narrow_regions_agree_with_proj(extent_lat, extent_lon):
    rng = np.random.default_rng(2)
    lats, lons = rng.uniform(0, [[extent_lat], [extent_lon]], (2, MIN_POSITIONS))
    expected = np.stack(projection((0, 0)).transform(lons, lats))
    assert np.abs(np.stack(project(lats, lons, (0, 0))) - expected).max() <= 2 * MAX_DIFFERENCE


def test_series_of_a_narrow_region_that_differs_from_proj_is_not_used(monkeypatch):
    """Few points of the disk about it have a latitude of the region."""
    original = plane_series._series_on

    def wrong_series(disk, values, noise):
        series = original(disk, values, noise)
        return replace(series, coefficients=series.coefficients * (1 + 1e-9))

    monkeypatch.setattr(plane_series, "_series_on", wrong_series)
    lats, lons = np.linspace(48, 48 + 1e-9, MIN_POSITIONS), np.linspace(8, 14, MIN_POSITIONS)
    center = (480_000_000, 110_000_000)
    expected = np.stack(projection(center).transform(lons, lats))
    assert (np.stack(project(lats, lons, center)) == expected).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
@pytest.mark.parametrize("axis", [0, 1])
def test_others_are_projected_beside_a_position_that_is_not_finite(wrong, axis):
    degrees = np.stack(region(48.0, 11.0, 1.0))
    degrees[axis, 5] = wrong
    positions = np.stack(project(*degrees, (480_000_000, 110_000_000)))
    assert not np.isfinite(positions[:, 5]).any()
    assert np.isfinite(np.delete(positions, 5, axis=1)).all()


def test_one_position_many_times_is_projected():
    center = (481_000_000, 115_000_000)
    lats, lons = np.full(MIN_POSITIONS, 48.2), np.full(MIN_POSITIONS, 11.6)
    x, y = project(lats, lons, center)
    assert (x[0], y[0]) == projection(center).transform(11.6, 48.2)
    lat, lon = to_geographic(np.stack([x, y], axis=1), Plane((center,)))
    assert lat[-1] == pytest.approx(48.2, abs=1e-12)
    assert lon[-1] == pytest.approx(11.6, abs=1e-12)
