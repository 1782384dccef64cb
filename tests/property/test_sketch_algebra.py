"""For any blocks: merging equals the sketch of all samples, and deleting undoes inserting."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import Track
from gpszip.sketches.sketch import (
    build_sketch,
    delete_sample,
    fitting_matrix,
    free_cost,
    insert_sample,
    line_cost,
    line_costs,
    merge_sketches,
)
from random_tests import examples

numbers = st.floats(-1e3, 1e3, allow_subnormal=False)


@st.composite
def tracks(draw):
    n, d = draw(st.integers(1, 12)), draw(st.integers(1, 3))
    times = np.cumsum(draw(st.lists(st.floats(0.01, 100), min_size=n, max_size=n)))
    positions = draw(st.lists(st.lists(numbers, min_size=d, max_size=d), min_size=n, max_size=n))
    weights = draw(st.none() | st.lists(st.floats(0.1, 10), min_size=n, max_size=n))
    return Track("t", times, positions, weights=weights)


def lines(track, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1e3, 1e3, (2, 4, track.dimension))


@examples(100)
@given(tracks(), st.integers(0, 12), st.integers(0, 99))
def test_merged_blocks_have_the_costs_of_one_block(track, cut, seed):
    cut = min(cut, len(track))
    expected = build_sketch(track)
    merged = merge_sketches(build_sketch(track, 0, cut), build_sketch(track, cut))
    starts, ends = lines(track, seed)
    np.testing.assert_allclose(
        line_costs(merged, starts, ends, 0.0, 50.0),
        line_costs(expected, starts, ends, 0.0, 50.0),
        rtol=1e-8,
        atol=1e-4,
    )
    assert (merged.first, merged.last, merged.count) == (
        expected.first,
        expected.last,
        expected.count,
    )


@examples(100)
@given(
    tracks(), st.floats(-500, 500), st.lists(numbers, min_size=3, max_size=3), st.floats(0.1, 10)
)
def test_deleting_undoes_inserting(track, time, position, weight):
    block, position = build_sketch(track), position[: track.dimension]
    restored = delete_sample(
        insert_sample(block, time, position, weight),
        time,
        position,
        weight,
        first=block.first,
        last=block.last,
    )
    starts, ends = lines(track, 1)
    np.testing.assert_allclose(
        line_costs(restored, starts, ends, 0.0, 50.0),
        line_costs(block, starts, ends, 0.0, 50.0),
        rtol=1e-6,
        atol=1e-2,
    )
    assert (restored.first, restored.last, restored.count) == (block.first, block.last, block.count)


@examples(100)
@given(tracks(), st.integers(0, 99))
def test_the_fitting_matrix_is_symmetric_and_its_trace_is_the_cost(track, seed):
    (start, *_), (end, *_) = lines(track, seed)
    block = build_sketch(track)
    matrix = fitting_matrix(block, start, end, 0.0, 10.0)
    np.testing.assert_allclose(matrix, matrix.T)
    cost = line_cost(block, start, end, 0.0, 10.0)
    np.testing.assert_allclose(np.trace(matrix), cost, rtol=1e-9, atol=1e-6)
    assert free_cost(block) <= cost * (1 + 1e-9) + 1e-6
