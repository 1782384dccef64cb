"""decompress, map, info, verify and recover, on small archives."""

import csv
import io
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from gpszip.archive import new_archive
from gpszip.container.layout import Form, Head, encode_head
from gpszip.model import GridWalk, GridWalks, Plane, QuantisationGrid


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_decompress_writes_knots_in_pieces(gpszip, archive):
    done = gpszip("decompress", archive, "-o", "knots.csv")
    assert (done.code, done.out) == (0, "")
    assert "7 knots" in done.err
    knots = rows(Path("knots.csv").read_text())
    assert [row["track_id"] for row in knots] == ["a/0"] * 3 + ["a/1"] * 2 + ["b c"] * 2
    assert [float(row["t"]) for row in knots] == [0, 10, 20, 90, 100, 5, 25]
    assert (float(knots[2]["x"]), float(knots[2]["y"])) == (100, 50)


def test_decompress_to_standard_output_is_data_only(gpszip, archive):
    done = gpszip("decompress", archive, "-o", "-", "--every", "5s", "--track", "b c")
    assert (done.code, done.err) == (0, "")
    assert [(row["track_id"], float(row["t"]), float(row["x"])) for row in rows(done.out)] == [
        ("b c", 5, 0),
        ("b c", 10, 25),
        ("b c", 15, 50),
        ("b c", 20, 75),
        ("b c", 25, 100),
    ]


def test_decompress_at_times_gives_no_positions_in_gaps(gpszip, archive):
    done = gpszip("decompress", archive, "-o", "-", "--at", "15,50,95", "--track", "a")
    assert [(row["track_id"], float(row["t"])) for row in rows(done.out)] == [
        ("a/0", 15),
        ("a/1", 95),
    ]


def test_decompress_at_times_of_a_file(gpszip, archive, tmp_path):
    (tmp_path / "when.csv").write_text("t,note\n15,x\n\n95,y\n")
    done = gpszip("decompress", archive, "-o", "-", "--at", "when.csv")
    assert [float(row["t"]) for row in rows(done.out)] == [15, 95, 15]


def test_decompress_only_one_track(gpszip, archive):
    done = gpszip("decompress", archive, "-o", "-", "--track", "a")
    assert {row["track_id"] for row in rows(done.out)} == {"a/0", "a/1"}


def test_decompress_of_a_track_ignores_tracks_named_like_its_pieces(gpszip, tmp_path):
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 10]), np.array([False]))
    new_archive(
        QuantisationGrid((0, 0), 0, 128, 128),
        ["a", "a/1"],
        GridWalks(np.array([[0, 0], [9, 0]]), (walk, walk)),
    ).save(tmp_path / "x.gpsz")
    done = gpszip("decompress", "x.gpsz", "-o", "-", "--track", "a")
    assert {row["track_id"] for row in rows(done.out)} == {"a"}


def test_decompress_writes_pieces_as_segments_of_one_track(gpszip, earthly):
    text = gpszip("decompress", earthly, "-o", "-", "--format", "gpx").out
    assert (text.count("<trk>"), text.count("<trkseg>"), text.count("<name>a</name>")) == (2, 3, 1)
    lines = json.loads(gpszip("decompress", earthly, "-o", "-", "--format", "geojson").out)[
        "features"
    ]
    assert [(line["geometry"]["type"], line["properties"]["track_id"]) for line in lines] == [
        ("MultiLineString", "a"),
        ("LineString", "b c"),
    ]


def test_decompress_warns_of_names_that_gpx_cannot_hold(gpszip, tmp_path):
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 10]), np.array([False]))
    grid = QuantisationGrid((0, 0), 0, 128, 128, Plane(((480_000_000, 110_000_000),)))
    new_archive(grid, ["bell \a"], GridWalks(np.array([[0, 0], [9, 0]]), (walk,))).save(
        tmp_path / "x.gpsz"
    )
    done = gpszip("decompress", "x.gpsz", "-o", "-", "--format", "gpx")
    assert (done.code, "<name>bell \ufffd</name>" in done.out) == (0, True)
    assert done.err.splitlines() == [
        "gpszip: gpx can't hold control characters: they are U+FFFD in the names of tracks, "
        "in 1 of them, the first 'bell \\x07'; write GeoJSON or Parquet to have them"
    ]


@pytest.mark.parametrize("suffix", ["gpx", "geojson", "parquet"])
def test_decompress_writes_other_formats(gpszip, earthly, suffix, tmp_path):
    import gpszip as package

    done = gpszip("decompress", earthly, "-o", f"out.{suffix}")
    assert done.code == 0, done.err
    assert sum(len(track) for track in package.read(tmp_path / f"out.{suffix}")) == 7


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--every", "1s", "--at", "5"], 2, "give one"),
        (["--every", "1s", "--samples"], 2, "--every and --samples were both given"),
        (["--samples"], 2, "--keep-times or --keep"),
        (["--every", "5m"], 2, "write min for minutes"),
        (["--at", "noon"], 2, "'noon' is no time"),
        (["--at", "500"], 2, "gpszip info --detail shows the time range"),
        (["--track", "zz"], 2, "there is no track 'zz' in the archive"),
        (["--every", "1s", "--track", "zz"], 2, "no track 'zz'"),
    ],
)
def test_decompress_explains_mistakes(gpszip, archive, arguments, code, message):
    done = gpszip("decompress", archive, "-o", "out.csv", *arguments)
    assert done.code == code
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not Path("out.csv").exists()


def test_decompress_without_times(gpszip, timeless):
    assert gpszip("decompress", timeless, "-o", "-").out.splitlines()[0] == "track_id,x,y"
    done = gpszip("decompress", timeless, "-o", "out.csv", "--every", "1s")
    assert done.code == 2
    assert "has no times, so that it can't be sampled in time" in done.err


def test_map_on_the_earth(gpszip, earthly):
    done = gpszip("map", earthly, "-o", "-", "--raw")
    features = json.loads(done.out)["features"]
    assert len(features) == 3
    lon, lat = features[0]["geometry"]["coordinates"][0]
    assert (round(lat, 3), round(lon, 3)) == (48.0, 11.0)


def test_map_of_edges_with_many_traversals(gpszip, archive):
    done = gpszip("map", archive, "-o", "map.geojson", "--min-traversals", "2", "--json")
    assert done.json == {"output": "map.geojson", "edges": 1}
    assert len(json.loads(Path("map.geojson").read_text())["features"]) == 1


@pytest.mark.parametrize("suffix", ["graphml", "gpkg", "fgb", "shp.zip", "parquet", "csv"])
def test_map_in_other_formats(gpszip, archive, suffix):
    done = gpszip("map", archive, "-o", f"map.{suffix}")
    assert done.code == 0, done.err
    assert Path(f"map.{suffix}").stat().st_size > 50


def test_a_log_follows_its_own_map_in_openstreetmap_xml(gpszip, log, tmp_path):
    # The square of the log, 4 km by 3 km at 48 degrees north.
    rows = [line.split(",") for line in log.read_text().splitlines()[1:]]
    degrees = [
        f"{20 * float(t)},{48 + float(y) * 9e-4:.7f},{11 + float(x) * 9e-4:.7f}" for t, x, y in rows
    ]
    (tmp_path / "drive.csv").write_text("\n".join(["t,lat,lon", *degrees]) + "\n")
    assert gpszip("compress drive.csv -o drive.gpsz --rmse 10m --effort 1").code == 0

    # The export is the same in a file and on standard output.
    done = gpszip("map drive.gpsz -o map.osm")
    assert done.code == 0, done.err
    assert "map.osm: edges" in done.err
    written = (tmp_path / "map.osm").read_bytes()
    assert gpszip("map drive.gpsz -o - --format osm").out.encode() == written

    # Every point is on a way, in its direction.
    assert b'k="oneway" v="yes"' in written
    done = gpszip("match drive.csv --network map.osm -o routes.geojson --json")
    assert done.code == 0, done.err
    facts = done.json
    assert (facts["points"], facts["matched"]) == (200, 1.0)
    assert facts["error"] < 20


def test_map_in_metres_is_no_openstreetmap(gpszip, archive):
    done = gpszip("map", archive, "-o", "map.osm")
    assert done.code == 1
    assert "map.osm: this map is in x and y" in done.err
    assert len(done.err.splitlines()) == 1
    assert not Path("map.osm").exists()


def test_map_of_unknown_format(gpszip, archive):
    done = gpszip("map", archive, "-o", "map.xyz")
    assert done.code == 1
    assert ".geojson, .json, .graphml, .osm, .gpkg, .fgb, .shp.zip, .shz" in done.err


def test_info_for_people(gpszip, archive):
    done = gpszip("info", archive, "--detail")
    assert done.code == 0
    assert "2 (a, b c)" in done.out
    assert "nodes 3, edges 3" in done.out
    assert "segments 5, gaps 1" in done.out
    assert "waypoints   7; shortest paths" in done.out
    assert "0 s to 100 s" in done.out


def test_info_for_programs(gpszip, earthly):
    facts = gpszip("info", earthly, "--json", "--detail").json
    assert facts["tracks"] == 2
    assert facts["ids"] == ["a", "b c"]
    assert facts["bytes"] == earthly.stat().st_size
    assert facts["planes"] == [[48.0, 11.0]]
    assert (facts["t_start"], facts["t_end"]) == (0, 100)
    assert facts["bounds"]["lat"][0] == pytest.approx(48.0)
    assert facts["bounds"]["lat"][1] == pytest.approx(48.00045, abs=1e-5)


def test_info_says_what_is_not_kept(gpszip, timeless):
    assert "times are not kept" in gpszip("info", timeless, "--detail").out


def test_verify_of_an_intact_archive(gpszip, archive):
    done = gpszip("verify", archive, "--json")
    assert done.code == 0
    assert done.json["whole"] is True


@pytest.mark.parametrize("command", ["verify", "info", "map", "decompress"])
def test_corrupt_archives_end_with_4(gpszip, archive, command):
    data = bytearray(archive.read_bytes())
    data[len(data) // 2] ^= 4
    archive.write_bytes(data)
    arguments = ["-o", "out.geojson"] if command in {"map", "decompress"} else []
    done = gpszip(command, archive, *arguments)
    assert done.code == 4
    assert done.err.startswith(f"gpszip: {archive}: ")
    assert "fetch or make it again" in done.err
    assert len(done.err.splitlines()) == 1
    assert not Path("out.geojson").exists()


@pytest.mark.parametrize(
    ("form", "command", "named"),
    [
        (Form.SECTIONS, "info", True),
        (Form.SECTIONS, "recover -o saved.gpsz", False),
        (Form.LONE, "info", False),
        (Form.NAMED, "info", False),
    ],
)
def test_recover_is_advised_where_it_can_help(gpszip, tmp_path, form, command, named):
    """With one checksum all is lost, however large; nor is recover the remedy where it failed."""
    (tmp_path / "bad.gpsz").write_bytes(encode_head(Head(form)) + bytes(70_000))
    first, *options = command.split()
    done = gpszip(first, "bad.gpsz", *options)
    assert done.code == 4
    assert "fetch or make it again" in done.err
    assert ("gpszip recover" in done.err) is named
    assert not (tmp_path / "saved.gpsz").exists()


@pytest.mark.parametrize("data", [b"", b"t,x,y\n0,1,2\n", b"\xa7Z"])
def test_files_that_are_no_archives(gpszip, tmp_path, data):
    (tmp_path / "odd.gpsz").write_bytes(data)
    done = gpszip("info", "odd.gpsz", "--json")
    assert done.code == 4
    error = json.loads(done.err)["error"]
    assert error["kind"] == "CorruptArchiveError"
    assert error["exit_code"] == 4


def test_archive_of_a_later_version(gpszip, archive):
    data = bytearray(archive.read_bytes())
    data[2] += 2
    archive.write_bytes(data)
    done = gpszip("info", archive)
    assert done.code == 4
    assert "archive of version 5; this GPSZip reads up to version 3: upgrade gpszip" in done.err
    assert "make it again" not in done.err


def test_archive_from_standard_input(shell, archive):
    done = shell("verify", "-", "--json", data=archive.read_bytes())
    assert done.returncode == 0
    assert json.loads(done.stdout)["tracks"] == 2


def test_recover_of_an_intact_archive_loses_nothing(gpszip, archive):
    done = gpszip("recover", archive, "-o", "saved.gpsz")
    assert done.code == 0
    assert "lost: nothing" in done.err
    assert Path("saved.gpsz").read_bytes() == archive.read_bytes()


def test_no_such_archive(gpszip):
    done = gpszip("info", "nowhere.gpsz")
    assert done.code == 1
    assert done.err == "gpszip: nowhere.gpsz: no such file\n"


def test_output_has_the_default_mode(gpszip, archive):
    gpszip("decompress", archive, "-o", "knots.csv")
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(Path("knots.csv").stat().st_mode) == 0o666 & ~mask
