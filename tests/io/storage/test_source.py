import gzip
import io
import os
import sys

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.expansion import CHECKED_BYTES, MAX_EXPANSION, ExpansionMeter
from gpszip.io.storage.source import Source, expand, spooled

ROWS = "".join(f"{i},{i},0\n" for i in range(200))
LOG = f"t,x,y\n{ROWS}".encode()


def lengths(result):
    return [len(track) for track in result.tracks]


def test_gzip_file_with_several_members():
    packed = gzip.compress(LOG[:100]) + gzip.compress(LOG[100:])
    assert lengths(read_logs(io.BytesIO(packed))) == [200]


@pytest.mark.parametrize(
    "damaged",
    [
        pytest.param(gzip.compress(LOG)[:-9], id="truncated"),
        pytest.param(
            gzip.compress(LOG)[:-8] + b"1234" + gzip.compress(LOG)[-4:], id="wrong checksum"
        ),
        pytest.param(gzip.compress(LOG) + b"and more", id="trailing bytes"),
    ],
)
def test_damaged_gzip_file_is_named(damaged):
    with pytest.raises(InputError, match=r"stream: damaged gzip file \(.*\); fetch it again"):
        read_logs(io.BytesIO(damaged))


def test_gzip_bomb_is_refused_early(tmp_path):
    path = tmp_path / "log.csv.gz"
    bomb = gzip.compress(b"t,x,y\n" + b"0,0,0\n" + b"\n" * (70 << 20), 6)
    path.write_bytes(bomb)
    message = "expands more than 300 times; if that is meant, unpack it yourself: zcat FILE"
    with pytest.raises(InputError, match=message):
        read_logs(path)
    with pytest.raises(InputError, match=message):
        store_logs(path, rows=1000)
    unpacked = 0
    with pytest.raises(InputError, match=message), Source("log", data=bomb).open() as stream:
        while chunk := stream.read(1 << 20):
            unpacked += len(chunk)
    assert unpacked < CHECKED_BYTES


def test_short_expansion_is_allowed():
    meter = ExpansionMeter("log", "unpack it")
    meter.count(CHECKED_BYTES - 1, 1)
    read = 2 * CHECKED_BYTES // MAX_EXPANSION + 1
    meter.count(CHECKED_BYTES, read)  # below the limit together with the bytes before
    meter.count(CHECKED_BYTES // 2, read)
    with pytest.raises(InputError, match="log: expands more than"):
        meter.count(CHECKED_BYTES, read)
    assert meter.refused


def test_sources_keep_no_file_open(tmp_path):
    resource = pytest.importorskip("resource")
    for i in range(120):
        (tmp_path / f"{i}.csv.gz").write_bytes(gzip.compress(f"t,x,y\n{ROWS}".encode(), 1))
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = len(os.listdir("/proc/self/fd")) + 20 if os.path.exists("/proc/self/fd") else 100
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, limits[1]))
    try:
        sources = list(expand(str(tmp_path / "*.gz")))
        heads = {source.head()[:6] for source in sources}
        result = read_logs(sources)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert heads == {b"t,x,y\n"}
    assert lengths(result) == [200] * 120


@pytest.mark.skipif(sys.platform != "linux", reason="names are bytes on Linux only")
def test_name_that_is_no_utf8_is_shown_escaped(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/w\xff\n.csv")
    with open(path, "wb") as file:
        file.write(LOG)
    (tmp_path / "other.csv").write_bytes(LOG)
    result = read_logs([path, str(tmp_path / "other.csv")])
    assert [track.id for track in result.tracks] == [r"w\xff\n", "other"]
    with pytest.raises(InputError, match=r"none\\xff\.csv: no such file"):
        read_logs(os.fsdecode(os.fsencode(tmp_path) + b"/none\xff.csv"))


@pytest.mark.skipif(sys.platform != "linux", reason="names are bytes on Linux only")
def test_parquet_file_with_a_name_that_is_no_utf8_is_read(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.parquet")
    pq.write_table(
        pa.table({"t": [0, 1], "x": [0.0, 1.0], "y": [0.0, 2.0]}), tmp_path / "plain.parquet"
    )
    (tmp_path / "plain.parquet").rename(path)
    assert len(read_logs(path).tracks[0]) == 2


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a\0b", r"^a\\x00b: can't be read: embedded null byte"),
        ("~nobody-of-this-name/a.csv", "can't be read: Could not determine home directory"),
        ("log.csv/deeper", "can't be read: Not a directory"),
        ("x" * 5000, "can't be read: File name too long"),
        ("socket", "can't be read: No such device or address"),
        ("empty.csv", "empty file; name one that holds a log"),
    ],
)
def test_names_that_are_no_files_are_reported(tmp_path, monkeypatch, name, message):
    import socket

    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_bytes(LOG)
    (tmp_path / "empty.csv").touch()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(InputError, match=message):
            read_logs(name)


def test_file_removed_after_listing_is_named(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_bytes(LOG)
    sources = list(expand(str(tmp_path / "*.csv")))
    (tmp_path / "a.csv").unlink()
    with pytest.raises(InputError, match=r"a\.csv: no such file"):
        read_logs(sources)
    assert [log.reason for log in read_logs(sources, skip_bad=True).left_out] == ["no such file"]
    with pytest.raises(InputError, match=r"a\.csv: no such file"):
        _ = sources[0].size


def test_file_that_shrinks_while_read_ends_early(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"0" * (1 << 20))
    with Source("log.csv", path=path).open() as stream:
        assert stream.read(10) == b"0" * 10
        path.write_bytes(b"0" * 5)
        assert stream.read(10) == b""


def test_spooled_streams_and_pipes_can_be_read_twice(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    child = os.fork()
    if child == 0:
        path.write_bytes(LOG)
        os._exit(0)
    try:
        with spooled([io.BytesIO(LOG), str(path), str(tmp_path / "none")]) as sources:
            assert [source.read() for source in sources[:2] for _ in range(2)] == [LOG] * 4
            assert "no such file" in str(sources[2])
    finally:
        os.waitpid(child, 0)
