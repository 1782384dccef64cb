"""Blocks of text to bytes and back."""

import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gpszip.container.layout import Cursor
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.notation import decode_notation, encode_notation, find_notation
from gpszip.lossless.text import MAX_BLOCK_BYTES, _split, decode_block, encode_block
from gpszip.lossless.trails import NO_TRAILS
from oracle.tokens import split_plainly
from random_tests import examples

#: Text of numbers in all notations, dates, words and separators.
PIECES = st.sampled_from(
    [
        *("0", "7", "12", "007", "-1", "-0", "-0.0", "0.50", "1e-05", "+3", ".", "-", "3."),
        *(".5", "12.345", "0" * 20, "-9.9", "1234567890" * 3, "0.1234567890123456789", "9" * 17),
        *("2008-10-23T02:53:04Z", "2008-10-23", "2024/02/29", "23:59:60", "07:08:09.250"),
        "1969-12-31T00:00:00",
        "2008-10-23 02:53:04",
        "2024/02/29 00:00:00",
        "2023-02-29T00:00:00",
        "9999-12-31T23:59:59.999",
        *(",", "\n", "\r\n", " ", ";", '"', "<trkpt lat=", "é", "],[", "},{", "\t"),
    ]
)
TEXTS = st.lists(PIECES, max_size=80).map("".join)


def round_trip(text: bytes) -> bytes:
    data = encode_block(text, GuideFinder(NO_TRAILS))
    assert decode_block(Cursor(data), len(text), NO_TRAILS) == text
    return data


@given(TEXTS)
@example("-0.00,1\n" * 5)
@example("0.5,00.5\n12.25,1.\n")
@settings(deadline=None)
def test_any_text_comes_back(text):
    round_trip(text.encode())


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_any_bytes_come_back(data):
    round_trip(data)


@given(TEXTS)
@settings(deadline=None)
def test_records_come_back_from_their_shapes(text):
    text = text.encode()
    if text:
        records = _split(text)
        assert records.write(len(text)) == text
        assert records.write(len(text) + 1) is None
        assert records.write(len(text) - 1) is None


@given(TEXTS)
@settings(deadline=None)
def test_tokens_are_those_that_the_plain_reader_finds(text):
    text = text.encode()
    if text:
        records = _split(text)
        values, decimals, widths = split_plainly(text)
        assert records.values.tolist() == values
        assert records.decimals.tolist() == decimals
        assert records.widths.tolist() == widths


def log(rows=2000, seed=1):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.integers(1, 4, rows))
    x, y = np.cumsum(random.normal(0, 3, (2, rows)), axis=1)
    return t, x, y


@pytest.mark.parametrize(
    "line",
    [
        "{t}.000,{x:.3f},{y:.3f}\n",
        "{t}\t{x:.1f}\t{y:.6f}\r\n",
        '"bus 7";{t};{x:+.3f};{y:.3f}\n',
        '<trkpt lat="{x:.6f}" lon="{y:.6f}"><ele>{t}</ele></trkpt>\n',
        '  <trkpt lat="{x:.6f}"\n lon="{y:.6f}">\n<time>{date}Z</time>\n  </trkpt>\n',
        "[{x:.5f}, {y:.5f}, {t}],",
    ],
)
def test_a_log_takes_about_the_bytes_of_its_numbers(line):
    t, x, y = log()
    dates = np.datetime64("2024-02-28T23:00:00") + t.astype("m8[s]")
    text = "".join(
        line.format(t=t[i], x=x[i], y=y[i], date=dates[i]) for i in range(len(t))
    ).encode()
    assert len(round_trip(text)) < len(text) / 4


@pytest.mark.parametrize("form", ["{:.17g}", "{!r}", "{:.6e}", "{:g}"])
def test_floats_in_all_forms_come_back(form):
    values = np.random.default_rng(2).normal(0, 10.0 ** np.arange(-8, 12), (60, 20)).ravel()
    round_trip("\n".join(form.format(float(value)) for value in values).encode())


def test_float32_in_text_comes_back():
    values = np.random.default_rng(3).normal(0, 50, 1000).astype(np.float32)
    round_trip("\n".join(map(str, values.astype(float).tolist())).encode())


def test_many_names_do_not_make_many_tables():
    t, x, y = log()
    rows = [f"car_{i % 500:x}w,{t[i]},{x[i]:.2f},{y[i]:.2f}\n" for i in range(len(t))]
    assert len(round_trip("".join(rows).encode())) < len("".join(rows)) / 3


def test_bytes_that_are_no_text_are_stored():
    noise = np.random.default_rng(4).bytes(5000)
    assert len(round_trip(noise)) == 5001
    assert len(round_trip(b"\xff" * 5000)) < 100


def test_minus_zeros_stay_in_their_table():
    lines = ["-0.00,7\n" if i % 3 == 1 else f"{i % 5}.25,7\n" for i in range(3000)]
    assert len(round_trip("".join(lines).encode())) < 300


def test_forged_minus_zeros_are_refused():
    values = np.array([0, 0, 5, 0])
    notation, _ = find_notation(values, np.zeros(4, np.uint8), np.array([1, 129, 1, 129], np.uint8))
    data = encode_notation(notation)
    back = decode_notation(Cursor(data), 4)
    assert back.minus_zeros.tolist() == [1, 3]
    for rows, message in ((1, "2 minus zeros of 1"), (3, "a minus zero past the last of 3")):
        with pytest.raises(CorruptArchiveError, match=message):
            decode_notation(Cursor(data), rows)


@pytest.mark.parametrize("text", [b"", b"\n", b"7", b"7\n7", b"x", b"-", b".", b"-7", b"12:34:5"])
def test_the_smallest_texts_come_back(text):
    round_trip(text)


NUMBERS = st.tuples(st.integers(-(10**17) + 1, 10**17 - 1), st.integers(0, 17), st.integers(1, 17))


@given(st.lists(NUMBERS, min_size=1, max_size=30))
@settings(deadline=None)
def test_any_notation_comes_back(numbers):
    values = np.array([value for value, _, _ in numbers], np.int64)
    places = np.array([place for _, place, _ in numbers], np.uint8)
    # No number is written with fewer digits than it has.
    least = [
        len(str(abs(v) // 10**p)) for v, p in zip(values.tolist(), places.tolist(), strict=True)
    ]
    widths = np.maximum([width for _, _, width in numbers], least).astype(np.uint8)
    notation, column = find_notation(values, places, widths)
    cursor = Cursor(encode_notation(notation))
    back = decode_notation(cursor, len(values)).apply(column)
    cursor.expect_end("the notation")
    assert np.array_equal(back[0], values)
    assert np.array_equal(back[1], places)
    assert np.array_equal(np.maximum(back[2], least), widths)


@pytest.mark.parametrize(
    ("data", "size", "message"),
    [
        (b"\x03", 1, "no block is coded by method 3"),
        (b"\x00ab", 3, "a block holds 2 bytes, not 3"),
        (b"\x00", MAX_BLOCK_BYTES + 1, "at most"),
        (b"\x02\x05\x01\x01", 4, "1 bytes, but 0 are left"),
        (b"\x02\x05\x09\x01", 4, "9 shapes of 1 bytes for 4 bytes of text"),
        (b"\x01\x07\x07", 3, "can't be expanded"),
    ],
)
def test_a_forged_block_is_refused(data, size, message):
    with pytest.raises(CorruptArchiveError, match=re.escape(message)):
        decode_block(Cursor(data), size)


@given(st.data())
@examples(200)
def test_a_changed_block_is_other_text_or_an_error(data):
    text = b"".join(b"%d,%.2f,a%02d\n" % (i * 3, i / 7, i) for i in range(40))
    block = bytearray(encode_block(text, GuideFinder(NO_TRAILS)))
    for _ in range(data.draw(st.integers(1, 3))):
        block[data.draw(st.integers(0, len(block) - 1))] = data.draw(st.integers(0, 255))
    try:
        assert len(decode_block(Cursor(bytes(block)), len(text), NO_TRAILS)) == len(text)
    except CorruptArchiveError:
        return
