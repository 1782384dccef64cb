"""Print how many points of a dense log are compressed in one CPU second, from CSV and Parquet.

    python benchmarks/throughput.py FOLDER POINTS... [--memory MEMORY]

The log is a patrol (`gpszip.testing.patrol`) at 13 Hz, with a maximum error of 50 cm and at effort
1. CPU seconds are those of the whole command, with its start, and behind them without it: the
start is what the command takes for a log of 1,000 points.
"""

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from gpszip.testing import patrol

#: Points of the log that shows what a start takes.
FEW_POINTS = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("points", type=int, nargs="+")
    parser.add_argument("--memory", default=None, help="for example 1GiB; all in memory without it")
    arguments = parser.parse_args()
    subprocess.run([sys.executable, "-m", "gpszip", "warm"], capture_output=True, check=True)
    start, _ = compress(write_log(arguments.folder, FEW_POINTS, "parquet"), None)
    for points in arguments.points:
        for suffix in ("csv", "parquet"):
            log = write_log(arguments.folder, points, suffix)
            seconds, report = compress(log, arguments.memory)
            print(
                f"{points:>11,} points from {suffix:7}: {seconds:6.1f} CPU s, "
                f"{points / seconds:9,.0f} points/s, "
                f"{points / max(seconds - start, 1e-3):9,.0f} without the start, "
                f"{report['bytes_out']:,} B",
                flush=True,
            )


def write_log(folder: Path, points: int, suffix: str) -> Path:
    """Write the log of a patrol, unless it is there."""
    path = folder / f"patrol-{points}.{suffix}"
    if path.exists():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    track = patrol(points)
    columns = np.column_stack([track.times, track.positions]).round(3).T
    table = pa.table(dict(zip("txy", columns, strict=True)))
    if suffix == "csv":
        pyarrow.csv.write_csv(table, path)
    else:
        pq.write_table(table, path)
    return path


def compress(log: Path, memory: str | None) -> tuple[float, dict]:
    """Compress a log in a process of its own; return its CPU seconds and its report."""
    options = ["--max-error", "50cm", "--effort", "1", "--force", "--json"]
    if memory is not None:
        options += ["--memory", memory]
    before = cpu_seconds()
    process = subprocess.run(
        [sys.executable, "-m", "gpszip", "compress", log, "-o", log.with_suffix(".gpsz"), *options],
        capture_output=True,
        text=True,
        check=True,
    )
    return cpu_seconds() - before, json.loads(process.stdout)


def cpu_seconds() -> float:
    """CPU seconds of all processes that were waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
