"""The plain decoder gives what the compiled one gives, bit for bit, in bounded work."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.ends import find_piece_ends
from gpszip.codec.modes import encode_smallest
from gpszip.codec.payload_head import SORTED_STARTS
from gpszip.codec.plain.decode import decode_plain
from gpszip.codec.plain.work import TooMuchWorkError, WorkLimit
from gpszip.codec.walks import decode, encode, encode_in_modes
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalks, QuantisationGrid
from gpszip.model.grid import step_size
from oracle.walks import assert_same, random_walks, walk
from random_tests import examples

#: More work than any test takes.
PLENTY = 10**9


def assert_agrees(data, dimension, tracks, grid=None):
    """Compare what both decoders give; return what the plain one gives."""
    plain = decode_plain(data, dimension, tracks, grid, WorkLimit(PLENTY))
    compiled = decode(data, dimension, tracks, grid=grid)
    assert_same(plain, compiled)
    assert plain.untimed == compiled.untimed
    assert (plain.ends is None) == (compiled.ends is None)
    if plain.ends is not None:
        assert plain.ends.tick == compiled.ends.tick
        np.testing.assert_array_equal(plain.ends.first, compiled.ends.first)
        np.testing.assert_array_equal(plain.ends.last, compiled.ends.last)
    return plain


@pytest.mark.parametrize("modes", range(8))
@pytest.mark.parametrize("seed", range(12))
def test_random_walks_are_decoded_as_by_the_compiled_decoder(seed, modes):
    walks = random_walks(seed, longest=100)
    if walks.timed or not modes & SORTED_STARTS:
        # expensive steps make an encoder take targets wherever it can
        step_bits = np.full(sum(len(one.nodes) for one in walks.walks), 20.0)
        data, _ = encode_in_modes(walks, None, modes, step_bits)
        assert_same(assert_agrees(data, walks.nodes.shape[1], len(walks.walks)), walks)


@given(st.integers(0, 2**32 - 1), st.integers(100, 170))
@examples(60)
def test_ends_are_decoded_as_by_the_compiled_decoder(seed, time):
    rng = np.random.default_rng(seed)
    walks = random_walks(4 * (seed % 1000) + 1)
    grid = QuantisationGrid((0,) * walks.nodes.shape[1], 1000, 128, time)
    step = step_size(time)
    ranges = []
    for one in walks.walks:
        times = 1 + one.time_steps * step
        samples = np.stack([times[np.append(True, one.gaps)], times[np.append(one.gaps, True)]])
        inwards = rng.random(samples.shape) * min(step, 1.0) * [[0.4], [-0.4]]
        ranges.append((samples + inwards).T)
    ends = find_piece_ends(ranges, walks, grid)
    shapes = frozenset({0}) if seed % 3 == 0 else frozenset()
    with_ends = GridWalks(walks.nodes, walks.walks, True, ends, shapes)
    data = encode_smallest(with_ends, grid=grid)
    assert_agrees(data, walks.nodes.shape[1], len(walks.walks), grid)


@given(st.binary(max_size=60), st.integers(1, 4), st.integers(0, 3))
@examples(200)
def test_any_bytes_are_refused_or_decoded_as_by_the_compiled_decoder(noise, dimension, tracks):
    grid = QuantisationGrid((0,) * dimension, 0, 128, 128)
    data = bytes([4 * 30 + 3]) + noise
    try:
        decode(data, dimension, tracks, grid=grid)
    except CorruptArchiveError:
        with pytest.raises(CorruptArchiveError):
            decode_plain(data, dimension, tracks, grid, WorkLimit(PLENTY))
        return
    assert_agrees(data, dimension, tracks, grid)


def test_new_edges_to_nodes_beyond_the_candidates_are_decoded():
    rng = np.random.default_rng(3)
    line = np.column_stack([np.arange(4200) * 3, rng.integers(-2, 3, 4200)])
    route = np.concatenate([np.arange(4200), [10, 4190, 2500, 4000, 3]])
    walks = GridWalks(line, (walk(route, np.zeros(len(route))),), False)
    assert_agrees(encode(walks), 2, 1)


def test_many_cheap_choices_are_decoded():
    # over gaps between two of seventy nodes, so often that few candidates are weighed any more
    line = np.column_stack([np.arange(70) * 9, np.zeros(70)]).astype(np.int64)
    route = np.concatenate([np.arange(70), np.tile([3, 66], 8300)])
    gaps = np.arange(len(route) - 1) >= 69
    walks = GridWalks(line, (walk(route, np.zeros(len(route)), gaps),), False)
    assert_agrees(encode(walks), 2, 1)


@pytest.mark.parametrize("modes", [0, 2])
def test_forged_durations_that_are_not_positive_are_refused(modes):
    # a duration of 2**25 - 1 and more is coded as a difference from that, of either sign
    nodes = np.array([[0, 0], [30, 4], [70, 9], [90, 30], [99, 50]])
    walks = GridWalks(nodes, (walk(range(5), np.arange(5) * 2**40),))
    data, _ = encode_in_modes(walks, None, modes, np.zeros(0))
    reasons = set()
    # Every third bit, so each bit of a byte is changed in some byte.
    for bit in range(8, 8 * len(data), 3):
        forged = bytearray(data)
        forged[bit // 8] ^= 1 << bit % 8
        try:
            decode(bytes(forged), 2, 1)
        except CorruptArchiveError as error:
            reasons.add(str(error))
            with pytest.raises(CorruptArchiveError):
                decode_plain(bytes(forged), 2, 1, None, WorkLimit(PLENTY))
        else:
            assert_agrees(bytes(forged), 2, 1)
    assert "times of the walks go back" in reasons


def test_work_is_counted_and_limited():
    walks = random_walks(1, longest=200)
    data, shape = encode(walks), (walks.nodes.shape[1], len(walks.walks))

    # the least limit under which it is decoded, by bisection
    refused, accepted = 0, 10**7
    while accepted - refused > 1:
        middle = (accepted + refused) // 2
        try:
            decode_plain(data, *shape, None, WorkLimit(middle))
            accepted = middle
        except TooMuchWorkError:
            refused = middle
    knots = sum(len(one.nodes) for one in walks.walks)
    assert 30 * knots < accepted < 1000 * knots

    # a limit that two payloads share is used up by the first
    limit = WorkLimit(accepted)
    decode_plain(data, *shape, None, limit)
    with pytest.raises(TooMuchWorkError):
        decode_plain(data, *shape, None, limit)


def test_forged_knots_are_refused_before_there_is_memory_for_them():
    # 8 million knots may lie in 16 kB
    data = bytes([0x81, 0x80, 0x80, 0x10]) + bytes(1 << 14)
    with pytest.raises(TooMuchWorkError):
        decode_plain(data, 2, 1, None, WorkLimit(10**6))


def count_calls(function):
    """Calls of functions, Python's and C's, that a call leads to."""
    calls = 0

    def count(_frame, event, _argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        function()
    except (CorruptArchiveError, TooMuchWorkError):
        pass
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.parametrize("modes", range(8))
def test_forged_payloads_take_bounded_work(modes):
    # bytes all alike make long runs of one symbol: hubs, searches, gaps to known nodes
    head = bytes([0, modes]) if modes > 3 else bytes([modes] if modes else [])
    knots = 4 * 1000 + 3
    for fill in (0x00, 0x55, 0xAA, 0xF3):
        data = head + bytes([knots & 127 | 128, knots >> 7]) + bytes([fill]) * 1000
        limit = WorkLimit(40_000)
        calls = count_calls(lambda data=data, limit=limit: decode_plain(data, 2, 3, None, limit))
        assert calls < 4 * 40_000
