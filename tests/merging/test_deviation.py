import math

import numpy as np
import pytest

from gpszip.merging.deviation import (
    Curve,
    measure_deviation,
    sample_curve,
    sample_weighted,
    split_at_gaps,
)
from gpszip.model import Track, Walk


def random_curve(rng, knots, gaps=0.2):
    times = np.cumsum(rng.uniform(0.5, 9, knots))
    return Curve(
        Track("a", times, np.cumsum(rng.normal(0, 5, (knots, 2)), axis=0)),
        rng.random(knots - 1) < gaps,
    )


def covering_walk(rng, curve, knots):
    """A walk over other knots, without gaps."""
    inner = np.sort(rng.uniform(curve.track.times[0], curve.track.times[-1], knots))
    times = np.unique(np.concatenate([curve.track.times[[0, -1]], inner]))
    return Walk(
        "a", np.arange(len(times), dtype=np.int32), times, np.zeros(len(times) - 1, bool)
    ), rng.normal(0, 20, (len(times), 2))


@pytest.mark.parametrize("seed", range(30))
def test_the_deviation_is_that_of_densely_sampled_curves(seed):
    rng = np.random.default_rng(seed)
    curve = random_curve(rng, 8)
    walk, nodes = covering_walk(rng, curve, 6)
    deviation = measure_deviation([curve], [walk], nodes)
    squares, spans = [], []
    for first, after in split_at_gaps(curve.gaps):
        times = curve.track.times[first:after]
        samples = np.unique(np.concatenate([np.linspace(times[0], times[-1], 20_001), times]))
        offsets = np.stack(
            [
                np.interp(samples, walk.times, nodes[:, axis])
                - np.interp(samples, times, curve.track.positions[first:after, axis])
                for axis in range(2)
            ],
            axis=1,
        )
        squares.append((offsets**2).sum(axis=1))
        spans.append(np.gradient(samples) if len(samples) > 1 else np.zeros(1))
    largest = math.sqrt(max(values.max() for values in squares))
    assert largest <= deviation.maximum * (1 + 1e-9)
    assert deviation.maximum == pytest.approx(largest, rel=2e-3)
    total = sum(
        curve.track.times[after - 1] - curve.track.times[first]
        for first, after in split_at_gaps(curve.gaps)
    )
    mean = (
        sum(float((values * span).sum()) for values, span in zip(squares, spans, strict=True))
        / total
    )
    assert deviation.rms >= math.sqrt(mean) * (1 - 2e-3)


def test_a_gap_of_the_walk_within_a_piece_is_an_infinite_deviation():
    curve = Curve(Track("a", [0, 10], [[0.0], [1.0]]), np.zeros(1, bool))
    walk = Walk(
        "a", np.zeros(4, np.int32), np.array([0.0, 4.0, 5.0, 10.0]), np.array([False, True, False])
    )
    assert measure_deviation([curve], [walk], np.zeros((1, 1))).maximum == math.inf
    without_gap = Walk("a", walk.nodes, walk.times, np.zeros(3, bool))
    assert measure_deviation([curve], [without_gap], np.zeros((1, 1))).maximum == 1.0
    late = Walk("a", np.zeros(2, np.int32), np.array([1.0, 10.0]), np.array([False]))
    assert measure_deviation([curve], [late], np.zeros((1, 1))).maximum == math.inf


def test_sampled_points_are_on_the_curve_and_none_in_its_gaps():
    rng = np.random.default_rng(5)
    curve = random_curve(rng, 12, gaps=0.4)
    dense = sample_curve(curve)
    assert np.isin(curve.track.times, dense.track.times).all()
    for axis in range(2):
        np.testing.assert_allclose(
            dense.track.positions[:, axis],
            np.interp(dense.track.times, curve.track.times, curve.track.positions[:, axis]),
            atol=1e-9,
        )
    assert int(dense.gaps.sum()) == int(curve.gaps.sum())
    np.testing.assert_array_equal(
        dense.track.times[:-1][dense.gaps], curve.track.times[:-1][curve.gaps]
    )
    np.testing.assert_array_equal(
        dense.track.times[1:][dense.gaps], curve.track.times[1:][curve.gaps]
    )
    assert len(dense.track) == 12 + 3 * int((~curve.gaps).sum())


def test_weights_are_in_proportion_to_time():
    curve = Curve(
        Track("a", [0.0, 10.0, 40.0, 100.0], [[0.0], [3.0], [3.0], [9.0]]),
        np.array([False, False, True]),
    )
    (points,) = sample_weighted([curve], 0.0)
    assert points.track.weights.mean() == pytest.approx(1.0, abs=0.01)
    weights = points.track.weights / points.track.weights.sum()
    assert weights[points.track.times < 10].sum() + weights[
        points.track.times == 10
    ] / 4 == pytest.approx(0.25, abs=0.01)
    assert weights[-1] < 0.001


def test_knots_have_the_given_share_of_the_weight():
    curve = Curve(Track("a", [0.0, 10.0, 40.0], [[0.0], [3.0], [3.0]]), np.zeros(2, bool))
    (all_at_knots,) = sample_weighted([curve], 1.0)
    inside = ~np.isin(all_at_knots.track.times, curve.track.times)
    assert all_at_knots.track.weights[inside].sum() < 0.01 * all_at_knots.track.weights.sum()
    assert np.ptp(all_at_knots.track.weights[~inside]) == pytest.approx(0.0)


def test_deviations_at_knots_count_by_their_share():
    curve = Curve(
        Track("a", [0.0, 2.0, 4.0], [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.zeros(2, bool)
    )
    walk = Walk("a", np.array([0, 1, 0], np.int32), np.array([0.0, 2.0, 4.0]), np.zeros(2, bool))
    nodes = np.array([[3.0, 0.0], [0.0, 0.0]])
    in_time, in_knots = 3.0, 6.0
    for share in (0.0, 0.25, 1.0):
        deviation = measure_deviation([curve], [walk], nodes, share).rms
        assert deviation**2 == pytest.approx((1 - share) * in_time + share * in_knots)
