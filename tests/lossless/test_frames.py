"""Columns with types to bytes and back."""

import io
from datetime import date
from decimal import Decimal

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless import arrays, frame_logs, frames
from gpszip.lossless.frame_logs import FrameHead, FrameSource
from gpszip.lossless.frames import decode_frame, encode_frame
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.logs import read_exact_logs, write_exact_logs
from gpszip.lossless.trails import NO_TRAILS
from random_tests import examples

ROWS = 96


def round_trip(batch, columns=None):
    data = encode_frame(batch, GuideFinder(NO_TRAILS))
    return decode_frame(Cursor(data), batch.schema, batch.num_rows, NO_TRAILS, columns)


def bits_of(array):
    """Values as Python shows them, but floats by their bits."""
    if pa.types.is_floating(array.type):
        width = array.type.bit_width // 8
        return [
            None if value is None else np.array(value, f"f{width}").tobytes()
            for value in array.to_pylist()
        ]
    return array.to_pylist()


def with_holes(values, kind=None):
    random = np.random.default_rng(len(values))
    return pa.array(values, kind, mask=random.random(len(values)) < 0.1)


def columns():
    random = np.random.default_rng(7)
    whole = np.arange(ROWS)
    points = [b"\1\1\0\0\0" + np.array([13 + i / 1e4, 52.5], "<f8").tobytes() for i in whole]
    micro = pa.timestamp("us", tz="Europe/Berlin")
    return {
        "bytes": with_holes(random.integers(-100, 100, ROWS).astype(np.int8)),
        "unsigned": with_holes(random.integers(0, 2**63, ROWS).astype(np.uint64) * np.uint64(2)),
        "large": with_holes(random.integers(-(2**62), 2**62, ROWS)),
        "flags": with_holes(random.random(ROWS) < 0.5),
        "micro": with_holes(whole * 10**6 + 17 * 10**14).cast(micro),
        "nano": with_holes(whole * 10**9 + 17 * 10**17).cast(pa.timestamp("ns")),
        "odd nano": with_holes(whole * 10**9 + whole**3 + 17 * 10**17).cast(pa.timestamp("ns")),
        "days": with_holes([date(2024, 1, 1 + i % 31) for i in range(ROWS)]),
        "clock": with_holes(whole * 10**6).cast(pa.time64("us")),
        "waits": with_holes(whole * 7).cast(pa.duration("ms")),
        "degrees": with_holes(np.round(52 + np.cumsum(random.normal(0, 1e-4, ROWS)), 7)),
        "noise": with_holes(random.normal(size=ROWS)),
        "short": with_holes(np.round(random.normal(size=ROWS), 3).astype(np.float32)),
        "short noise": with_holes(random.normal(size=ROWS).astype(np.float32)),
        "half": with_holes(random.normal(size=ROWS).astype(np.float16)),
        "odd": pa.array([float("nan"), -0.0, float("inf"), None] * (ROWS // 4)),
        "few odd": pa.array([-0.0 if i == 9 else i / 2 for i in range(ROWS)]),
        "texts": with_holes([f"car {i % 5}" for i in range(ROWS)]),
        "all differ": with_holes([f"id-{i}-é" for i in range(ROWS)], pa.large_string()),
        "newlines": with_holes([f"a\nb{i % 7}" for i in range(ROWS)]),
        "empty": with_holes([""] * ROWS),
        "numbered": with_holes([f"c{i % 5}" for i in range(ROWS)]).dictionary_encode(),
        "binary": with_holes([bytes([i, 0, 10]) for i in range(ROWS)]),
        "points": with_holes(points),
        "no points": with_holes([b"\1\2\0\0\0" + bytes(9 * (i % 2)) for i in range(ROWS)]),
        "decimal": with_holes([Decimal(i) / 4 for i in range(ROWS)], pa.decimal128(10, 2)),
        "lists": pa.array([[1, 2], None, [], [3]] * (ROWS // 4)),
        "structs": pa.array(
            [{"x": 1.5, "y": None}, None, {"x": -0.0, "y": "q"}, {"x": None, "y": "a\nb"}]
            * (ROWS // 4)
        ),
        "nothing": pa.nulls(ROWS),
        "no numbers": pa.nulls(ROWS, pa.float64()),
        "fixed": pa.array([b"abcd"] * ROWS, pa.binary(4)),
    }


BATCH = pa.record_batch(columns())


@pytest.mark.parametrize("rows", [slice(0, ROWS), slice(5, 6), slice(11, 60)])
def test_columns_of_all_types_come_back(rows):
    batch = BATCH.slice(rows.start, rows.stop - rows.start)
    back = round_trip(batch)
    assert back.schema.equals(batch.schema)
    for name in batch.schema.names:
        assert bits_of(back[name]) == bits_of(batch[name]), name


def test_some_columns_come_back_alone():
    chosen = ["texts", "noise", "structs", "points"]
    numbers = {BATCH.schema.names.index(name) for name in chosen}
    back = round_trip(BATCH, numbers)
    assert set(back.schema.names) == set(chosen)
    for name in back.schema.names:
        assert bits_of(back[name]) == bits_of(BATCH[name])


@given(st.lists(st.floats(width=64) | st.none(), min_size=1, max_size=30), st.booleans())
@examples(30)
def test_any_floats_come_back(values, short):
    kind = pa.float32() if short else pa.float64()
    with np.errstate(all="ignore"):
        numbers = [None if v is None else np.float32(v) if short else v for v in values]
    batch = pa.record_batch({"v": pa.array(numbers, kind, from_pandas=False)})
    assert bits_of(round_trip(batch)["v"]) == bits_of(batch["v"])


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.none(), min_size=1, max_size=30))
@examples(30)
def test_any_integers_come_back(values):
    batch = pa.record_batch({"v": pa.array(values, pa.int64())})
    assert round_trip(batch).equals(batch)


@given(st.lists(st.binary(max_size=12) | st.none(), min_size=1, max_size=30))
@examples(30)
def test_any_bytes_come_back(values):
    batch = pa.record_batch({"v": pa.array(values, pa.binary())})
    assert round_trip(batch).equals(batch)


def test_damage_is_found_or_harmless():
    batch = BATCH.select(["texts", "lists", "odd", "points", "newlines", "micro"]).slice(0, 24)
    data = encode_frame(batch, GuideFinder(NO_TRAILS))
    refused = 0
    for place in range(0, len(data), 13):
        forged = bytearray(data)
        forged[place] ^= 1 << place % 8
        try:
            decode_frame(Cursor(bytes(forged)), batch.schema, 24, NO_TRAILS)
        except CorruptArchiveError:
            refused += 1
    assert refused > 8


def test_exceptions_past_the_last_row_are_refused():
    # Gaps between exceptions add up to a row of the batch, modulo 2**64.
    batch = BATCH.select(["few odd"])
    data = encode_frame(batch, GuideFinder(NO_TRAILS))
    head, exception = bytes([0, 3, 1, 1]), bytes([9])
    assert head + exception in data
    gaps = encode_varint(2**62) + encode_varint(2**63 - 2**62) + encode_varint(2**63 - 9)
    record = bytes([0, 3, 1, 3]) + gaps + bytes(24)
    forged = encode_varint(len(record)) + record + data[1 + data[0] :]
    with pytest.raises(CorruptArchiveError, match="an exception past the last of 96 numbers"):
        decode_frame(Cursor(forged), batch.schema, ROWS, NO_TRAILS)


def test_an_order_by_no_column_is_refused(monkeypatch):
    monkeypatch.setattr(frame_logs, "_encode_order", lambda batch, order: b"\7" + bytes([0, 0]))
    batch = BATCH.select(["texts", "micro"])
    source = FrameSource(FrameHead(batch.schema, "zstd", (ROWS,), 0), lambda rows: iter([batch]))
    sink = io.BytesIO()
    logs = [("a.parquet", lambda: [bytes(10**5)])]
    write_exact_logs(logs, sink, NO_TRAILS, frames={"a.parquet": source})
    found = read_exact_logs(sink.getvalue(), NO_TRAILS).frames[0]
    for columns in (None, [1]):
        with pytest.raises(CorruptArchiveError, match="keys in column 7 of 2"):
            list(found.batches(None, columns))


def test_a_log_stays_as_it_is_where_its_bytes_are_fewer():
    head = FrameHead(BATCH.schema, "zstd", (ROWS,))
    frames = {"a.parquet": FrameSource(head, lambda rows: iter([BATCH]))}
    for data, is_kept in ((b"few", False), (bytes(10**6), True)):
        sink = io.BytesIO()
        logs = [("a.parquet", lambda data=data: [data]), ("b.csv", lambda: [b"1,2\n"])]
        write_exact_logs(logs, sink, NO_TRAILS, frames=frames)
        found = read_exact_logs(sink.getvalue(), NO_TRAILS)
        assert list(found.frames) == [0] * is_kept
        assert b"".join(found.read(1)) == b"1,2\n"
        if not is_kept:
            assert b"".join(found.read(0)) == data


@pytest.mark.parametrize(
    ("module", "limit"), [(arrays, "_MAX_TEXT_BYTES"), (frames, "_MAX_INTEGERS")]
)
@pytest.mark.parametrize("column", ["newlines", "lists"])
def test_a_log_stays_as_it_is_where_no_reader_would_accept_columns(
    monkeypatch, module, limit, column
):
    monkeypatch.setattr(module, limit, 1)
    batch = BATCH.select([column, "micro", "large"])
    source = FrameSource(FrameHead(batch.schema, "zstd", (ROWS,)), lambda rows: iter([batch]))
    sink, data = io.BytesIO(), bytes(10**6)
    logs = [("a.parquet", lambda: [data])]
    write_exact_logs(logs, sink, NO_TRAILS, frames={"a.parquet": source})
    found = read_exact_logs(sink.getvalue(), NO_TRAILS)
    assert not found.frames
    assert b"".join(found.read(0)) == data


def test_rows_over_several_spans_come_back(monkeypatch):
    # Rows of tracks in turn, in spans and blocks of a few rows.
    for name, rows in {"_SPAN_ROWS": 40, "_BLOCK_ROWS": 9, "_ONE_BLOCK_ROWS": 30}.items():
        monkeypatch.setattr(frame_logs, name, rows)
    names = ["texts", "micro", "degrees", "numbered"]
    batch = BATCH.select(names)
    head = FrameHead(batch.schema, "zstd", (50, ROWS - 50), 0)
    source = FrameSource(head, lambda rows: iter([batch.slice(0, 7), batch.slice(7)]))
    sink = io.BytesIO()
    logs = [("a.parquet", lambda: [bytes(10**5)])]
    write_exact_logs(logs, sink, NO_TRAILS, frames={"a.parquet": source})
    found = read_exact_logs(sink.getvalue(), NO_TRAILS).frames[0]
    assert [len(span.blocks) for span in found.spans] == [5, 5, 2]
    assert pa.Table.from_batches(found.batches()).to_pylist() == batch.to_pylist()
    wanted = [row for row in batch.to_pylist() if row["texts"] == "car 3"]
    assert pa.Table.from_batches(found.batches("car 3")).to_pylist() == wanted
    chosen = pa.Table.from_batches(found.batches("car 3", [3, 1])).to_pylist()
    assert chosen == [{name: row[name] for name in ("numbered", "micro")} for row in wanted]
    degrees = pa.Table.from_batches(found.batches(None, [2])).to_pylist()
    assert degrees == batch.select(["degrees"]).to_pylist()
