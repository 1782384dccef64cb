"""Stops that lie together are one place."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.history.stays.places import group_stops


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_groups_of_any_stops(seed, n):
    rng = np.random.default_rng(seed)
    homes = rng.uniform(-5000, 5000, (4, 2))
    positions = homes[rng.integers(0, 4, n)] + rng.normal(0, rng.choice([5, 60, 400]), (n, 2))
    weights, noise = np.exp(rng.uniform(0, 10, n)), np.exp(rng.uniform(1, 5, n))
    label, centres = group_stops(positions, weights, noise, 100.0)

    # Numbers are by weight, and all are in use; centres are means.
    mass = np.bincount(label, weights)
    assert (mass > 0).all() and (np.diff(mass) <= 1e-6 * mass[0]).all()
    for number, centre in enumerate(centres):
        rows = label == number
        exact = weights[rows] / noise[rows] ** 2
        mean = np.average(positions[rows], axis=0, weights=exact)
        np.testing.assert_allclose(centre, mean, atol=1e-6)

    # The order of stops doesn't count.
    order = rng.permutation(n)
    again, moved = group_stops(positions[order], weights[order], noise[order], 100.0)
    np.testing.assert_array_equal(again, label[order])
    np.testing.assert_allclose(moved, centres, atol=1e-6)


def test_places_of_well_separated_stops():
    rng = np.random.default_rng(2)
    homes = np.array([[0.0, 0.0], [400.0, 0.0], [0.0, 900.0]])
    truth = rng.integers(0, 3, 90)
    positions = homes[truth] + rng.normal(0, 15, (90, 2))
    label, centres = group_stops(positions, np.ones(90), np.full(90, 10.0), 100.0)
    assert len(centres) == 3
    np.testing.assert_allclose(centres[label], homes[truth], atol=12)


def test_an_uncertain_stop_makes_no_place_of_its_own():
    stops = [[0.0, 0.0], [400.0, 0.0], [9000.0, 0.0]]
    label, centres = group_stops(stops, [10, 500, 50], [10, 600, 600], 100.0)
    assert label.tolist() == [0, 0, 1]
    assert abs(centres[0, 0]) < 10


def test_no_stops():
    label, centres = group_stops(np.zeros((0, 2)), [], [], 100.0)
    assert len(label) == len(centres) == 0
