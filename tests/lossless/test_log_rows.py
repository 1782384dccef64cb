"""Logs kept as rows of tracks, of which some rows and columns are read."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.container.expansion import deflate
from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError, OptionError
from gpszip.lossless import tables, write_logs
from gpszip.lossless.columns import encode_column
from gpszip.lossless.layout import MAX_COLUMNS, TableLayout, decode_layout, encode_layout
from gpszip.lossless.logs import ExactLogs, read_exact_logs, write_exact_logs
from gpszip.lossless.order import read_key
from gpszip.lossless.rows import has_stray_quotes
from gpszip.lossless.text import decode_cells
from gpszip.lossless.trails import NO_TRAILS, NamedTrails
from oracle import exact_logs
from random_tests import examples

HEADER = b"# fleet\nid;t;x;ele;hr\r\n"
LAYOUT = TableLayout(ord(";"), HEADER, has_header=True, width=5, track_column=0)
NAMES = NamedTrails(("bus 1", "7", "tram"))


def body_of(data, layout=LAYOUT, trails=NAMES):
    sink = io.BytesIO()
    # Chunks end within rows.
    chunks = [data[i : i + 997] for i in range(0, len(data), 997)]
    write_exact_logs([("a.csv", lambda: chunks)], sink, trails, {"a.csv": layout})
    return sink.getvalue()


def fleet(rows=700, seed=1):
    """Rows of three vehicles in turn, two of which the archive knows by these names."""
    random = np.random.default_rng(seed)
    vehicle = random.integers(0, 3, rows)
    x = np.cumsum(random.normal(0, 30, (3, rows)), axis=1)
    ele = np.cumsum(random.integers(-2, 3, (3, rows)), axis=1)
    names = ["bus 1", "7", '"car; red"']
    lines = [
        f"{names[v]};{1000 + i}.5;{x[v, i]:.2f};{400 + ele[v, i] / 10:.1f};{ele[v, i] % 70}\r\n"
        for i, v in enumerate(vehicle.tolist())
    ]
    return HEADER + "".join(lines).encode(), lines


def cells(line):
    """Cells of a row, one of which may have a delimiter in quotes."""
    return line.strip().replace("car; red", "car_ red").split(";")


@pytest.fixture(scope="module")
def small_parts():
    """A section of several spans of several blocks."""
    patch = pytest.MonkeyPatch()
    for name, size in {
        "MAX_SPAN_BYTES": 8_000,
        "MAX_BLOCK_BYTES": 4_000,
        "_SORTED_BLOCK_BYTES": 2_000,
    }.items():
        patch.setattr(write_logs, name, size)
    data, lines = fleet()
    body = body_of(data)
    patch.undo()
    return data, lines, body


def test_rows_of_tracks_in_turn_come_back(small_parts):
    data, _, body = small_parts
    found = read_exact_logs(body, NAMES)
    assert len(found.spans) > 2
    assert all(len(span.blocks) > 2 for span in found.spans[:-1])
    assert b"".join(found.read(0)) == data
    assert b"".join(found.read(0, 10_000, 4_000)) == data[10_000:14_000]
    assert sorted(found.tracks(0)) == ["7", "bus 1", "car; red"]
    assert found.layout(0) == LAYOUT


def test_the_plain_reader_reads_rows_of_tracks(small_parts):
    data, _, body = small_parts
    assert exact_logs.read_logs(body, NAMES) == {"a.csv": data}


@pytest.mark.parametrize("track", ["bus 1", "7", "car; red"])
def test_rows_of_a_track_are_in_the_order_of_the_log(small_parts, track):
    _, lines, body = small_parts
    found = read_exact_logs(body, NAMES)
    wanted = [line for line in lines if line.startswith((f"{track};", f'"{track}"'))]
    assert b"".join(found.rows(0, track)).decode() == "".join(wanted)
    columns = b"".join(found.rows(0, track, [4, 3])).decode()
    assert columns == "".join(f"{cells(line)[4]};{cells(line)[3]}\n" for line in wanted)


def test_columns_of_all_tracks_are_in_the_order_of_the_log(small_parts):
    _, lines, body = small_parts
    found = read_exact_logs(body, NAMES)
    heights = "".join(f"{cells(line)[3]}\n" for line in lines)
    assert b"".join(found.rows(0, None, [3])).decode() == heights


def test_rows_of_a_track_need_only_its_blocks(small_parts):
    _, _, body = small_parts
    found = read_exact_logs(body, NAMES)
    decoded = []
    decode = ExactLogs._decode

    class Counting(ExactLogs):
        def _decode(self, block, *chosen):
            decoded.append(block)
            return decode(self, block, *chosen)

    counting = Counting(found.logs, found.body, found.spans, NAMES)
    list(counting.rows(0, "bus 1"))
    blocks = [block for span in found.spans for block in span.blocks]
    assert 0 < len(decoded) <= len(blocks) // 2


def test_columns_need_no_positions(monkeypatch):
    data, lines = fleet()
    found = read_exact_logs(body_of(data), NAMES)
    decoded = []
    original = tables.decode_column
    monkeypatch.setattr(
        tables, "decode_column", lambda *given: decoded.append(given) or original(*given)
    )
    got = b"".join(found.rows(0, "tram", [3, 4]))
    assert got == b""
    got = b"".join(found.rows(0, None, [3, 4])).decode()
    assert got == "".join(f"{cells(line)[3]};{cells(line)[4]}\n" for line in lines)

    # Times, by which rows are in order, heights and heart rates of each of three shapes.
    assert len(decoded) == 3 * 3


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["a", "b", "a b", '"q;r"', "", '"', "é"]),
            st.sampled_from(["1", "2.50", "-3", "x", '"\n"', "00:00:01", "1;2"]),
            st.sampled_from(["\n", "\r\n", "\n\n"]),
        ),
        min_size=4,
        max_size=60,
    ),
    st.booleans(),
)
@examples(30)
def test_any_rows_come_back(rows, ends):
    text = "".join(f"{a};{b}{end}" for a, b, end in rows).encode()
    data = b"id;v\n" + (text if ends else text.rstrip(b"\r\n"))
    layout = TableLayout(ord(";"), b"id;v\n", has_header=True, width=2, track_column=0)
    patch = pytest.MonkeyPatch()
    patch.setattr(write_logs, "MAX_SPAN_BYTES", 90)
    try:
        body = body_of(data, layout, NO_TRAILS)
    finally:
        patch.undo()
    assert b"".join(read_exact_logs(body, NO_TRAILS).read(0)) == data


def test_small_logs_with_rows_share_a_block():
    rows = [f"{i % 2},{i},{i * i % 91}\n" for i in range(120)]
    data = b"id,t,x\n" + "".join(rows).encode()
    layout = TableLayout(ord(","), b"id,t,x\n", has_header=True, width=3, track_column=0)
    sink = io.BytesIO()
    logs = {f"{name}.csv": data for name in "abc"}
    given = [(name, lambda data=data: [data]) for name, data in logs.items()]
    write_exact_logs(given, sink, NO_TRAILS, dict.fromkeys(logs, layout))
    found = read_exact_logs(sink.getvalue(), NO_TRAILS)
    assert len(found.spans) == 1
    assert exact_logs.read_logs(sink.getvalue(), NO_TRAILS) == logs
    assert found.layout(1) == layout
    assert found.tracks(1) == ("0", "1")
    assert b"".join(found.rows(1, "1", [2])) == b"".join(
        line.split(",")[2].encode() for line in rows[1::2]
    )


def test_forged_rows_are_refused(small_parts):
    # Any byte of the heads may be another: an error says so, or the checksum does.
    _, _, body = small_parts
    refused = 0
    for place in range(20, 140, 4):
        forged = bytearray(body)
        forged[place] ^= 1 << place % 8
        try:
            found = read_exact_logs(bytes(forged), NAMES)
            list(found.read(0))
        except CorruptArchiveError:
            refused += 1
    assert refused > 15


@pytest.mark.parametrize("cell", ['5" pipe', '"a"b', 'a "b'])
def test_rows_with_quotes_within_cells_come_back_as_a_whole_only(cell):
    rows = [f"{i % 2};{i};{i};{cell if i in (7, 9) else 'a'};0\r\n" for i in range(40)]
    data = HEADER + "".join(rows).encode()
    found = read_exact_logs(body_of(data), NAMES)
    assert b"".join(found.read(0)) == data
    for track, columns in (("1", None), (None, [1]), ("1", [1, 3])):
        with pytest.raises(OptionError, match="a quote within a cell"):
            list(found.rows(0, track, columns))


def test_quotes_at_the_ends_of_cells_are_none_within():
    rows = ['"a;""b"""; "c" ;"";d\r\n', '"x\ny";1;"z"\n']
    assert not has_stray_quotes("".join(rows).encode(), ord(";"))
    assert has_stray_quotes(b'a;"b\n', ord(";"))


def test_a_forged_order_is_refused():
    # Rows are ordered by a column that no row has, or one that would take much memory.
    forged = {1 << 12: None, (1 << 12) + 1: "keys in column 4097 of 4096", 1 << 60: "keys in"}
    for column, message in forged.items():
        cursor = Cursor(encode_varint(column))
        if message is None:
            assert read_key(cursor, MAX_COLUMNS) == column - 1
            continue
        with pytest.raises(CorruptArchiveError, match=message):
            read_key(cursor, MAX_COLUMNS)


def test_parts_of_forged_records_take_no_more_memory_than_their_text():
    # Each of 1,000 records has a shape that is longer than the text.
    shape = b"a" * 3000 + b",b\n"
    packed = deflate(encode_varint(len(shape)) + shape)
    head = b"".join(map(encode_varint, [1000, 1, len(shape) + 2, len(packed)]))
    block = b"\3" + head + packed + encode_column(np.zeros(1000, np.int64))[0]
    with pytest.raises(CorruptArchiveError, match="records of 3003000 bytes at least in 1100"):
        decode_cells(Cursor(block), 1100, NO_TRAILS, ord(","), [1])


@pytest.mark.parametrize("delimiter", [0, 10, 13, 34, 200])
def test_a_forged_delimiter_is_refused(delimiter):
    data = bytes([delimiter]) + encode_layout(LAYOUT)[1:]
    with pytest.raises(CorruptArchiveError, match=f"no cells end at byte {delimiter}"):
        decode_layout(Cursor(data))
