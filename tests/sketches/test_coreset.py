"""Guarantees of the coreset: exact at edges, bounds anywhere, least cost of k segments, eps."""

import numpy as np
import pytest

from gpszip import OptionError, SegmentMean, Track, coreset
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.pieces import PiecewiseLinear, from_segment_mean, polyline
from gpszip.testing.patrol import patrol
from oracle.coreset import best_cost, exact_cost, float_cost, free_cost, greedy_cuts

WALK = patrol(3000, seed=4)


def ones(track):
    return np.ones(len(track))


def bends(n=240, seed=3):
    rng = np.random.default_rng(seed)
    t = np.arange(float(n))
    return Track(
        "bends", t, np.stack([np.abs(t % 60 - 30), t / 9], axis=1) + rng.normal(0, 0.2, (n, 2))
    )


def test_the_cost_is_exact_for_breaks_at_block_edges():
    small = coreset(WALK, size=40)
    rng = np.random.default_rng(1)
    edges = small.edges[::5]
    positions = rng.normal(0, 9, (len(edges), 2))
    f = PiecewiseLinear(
        edges[:, 0],
        np.append(small.edges[4::5], small.edges[-1:], axis=0)[: len(edges), 1],
        positions,
        positions + 3,
    )
    cost = small.cost(f)
    expected = float_cost(WALK.times, WALK.positions, ones(WALK), f)
    assert cost.estimate == pytest.approx(expected, rel=1e-12)
    assert cost.upper - cost.lower < 1e-8 * expected
    assert cost.lower <= expected <= cost.upper


def test_the_bounds_hold_for_a_segment_mean():
    from gpszip.segmentation.em import segment_mean

    mean = segment_mean(WALK, 12, 6)
    cost = coreset(WALK, size=300).cost(mean, times=WALK.times)
    assert cost.lower <= mean.cost <= cost.upper
    assert cost.estimate == pytest.approx(mean.cost, rel=0.01)


def test_a_segment_mean_at_block_edges_needs_no_times():
    small = coreset(WALK, size=10)
    cuts = np.concatenate([[0], np.cumsum(small.counts)])[[0, 3, 7, 10]]
    mean = SegmentMean(cuts, np.array([0, 1, 0], np.int32), np.zeros((2, 2)), np.ones((2, 2)), 0.0)
    assert small.cost(mean).estimate == small.cost(from_segment_mean(mean, WALK.times)).estimate
    shifted = SegmentMean(cuts + np.array([0, 1, 0, 0]), mean.labels, mean.starts, mean.ends, 0.0)
    with pytest.raises(OptionError, match="times of the samples"):
        small.cost(shifted)


@pytest.mark.parametrize("outliers", [1, 5, 50])
@pytest.mark.parametrize("even", [True, False])
def test_the_bounds_hold_for_outliers_at_block_ends(outliers, even):
    track = bends(900) if even else WALK
    small = coreset(track, size=30)
    for block in (0, 7, 29):
        a, b = small.edges[block]
        knots = np.unique(
            np.concatenate(
                [
                    [track.times[0]],
                    np.linspace(b - 0.15 * (b - a), b, outliers + 1),
                    [track.times[-1]],
                ]
            )
        )
        low = np.interp(knots, track.times, track.positions[:, 0])
        positions = np.stack([low, np.where(np.arange(len(knots)) % 2, 5.0, -5.0)], axis=1)
        f = polyline(knots, positions)
        expected = exact_cost(track.times, track.positions, ones(track), f)
        cost = small.cost(f)
        assert cost.lower <= expected <= cost.upper
        assert cost.upper - cost.lower < 0.8 * expected


def test_the_cost_is_exact_for_even_times_on_a_line():
    track = Track("straight", np.arange(100.0), np.stack([np.arange(100.0)] * 2, axis=1))
    f = polyline([0, 33.3, 71.9, 99], [[0, 5], [40, 0], [60, 90], [99, 99]])
    cost = coreset(track, size=1).cost(f)
    expected = float_cost(track.times, track.positions, ones(track), f)
    assert cost.lower == pytest.approx(expected, rel=1e-9)
    assert cost.upper == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("size", [3, 12, 30])
def test_least_cost_is_a_lower_bound(k, size):
    for track in (
        bends(48),
        Track("noise", np.arange(48.0), np.random.default_rng(k).normal(0, 1, (48, 1))),
    ):
        assert coreset(track, size=size).least_cost(k) <= best_cost(
            track.times, track.positions, ones(track), k
        ) * (1 + 1e-9)


def test_least_cost_is_a_fifth_of_the_optimum_or_more():
    track = bends(60)
    assert coreset(track, size=24).least_cost(3) > 0.2 * best_cost(
        track.times, track.positions, ones(track), 3
    )


@pytest.mark.parametrize(("k", "eps"), [(2, 0.5), (4, 0.5), (4, 0.2), (1, 0.1)])
def test_the_estimate_of_any_k_segment_is_within_eps(k, eps):
    track = Track("even", np.arange(1500.0), bends(1500).positions)
    small = coreset(track, k=k, eps=eps)
    assert len(small) < len(track)
    rng = np.random.default_rng(7)
    for _ in range(60):
        knots = np.sort(
            rng.choice(track.times[1:-1], k - 1, replace=False)
            + rng.choice([0.0, 0.5, 0.25], k - 1)
        )
        knots = np.concatenate([[0], knots, [1499]])
        on_track = np.stack(
            [np.interp(knots, track.times, axis) for axis in track.positions.T], axis=1
        )
        f = polyline(knots, on_track + rng.normal(0, rng.choice([0, 0.5, 20]), on_track.shape))
        expected = float_cost(track.times, track.positions, ones(track), f)
        assert abs(small.cost(f).estimate - expected) <= eps * expected


@pytest.mark.parametrize("k", [1, 2, 4, 20, 100, 400])
@pytest.mark.parametrize("eps", [0.03, 0.5, 0.99])
def test_eps_of_the_coreset_is_at_most_the_given_eps(k, eps):
    for track in (bends(1500), WALK):
        small = coreset(track, k=k, eps=eps)
        assert small.eps(k) <= eps
        assert len(small) <= (len(track) + 1) // 2


def test_eps_is_infinite_for_too_few_blocks():
    assert coreset(bends(1500), size=4).eps(40) == np.inf


def test_blocks_become_finer_until_they_keep_eps():
    from gpszip.sketches.partition import blocks_under_cost, max_block_cost

    track = bends(1500)
    first = blocks_under_cost(track, max_block_cost(track, 2, 0.99))
    first_coreset = Coreset((track.id,), np.zeros(len(first), np.int64), first)
    assert first_coreset.eps(2) > 0.99, "the first blocks are fine enough; choose another track"
    assert len(first) < len(coreset(track, k=2, eps=0.99)) < 1.5 * len(first)


@pytest.mark.parametrize("line", [np.arange(300.0), np.abs(np.arange(300.0) - 150), np.zeros(300)])
def test_tracks_that_k_segments_fit_exactly_keep_eps(line):
    small = coreset(Track("exact", np.arange(300.0), line[:, None]), k=5, eps=0.1)
    assert small.eps(5) <= 0.1
    assert small.samples == 300


def test_uneven_times_are_reported():
    even, odd = bends(100), Track("odd", np.arange(100.0) ** 1.1, bends(100).positions)
    assert not coreset(even, size=9).uneven.any()
    assert coreset(odd, size=9).uneven.all()
    epoch = Track("epoch", np.arange(100) * 0.1 + 1.7e9, bends(100).positions)
    assert not coreset(epoch, size=9).uneven.any()


def test_free_costs_equal_the_reference():
    small = coreset(WALK, size=9)
    cuts = np.concatenate([[0], np.cumsum(small.counts)])
    for cost, a, b in zip(small.free_costs, cuts[:-1], cuts[1:], strict=True):
        assert cost == pytest.approx(
            free_cost(WALK.times[a:b], WALK.positions[a:b], np.ones(b - a)), rel=1e-9
        )
    assert small.samples == len(WALK)
    assert small.rmse == pytest.approx(np.sqrt(small.free_costs.sum() / len(WALK)))


def test_the_balanced_partition_equals_the_greedy_reference():
    from gpszip.kernels.sums import track_sums
    from gpszip.sketches.partition import _balanced_cuts

    track = bends(200)
    for limit in (0.5, 3.0, 40.0, 1e9):
        assert _balanced_cuts(track_sums(track), limit).tolist() == greedy_cuts(
            track.times, track.positions, ones(track), limit
        )


def test_the_size_is_shared_by_all_tracks():
    other = Track("other", np.arange(5.0), np.zeros((5, 2)))
    small = coreset([bends(), other], size=12)
    assert len(small) <= 12
    assert small.tracks == ("bends", "other")
    assert small.track("other").samples == 5
    assert small.cost(polyline([0, 4], [[1, 0], [1, 0]]), track="other").estimate == pytest.approx(
        5
    )
    with pytest.raises(OptionError, match="name one of these"):
        small.cost(polyline([0, 4], [[1, 0], [1, 0]]))


def test_free_costs_do_not_depend_on_the_origin():
    track = bends()
    shifted_track = Track("bends", track.times + 1.7e9, track.positions + np.array([5e6, 4e5]))
    assert coreset(shifted_track, size=20).free_costs == pytest.approx(
        coreset(track, size=20).free_costs, rel=1e-5
    )


def test_weights_count_like_repeated_samples():
    track = bends(100)
    heavy = Track("heavy", track.times, track.positions, np.full(100, 3.0))
    f = polyline([0, 40, 99], [[0, 0], [9, 9], [0, 5]])
    assert coreset(heavy, size=7).cost(f).estimate == pytest.approx(
        3 * coreset(track, size=7).cost(f).estimate
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give size"),
        ({"k": 3}, "k and eps together"),
        ({"eps": 0.5}, "k and eps together"),
        ({"size": 3, "max_bytes": 9000}, "give size"),
        ({"size": 0}, "size is 0"),
        ({"k": 0, "eps": 0.5}, "k is 0"),
        ({"k": 2, "eps": 1.5}, "between 0 and 1"),
        ({"max_bytes": 10}, "too few"),
    ],
)
def test_size_options_out_of_range_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        coreset(bends(), **options)


def test_invalid_functions_and_tracks_are_refused():
    small = coreset(bends(), size=5)
    with pytest.raises(OptionError, match="1 coordinates, the coreset 2"):
        small.cost(polyline([0, 1], [[0], [1]]))
    with pytest.raises(OptionError, match="follow each other"):
        polyline([0, 2, 1], [[0, 0]] * 3)
    with pytest.raises(OptionError, match="not finite"):
        polyline([0, 2], [[0, 0], [np.nan, 0]])
    with pytest.raises(OptionError, match="same id"):
        coreset([bends(), bends()], size=5)
