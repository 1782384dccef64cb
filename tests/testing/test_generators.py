import numpy as np
import pytest

from gpszip.testing import city, drives, patrol


def test_patrol_has_the_size_and_rate_of_the_thesis():
    track = patrol()
    steps = np.diff(track.times)
    assert len(track) == 72_273
    assert track.times[0] == 0
    assert 92 < track.times[-1] / 60 < 94
    assert 12.5 < 1 / np.median(steps) < 13.5
    assert 0.001 < steps.std() < 0.005
    assert (steps > 0).all()


def test_patrol_repeats_its_corridors():
    track = patrol(40_000, seed=3)
    visited = np.unique(np.round(track.positions[::13] / 2.0), axis=0)
    driven = np.linalg.norm(np.diff(track.positions[::130], axis=0), axis=1).sum()
    assert 2.0 * len(visited) < driven


def test_patrol_pauses():
    track = patrol(20_000, noise=0.0)
    still = np.linalg.norm(np.diff(track.positions, axis=0), axis=1) == 0
    assert 0.05 < still.mean() < 0.6


def test_patrol_has_the_requested_noise():
    quiet, loud = patrol(20_000, noise=0.0), patrol(20_000, noise=0.05)
    error = loud.positions - quiet.positions
    assert error.std() == pytest.approx(0.05, rel=0.15)
    assert np.corrcoef(error[:-1, 0], error[1:, 0])[0, 1] > 0.8


@pytest.mark.parametrize("corridors", [1, 2, 3, 4, 5, 60])
def test_patrol_builds_any_number_of_corridors(corridors):
    assert len(patrol(500, corridors=corridors, seed=corridors)) == 500


def test_seeds_select_patrols():
    first, repeated, other = patrol(500, seed=7), patrol(500, seed=7), patrol(500, seed=8)
    assert np.array_equal(first.positions, repeated.positions)
    assert not np.array_equal(first.positions, other.positions)


@pytest.mark.parametrize("period", [1.0, 15.0, 60.0])
def test_city_has_the_drives_in_degrees(period):
    town = city(vehicles=2, period=period, seed=5)
    plane = drives(vehicles=2, period=period, seed=5)
    assert list(town) == list(plane) == ["bus-0", "bus-1"]
    for name, (times, degrees) in town.items():
        assert np.allclose(np.diff(times), period)
        north = (degrees[:, 0] - 37.98) * 111_320.0
        assert np.allclose(north, plane[name][1][:, 1], atol=1e-6)


def test_drives_stay_on_streets():
    for _, positions in drives(blocks=4, vehicles=5, noise=0.0).values():
        off = np.abs(positions / 120.0 - np.round(positions / 120.0)).min(axis=1)
        assert off.max() < 1e-9
        assert np.abs(positions).max() <= 240.0
