"""Scales of logs that leave the roads, and of maps that are wrong."""

import numpy as np
import pytest

from gpszip.matching.match import match
from gpszip.matching.on_roads import DistanceMixture, fit_mixture
from gpszip.model import Network, Track

BLOCK, SIDE = 200.0, 8


def town(field=(2, 2, 5, 5)):
    """Square blocks; no streets inside a field, of which the corners are given in blocks."""
    n, (left, low, right, high) = SIDE + 1, field
    nodes = BLOCK * np.array([(x, y) for x in range(n) for y in range(n)], float)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(SIDE) for y in range(n)] + [
        (x * n + y, x * n + y + 1) for x in range(n) for y in range(SIDE)
    ]
    middles = [(nodes[a] + nodes[b]) / (2 * BLOCK) for a, b in pairs]
    kept = np.array(
        [
            pair
            for pair, at in zip(pairs, middles, strict=True)
            if not (left < at[0] < right and low < at[1] < high)
        ],
        np.int32,
    )
    both = np.ones(len(kept), bool)
    return Network(
        nodes,
        kept[:, 0].copy(),
        kept[:, 1].copy(),
        2 * np.arange(len(kept) + 1),
        nodes[kept.ravel()],
        both,
        both,
        np.full(len(kept), np.nan),
    )


def walk(corners, period, noise, speed=1.4, seed=1):
    """Samples of a walk along corners given in blocks, and whether each is off the roads: on none of the lines of whole blocks."""
    corners = BLOCK * np.array(corners, float)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0, along[-1] / speed, period)
    places = np.stack([np.interp(speed * times, along, axis) for axis in corners.T], axis=1)
    off = np.abs(places / BLOCK - np.round(places / BLOCK)).min(axis=1) > 1e-6
    return Track(
        "walker", times, places + np.random.default_rng(seed).normal(0, noise, places.shape)
    ), off


ACROSS = [(0, 0), (2, 0), (2, 2), (5, 5), (5, 6), (7, 6), (7, 8)]
#: Three times across, so that nearly half of the way is off the roads.
TO_AND_FRO = [
    (0, 1),
    (2, 1),
    (2, 3),
    (5, 4.25),
    (5, 3),
    (2, 4.25),
    (2, 3),
    (5, 3.75),
    (5, 7),
    (7, 7),
    (7, 8),
]


@pytest.mark.parametrize(("corners", "share"), [(ACROSS, 0.32), (TO_AND_FRO, 0.45)])
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
def test_who_crosses_a_field_leaves_the_roads_there(corners, share, noise, period):
    track, off = walk(corners, period, noise)
    assert off.mean() == pytest.approx(share, abs=0.03)
    found = match(track, town())[0]
    assert 0.7 * noise / np.sqrt(found.scales.averaging_window) < found.scales.error < 2.2 * noise
    assert found.scales.sigma < 2.5 * noise
    on = found.piece >= 0
    assert on[~off].mean() > 0.99
    assert (
        on[off].mean() < 0.55
    )  # no road is farther than 300 m, and those within ten errors are near
    assert found.breaks
    assert {one.reason for one in found.breaks} <= {"no road near", "off road", "detour"}
    assert sum(piece.length for piece in found.pieces) < 1.35 * (1 - share) * 1.4 * track.times[-1]
    assert found.confidence[on & ~off].mean() > 0.95
    assert (found.confidence[~on] == 0).all()


def test_a_field_in_the_middle_of_a_long_log_is_not_all_that_is_seen():
    streets = 3 * [(0, 0), (7, 0)]
    track, off = walk(
        [*streets, (0, 0), (2, 0), (2, 2), *(6 * [(5, 5), (2, 2)]), (5, 5), (5, 0), *streets],
        0.8,
        4.0,
    )
    middle = len(off) // 2
    assert (
        (len(track) > 20_000)
        & (off.mean() < 0.45)
        & (off[middle - 4000 : middle + 4000].mean() > 0.9)
    )
    assert match(track, town()).scales.error < 10


def test_hours_beside_the_roads_are_one_place():
    track, _ = walk([(0, 0), (2, 0), (2, 2), (2, 5), (5, 5)], 1.0, 4.0)
    drift = np.random.default_rng(2).normal(0, 4, (6 * len(track) // 30, 2)).repeat(30, axis=0)
    rest = track.positions[-1] + [-90.0, -95.0] + drift
    places = np.concatenate((track.positions, rest))
    found = match(Track("walker", np.arange(len(places)), places), town())[0]
    assert found.scales.error < 12
    assert found.piece[len(track) - 50] >= 0
    assert found.piece[-1] == -1


@pytest.mark.parametrize("shift", [(12.0, 0.0), (20.0, 10.0), (20.0, 0.0), (0.0, 30.0)])
@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("noise", [0.5, 4.0])
def test_a_map_that_is_wrong_everywhere_is_told(shift, period, noise):
    track, _ = walk(
        [(0, 0), (3, 0), (3, 2), (0, 2), (0, 7), (5, 7), (5, 8), (8, 8), (8, 2)], period, noise
    )
    found = match(Track("walker", track.times, track.positions + shift), town())[0]
    assert found.scales.error == pytest.approx(
        np.hypot(noise, np.hypot(*shift) / np.sqrt(2)), rel=0.4
    )
    assert found.share > 0.99
    assert not found.breaks


@pytest.mark.parametrize("share", [0.0, 0.1, 0.33, 0.45])
@pytest.mark.parametrize("start", [3.0, 12.0])
def test_distances_of_two_kinds_are_told_apart(share, start):
    rng = np.random.default_rng(3)
    off = rng.random(4000) < share
    distances = np.where(off, rng.uniform(0, 10 * start, 4000), np.abs(rng.normal(0, 5, 4000)))
    fit = fit_mixture(np.append(distances, np.nan), DistanceMixture(0.5, start, 10 * start))
    assert fit.error == pytest.approx(5, rel=0.15 if start > 5 else 0.4)
    on = fit.on_roads(distances)
    assert on[~off].mean() > 0.7
    assert on[off & (distances > 20)].sum() < 0.02 * max(off.sum(), 1)


def test_most_is_on_roads():
    """A few that are very near by chance don't make all others strays."""
    distances = np.append(np.full(400, 0.01), np.abs(np.random.default_rng(4).normal(0, 5, 600)))
    assert fit_mixture(distances, DistanceMixture(0.5, 6.0, 60.0)).error > 2


def test_without_layers_nothing_changes():
    start = DistanceMixture(0.5, 6.0, 60.0)
    assert fit_mixture(np.full(3, np.nan), start) == start
    assert fit_mixture(np.empty(0), start) == start
