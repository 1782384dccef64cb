"""Compress generated fleets of any size within a given memory, and print peak and time of each.

    python benchmarks/large.py FOLDER MEMORY POINTS...

Robots drive along the streets of one town, sampled at 10 Hz with a noise of 2 m. Each has a
million samples, or all where there are fewer. A file holds some hours of several vehicles, so that
tracks are interleaved and spread over files. Each fleet is compressed in a process of its own.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

#: Blocks along each side of the town.
BLOCKS = 24

#: Metres between two crossings.
BLOCK = 150.0

#: Metres per second.
SPEED = 10.0

#: Standard deviation of a position in metres.
NOISE = 2.0

#: Samples per second.
RATE = 10.0

#: Samples of a vehicle.
SAMPLES = 1_000_000

#: Vehicles that share files.
VEHICLES_PER_FILE = 10

#: Samples of each vehicle in a file.
SAMPLES_PER_FILE = 100_000

#: Runs the command in a process of its own, which prints its peak in MiB and its CPU seconds. The
#: peak that getrusage reports begins with that of the process that started this one.
SCRIPT = """
import resource, sys
from gpszip.cli.main import main
code = main(sys.argv[1:])
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
usage = resource.getrusage(resource.RUSAGE_SELF)
print(int(peak) / 1024, usage.ru_utime + usage.ru_stime, file=sys.stderr)
sys.exit(code)
"""


def main() -> None:
    folder, memory, *sizes = sys.argv[1:]
    subprocess.run(["gpszip", "warm"], capture_output=True, check=True)
    previous = None
    for points in map(int, sizes):
        logs = Path(folder) / f"{points}"
        if not logs.exists():
            generate(logs, points)
        report, peak, seconds = compress(logs, Path(folder) / f"{points}.gpsz", memory)

        # The power of the number of points with which time grows.
        exponent = math.nan
        if previous is not None and previous[0] < points:
            exponent = math.log(seconds / previous[1]) / math.log(points / previous[0])
        previous = points, seconds
        print(
            f"{points:>11,} points: {report['seconds']:.0f} s, CPU {seconds:.0f} s "
            f"(exponent {exponent:.2f}), peak {peak:.0f} MiB, "
            f"{report['bytes_in']:,} -> {report['bytes_out']:,} B, "
            f"RMSE {report['rmse']:.3f} m, {report['nodes']} nodes",
            flush=True,
        )


def compress(logs: Path, target: Path, memory: str) -> tuple[dict, float, float]:
    """Compress logs; return the report, the peak in MiB and the CPU seconds."""
    options = f"--force --rmse 5m --effort 1 --memory {memory} --json"
    command = ["compress", str(logs), "-o", str(target), *options.split()]
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, *command], capture_output=True, text=True, check=True
    )
    peak, seconds = map(float, process.stderr.split()[-2:])
    return json.loads(process.stdout), peak, seconds


def generate(folder: Path, points: int) -> None:
    """Write the drives of a fleet in files."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(7)
    count = max(1, points // SAMPLES)
    samples = points // count
    for first in range(0, count, VEHICLES_PER_FILE):
        vehicles = range(first, min(first + VEHICLES_PER_FILE, count))
        courses = {vehicle: generate_course(samples, rng) for vehicle in vehicles}
        for start in range(0, samples, SAMPLES_PER_FILE):
            times = np.arange(start, min(start + SAMPLES_PER_FILE, samples)) / RATE
            tables = [
                sample_course(f"bus-{vehicle}", times, *courses[vehicle], rng)
                for vehicle in vehicles
            ]
            table = pa.concat_tables(tables).combine_chunks().sort_by("t")
            pq.write_table(table, folder / f"{first:04}-{start:09}.parquet")


def generate_course(samples: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a drive between random crossings, and the distance driven to each.

    From each crossing to the next, a vehicle drives along one street and then along another.
    """
    length = samples * SPEED / RATE / BLOCK
    crossings = rng.integers(0, BLOCKS + 1, (int(length / (0.6 * BLOCKS)) + 4, 2)).astype(float)
    corners = np.empty((2 * len(crossings) - 1, 2))
    corners[::2] = crossings
    corners[1::2] = np.column_stack([crossings[1:, 0], crossings[:-1, 1]])
    corners *= BLOCK
    distances = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    return corners, np.r_[0, np.cumsum(distances)]


def sample_course(
    name: str,
    times: np.ndarray,
    corners: np.ndarray,
    distances: np.ndarray,
    rng: np.random.Generator,
) -> pa.Table:
    """Return noisy samples of a drive at constant speed."""
    axes = [np.interp(times * SPEED, distances, corners[:, axis]) for axis in (0, 1)]
    positions = np.column_stack(axes)
    positions += rng.normal(0, NOISE, positions.shape)
    names = pa.DictionaryArray.from_arrays(np.zeros(len(times), np.int32), [name])
    x, y = positions.T.round(2)
    return pa.table({"track_id": names, "t": times, "x": x, "y": y})


if __name__ == "__main__":
    main()
