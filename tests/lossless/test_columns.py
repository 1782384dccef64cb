"""Columns of integers to bytes and back."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.container.layout import Cursor
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.columns import (
    MAX_VALUE,
    CodedColumn,
    _choose,
    _encode_with,
    decode_column,
    encode_column,
    skip_column,
)
from gpszip.lossless.kernels import column_coder, decisions
from gpszip.lossless.setting import EXACT, FEW, MANY, NEAR
from oracle.exact_logs import Bytes, read_column
from oracle.lossless import ColumnDecoder

#: Columns of many kinds: any integers, small steps, few different steps, noise about a line.
VALUES = st.integers(-MAX_VALUE + 1, MAX_VALUE - 1)
STEPS = st.lists(st.integers(-9, 9) | st.sampled_from([0, 0, 0, 40, 5000]), max_size=200)
COLUMNS = st.lists(VALUES, max_size=60) | STEPS.map(lambda steps: np.cumsum(steps).tolist())


def drive(rows=400, seed=1, noise=3):
    """Times, x and y of a drive with stops, jitter and a jump, in whole steps."""
    random = np.random.default_rng(seed)
    elapsed = random.choice([1, 1, 1, 2, 30], rows)
    speed = np.abs(np.cumsum(random.normal(0, 2, rows))) * (random.random(rows) > 0.2)
    turn = np.cumsum(random.normal(0, 0.1, rows))
    x = np.cumsum(speed * elapsed * np.cos(turn)) + random.normal(0, noise, rows)
    y = np.cumsum(speed * elapsed * np.sin(turn)) + random.normal(0, noise, rows)
    x[rows // 2 :] += 10**6
    return [np.asarray(np.round(column), np.int64) for column in (np.cumsum(elapsed), x, y)]


def coded(values):
    return encode_column(np.asarray(values, np.int64))[1]


@given(COLUMNS)
@settings(deadline=None)
def test_any_integers_come_back(values):
    values = np.array(values, np.int64)
    data, column = encode_column(values)
    cursor = Cursor(data)
    back, known = decode_column(cursor, len(values))
    assert np.array_equal(back, values)
    assert np.array_equal(known.sizes, column.sizes)
    cursor.expect_end("the column")


@given(COLUMNS, COLUMNS, COLUMNS)
@settings(deadline=None)
def test_any_columns_help_each_other(values, times, side):
    rows = min(len(values), len(times), len(side))
    values = np.array(values[:rows], np.int64)
    times, side = coded(times[:rows]), coded(side[:rows])
    data, _ = encode_column(values, times, [side])
    assert np.array_equal(decode_column(Cursor(data), rows, times, [side])[0], values)


@pytest.mark.parametrize("order", [NEAR, EXACT])
@pytest.mark.parametrize(
    ("noise", "contexts"), [(0.2, FEW), (3, FEW), (3, MANY), (10**4, MANY), (10**9, FEW)]
)
def test_the_plain_decoder_reads_what_the_kernel_writes(order, noise, contexts):
    times, x, y = drive(noise=noise)
    sides = [coded(x), coded(y[::-1])]
    known = [coded(times), *sides]
    setting = _choose(y, order)._replace(contexts=contexts)
    payload, sizes = _encode_with(setting, y.copy(), known[0], sides, None)
    plain = ColumnDecoder(
        payload,
        setting,
        times.tolist(),
        [side.values.tolist() for side in sides],
        [side.shift for side in sides],
        [side.sizes.tolist() for side in sides],
    )
    values, plain_sizes = plain.decode(int(y[0]), len(y))
    assert values == y.tolist()
    assert plain_sizes == sizes.tolist()


def test_a_column_alone_agrees_with_the_plain_decoder():
    times = drive()[0]
    for order in (NEAR, EXACT):
        setting = _choose(times, order)
        payload, _ = _encode_with(setting, times.copy(), None, [], None)
        values, _ = ColumnDecoder(payload, setting, [], [], [], []).decode(1, len(times))
        assert values == (times - times[0] + 1).tolist()


def test_a_path_takes_fewer_bytes_with_its_times_and_other_axis():
    random = np.random.default_rng(3)
    times = np.cumsum(random.integers(1, 20, 3000))
    x = 50 * times + random.integers(-3, 4, 3000)
    y = 2 * x + random.integers(-1, 2, 3000)
    alone = sum(len(encode_column(column)[0]) for column in (x, y))
    known = coded(times)
    data, side = encode_column(x, known)
    together = len(data) + len(encode_column(y, known, [side])[0])
    assert together < 0.8 * alone


def test_noise_takes_little_more_than_its_entropy():
    values = np.random.default_rng(4).integers(0, 256, 20_000)
    assert len(encode_column(values)[0]) < 20_000 * 1.12


def test_standing_still_takes_a_few_bytes():
    assert len(encode_column(np.full(10**6, 7))[0]) < 8
    assert len(encode_column(np.arange(10**5) * 1000)[0]) < 80


def test_long_runs_are_coded_by_their_lengths():
    values = np.repeat([7, -3, 7, 10**12], [700, 1, 900, 400])
    data, column = encode_column(values)
    cursor = Cursor(data)
    back, _ = decode_column(cursor, len(values))
    cursor.expect_end("the column")
    assert np.array_equal(back, values)
    assert read_column(Bytes(data), len(values)).values == values.tolist()
    assert len(data) < 60
    assert not column.sizes.any()


@pytest.mark.parametrize(
    ("rows", "lengths", "message"),
    [
        (600, [300, 301], "the runs do not have 600 values"),
        (600, [600, 0], "the runs do not have 600 values"),
        (511, [300, 211], "2 runs of 511 values"),
        (600, [], "0 runs of 600 values"),
    ],
)
def test_forged_runs_are_refused(rows, lengths, message):
    runs = np.array(lengths, np.int64)
    parts = encode_column(np.arange(len(runs)))[0], encode_column(runs)[0]
    with pytest.raises(CorruptArchiveError, match=message):
        decode_column(Cursor(bytes([5, len(runs)]) + b"".join(parts)), rows)


def test_a_column_in_parts_has_the_bytes_of_the_whole():
    times, x, _ = drive(rows=4500, noise=40)
    data, known = encode_column(x, coded(times))
    whole, sizes = _encode_with(_choose(x, data[0] - 6), x, coded(times), [], None)
    assert data.endswith(whole)
    assert np.array_equal(known.sizes, sizes)


def test_tables_are_the_same_on_every_machine():
    # An error of exp or log in the last digit must not change what is rounded.
    exact = [
        65536 / (1 + np.exp(-np.arange(-3072, 3073) / 256)),
        65536 / (1 + np.exp(-np.arange(-1024, 1025) / 64)),
        256 * np.log(np.arange(1, 65538)),
        256 * np.log((np.arange(4096) + 0.5) / (4095.5 - np.arange(4096))),
        65536 / (np.arange(256) + 1.6),
        4 + 2600 / (100 + np.arange(4096)),
    ]
    for numbers in exact:
        fractions = np.abs(numbers - np.floor(numbers) - 0.5)
        ties = fractions == 0
        assert np.all(ties | (fractions > 1e-9 * np.maximum(np.abs(numbers), 1) / 1000))
    assert column_coder._LOGISTIC[1024] == 32768
    assert decisions._SQUASH[3072] == 32768


@pytest.mark.parametrize(
    ("position", "byte", "message"),
    [
        (0, 3, "no column is coded by method 3"),
        (4, 41, "the setting of a column is out of range"),
        (5, 99, "the setting of a column is out of range"),
    ],
)
def test_a_forged_head_is_refused(position, byte, message):
    data = bytearray(encode_column(np.array([3, 1, 4, 1, 5]))[0])
    data[position if position == 0 else position - 1] = byte
    with pytest.raises(CorruptArchiveError, match=re.escape(message)):
        decode_column(Cursor(bytes(data)), 5)


@given(st.binary(max_size=80), st.integers(0, 50))
@settings(deadline=None)
def test_any_bytes_are_a_column_or_an_error(data, rows):
    passed = Cursor(data)
    try:
        skip_column(passed, rows)
    except CorruptArchiveError:
        passed = None
    decoded = Cursor(data)
    try:
        values, _ = decode_column(decoded, rows)
    except CorruptArchiveError:
        return
    assert len(values) == rows
    assert passed is not None
    assert passed.offset == decoded.offset


@pytest.mark.parametrize("rows", [1, 5000, 300_000])
def test_a_column_is_passed_over_as_it_is_decoded(rows):
    # Of 300,000 values, 1,154 runs have 260 rows, but for the last: lengths are runs, too.
    for values in (np.full(rows, 7), np.arange(rows), np.arange(rows) // 260):
        data = encode_column(values)[0]
        cursor = Cursor(data + b"\7")
        assert skip_column(cursor, rows) == (bool(values.any() and values[-1] != values[0]), False)
        assert cursor.remaining == 1


def test_forged_runs_of_runs_are_refused():
    with pytest.raises(CorruptArchiveError, match="1 runs of 1 values"):
        skip_column(Cursor(b"\5\1" * 5000), 300)
    with pytest.raises(CorruptArchiveError, match="no column is coded by method 10"):
        skip_column(Cursor(bytes([10, 1])), 300)


def test_a_payload_that_ends_early_is_refused():
    data, _ = encode_column(np.random.default_rng(5).integers(0, 2**40, 4000))
    cursor = Cursor(data)
    with pytest.raises(CorruptArchiveError, match="ends before its 9000 values"):
        decode_column(cursor, 9000)


def test_a_constant_column_predicts_nothing():
    assert CodedColumn(np.full(4, 9), 0, np.zeros(4, np.uint8)).is_constant
    assert not CodedColumn(np.arange(4), 0, np.zeros(4, np.uint8)).is_constant
