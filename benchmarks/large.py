"""Compress generated fleets of any size within a given memory, each in a process of its own, and tell its peak and time.

    python benchmarks/large.py FOLDER MEMORY POINTS...

Robots drive the streets of one town, sampled at 10 Hz with an error of 2 m; each has a million samples, or as many as there are. Files hold
the hours of several vehicles, so that tracks are interleaved and spread over files.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

BLOCKS, BLOCK, SPEED, NOISE, RATE = 24, 150.0, 10.0, 2.0, 10.0
FLEET, HOURS = 10, 100_000  # vehicles that share files, and samples of each in one

#: The command as a process of its own, which at last tells its peak in MiB and its CPU seconds. What getrusage says of a peak begins with
#: that of the process that started this one.
MEASURED = """
import resource, sys
from gpszip.cli.main import main
code = main(sys.argv[1:])
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
used = resource.getrusage(resource.RUSAGE_SELF)
print(int(peak) / 1024, used.ru_utime + used.ru_stime, file=sys.stderr)
sys.exit(code)
"""


def main() -> None:
    folder, memory, *sizes = sys.argv[1:]
    subprocess.run(["gpszip", "warm"], capture_output=True, check=True)
    before = None
    for points in map(int, sizes):
        logs = Path(folder) / f"{points}"
        if not logs.exists():
            generate(logs, points)
        out = Path(folder) / f"{points}.gpsz"
        command = f"compress {logs} -o {out} --force --rmse 5m --effort 1 --memory {memory} --json".split()
        done = subprocess.run(
            [sys.executable, "-c", MEASURED, *command], capture_output=True, text=True, check=True
        )
        report, (peak, spent) = json.loads(done.stdout), map(float, done.stderr.split()[-2:])
        slope = (
            math.log(spent / before[1]) / math.log(points / before[0])
            if before and before[0] < points
            else math.nan
        )
        before = points, spent
        print(
            f"{points:>11,} points: {report['seconds']:.0f} s, CPU {spent:.0f} s (exponent {slope:.2f}), peak {peak:.0f} MiB, "
            f"{report['bytes_in']:,} -> {report['bytes_out']:,} B, RMSE {report['rmse']:.3f} m, {report['nodes']} nodes",
            flush=True,
        )


def generate(folder: Path, points: int) -> None:
    """Write the drives of a fleet, files of some vehicles' hours in turn."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(7)
    vehicles = max(1, points // 1_000_000)
    each = points // vehicles
    for first in range(0, vehicles, FLEET):
        fleet = range(first, min(first + FLEET, vehicles))
        ways = {vehicle: drive(each, rng) for vehicle in fleet}
        for start in range(0, each, HOURS):
            tables = []
            for vehicle in fleet:
                times = np.arange(start, min(start + HOURS, each)) / RATE
                corners, along = ways[vehicle]
                places = np.column_stack(
                    [np.interp(times * SPEED, along, corners[:, axis]) for axis in (0, 1)]
                )
                places += rng.normal(0, NOISE, places.shape)
                names = pa.DictionaryArray.from_arrays(
                    np.zeros(len(times), np.int32), [f"bus-{vehicle}"]
                )
                tables.append(
                    pa.table(
                        {
                            "track_id": names,
                            "t": times,
                            "x": places[:, 0].round(2),
                            "y": places[:, 1].round(2),
                        }
                    )
                )
            mixed = pa.concat_tables(tables).combine_chunks().sort_by("t")
            pq.write_table(mixed, folder / f"{first:04}-{start:09}.parquet")


def drive(samples: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a drive from one random crossing to another, along one street and then another, and the way to each."""
    needed = samples * SPEED / RATE / BLOCK
    goals = rng.integers(0, BLOCKS + 1, (int(needed / (0.6 * BLOCKS)) + 4, 2)).astype(float)
    corners = np.empty((2 * len(goals) - 1, 2))
    corners[::2] = goals
    corners[1::2] = np.column_stack([goals[1:, 0], goals[:-1, 1]])
    corners *= BLOCK
    return corners, np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]


if __name__ == "__main__":
    main()
