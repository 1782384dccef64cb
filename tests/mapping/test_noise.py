import numpy as np
import pytest

from gpszip.mapping.noise import estimate_noise, suggest_rmse
from gpszip.model import Plane, Track


def lane(n=4000, noise=0.0, dimension=2, seed=1, plane=None, uneven=False):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 1.8, n)) if uneven else np.arange(float(n))
    positions = times[:, None] + rng.normal(0, noise, (n, dimension))
    return Track("a", times, positions, plane=plane)


def no_gaps(*tracks):
    return [np.zeros(len(track) - 1, bool) for track in tracks]


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("noise", [0.01, 2.0])
def test_added_noise_is_found(dimension, uneven, noise):
    track = lane(noise=noise, dimension=dimension, uneven=uneven)
    assert estimate_noise([track], no_gaps(track)) == pytest.approx(
        noise * np.sqrt(dimension), rel=0.06
    )


def test_outliers_and_parked_tracks_hardly_change_the_noise():
    track = lane(noise=0.5)
    positions = track.positions.copy()
    positions[::40] += 1000
    parked = Track("b", np.arange(5000.0), np.zeros((5000, 2)))
    tracks = [Track("a", track.times, positions), parked]
    assert estimate_noise(tracks, no_gaps(*tracks)) == pytest.approx(0.5 * np.sqrt(2), rel=0.2)


def test_gaps_don_t_count():
    times = np.arange(300.0) + 1000 * (np.arange(300) // 3)
    positions = np.where(np.arange(300)[:, None] % 3 == 1, 7.0, 0.0) + 500 * (
        np.arange(300)[:, None] // 3 % 2
    )
    track = Track("a", times, positions)
    gaps = np.diff(times) > 10
    assert estimate_noise([track], [gaps]) == pytest.approx(7 / np.sqrt(1.5) / 0.6745, rel=1e-3)


@pytest.mark.parametrize("n", [1, 2, 3, 50])
def test_a_log_without_noise_gets_a_bound(n):
    track = lane(n)
    assert estimate_noise([track], no_gaps(track)) == 0
    assert suggest_rmse([track], no_gaps(track)) >= 1e-3


def test_the_bound_lies_above_the_noise_and_far_below_the_extent():
    track = lane(noise=0.3)
    bound = suggest_rmse([track], no_gaps(track))
    assert 0.3 * np.sqrt(2) < bound < 4000 * np.sqrt(2) / 200


def test_the_bound_of_pure_noise_is_limited_by_the_extent():
    rng = np.random.default_rng(3)
    track = Track("a", np.arange(500.0), rng.normal(0, 1, (500, 2)))
    extent = np.linalg.norm(np.ptp(track.positions, axis=0))
    assert suggest_rmse([track], no_gaps(track)) == pytest.approx(extent / 200, rel=0.05)


@pytest.mark.parametrize(("noise", "bound"), [(0.001, 3.0), (100.0, 10.0)])
def test_the_bound_of_a_gps_log_is_3_to_10_metres(noise, bound):
    track = lane(noise=noise, plane=Plane(((0, 0),)))
    assert suggest_rmse([track], no_gaps(track)) == bound


def test_a_shift_in_time_and_space_keeps_the_bound():
    track = lane(noise=0.3)
    moved = Track("a", track.times + 1e9, track.positions + 1e7)
    assert suggest_rmse([track], no_gaps(track)) == suggest_rmse([moved], no_gaps(moved))
