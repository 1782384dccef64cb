import gzip
import io
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source, expand, spooled
from random_tests import examples

LOG = b"t,x,y\n" + b"".join(b"%d,%d,0\n" % (i, i * i) for i in range(100))
OTHER = b"track_id,t,x,y\n7,0,0,0\n7,1,1,1\n"


def zipped(*members, method=zipfile.ZIP_DEFLATED):
    """Bytes of a zip archive with members (name, data)."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return file.getvalue()


def ids(result):
    return [(track.id, len(track)) for track in result.tracks]


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_each_file_in_an_archive_is_a_log(tmp_path, method):
    path = tmp_path / "walks.zip"
    path.write_bytes(
        zipped(
            ("mon/a.csv", LOG),
            ("b.csv.gz", gzip.compress(LOG)),
            ("c.tsv", OTHER),
            ("empty/", b""),
            method=method,
        )
    )
    result = read_logs(path)
    assert ids(result) == [("a", 100), ("b", 100), ("7", 2)]
    assert result.bytes < path.stat().st_size
    assert not result.left_out
    names = [f"{path}/mon/a.csv", f"{path}/b.csv.gz", f"{path}/c.tsv"]
    assert [source.name for source in expand(path)] == names
    with spooled(path) as sources:
        assert [source.name for source in sources] == names
        assert [source.read() for source in sources] == [LOG, LOG, OTHER]
        with store_logs(sources, rows=1000) as log:
            assert [(track.id, track.count) for track in log.tracks] == [
                ("a", 100),
                ("b", 100),
                ("7", 2),
            ]
    assert ids(read_logs(io.BytesIO(path.read_bytes()))) == ids(result)


def test_archive_of_a_single_log_is_like_the_log():
    assert ids(read_logs(io.BytesIO(zipped(("a.csv", LOG))))) == [("0", 100)]


def test_other_files_are_left_out_and_counted():
    others = [
        ("README.md", b"# Walks\n"),
        ("photo.jpg", bytes(range(256))),
        ("photo.JPG", bytes(range(255))),
        ("LICENSE", b"All rights.\n"),
    ]
    ignored = [("__MACOSX/._a.csv", b"x"), (".DS_Store", b"x"), (".git/config", b"x")]
    result = read_logs(io.BytesIO(zipped(("a.csv", LOG), *others, *ignored)))
    assert ids(result)[0][1] == 100
    assert result.complete
    assert [str(others) for others in result.other_files] == [
        "4 files without positions: 2 .jpg, 1 .md, 1 without a suffix"
    ]
    with store_logs(list(expand(io.BytesIO(zipped(("a.csv", LOG), *others)))), rows=1000) as log:
        assert log.read_result.other_files == result.other_files
    with pytest.raises(InputError, match=r"no log in it, only 4 files without .*: 2 \.jpg, "):
        read_logs(io.BytesIO(zipped(*others)))
    with pytest.raises(UnknownFormatError, match=r"stream/README\.md: is text"):
        read_logs(io.BytesIO(zipped(others[0])))


def test_names_of_members_are_no_paths(tmp_path, monkeypatch):
    (tmp_path / "current").mkdir()
    monkeypatch.chdir(tmp_path / "current")
    data = zipped(("../up.csv", LOG), ("/root.csv", LOG + b"100,1,1\n"), ("a\x1b[2J\n.csv", OTHER))
    with spooled(io.BytesIO(data)) as sources:
        assert [source.name for source in sources] == [
            "stream/../up.csv",
            "stream//root.csv",
            r"stream/a\x1b[2J\n.csv",
        ]
        assert len(read_logs(sources).tracks) == 3
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["current"]


def with_fields(data, **fields):
    """An archive of one member with changed fields in both headers of the member."""
    data, central = bytearray(data), data.rfind(b"PK\1\2")
    offsets = {"flags": (central + 8, 6), "method": (central + 10, 8)}
    for name, value in fields.items():
        for offset in offsets[name]:
            data[offset] = value
    return bytes(data)


def with_bad_byte(data, offset):
    return data[:offset] + bytes([data[offset] ^ 0xFF]) + data[offset + 1 :]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (zipped(), "no file in this zip archive"),
        (zipped(("a.csv", LOG))[:-30], "damaged zip archive"),
        (zipped(("a.csv", LOG))[100:], "neither text"),
        (b"PK\x03\x04" + b"x" * 100, "damaged zip archive"),
        (with_bad_byte(zipped(("a.csv", LOG)), 60), r"a\.csv: damaged in its zip archive"),
        (
            with_bad_byte(zipped(("a.csv", LOG), method=zipfile.ZIP_STORED), 60),
            r"a\.csv: damaged in its zip archive \(Bad CRC-32",
        ),
        (with_fields(zipped(("a.csv", LOG)), flags=1), r"a\.csv: is encrypted; unpack it first"),
        (with_fields(zipped(("a.csv", LOG)), method=14), r"a\.csv: is packed by method 14 of zip"),
        (
            zipped(("xl/workbook.xml", b"<a/>")),
            "is an Excel workbook; save the worksheet with the log as CSV",
        ),
        (gzip.compress(zipped(("a.csv", LOG))), "is a zip archive inside another file"),
    ],
)
def test_unreadable_archives_are_named(data, message):
    with pytest.raises(InputError, match=message):
        read_logs(io.BytesIO(data))


def test_bad_members_can_be_left_out():
    good, bad = zipped(("a.csv", LOG)), with_fields(zipped(("b.csv", OTHER)), flags=1)
    result = read_logs([io.BytesIO(good), io.BytesIO(bad)], skip_bad=True)
    assert [file.reason for file in result.left_out] == ["is encrypted; unpack it first"]


def test_members_that_share_bytes_are_refused():
    """The directory names one member a hundred times."""
    data = zipped(("a.csv", LOG * 20))
    start, end = data.rfind(b"PK\1\2"), data.rfind(b"PK\5\6")
    entries, tail = data[start:end] * 100, bytearray(data[end:])
    tail[8:10] = tail[10:12] = (100).to_bytes(2, "little")
    tail[12:16] = len(entries).to_bytes(4, "little")
    with pytest.raises(InputError, match="its members overlap"):
        read_logs(io.BytesIO(data[:start] + entries + bytes(tail)))


def test_zip_bomb_is_refused_once():
    """No single member exceeds the limit, but all together do."""
    data = zipped(*((f"{i}.csv", b"\n" * (24 << 20)) for i in range(4)))
    sources = list(expand(io.BytesIO(data)))
    assert [str(source) for source in sources if isinstance(source, InputError)] == [
        "stream: expands more than 300 times; "
        "if that is meant, unpack it yourself, and name the files"
    ]
    assert [source.collection for source in sources if isinstance(source, Source)] == ["stream"] * 2


def test_thousands_of_members_and_zip64():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for i in range(5_000):
            archive.writestr(f".hidden/{i}", b"")
        with archive.open("a.csv", "w", force_zip64=True) as member:
            member.write(LOG)
    assert ids(read_logs(io.BytesIO(file.getvalue()))) == [("0", 100)]


@examples(100)
@given(
    method=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]),
    changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4),
    cut=st.integers(0, 3000),
)
def test_changed_bytes_give_data_or_errors(method, changes, cut):
    data = bytearray(zipped(("a.csv", OTHER), ("ü/b.csv", OTHER), method=method))
    for offset, byte in changes:
        data[offset % len(data)] = byte
    for source in expand(io.BytesIO(bytes(data[: len(data) - max(cut - 2900, 0)]))):
        assert "\n" not in (str(source) if isinstance(source, InputError) else source.name)
        if isinstance(source, Source) and source.collection and source.error is None:
            assert source.data in (OTHER, b"")  # complete by its checksum, or declared as empty


# KMZ


KML_FILE = (
    b"<kml><Placemark><name>walk</name><Track><when>2024-05-04T08:00:00Z</when>"
    b"<coord>11.5 48.1 500</coord><when>2024-05-04T08:00:10Z</when><coord>11.6 48.2 501</coord>"
    b"</Track></Placemark></kml>"
)


class Unseekable(io.RawIOBase):
    """A stream that only goes on, for which zip writes sizes behind the members."""

    def __init__(self):
        self.data = bytearray()

    def writable(self):
        return True

    def write(self, data):
        self.data += data
        return len(data)


@pytest.mark.parametrize("streamed", [False, True])
def test_kmz_is_read_without_its_pictures(streamed):
    file = Unseekable() if streamed else io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", KML_FILE)
        archive.writestr("files/start.PNG", b"\x89PNG\r\n\x1a\n\0\0")
        archive.writestr("files/car.dae", b"<COLLADA/>")
    reading = read_logs(io.BytesIO(file.data if streamed else file.getvalue()))
    assert [(track.id, len(track)) for track in reading.tracks] == [("walk", 2)]
    assert reading.complete


def test_pictures_of_other_archives_are_named():
    with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
        archive.writestr("a.csv", "t,x,y\n0,0,0\n1,1,1\n")
        archive.writestr("start.png", b"\x89PNG\r\n\x1a\n\0\0")
    reading = read_logs(io.BytesIO(file.getvalue()))
    assert [each.kinds for each in reading.other_files] == [((".png", 1),)]
