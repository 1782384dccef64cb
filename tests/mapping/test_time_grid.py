import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gpszip.mapping.time_grid import (
    build_time_grid,
    count_slots,
    mask_near_knots,
    reweight_samples,
    select_slots,
    sparsify,
    transfer_knots,
)
from gpszip.model import QuantisationGrid, Track
from gpszip.model.grid import step_size
from gpszip.testing.strategies import track_lists


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


def cells_of(slots, piece):
    return slots.time_steps[slots.first_slots[piece] : slots.last_slots[piece] + 1]


@given(logs(), st.booleans())
@settings(max_examples=150)
def test_every_sample_lies_in_one_part_and_pieces_do_not_overlap(log, sparse):
    tracks, gaps, grid = log
    slots = build_time_grid(tracks, gaps, grid, sparse=sparse)
    begin = 0
    for piece, (first, last) in enumerate(
        zip(slots.first_slots.tolist(), slots.last_slots.tolist(), strict=True)
    ):
        assert slots.ends[first] == begin
        begin = int(slots.ends[last])
        assert (np.diff(cells_of(slots, piece)) > 0).all()
        for slot in range(first, last):
            mine = slots.times[slots.ends[slot] : slots.ends[slot + 1]]
            assert (mine >= slots.time_steps[slot] - 1e-6).all()
            assert (mine <= slots.time_steps[slot + 1] + 1e-6).all()
        if piece and slots.piece_tracks[piece] == slots.piece_tracks[piece - 1]:
            assert slots.time_steps[first] > slots.time_steps[slots.last_slots[piece - 1]]
    assert begin == slots.samples == sum(map(len, tracks))
    np.testing.assert_array_equal(np.unique(slots.piece_tracks), np.arange(len(tracks)))
    step = step_size(grid.time)
    expected = np.concatenate([(track.times - grid.epoch / 1000) / step for track in tracks])
    np.testing.assert_allclose(slots.times, expected, atol=2e-6 / step, rtol=1e-12)


@given(logs())
@settings(max_examples=100)
def test_gaps_part_pieces_where_a_cell_fits_in(log):
    tracks, gaps, grid = log
    slots = build_time_grid(tracks, gaps, grid)
    assert count_slots(tracks, gaps, grid) == len(slots.time_steps)
    for owner, gap in enumerate(gaps):
        assert 1 <= (slots.piece_tracks == owner).sum() <= 1 + gap.sum()


@given(logs(), st.integers(0, 2**32))
@settings(max_examples=150)
def test_sparse_slots_are_some_of_the_full_ones_and_hand_their_knots_on(log, seed):
    tracks, gaps, grid = log
    full, thin = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    assert len(thin.first_slots) == len(full.first_slots)
    for piece in range(len(full.first_slots)):
        every, some = cells_of(full, piece).tolist(), cells_of(thin, piece).tolist()
        assert set(some) <= set(every)
        assert (some[0], some[-1]) == (every[0], every[-1])
    at = np.where(
        np.random.default_rng(seed).random(len(thin.time_steps)) < 0.4,
        np.arange(len(thin.time_steps)),
        -1,
    )
    carried = transfer_knots(at, thin, full)
    np.testing.assert_array_equal(carried[carried >= 0], at[at >= 0])
    np.testing.assert_array_equal(full.time_steps[carried >= 0], thin.time_steps[at >= 0])
    np.testing.assert_array_equal(
        np.searchsorted(full.last_slots, np.flatnonzero(carried >= 0)),
        np.searchsorted(thin.last_slots, np.flatnonzero(at >= 0)),
    )


def same_as_laid_thin(tracks, gaps, grid):
    """Whether thinned slots are those of a sparse grid; where these are most of all there are none."""
    full, thin = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    found = sparsify(full)
    if found is None:
        return len(thin.time_steps) >= 0.7 * len(full.time_steps)
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
    return all(np.array_equal(getattr(found, field), getattr(thin, field)) for field in fields)


@given(logs())
@settings(max_examples=150)
def test_slots_are_thinned_to_a_sparse_grid(log):
    assert same_as_laid_thin(*log)


@pytest.mark.parametrize("seed", range(6))
def test_slots_of_tracks_with_pauses_and_gaps_are_thinned_to_a_sparse_grid(seed):
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
    assert same_as_laid_thin(tracks, gaps, grid)


@pytest.mark.parametrize("shift", [(1e9, 1e7), (1_600_000_000.0, -(2.0**22)), (-3600.0, 5e6)])
def test_a_shifted_log_has_the_same_slots(shift):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.integers(1, 3000, 300)) / 1000
    positions = np.round(np.cumsum(rng.normal(0, 2, (300, 2)), axis=0), 3)
    gap = rng.random(299) < 0.05
    here = build_time_grid(
        [Track("a", times, positions)], [gap], QuantisationGrid((0, 0), 0, 120, 130)
    )
    origin = (int(1000 * shift[1]),) * 2
    there = build_time_grid(
        [Track("a", times + shift[0], positions + shift[1])],
        [gap],
        QuantisationGrid(origin, int(1000 * shift[0]), 120, 130),
    )
    for name in vars(here):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name), err_msg=name)


def test_a_lone_sample_spans_a_cell():
    slots = build_time_grid(
        [Track("a", [5.3], [[1.0, 2.0]])],
        [np.zeros(0, bool)],
        QuantisationGrid((0, 0), 0, 128, 128),
    )
    assert slots.time_steps.tolist() == [5, 6]
    assert slots.ends.tolist() == [0, 1]


def test_places_are_means_where_samples_are_dense_and_lie_on_the_line_where_not():
    times = np.array([0, 0.8, 0.9, 1.1, 1.2, 4.0])
    track = Track("a", times, np.array([[0.0], [1], [2], [3], [6], [20]]))
    slots = build_time_grid([track], [np.zeros(5, bool)], QuantisationGrid((0,), 0, 128, 128))
    assert slots.positions[:, 0].tolist() == pytest.approx(
        [0, 3, 6 + 14 * 0.8 / 2.8, 6 + 14 * 1.8 / 2.8, 20]
    )


def test_a_very_long_pause_takes_no_slot_for_each_cell():
    track = Track("a", [0.0, 1.0, 1e6], np.zeros((3, 2)))
    slots = build_time_grid([track], [np.zeros(2, bool)], QuantisationGrid((0, 0), 0, 128, 64))
    assert len(slots.time_steps) < 20


@given(logs())
@settings(max_examples=50)
def test_samples_of_weight_one_are_what_they_were(log):
    slots = build_time_grid(*log)
    assume(slots.samples > 1)
    np.testing.assert_array_equal(
        reweight_samples(slots, np.ones(slots.samples, np.int64)).sums, slots.sums
    )
    np.testing.assert_array_equal(
        reweight_samples(slots, np.full(slots.samples, 3)).sums, 3 * slots.sums
    )


@given(logs(), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_slots_near_knots_hand_them_on_and_price_parts_alike(log, reach, seed):
    tracks, gaps, grid = log
    full, thin = (
        build_time_grid(tracks, gaps, grid),
        build_time_grid(tracks, gaps, grid, sparse=True),
    )
    knots = np.flatnonzero(np.random.default_rng(seed).random(len(full.time_steps)) < 0.2)
    near = mask_near_knots(thin, full, knots, reach)
    assert near[knots].all()
    assert near[full.first_slots].all()
    assert near[full.last_slots].all()
    assert near.sum() <= len(thin.time_steps) + (2 * reach + 1) * len(knots)
    picked = select_slots(full, near)
    np.testing.assert_array_equal(
        picked.time_steps[picked.first_slots], full.time_steps[full.first_slots]
    )
    np.testing.assert_array_equal(picked.sums[picked.last_slots], full.sums[full.last_slots])
    at = np.where(np.isin(np.arange(len(full.time_steps)), knots), 7, -1)
    np.testing.assert_array_equal(transfer_knots(at[near], picked, full), at)
