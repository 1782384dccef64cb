"""Logs of flights, ships, simulators and robots, from the file to an archive and back."""

import csv
import gzip
import io
import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from oracle import dataflash, igc, mavlink, plt, ulog

START = datetime(2024, 5, 4, 23, 58, tzinfo=UTC)
TIMES = [START + timedelta(minutes=i) for i in range(100)]
ROWS = [(time, 48 + i % 20 / 1e3, 11.5 + i / 1e4) for i, time in enumerate(TIMES)]


def owntracks():
    lines = [
        "2024-06-01T00:00:00Z\t*                 \t"
        + json.dumps({"_type": "location", "tst": time.timestamp(), "lat": lat, "lon": lon})
        for time, lat, lon in ROWS
    ]
    return "\n".join(lines).encode()


def readsb():
    trace = [
        [(time - START).total_seconds(), lat, lon, "ground", 1, 90, 0, None]
        for time, lat, lon in ROWS
    ]
    data = {"icao": "3c6444", "timestamp": START.timestamp(), "trace": trace}
    return gzip.compress(json.dumps(data).encode())


def ais():
    header = "# Timestamp,Type of mobile,MMSI,Latitude,Longitude,SOG\n"
    rows = [f"{time:%d/%m/%Y %H:%M:%S},Class A,219000001,{lat},{lon},1" for time, lat, lon in ROWS]
    return (header + "\n".join(rows)).encode()


def sumo():
    steps = [
        f'<timestep time="{time.timestamp()}">'
        f'<vehicle id="a" x="{lon:.6f}" y="{lat:.6f}"/></timestep>'
        for time, lat, lon in ROWS
    ]
    options = '<!-- <configuration><fcd-output.geo value="true"/></configuration> -->'
    return f"{options}<fcd-export>{''.join(steps)}</fcd-export>".encode()


def npz():
    file = io.BytesIO()
    t, lat, lon = zip(*((time.timestamp(), *at) for time, *at in ROWS), strict=True)
    np.savez_compressed(file, t=t, lat=lat, lon=lon)
    return file.getvalue()


def hdf5():
    h5py = pytest.importorskip("h5py")
    file = io.BytesIO()
    with h5py.File(file, "w") as opened:
        opened["gps/t"] = [row[0].timestamp() for row in ROWS]
        opened["gps/lat"], opened["gps/lon"] = ([row[i] for row in ROWS] for i in (1, 2))
    return file.getvalue()


def px4():
    data = ulog.header() + ulog.flags() + ulog.topic("vehicle_gps_position", ulog.GPS)
    data += ulog.subscription(0, "vehicle_gps_position")
    for time, lat, lon in ROWS:
        clock = round((time - START).total_seconds() * 1e6)
        at = (round(lat * 1e7), round(lon * 1e7), 500_000)
        utc = round(time.timestamp() * 1e6)
        data += ulog.data(0, ulog.GPS, clock, utc, *at, 1, 0, 3, 9)
    return data


def ardupilot():
    types, labels = dataflash.NEW
    data = dataflash.start() + dataflash.describe(130, "GPS", types, labels)
    for time, lat, lon in ROWS:
        row = (0, 0, 3, *dataflash.gps_time(time), 9, 1.2, lat, lon, 500, 1.0, 90.0)
        data += dataflash.message(130, types, *row)
    return data


def tlog():
    return b"".join(
        mavlink.frame(time.timestamp(), mavlink.GPS, mavlink.gps(*at)) for time, *at in ROWS
    )


LOGS = {
    "phone.rec": owntracks,
    "flight.igc": lambda: "\n".join(
        ["AXXX", igc.date(START), *(igc.fix(*row) for row in ROWS)]
    ).encode(),
    "walk.plt": (plt.HEADER + "".join(plt.point(*row) for row in ROWS)).encode,
    "trace_full_3c6444.json": readsb,
    "ais.csv": ais,
    "fcd.xml": sumo,
    "log.npz": npz,
    "log.h5": hdf5,
    "flight.ulg": px4,
    "flight.bin": ardupilot,
    "flight.tlog": tlog,
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_comes_back_within_its_bound(gpszip, tmp_path, name):
    (tmp_path / name).write_bytes(LOGS[name]())
    compressed = gpszip(f"compress {name} -o a.gpsz --max-error 5m --effort 1 --json")
    assert compressed.code == 0, compressed.err
    assert (compressed.json["points"], compressed.json["points_lost"]) == (100, 0)

    # Positions at the times of the log.
    (tmp_path / "times.txt").write_text("".join(f"{time.timestamp()}\n" for time in TIMES))
    sampled = gpszip("decompress a.gpsz -o samples.csv --at times.txt")
    assert sampled.code == 0, sampled.err
    rows = list(csv.DictReader((tmp_path / "samples.csv").read_text().splitlines()))
    assert len(rows) == 100
    for row, (time, lat, lon) in zip(rows, ROWS, strict=True):
        assert float(row["t"]) == pytest.approx(time.timestamp(), abs=1e-3)
        # 5 m, and what rounding to thousandths of minutes and microdegrees adds.
        north, east = (float(row["lat"]) - lat) * 111_200, (float(row["lon"]) - lon) * 74_500
        assert (north**2 + east**2) ** 0.5 < 6.2


def test_poses_of_a_robot_come_back(gpszip, tmp_path):
    scans = [f"FLASER 1 0.5 {i % 20} {i / 5} 0 0 0 0 {1e9 + i} host {i}" for i in range(100)]
    (tmp_path / "robot.log").write_text("\n".join(scans))
    compressed = gpszip("compress robot.log -o a.gpsz --max-error 0.1m --effort 1 --json")
    assert compressed.code == 0, compressed.err
    assert compressed.json["points"] == 100
    assert gpszip("decompress a.gpsz -o a.csv").code == 0
    assert len((tmp_path / "a.csv").read_text().splitlines()) > 2


def test_formats_lists_them(gpszip):
    listed = gpszip("formats").out
    assert "gpszip[hdf5]" in listed
    names = "owntracks igc plt readsb ais sumo carmen npz hdf5 ulog dataflash tlog"
    assert all(f"\n  {name} " in listed for name in names.split())


@pytest.mark.parametrize("name", LOGS)
def test_a_log_on_disk_is_the_one_in_memory(tmp_path, name):
    (tmp_path / name).write_bytes(LOGS[name]())
    (expected,) = read_logs(str(tmp_path / name)).tracks
    with store_logs(str(tmp_path / name), rows=30) as log:
        (track,) = (log.read(track) for track in log.tracks)
    assert track.id == expected.id
    assert track.times.tolist() == expected.times.tolist()
    np.testing.assert_allclose(track.positions, expected.positions, rtol=0, atol=1e-6)
