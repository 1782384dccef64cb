"""NMEA, FIT and location histories, from the file to an archive and back."""

import csv
from datetime import UTC, datetime, timedelta

import pytest

from oracle import fit, google, nmea

START = datetime(2024, 5, 4, 23, 58, tzinfo=UTC)
ROWS = [(START + timedelta(minutes=i), 48 + i % 20 / 1e3, 11.5 + i / 1e4, 0) for i in range(100)]


def nmea_log():
    lines = [line for time, *at, _ in ROWS for line in (nmea.gga(time, *at), nmea.rmc(time, *at))]
    return "\r\n".join(lines).encode()


def fit_log():
    records = [fit.record(round(time.timestamp()), *at) for time, *at, _ in ROWS]
    return fit.fit(fit.file_id(), *records)


LOGS = {
    "log.nmea": nmea_log,
    "ride.fit": fit_log,
    "Records.json": lambda: google.encode(google.records(ROWS)),
    "location-history.json": lambda: google.encode(google.ios(ROWS)),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_comes_back_within_its_bound(gpszip, tmp_path, name):
    if name.endswith(".fit"):
        pytest.importorskip("fitdecode")
    (tmp_path / name).write_bytes(LOGS[name]())
    compressed = gpszip(f"compress {name} -o a.gpsz --max-error 5m --effort 1 --json")
    assert compressed.code == 0, compressed.err
    summary = compressed.json
    assert (summary["points"], summary["points_lost"]) == (100, 0)

    # Positions at the times of the log.
    (tmp_path / "times.txt").write_text("".join(f"{row[0].timestamp()}\n" for row in ROWS))
    sampled = gpszip("decompress a.gpsz -o samples.csv --at times.txt")
    assert sampled.code == 0, sampled.err
    rows = list(csv.DictReader((tmp_path / "samples.csv").read_text().splitlines()))
    assert len(rows) == 100
    for row, (time, lat, lon, _) in zip(rows, ROWS, strict=True):
        assert float(row["t"]) == pytest.approx(time.timestamp(), abs=1e-3)
        # 5 m, and what rounding to minutes of degrees and microdegrees adds.
        north, east = (float(row["lat"]) - lat) * 111_200, (float(row["lon"]) - lon) * 74_500
        assert (north**2 + east**2) ** 0.5 < 5.2


def test_a_history_with_positions_and_paths_says_what_it_leaves_out(gpszip, tmp_path):
    history = google.encode(google.android(ROWS, ROWS[:50]))
    (tmp_path / "Timeline.json").write_bytes(history)
    run = gpszip("compress Timeline.json -o a.gpsz --max-error 5m --effort 1")
    assert run.code == 3
    assert "left out Timeline.json: 100 points of paths" in run.err
    run = gpszip("compress Timeline.json -o b.gpsz --max-error 5m --effort 1 --format google-paths")
    assert run.code == 3
    assert "left out Timeline.json: 50 positions of devices" in run.err


def test_formats_lists_them(gpszip):
    listed = gpszip("formats").out
    assert "gpszip[fit]" in next(line for line in listed.splitlines() if " fit " in line)
    assert all(f"\n  {name} " in listed for name in ("google", "google-paths", "fit", "nmea"))
