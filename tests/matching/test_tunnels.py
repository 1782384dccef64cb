"""Drives through a tunnel under other streets: the receiver is silent in it, and errs where it sees the sky again."""

import numpy as np
import pytest

from gpszip.matching.match import match
from gpszip.matching.patch import patch
from gpszip.matching.speeds import measure_motion
from gpszip.model import Network, Track

BLOCK, SIDE, SPEED = 120.0, 11, 12.0


def town():
    """Square blocks, and a tunnel from crossing (2, 3) to crossing (9, 8) that passes below the streets; it is the last road."""
    n = SIDE + 1
    nodes = BLOCK * np.array([(x, y) for x in range(n) for y in range(n)], float)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(SIDE) for y in range(n)]
    pairs += [(x * n + y, x * n + y + 1) for x in range(n) for y in range(SIDE)]
    roads = np.array([*pairs, (2 * n + 3, 9 * n + 8)], np.int32)
    both = np.ones(len(roads), bool)
    offsets = 2 * np.arange(len(roads) + 1)
    return Network(
        nodes,
        roads[:, 0].copy(),
        roads[:, 1].copy(),
        offsets,
        nodes[roads.ravel()],
        both,
        both,
        np.full(len(roads), np.nan),
    )


def drive(period, noise, jump, seed=1):
    """Seconds and true places of a drive at every second, and the samples outside the tunnel; the first are ``jump`` metres off."""
    corners = BLOCK * np.array([(0, 1), (2, 1), (2, 3), (9, 8), (9, 10), (11, 10)], float)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0, along[-1] / SPEED)
    places = np.stack([np.interp(SPEED * times, along, axis) for axis in corners.T], axis=1)
    begin, end = along[2] / SPEED, along[3] / SPEED
    seen = places + np.random.default_rng(seed).normal(0, noise, places.shape)
    seen += np.where(times > end, jump * np.exp(-np.maximum(times - end, 0) / 8), 0.0)[:, None] * [
        0.8,
        -0.6,
    ]
    kept = ((times < begin) | (times > end)) & (times % period == 0)
    return times, places, Track("car", times[kept], seen[kept])


@pytest.mark.parametrize("period", [1.0, 10.0])
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("jump", [0.0, 20.0])
def test_a_tunnel_does_not_break_the_route(period, noise, jump):
    streets = town()
    _, _, track = drive(period, noise, jump)
    assert np.diff(track.times).max() > 80
    found = match(track, streets)[0]
    (piece,) = found.pieces
    assert piece.route.edges.tolist().count(len(streets) - 1) == 1
    assert piece.length == pytest.approx(SPEED * np.ptp(track.times), rel=0.06)
    assert (found.edge != len(streets) - 1).mean() > 0.9


def test_silences_of_many_minutes_break_the_route():
    _, _, track = drive(1.0, 3.0, 0.0)
    late = track.times + np.where(track.times > 60, 300.0, 0.0)
    assert [one.reason for one in match(Track("car", late, track.positions), town())[0].breaks] == [
        "gap"
    ]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("jump", [0.0, 20.0])
def test_a_tunnel_is_filled_in(noise, jump, seed):
    times, places, track = drive(1.0, noise, jump, seed)
    (one,) = patch(track, town()).patches
    true = np.stack([np.interp(one.times, times, axis) for axis in places.T], axis=1)
    assert np.linalg.norm(one.positions - true, axis=1).mean() < 50


@pytest.mark.parametrize("noise", [0.0, 3.0, 8.0])
def test_noise_is_no_speed(noise):
    _, _, track = drive(1.0, noise, 0.0)
    assert measure_motion([track], 30.0).mean_speed == pytest.approx(SPEED, rel=0.25)
