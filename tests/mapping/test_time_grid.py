import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gpszip.mapping.time_grid import carry_knots, count_slots, lay_slots, pick_slots, slots_near, thin_slots, weigh_samples
from gpszip.model import Frame, Track
from gpszip.model.frame import quantum
from gpszip.testing.strategies import track_lists


@st.composite
def logs(draw):
    tracks = draw(track_lists(dimension=draw(st.integers(1, 3))))
    gaps = [np.array(draw(st.lists(st.booleans(), min_size=len(t) - 1, max_size=len(t) - 1)), bool) for t in tracks]
    origin = tuple(int(1000 * x) for x in tracks[0].positions[0])
    epoch = 1000 * int(min(track.times[0] for track in tracks))
    frame = Frame(origin, epoch, draw(st.integers(100, 150)), draw(st.integers(110, 160)))
    return tracks, gaps, frame


def cells_of(slots, piece):
    return slots.cells[slots.firsts[piece] : slots.lasts[piece] + 1]


@given(logs(), st.booleans())
@settings(max_examples=150)
def test_every_sample_lies_in_one_part_and_pieces_do_not_overlap(log, sparse):
    tracks, gaps, frame = log
    slots = lay_slots(tracks, gaps, frame, sparse=sparse)
    begin = 0
    for piece, (first, last) in enumerate(zip(slots.firsts.tolist(), slots.lasts.tolist(), strict=True)):
        assert slots.ends[first] == begin
        begin = int(slots.ends[last])
        assert (np.diff(cells_of(slots, piece)) > 0).all()
        for slot in range(first, last):
            mine = slots.times[slots.ends[slot] : slots.ends[slot + 1]]
            assert (mine >= slots.cells[slot] - 1e-6).all()
            assert (mine <= slots.cells[slot + 1] + 1e-6).all()
        if piece and slots.owners[piece] == slots.owners[piece - 1]:
            assert slots.cells[first] > slots.cells[slots.lasts[piece - 1]]
    assert begin == slots.samples == sum(map(len, tracks))
    np.testing.assert_array_equal(np.unique(slots.owners), np.arange(len(tracks)))
    step = quantum(frame.time)
    expected = np.concatenate([(track.times - frame.epoch / 1000) / step for track in tracks])
    np.testing.assert_allclose(slots.times, expected, atol=2e-6 / step, rtol=1e-12)


@given(logs())
@settings(max_examples=100)
def test_gaps_part_pieces_where_a_cell_fits_in(log):
    tracks, gaps, frame = log
    slots = lay_slots(tracks, gaps, frame)
    assert count_slots(tracks, gaps, frame) == len(slots.cells)
    for owner, gap in enumerate(gaps):
        assert 1 <= (slots.owners == owner).sum() <= 1 + gap.sum()


@given(logs(), st.integers(0, 2**32))
@settings(max_examples=150)
def test_sparse_slots_are_some_of_the_full_ones_and_hand_their_knots_on(log, seed):
    tracks, gaps, frame = log
    full, thin = lay_slots(tracks, gaps, frame), lay_slots(tracks, gaps, frame, sparse=True)
    assert len(thin.firsts) == len(full.firsts)
    for piece in range(len(full.firsts)):
        every, some = cells_of(full, piece).tolist(), cells_of(thin, piece).tolist()
        assert set(some) <= set(every)
        assert (some[0], some[-1]) == (every[0], every[-1])
    at = np.where(np.random.default_rng(seed).random(len(thin.cells)) < 0.4, np.arange(len(thin.cells)), -1)
    carried = carry_knots(at, thin, full)
    np.testing.assert_array_equal(carried[carried >= 0], at[at >= 0])
    np.testing.assert_array_equal(full.cells[carried >= 0], thin.cells[at >= 0])
    np.testing.assert_array_equal(
        np.searchsorted(full.lasts, np.flatnonzero(carried >= 0)), np.searchsorted(thin.lasts, np.flatnonzero(at >= 0))
    )


def same_as_laid_thin(tracks, gaps, frame):
    """Whether thinned slots are those of a sparse grid; where these are most of all there are none."""
    full, thin = lay_slots(tracks, gaps, frame), lay_slots(tracks, gaps, frame, sparse=True)
    found = thin_slots(full)
    if found is None:
        return len(thin.cells) >= 0.7 * len(full.cells)
    fields = ("cells", "ticks", "places", "centers", "sums", "firsts", "lasts", "owners", "ends")
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
        times = np.cumsum(rng.integers(1, 20_000, 60) + 90_000 * (seed % 2) * np.append(False, gap)) / 1000
        tracks.append(Track(name, times, np.cumsum(rng.normal(0, 1, (60, 2)), axis=0)))
        gaps.append(gap)
    frame = Frame((0, 0), 0, 112, 132)
    assert thin_slots(lay_slots(tracks, gaps, frame)) is not None
    assert same_as_laid_thin(tracks, gaps, frame)


@pytest.mark.parametrize("shift", [(1e9, 1e7), (1_600_000_000.0, -(2.0**22)), (-3600.0, 5e6)])
def test_a_shifted_log_has_the_same_slots(shift):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.integers(1, 3000, 300)) / 1000
    places = np.round(np.cumsum(rng.normal(0, 2, (300, 2)), axis=0), 3)
    gap = rng.random(299) < 0.05
    here = lay_slots([Track("a", times, places)], [gap], Frame((0, 0), 0, 120, 130))
    origin = (int(1000 * shift[1]),) * 2
    there = lay_slots([Track("a", times + shift[0], places + shift[1])], [gap], Frame(origin, int(1000 * shift[0]), 120, 130))
    for name in vars(here):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name), err_msg=name)


def test_a_lone_sample_spans_a_cell():
    slots = lay_slots([Track("a", [5.3], [[1.0, 2.0]])], [np.zeros(0, bool)], Frame((0, 0), 0, 128, 128))
    assert slots.cells.tolist() == [5, 6]
    assert slots.ends.tolist() == [0, 1]


def test_places_are_means_where_samples_are_dense_and_lie_on_the_line_where_not():
    times = np.array([0, 0.8, 0.9, 1.1, 1.2, 4.0])
    track = Track("a", times, np.array([[0.0], [1], [2], [3], [6], [20]]))
    slots = lay_slots([track], [np.zeros(5, bool)], Frame((0,), 0, 128, 128))
    assert slots.places[:, 0].tolist() == pytest.approx([0, 3, 6 + 14 * 0.8 / 2.8, 6 + 14 * 1.8 / 2.8, 20])


def test_a_very_long_pause_takes_no_slot_for_each_cell():
    track = Track("a", [0.0, 1.0, 1e6], np.zeros((3, 2)))
    slots = lay_slots([track], [np.zeros(2, bool)], Frame((0, 0), 0, 128, 64))
    assert len(slots.cells) < 20


@given(logs())
@settings(max_examples=50)
def test_samples_of_weight_one_are_what_they_were(log):
    slots = lay_slots(*log)
    assume(slots.samples > 1)
    np.testing.assert_array_equal(weigh_samples(slots, np.ones(slots.samples, np.int64)).sums, slots.sums)
    np.testing.assert_array_equal(weigh_samples(slots, np.full(slots.samples, 3)).sums, 3 * slots.sums)


@given(logs(), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_slots_near_knots_hand_them_on_and_price_parts_alike(log, reach, seed):
    tracks, gaps, frame = log
    full, thin = lay_slots(tracks, gaps, frame), lay_slots(tracks, gaps, frame, sparse=True)
    knots = np.flatnonzero(np.random.default_rng(seed).random(len(full.cells)) < 0.2)
    near = slots_near(thin, full, knots, reach)
    assert near[knots].all()
    assert near[full.firsts].all()
    assert near[full.lasts].all()
    assert near.sum() <= len(thin.cells) + (2 * reach + 1) * len(knots)
    picked = pick_slots(full, near)
    np.testing.assert_array_equal(picked.cells[picked.firsts], full.cells[full.firsts])
    np.testing.assert_array_equal(picked.sums[picked.lasts], full.sums[full.lasts])
    at = np.where(np.isin(np.arange(len(full.cells)), knots), 7, -1)
    np.testing.assert_array_equal(carry_knots(at[near], picked, full), at)
