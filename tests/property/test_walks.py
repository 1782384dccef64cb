import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.codec.kernels.walk_model import SORTED_STARTS
from gpszip.codec.modes import encode_smallest
from gpszip.codec.walks import decode, encode, encode_in_modes, number_by_visit
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalks
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk

spread = st.sampled_from([1, 3, 50, 2**12, 2**24, 2**40])


@st.composite
def lattice_walks(draw):
    """Walks in runs that go on, turn back, loop, stop, jump or leave a gap."""
    dimension, timed, scale = draw(st.integers(1, 5)), draw(st.booleans()), draw(spread)
    places = st.lists(st.integers(-scale, scale), min_size=dimension, max_size=dimension)
    nodes = draw(st.lists(places, min_size=1, max_size=12))
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


@given(lattice_walks())
@settings(max_examples=200)
def test_what_is_encoded_is_decoded(walks):
    assert_same(decode(encode(walks), walks.nodes.shape[1], len(walks.walks)), walks)


def in_modes(walks, modes):
    """Walks coded in the modes of ``modes`` that they allow, after a look at what their ways cost."""
    modes -= modes & SORTED_STARTS if not walks.timed else 0
    spent = np.zeros(sum(len(one.nodes) for one in walks.walks))
    encode_in_modes(walks, None, 0, spent)
    # dear ways make a writer aim wherever it can
    return encode_in_modes(walks, None, modes, spent + 20)[0]


@given(lattice_walks(), st.integers(1, 7))
@settings(max_examples=200)
def test_what_is_encoded_in_modes_is_decoded(walks, modes):
    data = in_modes(walks, modes)
    assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)
    judge(data, walks.nodes.shape[1], len(walks.walks))


@given(lattice_walks())
@settings(max_examples=100)
def test_the_smallest_is_no_larger_than_without_modes(walks):
    data = encode_smallest(walks)
    assert len(data) <= len(encode(walks))
    assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)


def judge(data, dimension, tracks):
    """Whatever the bytes are: walks that hold together, the plain decoder's own, or a refusal by both."""
    try:
        found = decode(data, dimension, tracks)
    except CorruptArchiveError:
        found = None
    try:
        places, plain, _ = walk_decoder.decode(data, dimension, tracks)
    except walk_decoder.BadWalks:
        plain = None
    assert (found is None) == (plain is None)
    if found is None:
        return
    assert found.nodes.tolist() == places
    assert len(found.walks) == tracks
    for one, twin in zip(found.walks, plain, strict=True):
        assert len(one.nodes) == len(one.time_steps) == len(one.gaps) + 1
        assert 0 <= one.nodes.min() <= one.nodes.max() < len(found.nodes)
        assert (np.diff(one.time_steps) > 0).all() or not found.timed
        assert [node for node, _, _ in twin] == one.nodes.tolist()
        assert [cell for _, cell, _ in twin] == one.time_steps.tolist()


@given(st.integers(0, 50), st.integers(1, 7), st.data())
@settings(max_examples=200)
def test_damaged_walks_in_modes_are_refused_or_are_walks(seed, modes, data):
    walks = random_walks(seed, longest=25)
    payload = bytearray(in_modes(walks, modes))
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[at] = data.draw(st.integers(0, 255))
    judge(
        bytes(payload[: data.draw(st.integers(0, len(payload)))]),
        walks.nodes.shape[1],
        len(walks.walks),
    )


@given(st.integers(0, 50), st.data())
@settings(max_examples=150)
def test_damaged_walks_are_refused_or_are_walks(seed, data):
    walks = random_walks(seed, longest=25)
    payload = bytearray(encode(walks))
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[at] = data.draw(st.integers(0, 255))
    judge(
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
@settings(max_examples=300)
def test_any_bytes_are_refused_or_are_walks(knots, timed, gapped, noise, dimension, tracks):
    count = 4 * knots + timed + 2 * gapped
    judge(
        (bytes([count]) if count < 128 else bytes([count & 127 | 128, count >> 7])) + noise,
        dimension,
        tracks,
    )


def test_every_truncation_is_refused_or_is_walks():
    walks = random_walks(5, longest=25)
    payload = encode(walks)
    for length in range(len(payload)):
        judge(payload[:length], walks.nodes.shape[1], len(walks.walks))
