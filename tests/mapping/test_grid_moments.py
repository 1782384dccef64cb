import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calling import from_python
from gpszip.mapping.kernels.grid_moments import (
    best_line_cost,
    prefix_sums,
    segment_costs,
    segment_moments,
)
from oracle import moments as plain

# Inner kernels, as Python calls them.
best_line_cost = from_python(best_line_cost)

UNIT = 64.0


class Log:
    """Samples in ticks, slots over them, and the segments between all pairs of slots."""

    def __init__(self, seed, dimension, samples=60, slots=12, shift_t=0, shift_x=0, weighted=False):
        rng = np.random.default_rng(seed)
        self.times = np.sort(rng.integers(0, 256 * (slots - 1), samples))
        self.positions = np.cumsum(rng.integers(-300, 300, (samples, dimension)), axis=0)
        self.weights = rng.integers(1, 9, samples) if weighted else np.ones(samples, np.int64)
        self.ticks = 256 * np.arange(slots)
        self.ends = np.searchsorted(self.times, self.ticks)
        self.ends[-1] = samples
        self.centers = self.positions[np.minimum(self.ends, samples - 1)] + rng.integers(
            -50, 50, (slots, dimension)
        )
        self.first_slots, self.last_slots = (
            index.astype(np.int64) for index in np.triu_indices(slots, 1)
        )
        self.starts, self.stops = rng.normal(0, 50, (2, len(self.first_slots), dimension))
        self.shift = shift_t, shift_x

    def segments(self):
        """Moments and the lines' costs, all shifted."""
        t, x = self.shift
        sums = prefix_sums(self.times + t, self.positions + x, self.weights, self.ends)
        moments = segment_moments(
            sums, self.first_slots, self.last_slots, self.ticks + t, self.centers + x, UNIT
        )
        return moments, segment_costs(
            moments, self.starts, self.stops, self.centers[self.first_slots] / UNIT
        )


@given(st.integers(0, 10_000), st.integers(1, 4), st.booleans())
def test_costs_are_sums_over_samples(seed, dimension, weighted):
    log = Log(seed, dimension, weighted=weighted)
    moments, costs = log.segments()
    for row, cost, a, b, start, end in zip(
        moments, costs, log.first_slots, log.last_slots, log.starts, log.stops, strict=True
    ):
        inside = list(plain.segment_samples(log.ends, a, b))
        t, x, w = log.times[inside], log.positions[inside] / UNIT, log.weights[inside]
        assert row[0] == w.sum()
        assert cost == pytest.approx(
            plain.line_cost(t, x, w, start, end, log.ticks[a], log.ticks[b]), rel=1e-9, abs=1e-6
        )
        if len(set(t.tolist())) > 1:
            best = best_line_cost(*row[:4], row[4 : 4 + dimension], row[4 + dimension :])
            assert best == pytest.approx(
                plain.best_line_cost(t.astype(float), x, w), rel=1e-6, abs=1e-4
            )
            assert best <= cost + 1e-6


@pytest.mark.parametrize("shift_t", [0, 256 * 10**9, -(2**45), 2**61])
@pytest.mark.parametrize("shift_x", [0, 64 * 10**9, -(2**50), 2**62 + 12345])
def test_a_shift_changes_no_bit_even_where_sums_wrap(shift_t, shift_x):
    original, shifted = Log(3, 3), Log(3, 3, shift_t=shift_t, shift_x=shift_x)
    for first, second in zip(original.segments(), shifted.segments(), strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_weight_counts_like_repeated_samples():
    log = Log(5, 2, weighted=True)
    heavy, costs = log.segments()
    log.times, log.positions = (
        np.repeat(log.times, log.weights),
        np.repeat(log.positions, log.weights, axis=0),
    )
    log.ends = np.concatenate([[0], np.cumsum(log.weights)])[log.ends]
    log.weights = np.ones(len(log.times), np.int64)
    for first, second in zip((heavy, costs), log.segments(), strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_segment_without_samples_costs_nothing():
    sums = prefix_sums(np.array([5]), np.array([[9]]), np.ones(1, np.int64), np.array([0, 0, 1]))
    moments = segment_moments(
        sums,
        np.array([0]),
        np.array([1]),
        np.array([0, 256, 512]),
        np.zeros((3, 1), np.int64),
        UNIT,
    )
    assert segment_costs(moments, np.array([[3.0]]), np.array([[4.0]]), np.zeros((1, 1)))[0] == 0
    assert best_line_cost(*moments[0, :4], moments[0, 4:5], moments[0, 5:]) == 0
