"""Exports of Strava, Garmin, Google, Apple and OwnTracks: one command reads each."""

import gzip
import io
import os
import re
from pathlib import Path

import pytest

import exports
from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from oracle import fit, google

pytest.importorskip("fitdecode")

N = exports.N

#: The tracks of each export with their points, and what is said of its other files.
EXPECTED = {
    "strava": (
        {"Morning Ride": N, "Morning Ride-2": N, "2021-05-06T07:00:00.000+00:00": N, "4": N},
        {"9 files without positions: 5 .csv, 2 .jpg, 1 .tcx, 1 .json"},
    ),
    "garmin": (
        {"a_0": N, "a_1": N, "a_2": N, "a_3": N},
        {
            "9 files without positions: 5 .fit, 3 .json, 1 .txt",
            "1 file with the same bytes as another one: 1 .fit",
        },
    ),
    "takeout": (
        {"5": 2 * N},
        {
            "3 files without positions: 1 .json, 1 .csv, 1 .html",
            "2 files of the same history as Records.json "
            "(--format google-paths reads its paths): 2 .json",
        },
    ),
    "apple": (
        {"Route 2021-05-04 9:41am": N, "Route 2021-05-05 9:41am": N},
        {"3 files without positions: 2 .xml, 1 .csv"},
    ),
    "days": ({"2021-05-04": N, "2021-05-05": N, "2021-05-06": N}, set()),
}


def in_order(text):
    """The kinds of files in an order of their own: that of equally frequent ones is free."""
    what, _, kinds = text.rpartition(": ")
    return what, frozenset(kinds.split(", "))


def write(kind, form, folder):
    """Write an export as an archive or a folder, and return its path."""
    files = getattr(exports, kind)()
    if form == "zip":
        path = folder / f"{kind}.zip"
        path.write_bytes(exports.zipped(files))
        return path
    exports.unpacked(files, folder / kind)
    return folder / kind


@pytest.mark.parametrize("form", ["zip", "folder"])
@pytest.mark.parametrize("kind", EXPECTED)
def test_an_export_is_read_completely(tmp_path, kind, form):
    path = write(kind, form, tmp_path)
    tracks, others = EXPECTED[kind]
    result = read_logs(str(path))
    assert {track.id: len(track) for track in result.tracks} == tracks
    assert {in_order(str(each)) for each in result.other_files} == set(map(in_order, others))
    assert result.complete

    # The same in batches.
    with store_logs(str(path), rows=1000) as log:
        assert {track.id: len(track) for track in log.tracks} == tracks
        assert log.read_result.other_files == result.other_files


@pytest.mark.parametrize("more", ["", "--memory 1GiB", "--dry-run"])
def test_the_command_says_what_it_left_out(gpszip, tmp_path, more):
    write("strava", "zip", tmp_path)
    run = gpszip(f"compress strava.zip -o me.gpsz --effort 1 --json {more}")
    assert run.code == 0, run.err
    summary = run.json
    [others] = summary["other_files"]
    assert others["kinds"] == {".csv": 5, ".jpg": 2, ".json": 1, ".tcx": 1}
    assert (summary["tracks"], summary["points"]) == (4, 4 * N)
    run = gpszip(f"compress strava.zip -o again.gpsz --effort 1 {more}")
    assert "gpszip: strava.zip: left out 9 files without positions: 5 .csv, 2 .jpg" in run.err


def test_paths_of_a_history_are_read_if_asked_for(tmp_path):
    for form in ("zip", "folder"):
        result = read_logs(str(write("takeout", form, tmp_path)), format="google-paths")
        assert [track.id for track in result.tracks] == ["2021_MAY"]
        assert result.complete
        assert "2 files of positions instead of paths: 2 .json" in map(str, result.other_files)


def split_takeout():
    """The two archives of an export whose second one has what devices measured."""
    files = exports.takeout()
    second = {name: data for name, data in files.items() if name.endswith("Records.json")}
    first = {name: data for name, data in files.items() if name not in second}
    return exports.zipped(first), exports.zipped(second)


def test_a_takeout_in_several_archives_is_read_as_one(tmp_path):
    (tmp_path / "parts").mkdir()
    names = [str(tmp_path / f"parts/takeout-20240504T080000Z-00{i}.zip") for i in (1, 2)]
    for name, data in zip(names, split_takeout(), strict=True):
        Path(name).write_bytes(data)
    pattern = str(tmp_path / "parts/takeout-*.zip")
    for sources in (str(tmp_path / "parts"), names, pattern, [pattern]):
        result = read_logs(sources)
        assert {track.id: len(track) for track in result.tracks} == {"5": 2 * N}, sources
        assert result.complete
        assert "2 files of the same history" in " ".join(map(str, result.other_files))


def test_records_in_a_folder_that_comes_later_are_preferred(tmp_path):
    files = exports.takeout()
    records = next(name for name in files if name.endswith("Records.json"))
    exports.unpacked({"b/Records.json": files.pop(records), **files}, tmp_path / "logs")
    assert [track.id for track in read_logs(str(tmp_path / "logs")).tracks] == ["5"]


def test_what_devices_measured_is_never_left_out_in_silence(tmp_path):
    """Renamed, it doesn't come first: then it is named as a loss."""
    files = exports.takeout()
    records = next(name for name in files if name.endswith("Records.json"))
    months = next(name for name in files if name.endswith("2021_MAY.json"))
    renamed = {"a.json": files[months], "b.json": files[records]}
    exports.unpacked(renamed, tmp_path / "logs")
    result = read_logs(str(tmp_path / "logs"))
    assert [track.id for track in result.tracks] == ["a"]
    assert not result.complete
    [left] = result.left_out
    assert left.name == str(tmp_path / "logs/b.json")
    assert "comes after a.json, which has paths of the same history" in left.reason


def test_an_empty_list_does_not_stand_for_the_history(tmp_path):
    files = exports.takeout()
    files = {name: data for name, data in files.items() if not name.endswith("Edits.json")}
    files = {
        name: b'{"locations": []}' if name.endswith("Records.json") else data
        for name, data in files.items()
    }
    exports.unpacked(files, tmp_path / "logs")
    result = read_logs(str(tmp_path / "logs"))
    assert [track.id for track in result.tracks] == ["2021_MAY"]


def test_months_are_read_where_there_are_no_records(tmp_path):
    files = {
        name: data
        for name, data in exports.takeout().items()
        if not name.endswith(("Records.json", "Edits.json"))
    }
    files["Takeout/more/2021_JUNE.json"] = google.encode(google.months(exports.rows(31)))
    exports.unpacked(files, tmp_path / "takeout")
    result = read_logs(str(tmp_path / "takeout"))
    assert sorted(track.id for track in result.tracks) == ["2021_JUNE", "2021_MAY"]


def test_a_damaged_log_is_named_and_the_others_are_read(gpszip, tmp_path):
    files = exports.strava()
    files["activities/4.fit.gz"] = gzip.compress(exports.activity(3)[:-20])
    (tmp_path / "strava.zip").write_bytes(exports.zipped(files))
    run = gpszip("compress strava.zip -o me.gpsz --effort 1")
    assert run.code == 3
    assert "left out strava.zip/activities/4.fit.gz: " in run.err
    assert "3 tracks" in run.err


def test_a_table_without_times_is_named_as_it_may_be_a_log(tmp_path):
    exports.unpacked({"a.csv": b"lat,lon\n48,11\n", **exports.days()}, tmp_path / "logs")
    result = read_logs(str(tmp_path / "logs"))
    assert not result.complete
    assert [left.name for left in result.left_out] == [str(tmp_path / "logs/a.csv")]


def test_large_files_of_other_kinds_are_not_read(tmp_path):
    """A video would be unpacked as 64 MiB, and damaged at its end."""
    data = exports.zipped({"a.csv": b"t,x,y\n0,0,0\n1,1,1\n", "a.mp4": os.urandom(1 << 21)})
    video = data.index(b"a.mp4") + (1 << 20)
    data = data[:video] + b"damage" + data[video + 6 :]
    result = read_logs(io.BytesIO(data))
    assert result.complete
    assert [str(each) for each in result.other_files] == ["1 file without positions: 1 .mp4"]


def test_many_repairs_of_one_kind_are_one_line(gpszip, tmp_path):
    time = round(exports.START.timestamp())
    for day in range(8):
        record = fit.record(time + day * 86400 - 5)
        records = [
            fit.record(round(t.timestamp()), lat, lon) for t, lat, lon, _ in exports.rows(day)
        ]
        (tmp_path / "rides").mkdir(exist_ok=True)
        (tmp_path / f"rides/{day}.fit").write_bytes(fit.fit(fit.file_id(), record, *records))
    run = gpszip("compress rides -o me.gpsz --effort 1")
    assert run.code == 0, run.err
    assert re.search(r"rides/0\.fit.* and 7 more: 8 .* dropped", run.err), run.err


def test_archives_in_archives_have_a_limit(tmp_path):
    data = exports.days()
    for _ in range(3):
        data = {"in.zip": exports.zipped(data)}
    assert len(read_logs(io.BytesIO(exports.zipped(data))).tracks) == 3
    deeper = {"in.zip": exports.zipped(data), "a.gpx": exports.gpx(9, "a")}
    result = read_logs(io.BytesIO(exports.zipped(deeper)))
    assert [left.reason for left in result.left_out] == [
        "lies within more than 3 other zip archives; unpack it first"
    ]


def test_a_bomb_in_archives_is_refused():
    """Each archive stays below the limit by itself, both together do not."""
    inner = exports.zipped({"a.csv": b"t,x,y\n" + b"\n" * (40 << 20)})
    with pytest.raises(InputError, match="no row"):
        read_logs(io.BytesIO(inner))
    outer = exports.zipped({f"{i}.zip": inner for i in range(3)})
    with pytest.raises(InputError, match=r"^stream: expands more than 300 times"):
        read_logs(io.BytesIO(outer))


@pytest.mark.skipif(os.name != "posix", reason="links and pipes")
def test_links_pipes_and_hidden_files_of_folders(tmp_path):
    logs = tmp_path / "logs"
    exports.unpacked(exports.days(), logs)
    (logs / "loop").symlink_to(logs, target_is_directory=True)
    (logs / "same.gpx").symlink_to(logs / "2021-05/04.gpx")
    (logs / "nowhere.gpx").symlink_to(logs / "none.gpx")
    os.mkfifo(logs / "pipe.zip")
    for name in (".git/a.gpx", "__MACOSX/a.gpx", ".hidden.gpx"):
        exports.unpacked({name: exports.gpx(7, "hidden")}, logs)
    result = read_logs(str(logs))
    assert [track.id for track in result.tracks] == ["2021-05-04", "2021-05-05", "2021-05-06"]
    assert [(left.name, left.reason) for left in result.left_out] == [
        (str(logs / "nowhere.gpx"), "no such file")
    ]
    assert {str(each) for each in result.other_files} == {
        "1 file without positions: 1 .zip",
        "1 file with the same bytes as another one: 1 .gpx",
    }


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
def test_a_folder_without_permission_is_named(tmp_path):
    exports.unpacked(exports.days(), tmp_path / "logs")
    (tmp_path / "logs/locked").mkdir(mode=0)
    result = read_logs(str(tmp_path / "logs"))
    assert [left.reason for left in result.left_out] == ["no permission to read it"]


def test_tables_of_parquet_stay_one_log_beside_other_files(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = tmp_path / "fleet"
    for vehicle in (1, 2):
        (folder / f"vehicle={vehicle}").mkdir(parents=True)
        table = pa.table({"t": [0, 1], "x": [0.0, 1.0], "y": [vehicle, 2.0]})
        pq.write_table(table, folder / f"vehicle={vehicle}/a.parquet")
    (folder / "_SUCCESS").touch()
    alone = read_logs(str(folder))
    assert alone.complete
    (folder / "README.md").write_text("# Fleet\n")
    beside = read_logs(str(folder))
    assert [len(track) for track in beside.tracks] == [len(track) for track in alone.tracks]
    assert [str(each) for each in beside.other_files] == ["1 file without positions: 1 .md"]
