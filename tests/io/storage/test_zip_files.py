import gzip
import io
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source, expand, spooled

LOG = b"t,x,y\n" + b"".join(b"%d,%d,0\n" % (i, i * i) for i in range(100))
OTHER = b"track_id,t,x,y\n7,0,0,0\n7,1,1,1\n"


def packed(*members, method=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return file.getvalue()


def ids(reading):
    return [(track.id, len(track)) for track in reading.tracks]


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_each_file_in_an_archive_is_a_log(tmp_path, method):
    path = tmp_path / "walks.zip"
    path.write_bytes(
        packed(
            ("mon/a.csv", LOG),
            ("b.csv.gz", gzip.compress(LOG)),
            ("c.tsv", OTHER),
            ("empty/", b""),
            method=method,
        )
    )
    reading = read_logs(path)
    assert ids(reading) == [("a", 100), ("b", 100), ("7", 2)]
    assert reading.bytes < path.stat().st_size
    assert not reading.left_out
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
    assert ids(read_logs(io.BytesIO(path.read_bytes()))) == ids(reading)


def test_a_single_log_in_an_archive_is_like_the_log_itself():
    assert ids(read_logs(io.BytesIO(packed(("a.csv", LOG))))) == [("0", 100)]


def test_what_is_no_log_is_left_out_and_named():
    others = [
        ("README.md", b"# Walks\n"),
        ("photo.jpg", bytes(range(256))),
        ("in.zip", packed(("a.csv", LOG))),
    ]
    passed_over = [("__MACOSX/._a.csv", b"x"), (".DS_Store", b"x"), (".git/config", b"x")]
    reading = read_logs(io.BytesIO(packed(("a.csv", LOG), *others, *passed_over)))
    assert ids(reading)[0][1] == 100
    assert [(left.name, left.reason.split(";")[0]) for left in reading.left_out] == [
        ("stream/README.md", "is text, but not named as a table"),
        ("stream/photo.jpg", "neither text nor a format that is known"),
        ("stream/in.zip", "is a zip archive inside another file"),
    ]
    with store_logs(list(expand(io.BytesIO(packed(("a.csv", LOG), *others)))), rows=1000) as log:
        assert [left.name for left in log.read_result.left_out] == [
            left.name for left in reading.left_out
        ]
    with pytest.raises(UnknownFormatError, match=r"stream/README\.md: is text"):
        read_logs(io.BytesIO(packed(others[0])))


def test_names_in_an_archive_are_names_only(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    data = packed(("../up.csv", LOG), ("/root.csv", LOG), ("a\x1b[2J\n.csv", LOG))
    with spooled(io.BytesIO(data)) as sources:
        assert [source.name for source in sources] == [
            "stream/../up.csv",
            "stream//root.csv",
            r"stream/a\x1b[2J\n.csv",
        ]
        assert len(read_logs(sources).tracks) == 3
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["here"]


def changed(data, **fields):
    """An archive of one member with fields of its two headers changed: offsets in the local one are 2 less."""
    data, at = bytearray(data), data.rfind(b"PK\1\2")
    places = {"flags": (at + 8, 6), "method": (at + 10, 8)}
    for name, value in fields.items():
        for place in places[name]:
            data[place] = value
    return bytes(data)


def with_bad_byte(data, at):
    return data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (packed(), "no file in this zip archive"),
        (packed(("a.csv", LOG))[:-30], "damaged zip archive"),
        (packed(("a.csv", LOG))[100:], "neither text"),
        (b"PK\x03\x04" + b"x" * 100, "damaged zip archive"),
        (with_bad_byte(packed(("a.csv", LOG)), 60), r"a\.csv: damaged in its zip archive"),
        (
            with_bad_byte(packed(("a.csv", LOG), method=zipfile.ZIP_STORED), 60),
            r"a\.csv: damaged in its zip archive \(Bad CRC-32",
        ),
        (changed(packed(("a.csv", LOG)), flags=1), r"a\.csv: is encrypted; unpack it first"),
        (changed(packed(("a.csv", LOG)), method=14), r"a\.csv: is packed by method 14 of zip"),
        (
            packed(("xl/workbook.xml", b"<a/>")),
            "is an Excel workbook; save the sheet with the log as CSV",
        ),
        (gzip.compress(packed(("a.csv", LOG))), "is a zip archive inside another file"),
    ],
)
def test_what_cannot_be_read_is_named(data, says):
    with pytest.raises(InputError, match=says):
        read_logs(io.BytesIO(data))


def test_bad_members_can_be_left_out():
    good, bad = packed(("a.csv", LOG)), changed(packed(("b.csv", OTHER)), flags=1)
    reading = read_logs([io.BytesIO(good), io.BytesIO(bad)], skip_bad=True)
    assert [left.reason for left in reading.left_out] == ["is encrypted; unpack it first"]


def test_archives_whose_members_share_bytes_are_refused():
    """The directory names one member a hundred times."""
    data = packed(("a.csv", LOG * 20))
    start, end = data.rfind(b"PK\1\2"), data.rfind(b"PK\5\6")
    entries, tail = data[start:end] * 100, bytearray(data[end:])
    tail[8:10] = tail[10:12] = (100).to_bytes(2, "little")
    tail[12:16] = len(entries).to_bytes(4, "little")
    with pytest.raises(InputError, match="its members overlap"):
        read_logs(io.BytesIO(data[:start] + entries + bytes(tail)))


def test_an_archive_that_expands_without_end_is_refused_once():
    """No member goes beyond the limit by itself, but all together."""
    data = packed(*((f"{i}.csv", b"\n" * (24 << 20)) for i in range(4)))
    sources = list(expand(io.BytesIO(data)))
    assert [str(source) for source in sources if isinstance(source, InputError)] == [
        "stream: expands more than 300 times; if that is meant, unpack it yourself, and name the files"
    ]
    assert (
        sum(source.archive == "stream" for source in sources if not isinstance(source, InputError))
        == 2
    )


def test_thousands_of_members_and_zip64():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for i in range(5_000):
            archive.writestr(f".hidden/{i}", b"")
        with archive.open("a.csv", "w", force_zip64=True) as member:
            member.write(LOG)
    assert ids(read_logs(io.BytesIO(file.getvalue()))) == [("0", 100)]


@settings(max_examples=150, deadline=None)
@given(
    method=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]),
    changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4),
    cut=st.integers(0, 3000),
)
def test_no_change_of_a_byte_breaks_the_reader(method, changes, cut):
    data = bytearray(packed(("a.csv", OTHER), ("ü/b.csv", OTHER), method=method))
    for place, byte in changes:
        data[place % len(data)] = byte
    for source in expand(io.BytesIO(bytes(data[: len(data) - max(cut - 2900, 0)]))):
        assert "\n" not in (str(source) if isinstance(source, InputError) else source.name)
        if isinstance(source, Source) and source.archive:
            assert source.data in (
                OTHER,
                b"",
            )  # whole, as its checksum is; or it says that it is empty
