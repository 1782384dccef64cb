import io
import os
import sys

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.read import read_logs


def put(folder, **files):
    for name, rows in files.items():
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n")


def ids(reading):
    return [(track.id, track.times.tolist()) for track in reading.tracks]


def test_patterns_files_and_streams_at_once(tmp_path):
    put(tmp_path, b=["t,x,y", "0,0,0"], a=["t,x,y", "1,0,0"], c=["track_id,t,x,y", "7,2,0,0"])
    stream = io.BytesIO(b"track_id,t,x,y\n8,0,0,0\n")
    reading = read_logs([str(tmp_path / "[ab].csv"), tmp_path / "c.csv", stream])
    assert ids(reading) == [("a", [1]), ("b", [0]), ("7", [2]), ("8", [0])]
    assert reading.points == 4
    assert reading.bytes == 12 * 2 + 25 - 0 + len(stream.getvalue()) - 2


def test_a_file_may_be_named_like_a_pattern(tmp_path):
    put(tmp_path, **{"walk[1]": ["t,x,y", "0,0,0"]})
    assert len(read_logs(str(tmp_path / "walk[1].csv")).tracks) == 1


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"t,x,y\n0,0,0\n")))
    reading = read_logs("-")
    assert ids(reading) == [("0", [0])]


def test_a_pipe_is_read_like_a_file(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    child = os.fork()
    if child == 0:
        path.write_bytes(b"t,x,y\n0,0,0\n1,1,1\n")
        os._exit(0)
    try:
        assert len(read_logs(path).tracks[0]) == 2
    finally:
        os.waitpid(child, 0)


def test_files_in_any_order_continue_a_vehicle(tmp_path):
    put(
        tmp_path,
        a=["id,t,x,y", "v,2,2,0", "v,3,3,0"],
        b=["id,t,x,y", "v,0,0,0", "v,1,1,0", "v,2,2,0"],
    )
    reading = read_logs(str(tmp_path / "*.csv"))
    assert ids(reading) == [("v", [0, 1, 2, 3])]
    assert reading.points == reading.kept + reading.lost == 5


def test_a_vehicle_at_two_positions_at_once_is_renamed_and_counted(tmp_path):
    put(tmp_path, a=["id,t,x,y", "v,0,0,0", "v,3,3,0"], b=["id,t,x,y", "v,1,9,0", "w,1,1,0"])
    reading = read_logs(str(tmp_path / "*.csv"))
    assert ids(reading) == [("v", [0, 3]), ("v-2", [1]), ("w", [1])]
    assert ["renamed" in repair.what for repair in reading.repairs] == [True]


def test_logs_without_names_that_share_their_file_name(tmp_path):
    for day in ("mon", "tue"):
        (tmp_path / day).mkdir()
        put(tmp_path / day, walk=["t,x,y", "0,0,0"])
    assert ids(read_logs(str(tmp_path / "*" / "walk.csv"))) == [("walk", [0]), ("walk-2", [0])]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("missing.csv", "no such file"),
        ("*.gpx", "no file matches this pattern"),
        (".", "no file in this folder"),
    ],
)
def test_missing_logs_are_named(tmp_path, monkeypatch, name, says):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        read_logs(name)
    assert says in str(caught.value)
    assert str(caught.value).startswith(name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_no_permission(tmp_path):
    put(tmp_path, a=["t,x,y", "0,0,0"])
    (tmp_path / "a.csv").chmod(0)
    with pytest.raises(InputError, match="no permission"):
        read_logs(tmp_path / "a.csv")


def test_bad_logs_stop_the_reading_or_are_named(tmp_path):
    put(tmp_path, a=["t,x,y", "0,0,0"], b=["hello"], c=["t,lat,lon", "0,1,1"])
    names = [str(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv", "d.csv")]
    with pytest.raises(InputError, match=r"b\.csv"):
        read_logs(names)
    reading = read_logs(names, skip_bad=True)
    assert ids(reading) == [("a", [0])]
    assert [left.name for left in reading.left_out] == names[1:]
    assert reading.points == 1
    assert "no such file" in reading.left_out[2].reason


def test_nothing_readable_is_an_error_even_when_bad_logs_may_be_left_out(tmp_path):
    with pytest.raises(InputError, match="none of 2 logs"):
        read_logs([tmp_path / "a.csv", tmp_path / "b.csv"], skip_bad=True)
    with pytest.raises(InputError, match="no log given"):
        read_logs([])


def test_metres_and_degrees_are_not_read_together(tmp_path):
    put(tmp_path, a=["t,x,y", "0,0,0"], b=["t,lat,lon", "0,1,1"], c=["t,x,y,z", "0,1,1,1"])
    with pytest.raises(InputError, match=r"holds lat,lon, but .*a\.csv x,y"):
        read_logs([tmp_path / "a.csv", tmp_path / "b.csv"])
    with pytest.raises(InputError, match=r"holds x,y,z, but .*a\.csv x,y"):
        read_logs([tmp_path / "a.csv", tmp_path / "c.csv"])


def test_all_tracks_share_one_plane():
    reading = read_logs(io.BytesIO(b"id,t,lat,lon\na,0,50,8\nb,0,50.1,8\nc,0,50.2,8\n"))
    assert {track.plane for track in reading.tracks} == {reading.tracks[0].plane}
    assert reading.tracks[1].positions.round(6).tolist() == [[0, 0]]
    assert np.isclose(reading.tracks[2].positions[0, 1], 11125, atol=5)


def test_the_format_can_be_forced():
    with pytest.raises(InputError, match="damaged JSON"):
        read_logs(io.BytesIO(b"t,x,y\n0,0,0\n"), format="geojson")
    with pytest.raises(OptionError, match="no format 'xyz'"):
        read_logs(io.BytesIO(b"t,x,y\n0,0,0\n"), format="xyz")


def test_a_one_point_log_is_fine():
    assert ids(read_logs(io.BytesIO(b"t,lat,lon\n5,1,1\n"))) == [("0", [5])]


@pytest.mark.parametrize("other", ["1.5", "stop"])
def test_attributes_of_a_track_keep_their_kind_beside_those_of_another_file(tmp_path, other):
    """A float64 can't hold the large number, and a text is no number."""
    header = "track_id,t,x,y,note"
    put(
        tmp_path,
        a=[header, "a,0,0,0,9007199254740993", "a,1,1,0,5"],
        b=[header, f"b,0,0,0,{other}", f"b,1,1,0,{other}"],
    )
    first, _ = read_logs(str(tmp_path / "*.csv"), keep=["note"]).tracks
    assert first.attributes["note"].dtype == np.int64
    assert first.attributes["note"].tolist() == [9007199254740993, 5]
