from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gpszip.errors import BoundError
from gpszip.mapping.initial_map import walks_of
from gpszip.mapping.time_grid import (
    build_time_grid,
    count_slots,
    mask_near_knots,
    place_walks,
    reweight_samples,
    select_samples,
    select_slots,
    sparsify,
    transfer_knots,
)
from gpszip.model import QuantisationGrid, Track
from gpszip.model.grid import step_index, step_size
from gpszip.testing.strategies import track_lists
from random_tests import examples


@st.composite
def logs(draw):
    tracks = draw(track_lists(dimension=draw(st.integers(1, 3))))
    gaps = [
        np.array(draw(st.lists(st.booleans(), min_size=len(t) - 1, max_size=len(t) - 1)), bool)
        for t in tracks
    ]
    origin = tuple(int(1000 * x) for x in tracks[0].positions[0])
    epoch = 1000 * int(min(track.times[0] for track in tracks))
    grid = QuantisationGrid(origin, epoch, draw(st.integers(100, 150)), draw(st.integers(110, 160)))
    return tracks, gaps, grid


def piece_steps(time_grid, piece):
    return time_grid.time_steps[time_grid.first_slots[piece] : time_grid.last_slots[piece] + 1]


@given(logs(), st.booleans())
@examples(80)
def test_every_sample_is_in_one_slot_and_pieces_do_not_overlap(log, sparse):
    tracks, gaps, grid = log
    time_grid = build_time_grid(tracks, gaps, grid, sparse=sparse)
    begin = 0
    for piece, (first, last) in enumerate(
        zip(time_grid.first_slots.tolist(), time_grid.last_slots.tolist(), strict=True)
    ):
        assert time_grid.ends[first] == begin
        begin = int(time_grid.ends[last])
        assert (np.diff(piece_steps(time_grid, piece)) > 0).all()
        for slot in range(first, last):
            inside = time_grid.times[time_grid.ends[slot] : time_grid.ends[slot + 1]]
            assert (inside >= time_grid.time_steps[slot] - 1e-6).all()
            assert (inside <= time_grid.time_steps[slot + 1] + 1e-6).all()
        if piece and time_grid.piece_tracks[piece] == time_grid.piece_tracks[piece - 1]:
            assert (
                time_grid.time_steps[first] > time_grid.time_steps[time_grid.last_slots[piece - 1]]
            )
    assert begin == time_grid.samples == sum(map(len, tracks))
    np.testing.assert_array_equal(np.unique(time_grid.piece_tracks), np.arange(len(tracks)))
    step = step_size(grid.time)
    expected = np.concatenate([(track.times - grid.epoch / 1000) / step for track in tracks])
    np.testing.assert_allclose(time_grid.times, expected, atol=2e-6 / step, rtol=1e-12)


@given(logs())
@examples(60)
def test_gaps_separate_pieces_where_a_time_step_fits(log):
    tracks, gaps, grid = log
    time_grid = build_time_grid(tracks, gaps, grid)
    assert count_slots(tracks, gaps, grid) == len(time_grid.time_steps)
    for track, gap in enumerate(gaps):
        assert 1 <= (time_grid.piece_tracks == track).sum() <= 1 + gap.sum()


@given(logs(), st.integers(0, 2**32))
@examples(80)
def test_knots_on_sparse_slots_are_transferred_to_full_ones(log, seed):
    tracks, gaps, grid = log
    full, sparse_grid = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    assert len(sparse_grid.first_slots) == len(full.first_slots)
    for piece in range(len(full.first_slots)):
        full_steps, sparse_steps = (
            piece_steps(full, piece).tolist(),
            piece_steps(sparse_grid, piece).tolist(),
        )
        assert set(sparse_steps) <= set(full_steps)
        assert (sparse_steps[0], sparse_steps[-1]) == (full_steps[0], full_steps[-1])
    slot_nodes = np.where(
        np.random.default_rng(seed).random(len(sparse_grid.time_steps)) < 0.4,
        np.arange(len(sparse_grid.time_steps)),
        -1,
    )
    transferred = transfer_knots(slot_nodes, sparse_grid, full)
    np.testing.assert_array_equal(transferred[transferred >= 0], slot_nodes[slot_nodes >= 0])
    np.testing.assert_array_equal(
        full.time_steps[transferred >= 0], sparse_grid.time_steps[slot_nodes >= 0]
    )
    np.testing.assert_array_equal(
        np.searchsorted(full.last_slots, np.flatnonzero(transferred >= 0)),
        np.searchsorted(sparse_grid.last_slots, np.flatnonzero(slot_nodes >= 0)),
    )


def nearest(steps, wanted):
    """Index of the nearest step; of two, the first."""
    return min(range(len(steps)), key=lambda index: (abs(steps[index] - wanted), index))


@given(logs(), st.integers(0, 2**32), st.sampled_from([0.5, 1.0, 1.7]))
@examples(60)
def test_walks_move_to_the_nearest_slots_of_another_grid(log, seed, ratio):
    # Walks with a knot at each end of a piece, and some in between.
    tracks, gaps, grid = log
    time_grid, rng = build_time_grid(tracks, gaps, grid), np.random.default_rng(seed)
    slots = len(time_grid.time_steps)
    is_knot = rng.random(slots) < 0.4
    is_knot[time_grid.first_slots] = is_knot[time_grid.last_slots] = True
    slot_nodes = np.where(is_knot, rng.integers(0, 9, slots), -1)
    walks = walks_of(time_grid, slot_nodes, np.arange(9.0)[:, None], len(tracks))

    # The twin goes knot by knot; on the same grid, nothing moves.
    placed = place_walks(time_grid, walks, ratio)
    owner = np.repeat(
        time_grid.piece_tracks, time_grid.last_slots - time_grid.first_slots + 1
    ).tolist()
    expected = [-1] * slots
    for track, walk in enumerate(walks.walks):
        first, steps = owner.index(track), time_grid.time_steps[np.array(owner) == track].tolist()
        knot_steps = (ratio * walk.time_steps).tolist()
        for step, node in zip(knot_steps, walk.nodes.tolist(), strict=True):
            expected[first + nearest(steps, step)] = node
        for piece in np.flatnonzero(time_grid.piece_tracks == track):
            for slot in (time_grid.first_slots[piece], time_grid.last_slots[piece]):
                if expected[slot] < 0:
                    expected[slot] = walk.nodes[nearest(knot_steps, time_grid.time_steps[slot])]
    assert placed.tolist() == expected
    if ratio == 1.0:
        assert (placed >= 0).tolist() == is_knot.tolist()


def is_sparsified_like_sparse_grid(tracks, gaps, grid):
    """Whether sparsify gives a sparse grid, or None where that has most of the slots."""
    full, sparse_grid = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    sparsified = sparsify(full)
    if sparsified is None:
        return len(sparse_grid.time_steps) >= 0.7 * len(full.time_steps)
    fields = (
        "time_steps",
        "ticks",
        "positions",
        "centers",
        "sums",
        "first_slots",
        "last_slots",
        "piece_tracks",
        "ends",
    )
    return all(
        np.array_equal(getattr(sparsified, field), getattr(sparse_grid, field)) for field in fields
    )


@given(logs())
@examples(80)
def test_sparsify_gives_a_sparse_grid(log):
    assert is_sparsified_like_sparse_grid(*log)


@pytest.mark.parametrize("seed", range(6))
def test_sparsify_gives_a_sparse_grid_with_pauses_and_gaps(seed):
    rng = np.random.default_rng(seed)
    tracks, gaps = [], []
    for name in "abc":
        gap = rng.random(59) < 0.1
        times = (
            np.cumsum(rng.integers(1, 20_000, 60) + 90_000 * (seed % 2) * np.append(False, gap))
            / 1000
        )
        tracks.append(Track(name, times, np.cumsum(rng.normal(0, 1, (60, 2)), axis=0)))
        gaps.append(gap)
    grid = QuantisationGrid((0, 0), 0, 112, 132)
    assert sparsify(build_time_grid(tracks, gaps, grid)) is not None
    assert is_sparsified_like_sparse_grid(tracks, gaps, grid)


@pytest.mark.parametrize("shift", [(1e9, 1e7), (1_600_000_000.0, -(2.0**22)), (-3600.0, 5e6)])
def test_a_shifted_log_has_the_same_slots(shift):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.integers(1, 3000, 300)) / 1000
    positions = np.round(np.cumsum(rng.normal(0, 2, (300, 2)), axis=0), 3)
    gap = rng.random(299) < 0.05
    original = build_time_grid(
        [Track("a", times, positions)], [gap], QuantisationGrid((0, 0), 0, 120, 130)
    )
    origin = (int(1000 * shift[1]),) * 2
    shifted = build_time_grid(
        [Track("a", times + shift[0], positions + shift[1])],
        [gap],
        QuantisationGrid(origin, int(1000 * shift[0]), 120, 130),
    )
    for name in vars(original):
        np.testing.assert_array_equal(getattr(original, name), getattr(shifted, name), err_msg=name)


def test_a_single_sample_spans_a_time_step():
    time_grid = build_time_grid(
        [Track("a", [5.3], [[1.0, 2.0]])],
        [np.zeros(0, bool)],
        QuantisationGrid((0, 0), 0, 128, 128),
    )
    assert time_grid.time_steps.tolist() == [5, 6]
    assert time_grid.ends.tolist() == [0, 1]


def test_positions_are_means_of_dense_samples_else_interpolated():
    times = np.array([0, 0.8, 0.9, 1.1, 1.2, 4.0])
    track = Track("a", times, np.array([[0.0], [1], [2], [3], [6], [20]]))
    time_grid = build_time_grid([track], [np.zeros(5, bool)], QuantisationGrid((0,), 0, 128, 128))
    assert time_grid.positions[:, 0].tolist() == pytest.approx(
        [0, 3, 6 + 14 * 0.8 / 2.8, 6 + 14 * 1.8 / 2.8, 20]
    )


def test_a_long_pause_has_no_slot_for_each_time_step():
    track = Track("a", [0.0, 1.0, 1e6], np.zeros((3, 2)))
    time_grid = build_time_grid([track], [np.zeros(2, bool)], QuantisationGrid((0, 0), 0, 128, 64))
    assert len(time_grid.time_steps) < 20


@given(logs())
@examples(50)
def test_weights_multiply_the_sums(log):
    time_grid = build_time_grid(*log)
    assume(time_grid.samples > 1)
    np.testing.assert_array_equal(
        reweight_samples(time_grid, np.ones(time_grid.samples, np.int64)).sums, time_grid.sums
    )
    np.testing.assert_array_equal(
        reweight_samples(time_grid, np.full(time_grid.samples, 3)).sums, 3 * time_grid.sums
    )


@given(logs(), st.integers(0, 2**32 - 1))
@examples(50)
def test_a_heavier_sample_counts_as_often_as_it_weighs(log, seed):
    time_grid = build_time_grid(*log)
    weights = np.random.default_rng(seed).integers(1, 4, len(time_grid.times))
    counts = np.diff(reweight_samples(time_grid, weights).sums[:, 0], prepend=0)
    slots = zip(np.append(0, time_grid.ends[:-1]), time_grid.ends, strict=True)
    np.testing.assert_array_equal(counts, [weights[first:after].sum() for first, after in slots])


@given(logs(), st.integers(0, 2**32 - 1))
@examples(50)
def test_samples_that_are_kept_stay_between_their_slots(log, seed):
    time_grid = build_time_grid(*log)
    keep = np.random.default_rng(seed).random(len(time_grid.times)) < 0.4
    kept = select_samples(time_grid, keep)
    slots = np.searchsorted(time_grid.ends, np.flatnonzero(keep), side="right")
    np.testing.assert_array_equal(
        np.searchsorted(kept.ends, np.arange(len(kept.times)), side="right"), slots
    )
    np.testing.assert_array_equal(kept.times, time_grid.times[keep])
    np.testing.assert_array_equal(kept.sample_positions, time_grid.sample_positions[keep])


@given(logs(), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_slots_near_knots_keep_knots_and_sums(log, reach, seed):
    tracks, gaps, grid = log
    full, sparse_grid = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    knots = np.flatnonzero(np.random.default_rng(seed).random(len(full.time_steps)) < 0.2)
    near = mask_near_knots(sparse_grid, full, knots, reach)
    assert near[knots].all()
    assert near[full.first_slots].all()
    assert near[full.last_slots].all()
    assert near.sum() <= len(sparse_grid.time_steps) + (2 * reach + 1) * len(knots)
    selected = select_slots(full, near)
    np.testing.assert_array_equal(
        selected.time_steps[selected.first_slots], full.time_steps[full.first_slots]
    )
    np.testing.assert_array_equal(selected.sums[selected.last_slots], full.sums[full.last_slots])
    slot_nodes = np.where(np.isin(np.arange(len(full.time_steps)), knots), 7, -1)
    np.testing.assert_array_equal(transfer_knots(slot_nodes[near], selected, full), slot_nodes)


def test_a_sample_rounded_to_microseconds_lies_on_its_time_step():
    """With steps of 0.42 s, rounding to microseconds shifts a time by more than 1e-6 steps."""
    grid = QuantisationGrid((0, 0), 0, 113, 118)
    times = np.arange(152_439, 152_439 + 400) * step_size(grid.time)
    for time in times:
        track = Track("a", [time, time + 2.0], np.zeros((2, 2)))
        first = build_time_grid([track], [np.zeros(1, bool)], grid).time_steps[0]
        assert first == round(time / step_size(grid.time))


def test_positions_whose_squares_fit_no_integer_are_refused():
    times = np.arange(4.0)
    for far, fits in ((2.0**32, True), (2.0**34, False)):
        track = Track("a", times, np.array([[0.0, 0.0], [1.0, 0.0], [far, 1.0], [3.0, 0.0]]))
        grid = QuantisationGrid((0, 0), 0, step_index(1.0), step_index(1.0))
        with nullcontext() if fits else pytest.raises(BoundError, match="too far apart"):
            build_time_grid([track], [np.zeros(3, np.bool_)], grid)
