"""Logs of the common formats go through the commands that a stranger tries first.

Those of instruments, ships and simulators are in ``test_other_formats.py``.
"""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import exports
from gpszip.io.logs.formats import LOG_FORMATS
from gpszip.io.logs.read import read_logs
from oracle import google, nmea

ROWS = exports.rows(0)
FORMATS = {log_format.name: log_format for log_format in LOG_FORMATS}
WRITTEN = [name for name, log_format in FORMATS.items() if log_format.write is not None]


def poses():
    """Seconds and positions of a robot that drives a square twice."""
    t = np.arange(120) / 2
    corners = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]], float)
    along = (t * 1.5) % 40
    return t, np.stack([np.interp(along, 10 * np.arange(5), axis) for axis in corners.T], axis=1)


def lines(rows, separator=" ", header=""):
    return (header + "".join(separator.join(map(repr, row)) + "\n" for row in rows)).encode()


def parquet():
    columns = {
        name: [row[i] for row in ROWS] for i, name in enumerate(("time", "latitude", "longitude"))
    }
    pq.write_table(pa.table(columns), sink := pa.BufferOutputStream())
    return sink.getvalue().to_pybytes()


def geojson():
    line = {"type": "LineString", "coordinates": [[lon, lat] for _, lat, lon, _ in ROWS]}
    times = [google.iso(time) for time, *_ in ROWS]
    feature = {"type": "Feature", "properties": {"coordTimes": times}, "geometry": line}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()


def kml():
    whens = "".join(f"<when>{google.iso(time)}</when>" for time, *_ in ROWS)
    coords = "".join(f"<gx:coord>{lon} {lat} 0</gx:coord>" for _, lat, lon, _ in ROWS)
    return (
        "<kml xmlns='http://www.opengis.net/kml/2.2' xmlns:gx='http://www.google.com/kml/ext/2.2'>"
        f"<Placemark><name>walk</name><gx:Track>{whens}{coords}</gx:Track></Placemark></kml>"
    ).encode()


def tum():
    times, places = poses()
    rows = np.column_stack([times, places, np.zeros((len(times), 4)), np.ones(len(times))])
    return lines(rows.tolist())


def kitti():
    return lines([(1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, 0) for x, y in poses()[1].tolist()])


def euroc():
    names = "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
    names += "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    times, places = poses()
    rows = [
        (round(t * 1e9), x, y, 0.0, 1.0, 0.0, 0.0, 0.0)
        for t, (x, y) in zip(times.tolist(), places.tolist(), strict=True)
    ]
    return lines(rows, ",", f"{names}\n")


def ros():
    pytest.importorskip("rosbags")
    from ros_bags import write_bag

    def messages(of):
        for t, p in zip(*map(list, poses()), strict=True):
            ns = round((1.7e9 + t) * 1e9)
            yield "/odom", ns, of.odometry(ns, (*p, 0))

    return write_bag("bag", "bag", messages).read_bytes()


def fit_activity():
    pytest.importorskip("fitdecode")
    return exports.activity(0)


#: For each format: the name of a file, its bytes, and options that it needs.
SAMPLES = {
    "parquet": ("a.parquet", parquet, ""),
    "gpx": ("a.gpx", lambda: exports.gpx(0, "ride"), ""),
    "kml": ("a.kml", kml, ""),
    "kmz": ("a.kmz", lambda: exports.zipped({"doc.kml": kml()}), ""),
    "tcx": ("a.tcx", lambda: exports.tcx(0), ""),
    "google": ("Records.json", lambda: google.encode(google.records(ROWS)), ""),
    "google-paths": (
        "Timeline.json",
        lambda: google.encode(google.android(ROWS)),
        "--format google-paths",
    ),
    "geojson": ("a.geojson", geojson, ""),
    "fit": ("a.fit", fit_activity, ""),
    "nmea": (
        "a.nmea",
        lambda: "\r\n".join(nmea.rmc(time, lat, lon) for time, lat, lon, _ in ROWS).encode(),
        "",
    ),
    "ros": ("log.bag", ros, ""),
    "euroc": ("data.csv", euroc, ""),
    "tum": ("a.tum", tum, ""),
    "kitti": ("poses.txt", kitti, "--rate 2"),
    "csv": (
        "a.csv",
        lambda: lines([(r[0].timestamp(), r[1], r[2]) for r in ROWS], ",", "time,lat,lon\n"),
        "",
    ),
}


def test_samples_are_those_of_formats_that_exist():
    assert not set(SAMPLES) - set(FORMATS)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_log_goes_through_all_commands(gpszip, tmp_path, name):
    file, make, options = SAMPLES[name]
    (tmp_path / file).write_bytes(make())

    # Compress it as its format is found.
    fast = f"--max-error 1m --effort 1 --json {options}"
    done = gpszip(f"compress {file} -o a.gpsz {fast}")
    assert done.code == 0, done.err
    points = done.json["points"]
    assert done.json["points_lost"] == 0
    # For a size, nothing is estimated.
    planned = gpszip(f"compress {file} -o none.gpsz --dry-run --bytes 500 --json {options}")
    assert planned.json["files"][0]["format"] == ("kml" if name == "kmz" else name)

    # Look at it.
    assert gpszip("info a.gpsz --detail --json").json["tracks"] == 1
    view_options = "" if "--format" in options else options
    assert gpszip(f"view a.gpsz --raw {file} -o a.html {view_options}").code == 0
    assert gpszip("map a.gpsz -o map.geojson").code == 0

    # Write it in all formats and read it again, once for degrees and once for metres: nothing else
    # about the format of the log is in an archive.
    if name not in ("csv", "tum"):
        return
    geographic = gpszip("cat a.gpsz").out.splitlines()[0].startswith("track_id,t,lat")
    for written in WRITTEN:
        if written == "tum" and geographic:
            continue  # it holds metres
        back = f"back{FORMATS[written].suffixes[0]}"
        done = gpszip(f"decompress a.gpsz -o {back} --force")
        if written in ("gpx", "kml", "kmz") and not geographic:
            assert done.code == 1
            assert "degrees" in done.err or "latitude" in done.err, done.err
            continue
        assert done.code == 0, done.err
        again = read_logs(tmp_path / back)
        assert len(again.tracks) == 1
        assert 2 <= again.points <= 2 * points
