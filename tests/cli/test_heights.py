"""Heights of GPX, KML, TCX and FIT, which are kept within 3 m unless --no-ele is given."""

import csv
import io
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import gpszip as package
from batches import force_batches

START = 1_714_557_600
COMPRESS = "--max-error 5m --effort 1"


def _stamp(second):
    return datetime.fromtimestamp(START + second, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _gpx(heights, first=0, times=True, name="hike"):
    """A straight way over hills; None is a point without height."""
    points = []
    for i, height in enumerate(heights, first):
        ele = "" if height is None else f"<ele>{height}</ele>"
        time = f"<time>{_stamp(i)}</time>" if times else ""
        points.append(f'<trkpt lat="{52 + i * 1e-5:.6f}" lon="13.4">{ele}{time}</trkpt>')
    head = f'<gpx version="1.1"><trk><name>{name}</name><trkseg>'
    return f"{head}{''.join(points)}</trkseg></trk></gpx>"


def _hills(count=200):
    return [round(300 + 20 * np.sin(i / 15), 1) for i in range(count)]


@pytest.fixture
def hike(tmp_path):
    heights = _hills()
    (tmp_path / "hike.gpx").write_text(_gpx(heights))
    return np.array(heights)


def test_decompressed_points_hold_heights_and_positions(gpszip, hike):
    done = gpszip(f"compress hike.gpx -o a.gpsz {COMPRESS}")
    assert done.code == 0, done.err
    assert re.search(r"ele within 3 m at every point: \d+ B", done.err)
    assert "not kept" not in done.err

    # Lines from point to point, on a straight way, are within the bound of the heights.
    rows = list(csv.DictReader(io.StringIO(gpszip("decompress a.gpsz -o -").out)))
    t, lat, ele = (np.array([float(row[name]) for row in rows]) for name in ("t", "lat", "ele"))
    seconds = np.arange(200.0)
    assert np.abs(np.interp(START + seconds, t, ele) - hike).max() <= 3.001
    assert np.abs(np.interp(START + seconds, t, lat) - 52 - seconds * 1e-5).max() * 111_195 <= 5
    assert 5 < len(rows) < 100
    text = gpszip("decompress a.gpsz -o - --format gpx").out
    assert text.count("<ele>") == len(rows)

    # The same for a part, and point by point.
    part = gpszip(f"cat a.gpsz --until {_stamp(99)}").out
    rows = list(csv.DictReader(io.StringIO(part)))
    t, ele = (np.array([float(row[name]) for row in rows]) for name in ("t", "ele"))
    assert np.abs(np.interp(START + seconds[:100], t, ele) - hike[:100]).max() <= 3.001


def test_no_ele_leaves_them_out(gpszip, hike):
    assert gpszip(f"compress hike.gpx -o with.gpsz {COMPRESS}").code == 0
    done = gpszip(f"compress hike.gpx -o without.gpsz {COMPRESS} --no-ele")
    assert "not kept: ele" in done.err
    without = package.open("without.gpsz")
    assert not without.curve_sizes
    assert without.size < package.open("with.gpsz").size

    # As of a log that has none, byte by byte.
    Path("flat.gpx").write_text(_gpx([None] * 200))
    assert gpszip(f"compress flat.gpx -o flat.gpsz {COMPRESS}").code == 0
    assert Path("flat.gpsz").read_bytes() == Path("without.gpsz").read_bytes()
    archive = package.compress("hike.gpx", max_error=5, effort=1, heights=False)
    assert archive.to_bytes() == without.to_bytes()
    archive = package.compress("hike.gpx", max_error=5, effort=1)
    assert archive.to_bytes() == Path("with.gpsz").read_bytes()


def test_what_is_named_wins(gpszip, hike):
    done = gpszip(f"compress hike.gpx -o a.gpsz {COMPRESS} --keep alt:1m")
    assert done.code == 0, done.err
    assert list(package.open("a.gpsz").curve_sizes) == ["alt"]
    Path("flat.gpx").write_text(_gpx([None] * 200))
    done = gpszip(f"compress flat.gpx -o no.gpsz {COMPRESS} --keep ele:1m")
    assert done.code == 1
    assert "no 'ele' to keep" in done.err


def test_files_with_and_without_heights(gpszip, hike, monkeypatch):
    Path("flat.gpx").write_text(_gpx([None] * 50, name="flat"))
    Path("odd.gpx").write_text(_gpx(["high"] * 50, name="odd"))
    Path("table.csv").write_text("track_id,t,lat,lon,alt\nb,0,52,13.4,7\nb,60,52.001,13.4,8\n")
    logs = "hike.gpx flat.gpx odd.gpx table.csv"
    for memory in ("", " --memory 420MiB"):
        done = gpszip(f"compress {logs} -o all.gpsz --force {COMPRESS}{memory}")
        assert done.code == 0, done.err
        assert "not kept: ele" in done.err
        archive = package.open("all.gpsz")
        found = archive.curve("hike", "ele", START + np.arange(200.0))
        assert np.abs(found - hike).max() <= 3
        for name in ("flat", "odd", "b"):
            assert np.isnan(archive.curve(name, "ele", archive.walk(name).times)).all()
        force_batches(monkeypatch, batch=100, subsample=100)


def test_shapes_and_sizes_have_none_and_say_so(gpszip, hike):
    Path("plan.gpx").write_text(_gpx(_hills(), times=False))
    done = gpszip(f"compress plan.gpx -o plan.gpsz {COMPRESS}")
    assert done.code == 0, done.err
    assert "heights of 1 track without times are not kept" in done.err
    done = gpszip("compress hike.gpx -o small.gpsz --bytes 90 --effort 1")
    assert done.code == 0, done.err
    assert "heights are not kept beside a size: add --keep ele:3m" in done.err
    assert package.open("small.gpsz").size <= 90


def test_tracks_in_memory_keep_theirs():
    plane = package.Plane(((520_000_000, 134_000_000),))
    times = [float(i) for i in range(60)]
    for positions, attributes, expected in (
        ([[i, 0.0] for i in times], {"ele": times, "hr": times}, ["ele"]),
        ([[i, 0.0] for i in times], {"ele": ["high"] * 60}, []),
    ):
        track = package.Track("a", times, positions, attributes=attributes, plane=plane)
        archive = package.compress(track, max_error=1, effort=1)
        assert list(archive.curve_sizes) == expected
        track = package.Track("a", times, positions, attributes=attributes)
        assert not package.compress(track, max_error=1, effort=1).curve_sizes


def test_heights_that_cannot_be_kept_stop_nothing(gpszip, tmp_path):
    (tmp_path / "odd.gpx").write_text(_gpx([1e300 if i == 7 else i for i in range(60)]))
    done = gpszip(f"compress odd.gpx -o odd.gpsz {COMPRESS}")
    assert done.code == 0, done.err
    assert "heights are not kept: column 'ele' has values up to 1e+300" in done.err
    assert not package.open("odd.gpsz").curve_sizes
    (tmp_path / "zero.gpx").write_text(_gpx([0] * 60))
    done = gpszip(f"compress zero.gpx -o zero.gpsz {COMPRESS}")
    assert "heights are not kept: all are 0" in done.err
    assert not package.open("zero.gpsz").curve_sizes


def test_append_goes_on_as_the_archive_is(gpszip, hike):
    Path("more.gpx").write_text(_gpx(_hills(100), first=200))
    Path("flat.gpx").write_text(_gpx([None] * 100, first=400))
    assert gpszip(f"compress hike.gpx -o with.gpsz {COMPRESS}").code == 0
    assert gpszip(f"compress hike.gpx -o without.gpsz {COMPRESS} --no-ele").code == 0
    for log in ("more", "flat"):
        for name in ("with", "without"):
            done = gpszip(f"compress {log}.gpx -o {name}.gpsz --append --effort 1")
            assert done.code == 0, done.err
    assert not package.open("without.gpsz").curve_sizes
    found = package.open("with.gpsz").curve("hike", "ele", START + np.arange(300.0))
    assert np.abs(found - np.append(hike, _hills(100))).max() <= 3

    # A table without heights leaves them out, too; its own heights go on.
    Path("table.csv").write_text(f"track_id,t,lat,lon\nb,{START},52,13.4\nb,{START + 60},52,13.4\n")
    Path("high.csv").write_text(
        f"track_id,t,lat,lon,alt\nc,{START},52,13.4,7\nc,{START + 60},52,13.4,8\n"
    )
    done = gpszip("compress table.csv high.csv -o with.gpsz --append --effort 1")
    assert done.code == 0, done.err
    archive = package.open("with.gpsz")
    assert np.isnan(archive.curve("b", "ele", START + 30.0))
    assert abs(archive.curve("c", "ele", START + 30.0) - 7.5) <= 3

    # A dry run counts them; without heights of the new log, the old ones stay.
    done = gpszip("compress more.gpx -o new.gpsz --dry-run --effort 1")
    assert done.code == 0, done.err
    Path("late.gpx").write_text(_gpx(_hills(100), first=600))
    done = gpszip("compress late.gpx -o with.gpsz --append --effort 1 --no-ele")
    assert done.code == 0, done.err
    archive = package.open("with.gpsz")
    times = START + np.array([100.0, 650.0])
    assert np.isnan(archive.curve("hike", "ele", times)).tolist() == [False, True]
