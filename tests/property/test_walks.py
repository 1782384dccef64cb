import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.kernels.walk_model import SORTED_STARTS
from gpszip.codec.modes import encode_smallest
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.plain.decode import decode_plain
from gpszip.codec.plain.work import WorkLimit
from gpszip.codec.walks import decode, encode, encode_in_modes
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalks
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk
from random_tests import examples

spread = st.sampled_from([1, 3, 50, 2**12, 2**24, 2**40])


@st.composite
def grid_walks(draw):
    """Walks in runs that go on, turn back, loop, stop, jump or have a gap."""
    dimension, timed, scale = draw(st.integers(1, 5)), draw(st.booleans()), draw(spread)
    positions = st.lists(st.integers(-scale, scale), min_size=dimension, max_size=dimension)
    nodes = draw(st.lists(positions, min_size=1, max_size=12))
    walks = []
    for _ in range(draw(st.integers(1, 4))):
        route, gaps = [draw(st.integers(0, len(nodes) - 1))], []
        for run in draw(
            st.lists(st.sampled_from(["on", "back", "loop", "stop", "jump", "gap"]), max_size=8)
        ):
            if run == "back":
                new = route[-2::-1][:5]
            elif run == "stop":
                new = route[-1:] * 2
            elif run == "loop":
                new = [*range(len(nodes)), 0]
            else:
                new = [
                    (route[-1] + 1) % len(nodes)
                    if run == "on"
                    else draw(st.integers(0, len(nodes) - 1))
                ]
            route += new
            gaps += [run == "gap"] * len(new)
        steps = draw(
            st.lists(
                st.integers(1, 40) | st.integers(1, 8 * scale),
                min_size=len(route),
                max_size=len(route),
            )
        )
        start = draw(st.integers(-scale, scale))
        walks.append(walk(route, start + np.cumsum(steps) if timed else np.zeros(len(route)), gaps))
    return number_by_visit(GridWalks(np.array(nodes, np.int64), tuple(walks), timed))


@given(grid_walks())
@examples(200)
def test_walks_round_trip(walks):
    assert_same(decode(encode(walks), walks.nodes.shape[1], len(walks.walks)), walks)


def encode_some_modes(walks, modes):
    """Encode walks in those of the modes that they allow."""
    modes -= modes & SORTED_STARTS if not walks.timed else 0
    step_bits = np.zeros(sum(len(one.nodes) for one in walks.walks))
    encode_in_modes(walks, None, 0, step_bits)
    # expensive steps make an encoder take targets wherever it can
    return encode_in_modes(walks, None, modes, step_bits + 20)[0]


@given(grid_walks(), st.integers(1, 7))
@examples(120)
def test_walks_round_trip_in_modes(walks, modes):
    data = encode_some_modes(walks, modes)
    assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)
    assert_decoders_agree(data, walks.nodes.shape[1], len(walks.walks))


@given(grid_walks())
@examples(100)
def test_the_smallest_payload_is_no_larger_than_without_modes(walks):
    data = encode_smallest(walks)
    assert len(data) <= len(encode(walks))
    assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)


def assert_decoders_agree(data, dimension, tracks):
    """All three decoders refuse the bytes, or find the same consistent walks."""
    try:
        found = decode(data, dimension, tracks)
    except CorruptArchiveError:
        found = None
    try:
        positions, plain, _ = walk_decoder.decode(data, dimension, tracks)
    except walk_decoder.InvalidWalks:
        plain = None
    assert (found is None) == (plain is None)
    if found is None:
        with pytest.raises(CorruptArchiveError):
            decode_plain(data, dimension, tracks, None, WorkLimit(10**9))
        return
    assert_same(decode_plain(data, dimension, tracks, None, WorkLimit(10**9)), found)
    assert found.nodes.tolist() == positions
    assert len(found.walks) == tracks
    for one, twin in zip(found.walks, plain, strict=True):
        assert len(one.nodes) == len(one.time_steps) == len(one.gaps) + 1
        assert 0 <= one.nodes.min() <= one.nodes.max() < len(found.nodes)
        assert (np.diff(one.time_steps) > 0).all() or not found.timed
        assert [node for node, _, _ in twin] == one.nodes.tolist()
        assert [time_step for _, time_step, _ in twin] == one.time_steps.tolist()


@given(st.integers(0, 50), st.integers(1, 7), st.data())
@examples(100)
def test_damaged_walks_in_modes_are_refused_or_decoded(seed, modes, data):
    walks = random_walks(seed, longest=25)
    payload = bytearray(encode_some_modes(walks, modes))
    for place in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[place] = data.draw(st.integers(0, 255))
    assert_decoders_agree(
        bytes(payload[: data.draw(st.integers(0, len(payload)))]),
        walks.nodes.shape[1],
        len(walks.walks),
    )


@given(st.integers(0, 50), st.data())
@examples(80)
def test_damaged_walks_are_refused_or_decoded(seed, data):
    walks = random_walks(seed, longest=25)
    payload = bytearray(encode(walks))
    for place in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[place] = data.draw(st.integers(0, 255))
    assert_decoders_agree(
        bytes(payload[: data.draw(st.integers(0, len(payload)))]),
        walks.nodes.shape[1],
        len(walks.walks),
    )


@given(
    st.integers(0, 40),
    st.booleans(),
    st.booleans(),
    st.binary(max_size=40),
    st.integers(1, 5),
    st.integers(0, 3),
)
@examples(300)
def test_any_bytes_are_refused_or_decoded(knots, timed, gapped, noise, dimension, tracks):
    count = 4 * knots + timed + 2 * gapped
    assert_decoders_agree(
        (bytes([count]) if count < 128 else bytes([count & 127 | 128, count >> 7])) + noise,
        dimension,
        tracks,
    )


def test_every_truncation_is_refused_or_decoded():
    walks = random_walks(5, longest=25)
    payload = encode(walks)
    for length in range(len(payload)):
        assert_decoders_agree(payload[:length], walks.nodes.shape[1], len(walks.walks))
