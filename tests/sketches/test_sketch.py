from __future__ import annotations

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.model import Track
from gpszip.sketches.sketch import (
    best_line,
    build_sketch,
    delete_sample,
    empty_sketch,
    fitting_matrix,
    free_cost,
    insert_sample,
    line_cost,
    line_costs,
    merge_sketches,
)
from oracle import sketch as oracle


def random_track(seed, n=30, d=2, *, weighted=True, time=0.0, place=0.0):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.2, 3.0, n) if weighted else None
    return Track(
        "t",
        time + np.cumsum(rng.uniform(0.1, 2.0, n)),
        place + rng.normal(0, 5, (n, d)).cumsum(axis=0),
        weights=weights,
    )


def assert_same(a, b, scale=1e-9):
    for name in ("weight", "time", "place", "spread", "drift", "scatter"):
        x, y = np.asarray(getattr(a, name)), np.asarray(getattr(b, name))
        np.testing.assert_allclose(
            x, y, rtol=scale, atol=scale * (1 + np.abs(y).max()), err_msg=name
        )
    assert a.count == b.count


@pytest.mark.parametrize("d", [1, 2, 3, 5])
@pytest.mark.parametrize("weighted", [False, True])
def test_cost_and_fitting_matrix_equal_the_reference(d, weighted):
    track = random_track(d, d=d, weighted=weighted)
    weights = np.ones(len(track)) if track.weights is None else track.weights
    rng = np.random.default_rng(9)
    for _ in range(20):
        start, end, t0, t1 = (
            rng.normal(0, 20, d),
            rng.normal(0, 20, d),
            rng.uniform(-5, 5),
            rng.uniform(10, 50),
        )
        expected = oracle.fitting_matrix(track.times, track.positions, weights, start, end, t0, t1)
        block = build_sketch(track)
        np.testing.assert_allclose(
            fitting_matrix(block, start, end, t0, t1), expected, rtol=1e-9, atol=1e-6
        )
        assert line_cost(block, start, end, t0, t1) == pytest.approx(np.trace(expected), rel=1e-11)


def test_costs_of_many_lines_equal_the_reference():
    track, rng = random_track(4, d=3), np.random.default_rng(5)
    starts, ends = rng.normal(0, 9, (17, 3)), rng.normal(0, 9, (17, 3))
    block = build_sketch(track)
    expected = [
        np.trace(
            oracle.fitting_matrix(track.times, track.positions, track.weights, *pair, 1.0, 4.0)
        )
        for pair in zip(starts, ends, strict=True)
    ]
    np.testing.assert_allclose(line_costs(block, starts, ends, 1.0, 4.0), expected, rtol=1e-11)


def test_a_line_without_duration_stays_at_its_start():
    track = random_track(1)
    expected = (track.weights * ((track.positions - [1.0, 2.0]) ** 2).sum(axis=1)).sum()
    assert line_cost(build_sketch(track), [1.0, 2.0], [7.0, 7.0], 3.0, 3.0) == pytest.approx(
        expected
    )


def test_inserting_all_samples_gives_the_sketch_of_the_track():
    track = random_track(2, d=3)
    block = empty_sketch(3)
    for t, p, w in zip(track.times, track.positions, track.weights, strict=True):
        block = insert_sample(block, t, p, w)
    assert_same(block, build_sketch(track))
    assert (block.first, block.last) == (track.times[0], track.times[-1])


def test_deleting_the_first_samples_gives_the_sketch_of_the_rest():
    track = random_track(3)
    block = build_sketch(track)
    for i in range(len(track) - 1):
        block = delete_sample(
            block, track.times[i], track.positions[i], track.weights[i], first=track.times[i + 1]
        )
        assert_same(block, build_sketch(track, i + 1), 1e-8)
        assert block.first == track.times[i + 1]
    last = delete_sample(block, track.times[-1], track.positions[-1], track.weights[-1])
    assert (last.count, last.weight) == (0, 0.0)


def test_deleting_from_an_empty_block_is_refused():
    with pytest.raises(OptionError, match="can't be removed"):
        delete_sample(empty_sketch(2), 0.0, [0.0, 0.0])


@pytest.mark.parametrize("seed", range(5))
def test_merging_is_exact_in_any_order(seed):
    track = random_track(seed, d=2)
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(track) + 1, 4))
    blocks = [
        build_sketch(track, a, b) for a, b in zip([0, *cuts], [*cuts, len(track)], strict=True)
    ]
    forward, backward = blocks[0], blocks[-1]
    for block in blocks[1:]:
        forward = merge_sketches(forward, block)
    for block in blocks[-2::-1]:
        backward = merge_sketches(block, backward)
    assert_same(forward, build_sketch(track))
    assert_same(backward, build_sketch(track))


@pytest.mark.parametrize("d", [1, 3])
def test_the_best_line_is_least_squares_and_costs_least(d):
    track = random_track(6, d=d)
    block = build_sketch(track)
    np.testing.assert_allclose(
        best_line(block),
        oracle.best_line(track.times, track.positions, track.weights),
        rtol=1e-9,
        atol=1e-9,
    )
    least = line_cost(block, *best_line(block), block.first, block.last)
    assert free_cost(block) == pytest.approx(least, rel=1e-9)
    rng = np.random.default_rng(0)
    for _ in range(50):
        start, end = (point + rng.normal(0, 0.1, d) for point in best_line(block))
        assert line_cost(block, start, end, block.first, block.last) > least


def test_the_best_line_of_one_sample_is_a_point():
    start, end = best_line(build_sketch(Track("t", [5.0], [[1.0, 2.0]])))
    assert start.tolist() == end.tolist() == [1.0, 2.0]


def test_an_empty_block_has_no_best_line():
    with pytest.raises(OptionError, match="empty block"):
        best_line(build_sketch(random_track(0), 4, 4))


def test_costs_do_not_depend_on_the_origin():
    near = random_track(7, n=200)
    far = Track("t", near.times + 2**30, near.positions + 2**23, weights=near.weights)
    a, b = build_sketch(near), build_sketch(far)
    line = (near.positions[0], near.positions[-1], near.times[0], near.times[-1])
    shifted = (line[0] + 2**23, line[1] + 2**23, line[2] + 2**30, line[3] + 2**30)
    assert line_cost(b, *shifted) == pytest.approx(line_cost(a, *line), rel=1e-6)
