"""Columns kept within an error: --keep ele:1m, as a user asks for them."""

import csv
import io
import math
import xml.etree.ElementTree as ElementTree
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import gpszip as package
from batches import force_batches
from gpszip.pipeline import kept_curves

START = 1_714_557_600


@pytest.fixture
def ride(tmp_path):
    """A ride with altitude, a hole in it, and a pulse."""
    rng = np.random.default_rng(2)
    heights = np.round(100 + np.cumsum(rng.normal(size=300) * 0.3), 1)
    points = []
    for i, height in enumerate(heights):
        stamp = datetime.fromtimestamp(START + i, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        ele = "" if 100 <= i < 120 else f"<ele>{height}</ele>"
        hr = 120 + round(10 * math.sin(i / 30))
        lat, lon = 52.5 + 0.002 * math.sin(i / 60), 13.4 + 0.003 * math.cos(i / 60)
        points.append(
            f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}">{ele}<time>{stamp}</time><hr>{hr}</hr></trkpt>'
        )
    head = '<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><name>ride</name>'
    text = f"{head}<trkseg>{''.join(points)}</trkseg></trk></gpx>"
    (tmp_path / "ride.gpx").write_text(text)
    heights[100:120] = np.nan
    return heights


@pytest.fixture(scope="module")
def made():
    """Bytes of the archive, once it is made."""
    return []


@pytest.fixture
def archive(gpszip, ride, made, tmp_path):
    command = "compress ride.gpx -o ride.gpsz --max-error 5m --effort 1 --keep ele:1m,hr:2"
    if not made:
        done = gpszip(command)
        assert done.code == 0, done.err
        assert "ele within 1 m at every point" in done.err
        made.append((tmp_path / "ride.gpsz").read_bytes())
    (tmp_path / "ride.gpsz").write_bytes(made[0])
    return package.open(tmp_path / "ride.gpsz")


def test_values_come_back_within_their_bounds(archive, ride):
    times = START + np.arange(300.0)
    found = archive.curve("ride", "ele", times)
    assert np.nanmax(np.abs(found - ride)) <= 1
    assert np.isnan(found).tolist() == np.isnan(ride).tolist()
    pulse = np.round(120 + 10 * np.sin(np.arange(300) / 30))
    assert np.abs(archive.curve("ride", "hr", times) - pulse).max() <= 2
    # At any time, which exact columns can't.
    half = archive.curve("ride", "ele", "2024-05-01T10:00:10.5Z")
    assert abs(half - ride[10:12].mean()) <= 2
    assert archive.kept_columns is None


def test_all_ways_to_decompress_have_them(gpszip, archive, tmp_path):
    for command in (
        "decompress ride.gpsz -o -",
        "decompress ride.gpsz -o - --every 20s",
        "cat ride.gpsz --every 20s",
        "cat ride.gpsz --since 2024-05-01T10:01:00Z",
    ):
        done = gpszip(command)
        assert done.code == 0, done.err
        rows = list(csv.DictReader(io.StringIO(done.out)))
        for row in rows:
            expected = archive.curve("ride", "hr", float(row["t"]))
            assert float(row["hr"]) == pytest.approx(float(expected)), command
        assert len(rows) > 2
    done = gpszip("decompress ride.gpsz -o - --every 20s --format gpx")
    points = ElementTree.fromstring(done.out).iter("{http://www.topografix.com/GPX/1/1}trkpt")
    heights = [[float(e.text) for e in p if e.tag.endswith("ele")] for p in points]
    assert [len(height) for height in heights].count(0) == 1
    assert heights[0][0] == pytest.approx(float(archive.curve("ride", "ele", START)), abs=1e-3)


def test_beside_exact_columns(gpszip, ride, tmp_path):
    done = gpszip("compress ride.gpx -o a.gpsz --max-error 5m --effort 1 --keep hr,ele:2ft")
    assert done.code == 0, done.err
    archive = package.open(tmp_path / "a.gpsz")
    assert archive.kept_columns == ("hr",)
    assert archive.curve_sizes["ele"][0] == pytest.approx(0.6096)
    track = archive.samples()[0]
    pulse = np.round(120 + 10 * np.sin(np.arange(300) / 30))
    assert track.attributes["hr"].tolist() == pulse.tolist()
    assert np.nanmax(np.abs(track.attributes["ele"] - ride)) <= 0.6096


def test_info_verify_and_select(gpszip, archive, ride, tmp_path):
    assert "within 1 m at every point" in gpszip("info ride.gpsz").out
    facts = gpszip("info ride.gpsz --json").json
    assert [(curve["name"], curve["bound"]) for curve in facts["curves"]] == [("ele", 1), ("hr", 2)]
    assert gpszip("verify ride.gpsz").code == 0
    options = "--since 2024-05-01T10:03:00Z --until 2024-05-01T10:04:00Z"
    assert gpszip(f"select ride.gpsz -o part.gpsz {options}").code == 0
    part = package.open(tmp_path / "part.gpsz")
    times = START + np.arange(181.0, 240.0)
    assert part.curve("ride", "ele", times).tolist() == archive.curve("ride", "ele", times).tolist()
    assert len(part._curve_columns["ele"].knots[0]) < len(archive._curve_columns["ele"].knots[0])


def test_split_gives_each_part_its_knots(gpszip, archive, tmp_path):
    done = gpszip("split ride.gpsz --by 2min -o parts")
    assert done.code == 0, done.err
    parts = sorted((tmp_path / "parts").glob("*.gpsz"))
    assert len(parts) == 3
    times = START + np.arange(300.0)
    for column in ("ele", "hr"):
        expected = archive.curve("ride", column, times)
        for part in map(package.open, parts):
            is_inside = ~np.isnan(part.position("ride", times)[:, 0])
            assert is_inside.sum() >= 59
            found = part.curve("ride", column, times)[is_inside]
            assert found.tolist() == pytest.approx(expected[is_inside].tolist(), nan_ok=True)

    # Two knots more at each end of a part.
    counts = [len(package.open(part)._curve_columns["hr"].knots[0]) for part in parts]
    assert sum(counts) <= len(archive._curve_columns["hr"].knots[0]) + 4 * len(parts)


def test_recover_keeps_them(gpszip, archive, tmp_path):
    done = gpszip("recover ride.gpsz -o saved.gpsz")
    assert done.code == 0, done.err
    saved, times = package.open(tmp_path / "saved.gpsz"), START + np.arange(300.0)
    assert np.array_equal(
        saved.curve("ride", "ele", times), archive.curve("ride", "ele", times), equal_nan=True
    )


def test_logs_larger_than_memory_keep_them(gpszip, archive, ride, monkeypatch):
    force_batches(monkeypatch, batch=100, subsample=100)
    monkeypatch.setattr(kept_curves, "_ROWS", 70)
    options = "--max-error 5m --effort 1 --memory 420MiB"
    done = gpszip("compress ride.gpx -o large.gpsz --keep ele:1m,hr:2", *options.split())
    assert done.code == 0, done.err
    assert "ele within 1 m at every point" in done.err
    large, times = package.open("large.gpsz"), START + np.arange(300.0)
    found = large.curve("ride", "ele", times)
    assert np.nanmax(np.abs(found - ride)) <= 1
    assert np.isnan(found).tolist() == np.isnan(ride).tolist()

    # A knot more for each slice of rows; with too little memory for knots, an error.
    count = len(large._curve_columns["ele"].knots[0])
    assert 0 <= count - len(archive._curve_columns["ele"].knots[0]) <= 2 * 300 // 70 + 2
    monkeypatch.setattr(kept_curves, "knots_of_curves", lambda _: 10)
    done = gpszip("compress ride.gpx -o no.gpsz --keep ele:1m", *options.split())
    assert done.code == 2
    assert "more than 10 knots within 1, more than fit the memory" in done.err


def test_times_in_another_unit_are_refused(archive):
    with pytest.raises(package.OptionError, match="no track has such times"):
        archive.curve("ride", "ele", 1000 * (START + np.arange(3)))
    assert np.isnan(archive.curve("ride", "ele", START + 1000))


def test_parts_join_to_the_same_curves(gpszip, archive):
    assert gpszip("split ride.gpsz --by 2min -o parts").code == 0
    parts = sorted(map(str, Path("parts").glob("*.gpsz")))
    done = gpszip("join -o all.gpsz", *parts[::-1])
    assert done.code == 0, done.err
    whole = package.open("all.gpsz")
    for name, column in whole._curve_columns.items():
        expected = archive._curve_columns[name]
        assert (column.bound, column.step) == (expected.bound, expected.step)
        assert column.knots[0].tolist() == expected.knots[0].tolist()

    # Merging moves walks, not curves; tracks of other archives have no values.
    Path("other.csv").write_text("track_id,t,lat,lon\nb,0,52.5,13.4\nb,60,52.501,13.4\n")
    assert gpszip("compress other.csv -o other.gpsz --max-error 5m --effort 1").code == 0
    done = gpszip("merge other.gpsz ride.gpsz -o merged.gpsz")
    assert done.code == 0, done.err
    assert "only some archives keep ele, hr within an error" in done.err
    merged, times = package.open("merged.gpsz"), START + np.arange(300.0)
    expected = archive.curve("ride", "ele", times)
    assert np.array_equal(merged.curve("ride", "ele", times), expected, equal_nan=True)
    assert np.isnan(merged.curve("b", "ele", 30.0))


def test_append_goes_on_with_them(gpszip, ride, monkeypatch):
    text = Path("ride.gpx").read_text()
    head, *points = text.split("<trkpt")
    points[-1], tail = points[-1].split("</trkseg>")
    for name, own in (("first", points[:150]), ("second", points[149:])):
        Path(f"{name}.gpx").write_text("<trkpt".join([head, *own]) + "</trkseg>" + tail)
    compress = "compress first.gpx -o a.gpsz --max-error 5m --effort 1 --keep ele:1m"
    assert gpszip(compress).code == 0
    before = Path("a.gpsz").read_bytes()
    times, archives = START + np.arange(300.0), []
    for memory in ("", " --memory 420MiB"):
        Path("a.gpsz").write_bytes(before)
        done = gpszip(f"compress second.gpx -o a.gpsz --append --effort 1{memory}")
        assert done.code == 0, done.err
        assert "ele within 1 m at every point" in done.err
        archives.append(package.open("a.gpsz"))
        found = archives[-1].curve("ride", "ele", times)
        assert np.nanmax(np.abs(found - ride)) <= 1
        assert np.isnan(found).tolist() == np.isnan(ride).tolist()
        # No hole where the second log goes on.
        assert not np.isnan(archives[-1].curve("ride", "ele", times[148:152] + 0.5)).any()
        force_batches(monkeypatch, batch=100, subsample=100)

    # A part that was cut, and the rest of its log: no line is cut.
    assert gpszip(compress.replace("first", "ride") + " --force").code == 0
    whole = package.open("a.gpsz")
    assert gpszip("select a.gpsz -o part.gpsz --until 2024-05-01T10:03:20Z").code == 0
    done = gpszip("compress ride.gpx -o part.gpsz --append --effort 1 --since 2024-05-01T10:03:20Z")
    assert done.code == 0, done.err
    part = package.open("part.gpsz")
    assert part.curve_sizes["ele"][0] == 1
    assert np.nanmax(np.abs(part.curve("ride", "ele", times) - ride)) <= 1
    knots = [len(each._curve_columns["ele"].knots[0]) for each in (whole, part)]
    assert knots[1] <= knots[0] + 2

    # A further column begins with the new log; a smaller bound doesn't hold for the old one.
    Path("a.gpsz").write_bytes(before)
    options = "-o a.gpsz --append --effort 1 --dry-run"
    done = gpszip(f"compress second.gpx {options} --keep ele:0.5m")
    assert done.code == 2
    assert "the archive keeps 'ele' within 1, so that 0.5 can't be held" in done.err
    done = gpszip("compress second.gpx -o a.gpsz --append --effort 1 --keep hr:2")
    assert done.code == 0, done.err
    pulse = package.open("a.gpsz").curve("ride", "hr", times)
    assert np.flatnonzero(np.isnan(pulse)).tolist() == list(range(149))


def test_columns_exact_here_and_within_an_error_there(gpszip, archive):
    done = gpszip("compress ride.gpx -o exact.gpsz --max-error 5m --effort 1 --keep ele")
    assert done.code == 0, done.err
    merged = gpszip("merge exact.gpsz ride.gpsz -o all.gpsz --same-id prefix")
    assert merged.code == 2
    assert "keeps 'ele' exactly, another one within an error" in merged.err
    appended = gpszip("compress ride.gpx -o exact.gpsz --append --keep ele:1m")
    assert appended.code == 2
    assert "column 'ele' is kept twice" in appended.err


def test_mistakes(gpszip, ride):
    for keep, words in (
        ("ele:1x", "no unit of length"),
        ("ele:0", "greater than 0"),
        ("ele:-1", "greater than 0"),
        ("ele,ele:1", "kept twice"),
        ("lat:1", "no 'lat' to keep"),
    ):
        done = gpszip("compress ride.gpx -o no.gpsz --keep", keep)
        assert done.code in {1, 2}, keep
        assert words in done.err, keep
    assert gpszip("compress ride.gpx -o hr.gpsz --max-error 5m --effort 1 --no-ele").code == 0
    with pytest.raises(package.OptionError, match="no column 'ele'"):
        package.open("hr.gpsz").curve("ride", "ele", START)


def test_infinite_values_are_counted(gpszip, tmp_path):
    heights = ["inf" if i in {3, 40} else "" if i == 9 else i % 5 for i in range(60)]
    rows = [f"{i},{i},0,{height}\n" for i, height in enumerate(heights)]
    (tmp_path / "a.csv").write_text("t,x,y,ele\n" + "".join(rows))
    done = gpszip("compress a.csv -o a.gpsz --max-error 1m --effort 1 --keep ele:1")
    assert done.code == 0, done.err
    assert "B, 2 infinite values left out" in done.err
    found = package.open(tmp_path / "a.gpsz").curve("0", "ele", np.arange(60))
    assert np.flatnonzero(np.isnan(found)).tolist() == [3, 9, 40]


def test_from_python(ride, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    archive = package.compress("ride.gpx", max_error=5, effort=1, keep_within={"ele": 3.0})
    assert np.nanmax(np.abs(archive.curve("ride", "ele", START + np.arange(300.0)) - ride)) <= 3
    plain = package.compress("ride.gpx", max_error=5, effort=1, heights=False)
    assert plain.size < archive.size
    assert plain.decompress()[0].attributes == {}


def test_merged_parts_of_a_track_keep_within_the_larger_bound():
    times = np.arange(120.0)
    heights = np.cumsum(np.random.default_rng(5).normal(size=120))
    positions = np.stack([times, np.zeros(120)], axis=1)
    parts = [
        package.Track("a", times[own], positions[own], attributes={"ele": heights[own]})
        for own in (slice(60), slice(60, None))
    ]
    archives = [
        package.compress(part, max_error=1, effort=1, keep_within={"ele": bound})
        for part, bound in zip(parts, (2.0, 0.5), strict=True)
    ]
    merged = package.merge(archives, same_id="join")
    assert merged.curve_sizes["ele"][0] == 2
    assert np.abs(merged.curve("a", "ele", times) - heights).max() <= 2
