"""Simplifiers against their definitions, written as plainly as possible."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip import Track
from gpszip.experiments.peers import libraries
from gpszip.experiments.peers.by_halves import significances
from gpszip.experiments.peers.by_removal import (
    effective_areas,
    merge_costs,
    squish_priorities,
    sttrace,
)
from gpszip.experiments.peers.by_windows import dead_reckoning, opening_window
from gpszip.experiments.peers.least_squares import fit_line


def walk(seed, count=40, dimension=2):
    """A random walk at uneven times; no two distances are the same."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 2.0, count))
    return Track("a", times, np.cumsum(rng.normal(0, 1, (count, dimension)), axis=0))


def at_time(track, a, b, i):
    share = (track.times[i] - track.times[a]) / (track.times[b] - track.times[a])
    return track.positions[a] + share * (track.positions[b] - track.positions[a])


def sed(track, a, i, b):
    return math.dist(track.positions[i], at_time(track, a, b, i))


def to_segment(track, a, i, b):
    """Distance from a segment, as the least of many points on it."""
    shares = np.linspace(0, 1, 20_001)[:, None]
    points = track.positions[a] + shares * (track.positions[b] - track.positions[a])
    return np.linalg.norm(points - track.positions[i], axis=1).min()


def halves(track, distance, tolerance, a, b):
    """Samples that Douglas-Peucker keeps between a and b."""
    if b - a < 2:
        return []
    distances = [distance(track, a, i, b) for i in range(a + 1, b)]
    farthest = a + 1 + int(np.argmax(distances))
    if max(distances) <= tolerance:
        return []
    left = halves(track, distance, tolerance, a, farthest)
    return [*left, farthest, *halves(track, distance, tolerance, farthest, b)]


seeds = st.integers(0, 10_000)
tolerances = st.floats(0.1, 4.0)


@given(seeds, tolerances, st.sampled_from([2, 3]))
def test_td_tr_keeps_what_recursion_keeps(seed, tolerance, dimension):
    track = walk(seed, dimension=dimension)
    expected = [0, *halves(track, sed, tolerance, 0, len(track) - 1), len(track) - 1]
    kept = np.flatnonzero(significances(track, by_time=True) > tolerance)
    assert kept.tolist() == expected


@pytest.mark.parametrize("seed", range(4))
def test_douglas_peucker_keeps_what_recursion_keeps(seed):
    track = walk(seed)
    expected = [0, *halves(track, to_segment, 1.0, 0, len(track) - 1), len(track) - 1]
    kept = np.flatnonzero(significances(track, by_time=False) > 1.0)
    assert kept.tolist() == expected


def eliminated(track, cost, adds):
    """Largest cost up to the removal of each sample, by looking for the cheapest each time."""
    left, found = list(range(len(track))), np.full(len(track), np.inf)
    added, largest = np.zeros(len(track)), 0.0
    while len(left) > 2:
        costs = [
            added[q] + cost(track, a, q, b)
            for a, q, b in zip(left, left[1:], left[2:], strict=False)
        ]
        at = int(np.argmin(costs)) + 1
        largest = max(largest, costs[at - 1])
        found[left[at]] = largest
        if adds:
            for side in (left[at - 1], left[at + 1]):
                added[side] = max(added[side], costs[at - 1])
        left.pop(at)
    return found


def triangle(track, a, q, b):
    """Area by Heron's formula."""
    p = track.positions
    sides = math.dist(p[a], p[q]), math.dist(p[q], p[b]), math.dist(p[a], p[b])
    half = sum(sides) / 2
    return math.sqrt(max(half * math.prod(half - side for side in sides), 0.0))


@given(seeds, st.sampled_from([2, 3]))
def test_visvalingam_removes_the_smallest_triangles(seed, dimension):
    track = walk(seed, dimension=dimension)
    assert effective_areas(track) == pytest.approx(
        eliminated(track, triangle, adds=False), abs=1e-6
    )


@given(seeds)
def test_squish_removes_the_lowest_priorities(seed):
    track = walk(seed)
    assert squish_priorities(track) == pytest.approx(eliminated(track, sed, adds=True))


@given(seeds, tolerances)
def test_squish_bounds_the_error(seed, tolerance):
    track = walk(seed)
    kept = np.flatnonzero(squish_priorities(track) > tolerance)
    for a, b in zip(kept, kept[1:], strict=False):
        assert all(sed(track, a, i, b) <= tolerance + 1e-9 for i in range(a + 1, b))


@given(seeds, st.integers(2, 45))
def test_sttrace_drops_the_sample_nearest_to_its_neighbours_line(seed, size):
    track, buffer = walk(seed), []
    for new in range(len(track)):
        buffer.append(new)
        if len(buffer) > size:
            costs = [
                sed(track, *three) for three in zip(buffer, buffer[1:], buffer[2:], strict=False)
            ]
            buffer.pop(int(np.argmin(costs)) + 1)
    assert sttrace(track, size).tolist() == buffer


@given(seeds, tolerances, st.integers(2, 90))
def test_the_window_opens_until_a_sample_is_too_far(seed, tolerance, longest):
    track, kept = walk(seed, 80), [0]
    while kept[-1] < len(track) - 1:
        a, end = kept[-1], kept[-1] + 1
        while end < min(a + longest, len(track) - 1):
            if any(sed(track, a, i, end + 1) > tolerance for i in range(a + 1, end + 1)):
                break
            end += 1
        kept.append(end)
    assert opening_window(track, tolerance, longest).tolist() == kept


@given(seeds, tolerances)
def test_dead_reckoning_sends_what_it_did_not_predict(seed, tolerance):
    track, sent = walk(seed, 80), [0]
    for i in range(2, len(track)):
        last = sent[-1]
        if i < last + 2:
            continue
        velocity = (track.positions[last + 1] - track.positions[last]) / (
            track.times[last + 1] - track.times[last]
        )
        predicted = track.positions[last] + (track.times[i] - track.times[last]) * velocity
        if math.dist(predicted, track.positions[i]) > tolerance:
            sent.append(i)
    if sent[-1] != len(track) - 1:
        sent.append(len(track) - 1)
    assert dead_reckoning(track, tolerance).tolist() == sent


def test_vertices_have_the_least_squares():
    track, kept = walk(5, 60), np.array([0, 11, 30, 31, 59])
    knots = track.times[kept]
    hats = np.array([np.interp(track.times, knots, row) for row in np.eye(5)]).T
    expected = np.linalg.lstsq(hats, track.positions, rcond=None)[0]
    assert fit_line(track, kept).positions == pytest.approx(expected, abs=0.05)


def test_bottom_up_finds_the_corners_of_a_noisy_course():
    corners = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [0.0, 80.0]])
    times = np.arange(300.0)
    positions = np.column_stack([np.interp(times, [0, 100, 180, 299], axis) for axis in corners.T])
    track = Track("a", times, positions + np.random.default_rng(1).normal(0, 0.5, (300, 2)))
    kept = np.sort(np.argsort(merge_costs(track))[-4:])
    assert fit_line(track, kept).positions == pytest.approx(corners, abs=2.5)


def merging(track, a, q, b):
    """Squared distances that one line in place of two adds."""
    one = sum(sed(track, a, i, b) ** 2 for i in range(a, b + 1))
    left = sum(sed(track, a, i, q) ** 2 for i in range(a, q + 1))
    return one - left - sum(sed(track, q, i, b) ** 2 for i in range(q, b + 1))


@given(seeds, st.sampled_from([2, 3]))
def test_bottom_up_merges_what_adds_least(seed, dimension):
    # Far from the first time and place sums are exact, too.
    rough = walk(seed, 14, dimension)
    times, positions = rough.times.round(3), rough.positions.round(3)
    times[1:], positions[1:] = times[1:] + 1e7, positions[1:] + 1e4
    track = Track("a", times, positions)
    expected = eliminated(track, merging, adds=False)
    assert merge_costs(track) == pytest.approx(expected, rel=1e-6, abs=1e-3)


@pytest.mark.parametrize(
    ("package", "keep", "own", "tolerance"),
    [
        ("shapely", libraries.shapely_simplify, lambda t: significances(t, by_time=False), 0.8),
        (
            "simplification",
            libraries.vw_and_rdp("simplify_coords_idx"),
            lambda t: significances(t, by_time=False),
            0.8,
        ),
        ("simplification", libraries.vw_and_rdp("simplify_coords_vw_idx"), effective_areas, 0.9),
        (
            "movingpandas",
            libraries.movingpandas_td_tr,
            lambda t: significances(t, by_time=True),
            0.8,
        ),
    ],
)
def test_packages_keep_the_same_samples(package, keep, own, tolerance):
    if not libraries.is_installed(package):
        pytest.skip(f"{package} is not installed")
    track = walk(9, 120)
    assert keep(track, tolerance).tolist() == np.flatnonzero(own(track) > tolerance).tolist()
