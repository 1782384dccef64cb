"""Kept columns come back exactly, and forged ones are refused."""

import contextlib
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gpszip.container import columns
from gpszip.container.attributes import (
    KeptColumns,
    encode_attributes,
    read_attributes,
    read_column_names,
)
from gpszip.container.layout import encode_varint
from gpszip.errors import CorruptArchiveError, OptionError
from oracle import attributes as plain
from random_tests import examples


def column(n):
    numbers = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-10_000, 10_000).map(
        lambda i: i / 100
    )
    return st.one_of(
        hnp.arrays(np.int64, n),
        hnp.arrays(np.int64, n, elements=st.integers(-5, 5)),
        hnp.arrays(np.float64, n, elements=numbers),
        hnp.arrays(
            np.float64, n, elements=st.integers(-999, 999).map(lambda i: i / 10) | st.just(np.nan)
        ),
        st.lists(st.text(max_size=6), min_size=n, max_size=n).map(
            lambda texts: np.array(texts, dtype=object)
        ),
    )


@st.composite
def kept_columns(draw):
    counts = tuple(draw(st.lists(st.integers(1, 8), min_size=1, max_size=4)))
    n = sum(counts)
    ticks = np.cumsum(draw(hnp.arrays(np.int64, n, elements=st.integers(1, 10_000))))
    times = ticks / draw(st.sampled_from([1, 10, 1000, 10**6, 7]))
    names = draw(st.lists(st.text(max_size=5), max_size=3, unique=True))
    return KeptColumns(counts, times, {name: draw(column(n)) for name in names})


@given(kept_columns())
@examples(50)
def test_columns_round_trip(kept):
    body = encode_attributes(kept)
    back = read_attributes(body, len(kept.counts))
    assert read_column_names(body, len(kept.counts)) == tuple(kept.columns)
    assert back.counts == kept.counts
    np.testing.assert_array_equal(back.times, kept.times)
    assert list(back.columns) == list(kept.columns)
    for name, values in kept.columns.items():
        assert back.columns[name].dtype == values.dtype
        np.testing.assert_array_equal(back.columns[name], values)
    assert encode_attributes(kept) == body


def example(n=40):
    times = 1.7e9 + np.arange(n) + np.arange(n) % 3 / 1000
    speed = np.where(np.arange(n) % 9 == 0, np.nan, np.round(3 * np.sin(np.arange(n)), 1))
    return KeptColumns(
        (n - 10, 10),
        times,
        {
            "speed": speed,
            "mode": np.array(["walk", "bus"])[np.arange(n) // 11 % 2],
            "n": np.arange(n),
        },
    )


@given(kept_columns())
@examples(40)
def test_the_plain_reader_agrees(kept):
    counts, times, columns = plain.read_attributes(encode_attributes(kept), len(kept.counts))
    assert counts == list(kept.counts)
    assert times == kept.times.tolist()
    for name, values in kept.columns.items():
        np.testing.assert_array_equal(np.array(columns[name], dtype=values.dtype), values)


GOLDEN = (
    "1e0a03057370656564046d6f6465016e2480a0abfef962d20f011d63606563208c006214804020100800320198012d31072a360e23135b"
    "40381e17352512284213312d002e3208351d192438161f351d3a0b440f0c020924036275730477616c6b012d63628203060460c2100500"
    "2000020000"
)


def test_the_oldest_section_is_read():
    back = read_attributes(bytes.fromhex(GOLDEN), 2)
    kept = example()
    assert back.counts == kept.counts
    np.testing.assert_array_equal(back.times, kept.times)
    for name, values in kept.columns.items():
        np.testing.assert_array_equal(back.columns[name], values)


def test_rows_of_each_track():
    kept = read_attributes(encode_attributes(example()), 2)
    np.testing.assert_array_equal(kept.columns["n"][kept.rows(1)], np.arange(30, 40))


def test_regular_columns_take_few_bytes():
    n = 100_000
    kept = KeptColumns((n,), 1.7e9 + np.arange(n) / 10, {"n": np.arange(n), "still": np.zeros(n)})
    assert len(encode_attributes(kept)) < 150
    rough = KeptColumns(
        (n,),
        np.arange(n) * 1.0,
        {"ele": np.round(np.cumsum(np.random.default_rng(1).normal(0, 0.3, n)), 1)},
    )
    assert len(encode_attributes(rough)) < 0.55 * n


def test_long_regular_columns_are_read():
    n = 3_000_000
    kept = KeptColumns((n,), np.arange(n) * 1.0)
    assert len(read_attributes(encode_attributes(kept), 1).times) == n


def test_every_truncation_and_flipped_bit_is_refused_or_read():
    body = encode_attributes(example())
    for end in range(len(body)):
        with pytest.raises(CorruptArchiveError):
            read_attributes(body[:end], 2)
    refused = 0
    for place in range(8 * len(body)):
        forged = bytearray(body)
        forged[place // 8] ^= 1 << place % 8
        try:
            read_attributes(bytes(forged), 2)
        except CorruptArchiveError:
            refused += 1
    assert refused > len(body)


@given(st.binary(max_size=60), st.integers(0, 5))
@examples(300)
def test_any_bytes_are_refused_or_read(data, tracks):
    with contextlib.suppress(CorruptArchiveError):
        read_attributes(data, tracks)


def packed(data):
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    small = packer.compress(data) + packer.flush()
    return encode_varint(4 * len(small) + 1) + small


HUGE = 1 << 40
FORGED = {
    "too many samples": encode_varint(HUGE) + encode_varint(0) + b"\x01\x00\x00\x00",
    "too many columns": encode_varint(1) + encode_varint(HUGE),
    "too many samples for the columns": encode_varint(1 << 20)
    + encode_varint(9)
    + b"".join(bytes([1, 65 + i]) for i in range(9))
    + bytes(40),
    "two of one name": encode_varint(1) + encode_varint(2) + b"\x01a\x01a" + bytes(20),
    "a name that is no text": encode_varint(1) + encode_varint(1) + b"\x01\xff" + bytes(20),
    "a block too large": encode_varint(1)
    + encode_varint(0)
    + bytes([0, 8])
    + encode_varint(4 * HUGE),
    "a block that grows": encode_varint(9)
    + encode_varint(0)
    + bytes([0, 8])
    + packed(bytes(10_000_000)),
    "numbers of nine bytes": encode_varint(1) + encode_varint(0) + bytes([0, 9, 4 * 9]) + bytes(9),
    "an unknown kind": encode_varint(1) + encode_varint(0) + bytes([13, 0, 0]),
    "times that stand still": encode_varint(2) + encode_varint(0) + bytes([0, 0, 0]),
    "times with holes": encode_varint(1) + encode_varint(0) + bytes([1 | 64, 4, 128, 0, 0]),
    "times that are texts": encode_varint(1) + encode_varint(0) + bytes([12, 1, 1, 4, 0, 0, 0]),
    "a text that is not there": encode_varint(1)
    + encode_varint(1)
    + b"\x01a"
    + bytes([0, 0, 0, 12, 0, 0, 0, 0, 0]),
    "texts that are too many": encode_varint(1)
    + encode_varint(1)
    + b"\x01a"
    + bytes([0, 0, 0, 12])
    + encode_varint(HUGE)
    + encode_varint(HUGE)
    + bytes(9),
    "bytes after the end": encode_varint(1) + encode_varint(0) + bytes([0, 0, 0, 7]),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_bodies_are_refused(name):
    with pytest.raises(CorruptArchiveError):
        read_attributes(FORGED[name], 1)


def test_columns_that_can_t_be_kept_are_named():
    for values in (
        np.array([1, "a"], dtype=object),
        np.array([1, 1 << 63], np.uint64),
        np.array(["2024-01-01"] * 2, "M8[D]"),
    ):
        with pytest.raises(OptionError, match="'odd'"):
            encode_attributes(KeptColumns((2,), np.arange(2.0), {"odd": values}))


@given(kept_columns(), st.integers(1, 5))
@examples(60)
def test_columns_read_in_chunks_round_trip(kept, chunk):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns, "_CHUNK", chunk)
        patch.setattr(columns, "LARGE", 8)
        patch.setattr(columns, "_MAX_SPOOLED", 8)
        body = encode_attributes(kept)
    back = read_attributes(body, len(kept.counts))
    np.testing.assert_array_equal(back.times, kept.times)
    for name, values in kept.columns.items():
        np.testing.assert_array_equal(back.columns[name], values)


def test_noise_is_stored_unpacked(monkeypatch):
    monkeypatch.setattr(columns, "LARGE", 1000)
    noise = np.random.default_rng(1).integers(-(1 << 62), 1 << 62, 4000)
    body = encode_attributes(KeptColumns((4000,), np.arange(4000.0), {"noise": noise}))
    assert np.array_equal(read_attributes(body, 1).columns["noise"], noise)
    assert len(body) < 32_200
