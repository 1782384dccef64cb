"""Measure how fast logs are read and positions are computed, in CPU seconds.

    python benchmarks/reading.py [TRACKS]

Logs of a million points are written in each notation and read in this process, all imports done:
parsing, cleaning, joining, sorting, projecting. Positions are those of a million times along one
track. Last come logs of many tracks of 20 points each (100,000 by default), and an archive of as
many walks, which is coded without learning a map. Each figure is the best of several runs, user
and system time. The last line is the peak of the process.
"""

import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pyarrow import csv

import gpszip
from gpszip.archive import new_archive
from gpszip.codec.numbering import number_by_visit
from gpszip.io.logs.read import read_logs
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track
from gpszip.testing import patrol

#: Points of a log.
POINTS = 1_000_000

#: Runs of which the fastest counts.
RUNS = 5

#: Points of a short track.
SHORT = 20

#: Streets of the town on either side, and metres between two crossings.
STREETS = 25
BLOCK = 150


def main() -> None:
    tracks = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        print("reading a million points")
        measure_reading()
        print("\na million positions of one track")
        measure_positions()
        print(f"\n{tracks:,} tracks of {SHORT} points")
        measure_many_tracks(tracks)
        os.chdir("/")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak {peak:.0f} MiB")


def measure_reading() -> None:
    """Read logs of all notations."""
    for name, sources in write_logs().items():
        seconds = cpu_seconds(lambda sources=sources: read_logs(sources))
        print(f"  {name:<36} {seconds:.3f} s")


def write_logs() -> dict[str, list[str]]:
    """Write the log of a robot in several notations; return their files."""
    # In metres, and in degrees with dates.
    robot = patrol(POINTS)
    x, y = robot.positions.round(3).T
    metres = {"t": robot.times.round(3), "x": x, "y": y}
    degrees = {"lat": np.round(48 + y / 111_000, 7), "lon": np.round(11 + x / 75_000, 7)}
    stamps = pa.array((robot.times * 1000).astype(np.int64) + 1_700_000_000_000)
    dates = pc.strftime(stamps.cast(pa.timestamp("ms")), format="%Y-%m-%dT%H:%M:%SZ")
    names = np.char.add("robot-", (np.arange(POINTS) // 1000).astype(str))

    # Tables.
    write_csv("plain.csv", metres)
    write_csv("ids.csv", {"track_id": names, **metres})
    write_csv("degrees.csv", {"t": metres["t"], **degrees})
    write_csv("dates.csv", {"time": dates, **degrees})
    pq.write_table(pa.table(metres), "plain.parquet")
    pq.write_table(pa.table({"t": metres["t"], **degrees}), "degrees.parquet")

    # Many files.
    parts = [slice(first, first + 10_000) for first in range(0, POINTS, 10_000)]
    for number, rows in enumerate(parts):
        write_csv(f"part-{number:03}.csv", {name: cells[rows] for name, cells in metres.items()})
    walks = [write_gpx(number, degrees, stamps) for number in range(50)]
    return {
        "CSV t,x,y": ["plain.csv"],
        "CSV with the names of 1,000 tracks": ["ids.csv"],
        "CSV t,lat,lon": ["degrees.csv"],
        "CSV with ISO dates, lat,lon": ["dates.csv"],
        "100 CSV files": [f"part-{number:03}.csv" for number in range(len(parts))],
        "Parquet t,x,y": ["plain.parquet"],
        "Parquet t,lat,lon": ["degrees.parquet"],
        "50 GPX files of 500 points": walks,
    }


def write_csv(path: str, columns: dict[str, object]) -> None:
    csv.write_csv(pa.table(columns), path, csv.WriteOptions(quoting_style="none"))


def write_gpx(number: int, degrees: dict[str, np.ndarray], stamps: pa.Array) -> str:
    """Write 500 points as GPX; return the file's name."""
    rows = slice(500 * number, 500 * (number + 1))
    dates = pc.strftime(stamps[rows].cast(pa.timestamp("ms")), format="%Y-%m-%dT%H:%M:%SZ")
    points = "".join(
        f'<trkpt lat="{lat}" lon="{lon}"><ele>400</ele><time>{date}</time></trkpt>\n'
        for lat, lon, date in zip(
            degrees["lat"][rows], degrees["lon"][rows], dates.to_pylist(), strict=True
        )
    )
    path = f"walk-{number:03}.gpx"
    Path(path).write_text(
        '<gpx version="1.1" creator="b" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><name>walk {number}</name><trkseg>{points}</trkseg></trk></gpx>"
    )
    return path


def measure_positions() -> None:
    """Ask two archives, in metres and in degrees, for positions in order and in any order."""
    robot = patrol(20_000)
    x, y = robot.positions.T
    write_csv("robot.csv", {"t": robot.times, "lat": 48 + y / 111_000, "lon": 11 + x / 75_000})
    in_metres = gpszip.compress(robot, rmse=0.2, effort=1)
    in_degrees = gpszip.compress("robot.csv", rmse=0.2, effort=1)

    # Positions in each order of times, and at equal intervals.
    rng = np.random.default_rng(1)
    for name, archive in (("x, y", in_metres), ("lat, lon", in_degrees)):
        view = archive[archive.ids[0]]
        times = np.linspace(view.start, view.end, POINTS)
        for order, asked in (("in order", times), ("in any order", rng.permutation(times))):
            seconds = cpu_seconds(lambda view=view, asked=asked: view.position(asked))
            rate = POINTS / seconds / 1e6
            print(f"  {name + ', ' + order:<36} {seconds:.3f} s, {rate:.0f} million a second")
        every = (view.end - view.start) / POINTS
        seconds = cpu_seconds(lambda view=view, every=every: view.sample(every))
        print(f"  {name + ', sample(every)':<36} {seconds:.3f} s")


def measure_many_tracks(count: int) -> None:
    """Read many short tracks; write, open, ask and decompress an archive of as many walks."""
    # Read.
    walks, ranges = drive(count)
    write_short_tracks(walks)
    for path in ("short.csv", "short.parquet"):
        seconds = cpu_seconds(lambda path=path: read_logs([path]), 2)
        print(f"  {'read ' + path:<36} {seconds:.2f} s")

    # Code the walks, and write them.
    grid, ids = QuantisationGrid((0, 0), 0, 128, 128), [f"trip-{i}" for i in range(count)]
    seconds = cpu_seconds(
        lambda: new_archive(grid, ids, walks, time_ranges=ranges).save("short.gpsz", force=True), 1
    )
    print(f"  {'code and write the walks':<36} {seconds:.2f} s")

    # Open and ask; kernels and modules are loaded by the steps before.
    print(f"  {'open':<36} {cpu_seconds(lambda: gpszip.open('short.gpsz')):.3f} s")
    seconds = cpu_seconds(lambda: gpszip.open("short.gpsz")["trip-77"].position(5.0))
    print(f"  {'open, and ask one track':<36} {seconds:.3f} s")
    seconds = cpu_seconds(lambda: gpszip.open("short.gpsz").decompress(), 2)
    print(f"  {'decompress all':<36} {seconds:.2f} s")


def drive(count: int) -> tuple[GridWalks, list[np.ndarray]]:
    """Walks along five crossings of a town, and the time range of each."""
    rng = np.random.default_rng(1)
    crossings = np.array([[x, y] for x in range(STREETS) for y in range(STREETS)])
    walks, ranges = [], []
    for start in rng.integers(2, STREETS - 2, (count, 2)):
        # Two blocks along one street, and two along another.
        first, second = np.eye(2, dtype=int)[rng.permutation(2)] * rng.choice([-1, 1], (2, 1))
        places = np.cumsum([start, first, first, second, second], axis=0)

        # Each block takes the same time.
        times = np.int64(rng.integers(0, 1_000_000)) + 40 * np.arange(5)
        nodes = (places[:, 0] * STREETS + places[:, 1]).astype(np.int32)
        walks.append(GridWalk(nodes, times, np.zeros(4, np.bool_)))
        ranges.append(np.array([[times[0], times[-1]]], np.float64))
    return number_by_visit(GridWalks(crossings * BLOCK, tuple(walks))), ranges


def write_short_tracks(walks: GridWalks) -> None:
    """Write the samples of walks as CSV and as Parquet."""
    samples = []
    for number, walk in enumerate(walks.walks):
        begin, end = walk.time_steps[[0, -1]].tolist()
        times = np.linspace(begin, end, SHORT)
        at = [np.interp(times, walk.time_steps, axis) for axis in walks.nodes[walk.nodes].T]
        samples.append(Track(f"trip-{number}", times, np.column_stack(at)))
    names = pa.array([track.id for track in samples])
    positions = np.concatenate([track.positions for track in samples])
    positions = (positions + np.random.default_rng(2).normal(0, 2, positions.shape)).round(2)
    columns = {
        "track_id": names.take(pa.array(np.repeat(np.arange(len(samples)), SHORT))),
        "t": np.concatenate([track.times for track in samples]).round(3),
        "x": positions[:, 0],
        "y": positions[:, 1],
    }
    write_csv("short.csv", columns)
    pq.write_table(pa.table(columns), "short.parquet")


def cpu_seconds(action: Callable[[], object], runs: int = RUNS) -> float:
    """Least CPU seconds of several runs."""
    seconds = []
    for _ in range(runs):
        start = time.process_time()
        action()
        seconds.append(time.process_time() - start)
    return min(seconds)


if __name__ == "__main__":
    main()
