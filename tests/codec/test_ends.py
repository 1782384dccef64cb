import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.ends import TICKS, claimed_spans, ends_of
from gpszip.codec.modes import encode_smallest
from gpszip.codec.walks import decode
from gpszip.errors import CorruptArchiveError
from gpszip.model import Frame, LatticeWalk, LatticeWalks
from gpszip.model.frame import quantum
from gpszip.model.lattice import Ends
from oracle import walk_decoder
from oracle.tail import read_tail
from oracle.walks import random_walks, walk


def spans_within(walks, frame, rng, whole):
    """First and last sample of each piece, within a cell of its knots."""
    spans = []
    for one in walks.walks:
        times = frame.epoch / 1000 + one.cells * quantum(frame.time)
        first, last = times[np.append(True, one.gaps)], times[np.append(one.gaps, True)]
        begin = first + rng.random(len(first)) * quantum(frame.time)
        end = np.maximum(last - rng.random(len(first)) * quantum(frame.time), begin)
        own = np.stack([begin, end], axis=1)
        own = np.clip(np.round(own) if whole else own, first[:, None], last[:, None])
        spans.append(own)
    return spans


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_ends_come_back_from_the_coder_and_from_its_plain_twin(seed, whole):
    rng = np.random.default_rng(seed)
    walks, frame = random_walks(seed), Frame((0, 0), 1_000, 128, int(rng.integers(100, 170)))
    if not walks.timed or not walks.walks:
        pytest.skip("no times")
    frame = Frame((0,) * walks.nodes.shape[1], frame.epoch, frame.space, frame.time)
    ends = ends_of(spans_within(walks, frame, rng, whole), walks, frame)
    made = LatticeWalks(walks.nodes, walks.walks, True, ends)
    data = encode_smallest(made, frame=frame)
    back = decode(data, walks.nodes.shape[1], len(walks.walks), frame=frame)
    assert back.ends.tick == ends.tick
    assert back.ends.first.tolist() == ends.first.tolist()
    assert back.ends.last.tolist() == ends.last.tolist()
    decoder, tracks = walk_decoder.read(data, walks.nodes.shape[1], len(walks.walks))
    shapes, (tick, pieces) = read_tail(decoder.coder, decoder.places, tracks, quantum(frame.time))
    assert (shapes, tick) == (set(), ends.tick)
    assert pieces == list(zip(ends.first.tolist(), ends.last.tolist(), strict=True))


@given(st.integers(0, 2**32 - 1), st.integers(0, 10_000), st.sampled_from([1.0, 0.1, 0.001]), st.integers(100, 250))
def test_tracks_start_and_end_at_their_samples(seed, start, unit, time):
    rng = np.random.default_rng(seed)
    step = quantum(time)
    first, last = np.sort(np.round(rng.random(2) * 40 * step / unit)) * unit + start
    low, high = int(np.floor((first - start) / step + 1e-6)), int(np.ceil((last - start) / step - 1e-6))
    frame = Frame((0,), 1000 * start, 128, time)
    one = LatticeWalk(np.array([0, 1], np.int32), np.array([low, max(high, low + 1)]), np.array([False]))
    walks = LatticeWalks(np.array([[0], [7]]), (one,))
    made = LatticeWalks(walks.nodes, walks.walks, True, ends_of([np.array([[first, last]])], walks, frame))
    (span,) = claimed_spans(decode(encode_smallest(made, frame=frame), 1, 1, frame=frame), frame)
    assert span[0] == pytest.approx([first, last], abs=1e-5)


def test_ends_may_be_rounded_by_less_than_a_quarter_of_the_sampling():
    one = walk([0, 1], [0, 4])
    walks, frame = LatticeWalks(np.array([[0], [7]]), (one,)), Frame((0,), 0, 128, 176)  # cells of 64 s
    exact = ends_of([np.array([[3.0, 251.0]])], walks, frame)
    rounded = ends_of([np.array([[3.0, 251.0]])], walks, frame, step=60.0)
    assert (TICKS[exact.tick], exact.first.tolist(), exact.last.tolist()) == ((1, 1), [3], [251])
    assert (TICKS[rounded.tick], rounded.first.tolist(), rounded.last.tolist()) == ((15, 1), [0], [17])


def test_a_piece_beside_a_gap_is_cut_only_where_it_goes_far_in_a_cell():
    torn = [False, True, False]
    slow, fast = walk([0, 1, 2, 3], [0, 8, 50, 60], torn), walk([0, 4, 2, 3], [0, 8, 50, 60], torn)
    nodes = np.array([[0], [8], [100], [110], [800]])
    frame = Frame((0,), 0, 128, 136)  # cells of 2 s
    walks = LatticeWalks(nodes, (slow, fast))
    ends = ends_of([np.array([[0.0, 14.0], [100.0, 119.0]])] * 2, walks, frame)
    assert TICKS[ends.tick] == (1, 1)
    assert ends.last.tolist() == [16, 119, 14, 119]


def test_shapes_have_no_ends():
    shape, drive = walk([0, 1], [0, 1]), walk([1, 0], [0, 9])
    frame = Frame((0,), 0, 128, 136)
    walks = LatticeWalks(np.array([[0], [70]]), (shape, drive), untimed=frozenset({0}))
    made = LatticeWalks(walks.nodes, walks.walks, True, ends_of([np.zeros((0, 2)), np.array([[1.0, 17.0]])], walks, frame), walks.untimed)
    data = encode_smallest(made, frame=frame)
    back = decode(data, 1, 2, frame=frame)
    assert back.untimed == {0}
    assert claimed_spans(back, frame)[1].tolist() == [[1.0, 17.0]]
    decoder, tracks = walk_decoder.read(data, 1, 2)
    assert read_tail(decoder.coder, decoder.places, tracks, 2.0)[0] == {0}


def test_what_can_not_be_coded_is_claimed_from_the_knot_on():
    one = walk([0, 1], [0, 4])
    walks, frame = LatticeWalks(np.array([[0], [7]]), (one,)), Frame((0,), 0, 128, 128)
    ends = ends_of([np.array([[-50.0, 90.0]])], walks, frame)
    made = LatticeWalks(walks.nodes, walks.walks, True, ends)
    (span,) = claimed_spans(decode(encode_smallest(made, frame=frame), 1, 1, frame=frame), frame)
    assert span.tolist() == [[0.0, 4.0]]


def test_no_tracks_have_no_ends():
    frame = Frame((0, 0), 0, 128, 128)
    walks = LatticeWalks(np.zeros((0, 2), np.int64), ())
    made = LatticeWalks(walks.nodes, (), True, ends_of([], walks, frame))
    back = decode(encode_smallest(made, frame=frame), 2, 0, frame=frame)
    assert claimed_spans(back, frame) == []


def test_forged_ends_before_starts_are_refused():
    one = walk([0, 1], [0, 4])
    frame = Frame((0,), 0, 128, 128)
    forged = LatticeWalks(np.array([[0], [7]]), (one,), True, Ends(7, np.array([4]), np.array([0])))
    with pytest.raises(CorruptArchiveError, match="ends before it starts"):
        encode_smallest(forged, frame=frame)


def test_pieces_too_far_for_ticks_are_claimed_from_knot_to_knot_or_refused():
    one = walk([0, 1], [2**44, 2**44 + 4])
    walks, frame = LatticeWalks(np.array([[0], [7]]), (one,)), Frame((0,), 0, 128, 255)
    assert ends_of([np.array([[0.0005, 1.0]])], walks, frame).tick == 0
    forged = LatticeWalks(walks.nodes, walks.walks, True, Ends(15, np.array([0]), np.array([9])))
    with pytest.raises(CorruptArchiveError, match="too far from the epoch"):
        encode_smallest(forged, frame=frame)
