import math

import constriction
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.kernels.range_coder import (
    code_bits,
    code_interval,
    decode_cumulative,
    finish,
    is_decoding,
    new_decoder,
    new_encoder,
)
from gpszip.kernels.jit import jit
from oracle.range_coder import Decoder, Encoder
from random_tests import examples


@jit
def _code_all(coder, starts, widths, totals):
    for i in range(len(starts)):
        code_interval(coder, starts[i], widths[i], totals[i])


@jit
def _find_all(coder, starts, widths, totals, found):
    for i in range(len(starts)):
        found[i] = decode_cumulative(coder, totals[i])
        code_interval(coder, starts[i], widths[i], totals[i])


@jit
def _code_symbols(coder, symbols, edges):
    """Code symbols of one distribution."""
    total = edges[-1]
    for i in range(len(symbols)):
        if is_decoding(coder):
            symbols[i] = np.searchsorted(edges, decode_cumulative(coder, total), side="right") - 1
        s = symbols[i]
        code_interval(coder, edges[s], edges[s + 1] - edges[s], total)


@jit
def _code_raw(coder, values, counts):
    for i in range(len(values)):
        values[i] = code_bits(coder, values[i], counts[i])


def written(intervals):
    """Bytes of the kernel for (start, width, total) rows; the plain encoder writes the same."""
    rows = np.array(intervals, np.int64).reshape(-1, 3)
    coder = new_encoder(16 + 8 * len(rows))
    _code_all(coder, *rows.T.copy())
    plain = Encoder()
    for row in rows.tolist():
        plain.interval(*row)
    data = finish(coder)
    assert data == plain.finish()
    return data


def assert_decodes(data, intervals):
    rows = np.array(intervals, np.int64).reshape(-1, 3)
    found = np.zeros(len(rows), np.int64)
    _find_all(new_decoder(data), *rows.T.copy(), found)
    assert ((rows[:, 0] <= found) & (found < rows[:, 0] + rows[:, 1])).all()
    plain = Decoder(data)
    for (start, width, total), at in zip(rows.tolist(), found.tolist(), strict=True):
        assert plain.decode_cumulative(total) == at
        plain.interval(start, width, total)
    assert not plain.is_exhausted


@st.composite
def intervals(draw):
    total = draw(st.integers(1, 300) | st.sampled_from([2**16, 2**41, 2**41 - 1, 2**33 + 1]))
    start = draw(st.sampled_from([0, total - 1]) | st.integers(0, total - 1))
    width = draw(st.sampled_from([1, total - start]) | st.integers(1, total - start))
    return start, width, total


@given(st.lists(intervals(), max_size=60))
@examples(150)
def test_bytes_are_those_of_the_plain_encoder_and_decode(rows):
    assert_decodes(written(rows), rows)


@pytest.mark.parametrize("seed", range(4))
def test_long_sequences_take_their_entropy(seed):
    rng = np.random.default_rng(seed)
    widths = rng.integers(1, 10 ** (1 + 2 * seed), 50)
    widths[7] = max(1, 10**seed)
    edges = np.concatenate([[0], np.cumsum(widths)])
    chances = widths / widths.sum()
    symbols = rng.choice(50, 20_000, p=chances)
    coder = new_encoder(100_000)
    _code_symbols(coder, symbols.copy(), edges)
    data = finish(coder)
    entropy = -np.log2(chances[symbols]).sum() / 8
    assert len(data) <= 1 + 1.001 * entropy
    back = np.zeros_like(symbols)
    _code_symbols(new_decoder(data), back, edges)
    np.testing.assert_array_equal(back, symbols)


@pytest.mark.parametrize("seed", range(3))
def test_lengths_are_those_of_constriction(seed):
    rng = np.random.default_rng(seed)
    chances = rng.dirichlet(np.full(40, 0.3))
    # constriction counts in 2**-24; so do we, to code the very same probabilities
    widths = np.maximum(np.round(chances * 2**24), 1).astype(np.int64)
    widths[widths.argmax()] += 2**24 - widths.sum()
    model = constriction.stream.model.Categorical(widths / 2**24, perfect=False)
    symbols = rng.choice(40, 30_000, p=widths / 2**24)
    reference = constriction.stream.queue.RangeEncoder()
    reference.encode(symbols.astype(np.int32), model)
    words = reference.get_compressed()
    coder = new_encoder(200_000)
    edges = np.concatenate([[0], np.cumsum(widths)])
    _code_symbols(coder, symbols.copy(), edges)
    data = finish(coder)
    assert abs(len(data) - 4 * len(words)) <= 8
    back = np.zeros_like(symbols)
    _code_symbols(new_decoder(data), back, edges)
    np.testing.assert_array_equal(
        back, constriction.stream.queue.RangeDecoder(words).decode(model, 30_000)
    )


def straddling(length, total):
    """Intervals around the border of a byte; those before it stay undecided: 7f ff ff ..."""
    plain, rows = Encoder(), []
    for _ in range(length):
        border = 0x80 << (56 + 8 * plain.shifts)
        start = (border - plain.low) // (plain.range // total)
        assert plain.low < border < plain.low + plain.range
        rows.append((start, 1, total))
        plain.interval(*rows[-1])
    border = 0x80 << (56 + 8 * plain.shifts)
    above = -(-(border - plain.low) // (plain.range >> 40))
    return rows, (0, above - 1, 2**40), (above, 2**40 - above, 2**40)


@pytest.mark.parametrize("total", [3, 255, 1000, 2**20 + 7])
@pytest.mark.parametrize("length", [30, 31, 200])
def test_a_carry_runs_through_all_undecided_bytes(length, total):
    rows, below, above = straddling(length, total)
    waiting = max(int(length * math.log2(total) / 8) - 8, 0)
    for last, head in ((below, b"\x7f" + b"\xff" * waiting), (above, b"\x80" + bytes(waiting))):
        ended = [*rows, last, *[(1, 1, 7)] * 30]
        data = written(ended)
        assert data.startswith(head)
        assert_decodes(data, ended)


def test_certain_symbols_take_no_byte():
    assert written([]) == b""
    assert written([(0, 1, 1)] * 1000) == b""


def test_the_end_takes_the_fewest_bytes():
    for first in range(256):
        assert len(written([(first, 1, 256)])) <= 2
    # an interval of a quarter holds a number of one byte
    assert all(len(written([(i, 1, 4)])) <= 1 for i in range(4))


def test_zeros_at_the_end_that_a_decoder_needs_stay():
    rows = [(1, 1, 256)] + [(0, 1, 256)] * 100
    data = written(rows)
    assert data.rstrip(b"\0") != data
    assert_decodes(data, rows)


@given(st.binary(max_size=40))
def test_any_bytes_decode(data):
    edges = np.array([0, 1, 5, 1000, 2**20])
    symbols = np.zeros(200, np.int64)
    _code_symbols(new_decoder(data), symbols, edges)
    plain = Decoder(data)
    for symbol in symbols.tolist():
        at = plain.decode_cumulative(int(edges[-1]))
        assert edges[symbol] <= at < edges[symbol + 1]
        plain.interval(int(edges[symbol]), int(edges[symbol + 1] - edges[symbol]), int(edges[-1]))


def test_bytes_past_the_end_read_as_zeros():
    symbols, padded = np.zeros(300, np.int64), np.zeros(300, np.int64)
    _code_symbols(new_decoder(b"\x9a\x41"), symbols, np.array([0, 3, 4]))
    _code_symbols(new_decoder(b"\x9a\x41" + bytes(200)), padded, np.array([0, 3, 4]))
    np.testing.assert_array_equal(symbols, padded)


@given(
    st.lists(
        st.integers(1, 32).flatmap(lambda n: st.tuples(st.integers(0, 2**n - 1), st.just(n))),
        max_size=50,
    )
)
def test_equally_likely_bits_round_trip_and_take_a_bit_each(pairs):
    values, counts = (
        np.array([v for v, _ in pairs], np.int64),
        np.array([n for _, n in pairs], np.int64),
    )
    coder = new_encoder(500)
    _code_raw(coder, values.copy(), counts)
    data = finish(coder)
    assert len(data) <= math.ceil(counts.sum() / 8) + 1
    back = np.zeros(len(pairs), np.int64)
    _code_raw(new_decoder(data), back, counts)
    np.testing.assert_array_equal(back, values)


def test_an_encoder_without_capacity_says_so():
    starts = np.arange(5000) % 255
    coder = new_encoder(10)
    _code_all(coder, starts, np.ones(5000, np.int64), np.full(5000, 256))
    assert finish(coder) is None
    assert len(coder.data) == 26
