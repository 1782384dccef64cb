"""Logs kept byte by byte."""

import io
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.errors import CorruptArchiveError
from gpszip.lossless import write_logs
from gpszip.lossless.logs import read_exact_logs, write_exact_logs
from gpszip.lossless.text import MAX_BLOCK_BYTES
from gpszip.lossless.trails import NO_TRAILS
from oracle import exact_logs


def body_of(logs):
    sink = io.BytesIO()
    write_exact_logs([(name, lambda data=data: iter(data)) for name, data in logs.items()], sink)
    return sink.getvalue()


def text(rows, seed=1):
    random = np.random.default_rng(seed)
    steps = np.cumsum(random.integers(-3, 4, (rows, 2)), axis=0)
    return "".join(f"{i},{x},{y}\n" for i, (x, y) in enumerate(steps.tolist())).encode()


@given(st.lists(st.lists(st.binary(max_size=40), max_size=4), max_size=5))
@settings(deadline=None)
def test_any_logs_come_back(logs):
    logs = {f"log {i}": chunks for i, chunks in enumerate(logs)}
    found = read_exact_logs(body_of(logs), NO_TRAILS)
    assert [log.name for log in found.logs] == list(logs)
    for number, chunks in enumerate(logs.values()):
        assert b"".join(found.read(number)) == b"".join(chunks)


@pytest.fixture(scope="module")
def large():
    """Two logs over several small blocks, the second beginning within one."""
    return {"a": [text(4_000)], "b": [text(5_000, 2)], "c": [b"1,2,3"]}


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(write_logs, "MAX_BLOCK_BYTES", 1 << 16)


@pytest.fixture
def large_body(large, small_blocks):
    return body_of(large)


def test_logs_over_several_blocks_come_back(large, large_body):
    found = read_exact_logs(large_body, NO_TRAILS)
    assert len(found.spans) == 2
    for number, (data,) in enumerate(large.values()):
        assert b"".join(found.read(number)) == data


def test_chunks_do_not_change_the_body(large, large_body):
    pieces = {
        name: [data[i : i + 10_001] for i in range(0, len(data), 10_001)]
        for name, (data,) in large.items()
    }
    assert body_of(pieces) == large_body


def test_a_part_of_a_log_needs_only_its_blocks(large, large_body):
    found = read_exact_logs(large_body, NO_TRAILS)
    (data,) = large["b"]
    decoded = []
    decode = type(found)._decode

    class Counting(type(found)):
        def _decode(self, block, *chosen):
            decoded.append(block)
            return decode(self, block, *chosen)

    counting = Counting(found.logs, found.body, found.spans, NO_TRAILS)
    assert b"".join(counting.read(1, 40_000, 500)) == data[40_000:40_500]
    assert len(decoded) == 1
    assert b"".join(counting.read(1, len(data) - 3, 500)) == data[-3:]
    assert b"".join(counting.read(1, len(data), 5)) == b""


def test_text_without_lines_is_cut_anywhere():
    data = b"7," * (MAX_BLOCK_BYTES // 2 + 100)
    found = read_exact_logs(body_of({"a": [data]}), NO_TRAILS)
    assert [span.size for span in found.spans] == [MAX_BLOCK_BYTES, 200]
    assert b"".join(found.read(0)) == data


def test_small_logs_share_a_block():
    logs = {f"{i}.csv": [text(60, i)] for i in range(20)}
    alone = sum(len(body_of({name: data})) for name, data in logs.items())
    assert len(body_of(logs)) < 0.7 * alone


def test_another_checksum_is_refused():
    body = bytearray(body_of({"a": [b"0,1\n0,2\n"]}))
    body[5] ^= 1
    found = read_exact_logs(bytes(body), NO_TRAILS)
    with pytest.raises(CorruptArchiveError, match="'a' differs from its checksum"):
        list(found.read(0))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"\x02\x01a\x00\0\0\0\0", "2 logs in 7 bytes"),
        (b"\x01\x00a\x00\0\0\0\0", "a log's name of 0 bytes"),
        (b"\x01\x01\xff\x00\0\0\0\0", "not UTF-8"),
        (b"\x01\x02..\x00\0\0\0\0", "holds a folder: '..'"),
        (b"\x01\x03a/b\x00\0\0\0\0", "holds a folder: 'a/b'"),
        (b"\x01\x01a\x00\0\0\0\0K\x07", "1 bytes after the end"),
        (b"\x01\x01a\x05\0\0\0\0K\x06\x01\x00", "a block of 6 bytes, where 5 are left"),
        (b"\x01\x01a\x05\0\0\0\0K\x05\x09\x00", "9 bytes, but 1 are left"),
        (b"\x02\x01a\x00\0\0\0\0K\x01a\x00\0\0\0\0K", "two logs of one name"),
    ],
)
def test_a_forged_section_is_refused(body, message):
    # Section 13 has the kind of each log where K stands.
    with pytest.raises(CorruptArchiveError, match=re.escape(message)):
        read_exact_logs(body.replace(b"K", b""))
    with pytest.raises(CorruptArchiveError, match=re.escape(message)):
        read_exact_logs(b"\0" + body.replace(b"K", b"\0"), NO_TRAILS)


def test_an_unknown_kind_of_logs_is_refused():
    with pytest.raises(CorruptArchiveError, match="logs of kind 2"):
        read_exact_logs(b"\2\0", NO_TRAILS)


@pytest.mark.parametrize("seed", range(4))
def test_the_plain_reader_reads_what_is_written(seed):
    random = np.random.default_rng(seed)
    x, y = np.cumsum(random.normal(0, 3, (2, 80)), axis=1)
    dates = np.datetime64("2024-02-28T23:59:00") + np.cumsum(random.integers(1, 30, 80))
    minutes = np.floor(random.integers(10**5, 10**6, 80) * (10**7 / 60_000) + 0.5) / 1e7
    logs = {
        "a.csv": "".join(f"{i},{x[i]:.3f},{y[i]:.2f},{minutes[i]:.7f}\n" for i in range(80)),
        "b.gpx": "".join(
            f'<p lat="{x[i]:g}">\n<time>{dates[i]}Z</time><ele>{y[i]!s}</ele>\n' for i in range(40)
        ),
        "c.txt": "".join(
            f"{i % 7:03},w{i}x,{dates[i]:}.50\r\n".replace("T", " ") for i in range(80)
        ),
        "d": "-0.0,1e-05,07:08:09",
        "e": "",
    }
    logs = {name: text.encode() for name, text in logs.items()}
    logs["f"] = random.bytes(50)
    # The last log is no text, so that all together are not stored as tables.
    for last in ("a.csv", "e", "f"):
        chosen = {name: data for name, data in logs.items() if name <= last}
        body = body_of({name: [data] for name, data in chosen.items()})
        assert exact_logs.read_logs(body, NO_TRAILS) == chosen


def test_the_plain_reader_reads_many_shapes():
    rows = [
        f"car_{'x' * (i % 90)},{i},{i * i % 50}.5,{'y' if i % 3 else 'z'}\n" for i in range(200)
    ]
    data = "".join(rows).encode()
    assert exact_logs.read_logs(body_of({"a": [data]}), NO_TRAILS) == {"a": data}
