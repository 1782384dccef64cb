"""Scales of logs that leave the roads, and of maps that are wrong."""

import numpy as np
import pytest

from gpszip.matching.match import match
from gpszip.matching.on_roads import DistanceMixture, fit_mixture
from gpszip.model import Track
from matching.streets import grid, network, sample_line

BLOCK, BLOCKS = 200.0, 8


def town_with_field(field=(2, 2, 5, 5)):
    """Square blocks without streets inside a field, whose corners are in blocks."""
    left, low, right, high = field
    nodes, pairs = grid(BLOCKS, BLOCK)
    x, y = nodes[np.array(pairs)].mean(axis=1).T / BLOCK
    is_inside = (left < x) & (x < right) & (low < y) & (y < high)
    return network(nodes, np.array(pairs)[~is_inside])


def walk(corners, period, noise, speed=1.4, seed=1):
    """Samples of a walk along corners given in blocks, and whether each is off the streets."""
    times, positions = sample_line(BLOCK * np.array(corners, float), speed, period)
    blocks = positions / BLOCK
    is_off = np.abs(blocks - np.round(blocks)).min(axis=1) > 1e-6
    errors = np.random.default_rng(seed).normal(0, noise, positions.shape)
    return Track("walker", times, positions + errors), is_off


ACROSS = [(0, 0), (2, 0), (2, 2), (5, 5), (5, 6), (7, 6), (7, 8)]

#: Three times across the field, so that nearly half of the walk is off the roads.
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


@pytest.mark.parametrize(("corners", "share_off"), [(ACROSS, 0.32), (TO_AND_FRO, 0.45)])
@pytest.mark.parametrize("noise", [3.0, 8.0])
@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
def test_a_walk_across_a_field_leaves_the_roads_there(corners, share_off, noise, period):
    track, is_off = walk(corners, period, noise)
    assert is_off.mean() == pytest.approx(share_off, abs=0.03)
    matched = match(track, town_with_field())[0]

    # scales are those of the streets
    scales = matched.scales
    assert 0.7 * noise / np.sqrt(scales.averaging_window) < scales.error < 2.2 * noise
    assert scales.sigma < 2.5 * noise

    # no road is farther than 300 m, and samples within ten errors of one are matched
    is_matched = matched.piece >= 0
    assert is_matched[~is_off].mean() > 0.99
    assert is_matched[is_off].mean() < 0.55
    assert matched.breaks
    reasons = {break_.reason for break_ in matched.breaks}
    assert reasons <= {"no road near", "off road", "detour"}
    length_on_streets = (1 - share_off) * 1.4 * track.times[-1]
    assert sum(piece.length for piece in matched.pieces) < 1.35 * length_on_streets
    assert matched.confidence[is_matched & ~is_off].mean() > 0.95
    assert (matched.confidence[~is_matched] == 0).all()


def test_the_sample_of_a_long_log_is_not_only_its_middle():
    street = 3 * [(0, 0), (7, 0)]
    across = [(0, 0), (2, 0), (2, 2), *(6 * [(5, 5), (2, 2)]), (5, 5), (5, 0)]
    track, is_off = walk([*street, *across, *street], 0.8, 4.0)
    middle = len(is_off) // 2
    assert len(track) > 20_000
    assert is_off.mean() < 0.45
    assert is_off[middle - 4000 : middle + 4000].mean() > 0.9
    assert match(track, town_with_field()).scales.error < 10


def test_hours_beside_the_roads_are_off_the_roads():
    track, _ = walk([(0, 0), (2, 0), (2, 2), (2, 5), (5, 5)], 1.0, 4.0)
    drift = np.random.default_rng(2).normal(0, 4, (6 * len(track) // 30, 2)).repeat(30, axis=0)
    beside = track.positions[-1] + [-90.0, -95.0] + drift
    positions = np.concatenate((track.positions, beside))
    matched = match(Track("walker", np.arange(len(positions)), positions), town_with_field())[0]
    assert matched.scales.error < 12
    assert matched.piece[len(track) - 50] >= 0
    assert matched.piece[-1] == -1


@pytest.mark.parametrize("shift", [(12.0, 0.0), (20.0, 10.0), (20.0, 0.0), (0.0, 30.0)])
@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("noise", [0.5, 4.0])
def test_a_shifted_map_makes_the_error_larger(shift, period, noise):
    corners = [(0, 0), (3, 0), (3, 2), (0, 2), (0, 7), (5, 7), (5, 8), (8, 8), (8, 2)]
    track, _ = walk(corners, period, noise)
    shifted = Track("walker", track.times, track.positions + shift)
    matched = match(shifted, town_with_field())[0]
    expected = np.hypot(noise, np.hypot(*shift) / np.sqrt(2))
    assert matched.scales.error == pytest.approx(expected, rel=0.4)
    assert matched.share > 0.99
    assert not matched.breaks


@pytest.mark.parametrize("share_off", [0.0, 0.1, 0.33, 0.45])
@pytest.mark.parametrize("start", [3.0, 12.0])
def test_the_mixture_separates_two_kinds_of_distances(share_off, start):
    rng = np.random.default_rng(3)
    is_off = rng.random(4000) < share_off
    distances = np.where(is_off, rng.uniform(0, 10 * start, 4000), np.abs(rng.normal(0, 5, 4000)))
    mixture = fit_mixture(np.append(distances, np.nan), DistanceMixture(0.5, start, 10 * start))
    assert mixture.error == pytest.approx(5, rel=0.15 if start > 5 else 0.4)
    probability = mixture.on_roads(distances)
    assert probability[~is_off].mean() > 0.7
    assert probability[is_off & (distances > 20)].sum() < 0.02 * max(is_off.sum(), 1)


def test_most_time_steps_are_on_roads():
    """A few that are very near by chance don't take all others off the roads."""
    normal = np.abs(np.random.default_rng(4).normal(0, 5, 600))
    distances = np.append(np.full(400, 0.01), normal)
    assert fit_mixture(distances, DistanceMixture(0.5, 6.0, 60.0)).error > 2


@pytest.mark.parametrize("distances", [np.full(3, np.nan), np.empty(0)])
def test_without_distances_the_mixture_stays(distances):
    start = DistanceMixture(0.5, 6.0, 60.0)
    assert fit_mixture(distances, start) == start
