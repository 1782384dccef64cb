"""Errors of files: path, location, reason and remedy are fields, from which the message is made."""

import io
import struct
import zlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip
from gpszip.errors import CorruptArchiveError, InputError, OutputError
from gpszip.geo.planes import choose_plane
from gpszip.io.coresets import read_coreset
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.maps.write import write_map
from gpszip.io.networks.prepared_file import PREPARED_MAGIC
from gpszip.io.networks.read import read_network
from gpszip.model import RoadMap

#: A feature of GeoJSON with a line; its times are left to fill in.
LINE = (
    '{"type": "Feature", "properties": {"times": %s}, '
    '"geometry": {"type": "LineString", "coordinates": [[11, 48], [11.1, 48]]}}'
)

#: Where a log in degrees is.
NEAR = gpszip.Track("car", [0, 60], [[0, 0], [9, 9]], plane=choose_plane([48], [11]))

#: Logs by name: text, location, reason and remedy. The last two may be the beginnings of them.
LOGS = {
    "back.csv": (
        "t,x,y\n0,0,0\n9,1,0\n4,2,0\n",
        "row 4",
        "time goes back 5 s",
        "--sort orders the points, --split",
    ),
    "midnight.csv": (
        "time,x,y\n23:59:58,0,0\n23:59:59,1,0\n00:00:01,2,0\n",
        "row 4",
        "the time of day goes back",
        "add a column named date",
    ),
    "quote.csv": (
        't,x,y,note\n0,0,0,a\n1,1,0,"b\n2,2,0,c\n',
        "row 3",
        "a quote is not closed",
        "close it",
    ),
    "swapped.csv": (
        "t,lat,lon\n0,99,48\n1,99.1,48\n",
        "row 2",
        "latitude 99, longitude 48: they look swapped",
        "name them: --columns lat=COLUMN,lon=COLUMN",
    ),
    "metres.csv": (
        "t,lat,lon\n0,480,5000\n1,490,5000\n",
        "row 2",
        "latitude 480, longitude 5000: not degrees",
        "if they are metres",
    ),
    "dates.csv": (
        "time,x,y\n03/04/2024 08:00,0,0\n03/04/2024 08:01,1,0\n",
        "column 'time'",
        "'03/04/2024 08:00' can be 3 Apr 2024 or 4 Mar 2024",
        "say which: --dates dmy or --dates mdy",
    ),
    "both.csv": (
        "date,time,x,y\n2024-05-04,100,0,0\n2024-05-04,130,1,0\n",
        "column 'time'",
        "'100' can be seconds or hhmmss",
        "if seconds, say so",
    ),
    "clock.csv": (
        "t,x,y\n" + "".join(f"{80000 + 100 * (i // 6) + 10 * (i % 6)},{i},0\n" for i in range(20)),
        "column 't'",
        "080000 and the numbers after it step like hours",
        "write 08:00:00",
    ),
    "words.csv": (
        "time,x,y\nnoon,0,0\nlate,1,0\n",
        "column 'time'",
        "'noon' is no date and time",
        "give ISO 8601",
    ),
    "empty.csv": ("", None, "empty file", "name one that holds a log"),
    "torn.gpx": (
        '<gpx><trk><trkseg>\n<trkpt lat="48" lon="11">',
        "line 2",
        "damaged GPX: the file ends within <trkseg>",
        "fetch it again, or end it with </trkseg></trk></gpx>",
    ),
    "typed.gpx": (
        '<?xml version="1.0"?>\n<!DOCTYPE gpx>\n<gpx></gpx>',
        "line 2",
        "has a document type (<!DOCTYPE), which no GPX file needs",
        "remove it",
    ),
    "count.geojson": (
        LINE % "[0]",
        "feature 1",
        "has 2 positions, but 1 times",
        "--skip-bad leaves it out",
    ),
    "times.geojson": (
        LINE % '["noon", "late"]',
        "feature 1: times",
        "'noon' is no date and time",
        "give ISO 8601",
    ),
}

#: Networks by name, as above.
NETWORKS = {
    "none.geojson": (b" ", None, "empty file", "name one that holds a network"),
    "other.txt": (b"a road", None, "no network", "known are"),
    "node.graphml": (
        b'<graphml><graph><node id="a"/></graph></graphml>',
        None,
        "node 'a' has no position",
        "nodes need the numbers",
    ),
    "far.geojson": (
        (LINE % "null").replace("[11, 48]", "[11e6, 48]").encode(),
        None,
        "is in metres of an unknown origin, but the log in degrees",
        "convert one of them",
    ),
}


def _check(error, path, location, reason, remedy):
    """Check the fields of an error, and that its message is made of them."""
    assert (error.path, error.location) == (str(path), location)
    assert error.reason.startswith(reason)
    assert error.remedy.startswith(remedy)
    where = f"{path}: " if location is None else f"{path}: {location}: "
    assert str(error) == f"{where}{error.reason}; {error.remedy}"


@pytest.mark.parametrize("name", LOGS)
def test_errors_of_logs_have_fields(tmp_path, name):
    text, *fields = LOGS[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as caught:
        read_logs(tmp_path / name)
    _check(caught.value, tmp_path / name, *fields)


@pytest.mark.parametrize("name", [name for name in LOGS if name.endswith(".csv")])
def test_logs_on_disk_have_the_same_errors(tmp_path, name):
    text, *fields = LOGS[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as caught:
        store_logs(str(tmp_path / name), rows=1000)
    _check(caught.value, tmp_path / name, *fields)


@pytest.mark.parametrize("name", NETWORKS)
def test_errors_of_networks_have_fields(tmp_path, name):
    data, *fields = NETWORKS[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_network(tmp_path / name, near=NEAR)
    _check(caught.value, tmp_path / name, *fields)


def test_columns_of_a_parquet_file_are_named_in_the_reason(tmp_path):
    table = pa.table({"t": [0.0, 1.0], "x": [0.0, 1.0], "y": [0.0, 1.0], "id": [["a"], ["b"]]})
    pq.write_table(table, tmp_path / "a.parquet")
    with pytest.raises(InputError) as caught:
        read_logs(tmp_path / "a.parquet")
    reason = "column 'id' holds list"
    _check(caught.value, tmp_path / "a.parquet", None, reason, "name another one")


def test_what_is_damaged_comes_with_its_offset_and_a_remedy(tmp_path):
    front = PREPARED_MAGIC + struct.pack("<IIQQQQ", 2, 0, 0, 0, 0, 0)
    path = tmp_path / "a.gpsz"
    path.write_bytes(front + struct.pack("<I", zlib.crc32(front) ^ 1))
    with pytest.raises(CorruptArchiveError) as caught:
        read_network(path)
    _check(caught.value, path, None, "its index is damaged (at byte 0)", "prepare it again")
    assert caught.value.offset == 0


def test_a_damaged_archive_has_its_file(tmp_path):
    path = tmp_path / "a.gpsz"
    path.write_bytes(b"no archive")
    with pytest.raises(CorruptArchiveError) as caught:
        gpszip.open(path)
    assert caught.value.path == str(path)
    assert caught.value.offset == 0
    assert str(caught.value).startswith(f"{path}: not a .gpsz archive: ")


def test_features_left_out_have_reasons_without_the_file(tmp_path):
    # One feature has times that are none, and the file is cut off after another one.
    path = tmp_path / "a.geojson"
    good, bad = LINE % "[0, 1]", LINE % '["noon", "late"]'
    path.write_text(f'{{"type": "FeatureCollection", "features": [{good}, {bad}, {{"a')
    left_out = {item.name: item.reason for item in read_logs(path, skip_bad=True).left_out}
    reason = left_out[f"{path}: feature 2"]
    assert reason.startswith("'noon' is no date and time; give ISO 8601")
    assert left_out[f"{path}: all after feature 2"].startswith("damaged JSON file")


def test_a_stopped_track_has_a_reason_without_the_file(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"still,7,{i},0\ngoing,{i},{i},0\n" for i in range(5)]
    path.write_text("id,t,x,y\n" + "".join(sorted(rows)))
    [item] = read_logs(path, skip_bad=True, sort=True).left_out
    assert item.name == f"{path}: track 'still'"
    assert item.reason.startswith("all 5 points of track 'still' have the same time, 7 s; name")


def test_a_coreset_and_a_map_have_fields(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"a": [1]}), path)
    with pytest.raises(InputError) as caught:
        read_coreset(path)
    _check(caught.value, path, None, "is no coreset", "make one with: gpszip coreset LOG")

    road_map = RoadMap(
        np.array([[0.0, 0.0], [40.0, 30.0]]), np.array([[0, 1]]), np.array([3]), np.array([1])
    )
    with pytest.raises(OutputError) as caught:
        write_map(road_map, tmp_path / "a.odd")
    reason = "can't tell the format from this name"
    _check(caught.value, tmp_path / "a.odd", None, reason, "end it with one of")


def test_a_stream_is_named_as_one():
    with pytest.raises(InputError) as caught:
        read_logs(io.BytesIO(b"t,x,y\n5,0,0\n1,0,0\n"))
    assert caught.value.location == "row 3"
    assert str(caught.value) == f"{caught.value.path}: {caught.value.detail}"
