"""Drives through a tunnel under other streets: no samples in it, and large errors after it."""

import numpy as np
import pytest

from gpszip.matching.match import match
from gpszip.matching.patch import patch
from gpszip.matching.speeds import measure_motion
from gpszip.model import Track
from matching.streets import grid, network, sample_line

BLOCK, BLOCKS, SPEED = 120.0, 11, 12.0


def town():
    """Streets, and as the last road a tunnel from crossing (2, 3) to crossing (9, 8) below them."""
    nodes, pairs = grid(BLOCKS, BLOCK)
    n = BLOCKS + 1
    return network(nodes, [*pairs, (2 * n + 3, 9 * n + 8)])


def drive_through_tunnel(period, noise, jump, seed=1):
    """Times and true positions at every second, and a track of the samples outside the tunnel.

    The first samples after the tunnel are ``jump`` metres off.
    """
    corners = BLOCK * np.array([(0, 1), (2, 1), (2, 3), (9, 8), (9, 10), (11, 10)], float)
    times, positions = sample_line(corners, SPEED, 1.0)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    begin, end = along[2] / SPEED, along[3] / SPEED

    seen = positions + np.random.default_rng(seed).normal(0, noise, positions.shape)
    offset = np.where(times > end, jump * np.exp(-np.maximum(times - end, 0) / 8), 0.0)
    seen += offset[:, None] * [0.8, -0.6]
    kept = ((times < begin) | (times > end)) & (times % period == 0)
    return times, positions, Track("car", times[kept], seen[kept])


@pytest.mark.parametrize("period", [1.0, 10.0])
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("jump", [0.0, 20.0])
def test_a_tunnel_does_not_break_the_route(period, noise, jump):
    streets = town()
    tunnel = len(streets) - 1
    _, _, track = drive_through_tunnel(period, noise, jump)
    assert np.diff(track.times).max() > 80
    matched = match(track, streets)[0]
    (piece,) = matched.pieces
    assert piece.route.edges.tolist().count(tunnel) == 1
    assert piece.length == pytest.approx(SPEED * np.ptp(track.times), rel=0.06)
    assert (matched.edge != tunnel).mean() > 0.9


def test_a_gap_of_many_minutes_breaks_the_route():
    _, _, track = drive_through_tunnel(1.0, 3.0, 0.0)
    times = track.times + np.where(track.times > 60, 300.0, 0.0)
    matched = match(Track("car", times, track.positions), town())[0]
    assert [break_.reason for break_ in matched.breaks] == ["gap"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("jump", [0.0, 20.0])
def test_a_tunnel_is_filled(noise, jump, seed):
    times, positions, track = drive_through_tunnel(1.0, noise, jump, seed)
    (filled,) = patch(track, town()).patches
    true = np.stack([np.interp(filled.times, times, axis) for axis in positions.T], axis=1)
    assert np.linalg.norm(filled.positions - true, axis=1).mean() < 50


@pytest.mark.parametrize("noise", [0.0, 3.0, 8.0])
def test_noise_does_not_raise_the_speed(noise):
    _, _, track = drive_through_tunnel(1.0, noise, 0.0)
    assert measure_motion([track], 30.0).mean_speed == pytest.approx(SPEED, rel=0.25)
