"""For any track: tau never rises, and every part and label is accounted for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation import estep
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.mstep import maximize
from gpszip.segmentation.state import EMState, total_cost
from oracle import segmentation as oracle
from random_tests import examples


@st.composite
def problems(draw):
    """A track on a coarse grid, so that ties, stops and repeats are common, with k and m."""
    n, d = draw(st.integers(1, 18)), draw(st.integers(1, 3))
    steps = draw(
        st.lists(st.sampled_from([0.001, 0.5, 1.0, 1.0, 1.0, 60.0]), min_size=n, max_size=n)
    )
    positions = draw(
        st.lists(
            st.lists(st.sampled_from([0.0, 1.0, 2.0, -3.5, 100.0]), min_size=d, max_size=d),
            min_size=n,
            max_size=n,
        )
    )
    weights = draw(
        st.none() | st.lists(st.sampled_from([0.01, 1.0, 2.0, 500.0]), min_size=n, max_size=n)
    )
    k = draw(st.integers(1, n))
    return Track("t", np.cumsum(steps), positions, weights=weights), k, draw(st.integers(1, k))


@examples(100)
@given(
    problems(),
    st.sampled_from(["bottom-up", "douglas-peucker"]),
    st.sampled_from(["odd-even", "linear", "naive", "exact"]),
)
def test_tau_descends_to_the_reference_cost(problem, initial, expectation):
    track, k, m = problem
    mean = segment_mean(track, k, m, initial=initial, expectation=expectation)
    assert (mean.k, mean.m) == (k, m)
    assert (np.diff(mean.costs) <= 0).all()
    assert np.diff(mean.boundaries).min() >= 1
    scale = 1 + (track.positions**2).sum() * (1 if track.weights is None else track.weights.max())
    assert mean.cost == pytest.approx(
        oracle.cost(track, mean.boundaries, mean.labels, mean.starts, mean.ends),
        rel=1e-6,
        abs=1e-9 * scale,
    )


@examples(100)
@given(problems(), st.integers(0, 2**32 - 1))
def test_no_single_step_raises_tau(problem, seed):
    track, k, m = problem
    rng, sums = np.random.default_rng(seed), track_sums(track)
    boundaries = np.array(
        [0, *np.sort(rng.choice(np.arange(1, len(track)), k - 1, replace=False)), len(track)],
        dtype=np.int64,
    )
    points = rng.choice([0.0, 1.0, 2.0], (2, m, track.dimension)) / sums.position_tick
    state = EMState(boundaries, rng.integers(0, m, k).astype(np.int32), *points)
    scale = sums.w.sum() * (1 + np.square(np.abs(sums.p).max() + np.abs(points).max()))
    for step in (estep.naive, estep.linear, estep.odd_even, estep.exact, maximize):
        assert total_cost(sums, step(sums, state)) <= total_cost(sums, state) + 1e-13 * scale
    naive, linear = estep.naive(sums, state), estep.linear(sums, state)
    assert naive.boundaries.tolist() == linear.boundaries.tolist()
    assert naive.labels.tolist() == linear.labels.tolist()
