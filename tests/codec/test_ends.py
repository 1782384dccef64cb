import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.ends import TICKS, find_piece_ends, stored_time_ranges
from gpszip.codec.modes import encode_smallest
from gpszip.codec.walks import decode
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.model.grid import step_size
from gpszip.model.grid_walks import PieceEnds
from oracle import walk_decoder
from oracle.tail import read_tail
from oracle.walks import random_walks, walk


def random_ranges(walks, grid, rng, in_seconds):
    """First and last sample of each piece, within a time step of its knots."""
    ranges = []
    for one in walks.walks:
        times = grid.epoch / 1000 + one.time_steps * step_size(grid.time)
        first, last = times[np.append(True, one.gaps)], times[np.append(one.gaps, True)]
        begin = first + rng.random(len(first)) * step_size(grid.time)
        end = np.maximum(last - rng.random(len(first)) * step_size(grid.time), begin)
        samples = np.stack([begin, end], axis=1)
        samples = np.clip(
            np.round(samples) if in_seconds else samples, first[:, None], last[:, None]
        )
        ranges.append(samples)
    return ranges


@pytest.mark.parametrize("in_seconds", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_ends_round_trip_and_the_plain_decoder_agrees(seed, in_seconds):
    rng = np.random.default_rng(seed)
    walks, grid = (
        random_walks(seed),
        QuantisationGrid((0, 0), 1_000, 128, int(rng.integers(100, 170))),
    )
    if not walks.timed or not walks.walks:
        pytest.skip("no times")
    grid = QuantisationGrid((0,) * walks.nodes.shape[1], grid.epoch, grid.space, grid.time)
    ends = find_piece_ends(random_ranges(walks, grid, rng, in_seconds), walks, grid)
    with_ends = GridWalks(walks.nodes, walks.walks, True, ends)
    data = encode_smallest(with_ends, grid=grid)
    back = decode(data, walks.nodes.shape[1], len(walks.walks), grid=grid)
    assert back.ends.tick == ends.tick
    assert back.ends.first.tolist() == ends.first.tolist()
    assert back.ends.last.tolist() == ends.last.tolist()
    decoder, tracks = walk_decoder.read(data, walks.nodes.shape[1], len(walks.walks))
    shapes, (tick, pieces) = read_tail(
        decoder.coder, decoder.positions, tracks, step_size(grid.time)
    )
    assert (shapes, tick) == (set(), ends.tick)
    assert pieces == list(zip(ends.first.tolist(), ends.last.tolist(), strict=True))


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 10_000),
    st.sampled_from([1.0, 0.1, 0.001]),
    st.integers(100, 250),
)
def test_tracks_start_and_end_at_their_samples(seed, start, unit, time):
    rng = np.random.default_rng(seed)
    step = step_size(time)
    first, last = np.sort(np.round(rng.random(2) * 40 * step / unit)) * unit + start
    low, high = (
        int(np.floor((first - start) / step + 1e-6)),
        int(np.ceil((last - start) / step - 1e-6)),
    )
    grid = QuantisationGrid((0,), 1000 * start, 128, time)
    one = GridWalk(
        np.array([0, 1], np.int32), np.array([low, max(high, low + 1)]), np.array([False])
    )
    walks = GridWalks(np.array([[0], [7]]), (one,))
    with_ends = GridWalks(
        walks.nodes, walks.walks, True, find_piece_ends([np.array([[first, last]])], walks, grid)
    )
    (time_range,) = stored_time_ranges(
        decode(encode_smallest(with_ends, grid=grid), 1, 1, grid=grid), grid
    )
    assert time_range[0] == pytest.approx([first, last], abs=1e-5)


def test_ends_may_be_rounded_by_less_than_a_quarter_of_the_sampling():
    one = walk([0, 1], [0, 4])
    walks, grid = (
        GridWalks(np.array([[0], [7]]), (one,)),
        QuantisationGrid((0,), 0, 128, 176),
    )  # time steps of 64 s
    exact = find_piece_ends([np.array([[3.0, 251.0]])], walks, grid)
    rounded = find_piece_ends([np.array([[3.0, 251.0]])], walks, grid, step=60.0)
    assert (TICKS[exact.tick], exact.first.tolist(), exact.last.tolist()) == ((1, 1), [3], [251])
    assert (TICKS[rounded.tick], rounded.first.tolist(), rounded.last.tolist()) == (
        (15, 1),
        [0],
        [17],
    )


def test_a_piece_beside_a_gap_has_an_offset_only_where_it_is_fast():
    torn = [False, True, False]
    slow, fast = walk([0, 1, 2, 3], [0, 8, 50, 60], torn), walk([0, 4, 2, 3], [0, 8, 50, 60], torn)
    nodes = np.array([[0], [8], [100], [110], [800]])
    grid = QuantisationGrid((0,), 0, 128, 136)  # time steps of 2 s
    walks = GridWalks(nodes, (slow, fast))
    ends = find_piece_ends([np.array([[0.0, 14.0], [100.0, 119.0]])] * 2, walks, grid)
    assert TICKS[ends.tick] == (1, 1)
    assert ends.last.tolist() == [16, 119, 14, 119]


def test_tracks_without_times_have_no_ends():
    shape, drive = walk([0, 1], [0, 1]), walk([1, 0], [0, 9])
    grid = QuantisationGrid((0,), 0, 128, 136)
    walks = GridWalks(np.array([[0], [70]]), (shape, drive), untimed=frozenset({0}))
    with_ends = GridWalks(
        walks.nodes,
        walks.walks,
        True,
        find_piece_ends([np.zeros((0, 2)), np.array([[1.0, 17.0]])], walks, grid),
        walks.untimed,
    )
    data = encode_smallest(with_ends, grid=grid)
    back = decode(data, 1, 2, grid=grid)
    assert back.untimed == {0}
    assert stored_time_ranges(back, grid)[1].tolist() == [[1.0, 17.0]]
    decoder, tracks = walk_decoder.read(data, 1, 2)
    assert read_tail(decoder.coder, decoder.positions, tracks, 2.0)[0] == {0}


def test_ends_outside_of_the_knots_are_those_of_the_knots():
    one = walk([0, 1], [0, 4])
    walks, grid = GridWalks(np.array([[0], [7]]), (one,)), QuantisationGrid((0,), 0, 128, 128)
    ends = find_piece_ends([np.array([[-50.0, 90.0]])], walks, grid)
    with_ends = GridWalks(walks.nodes, walks.walks, True, ends)
    (time_range,) = stored_time_ranges(
        decode(encode_smallest(with_ends, grid=grid), 1, 1, grid=grid), grid
    )
    assert time_range.tolist() == [[0.0, 4.0]]


def test_no_tracks_have_no_ends():
    grid = QuantisationGrid((0, 0), 0, 128, 128)
    walks = GridWalks(np.zeros((0, 2), np.int64), ())
    with_ends = GridWalks(walks.nodes, (), True, find_piece_ends([], walks, grid))
    back = decode(encode_smallest(with_ends, grid=grid), 2, 0, grid=grid)
    assert stored_time_ranges(back, grid) == []


def test_forged_ends_before_starts_are_refused():
    one = walk([0, 1], [0, 4])
    grid = QuantisationGrid((0,), 0, 128, 128)
    forged = GridWalks(
        np.array([[0], [7]]), (one,), True, PieceEnds(7, np.array([4]), np.array([0]))
    )
    with pytest.raises(CorruptArchiveError, match="ends before it starts"):
        encode_smallest(forged, grid=grid)


def test_pieces_too_far_for_ticks_last_from_knot_to_knot_or_are_refused():
    one = walk([0, 1], [2**44, 2**44 + 4])
    walks, grid = GridWalks(np.array([[0], [7]]), (one,)), QuantisationGrid((0,), 0, 128, 255)
    assert find_piece_ends([np.array([[0.0005, 1.0]])], walks, grid).tick == 0
    forged = GridWalks(walks.nodes, walks.walks, True, PieceEnds(15, np.array([0]), np.array([9])))
    with pytest.raises(CorruptArchiveError, match="too far from the epoch"):
        encode_smallest(forged, grid=grid)
