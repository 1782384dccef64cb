"""Measure the CPU seconds of small commands, from the start of the process to its end.

    python benchmarks/startup.py

Each figure is the median of five runs, user and system time of the whole process, with all kernels
and Python's bytecode compiled by a run before, as in an installed package; also where
PYTHONDONTWRITEBYTECODE is set. The logs are generated: a robot's 100 points, and a town's drives
for an archive of some kilobytes.
"""

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from gpszip import Track, compress
from gpszip.io.logs.write import write_tracks
from gpszip.testing import patrol
from gpszip.testing.city import drives

RUNS = 5

GPSZIP = [sys.executable, "-m", "gpszip"]

ASK = "import gpszip; archive = gpszip.open('{}'); archive.position(archive.ids[0], 100.0)"

COMMANDS = {
    "import numpy": [sys.executable, "-c", "import numpy"],
    "--version": [*GPSZIP, "--version"],
    "--help": [*GPSZIP, "--help"],
    "match --help": [*GPSZIP, "match", "--help"],
    "info small": [*GPSZIP, "info", "small.gpsz"],
    "verify small": [*GPSZIP, "verify", "small.gpsz"],
    "decompress small": [*GPSZIP, "decompress", "small.gpsz", "-o", "-"],
    "map --raw small": [*GPSZIP, "map", "--raw", "small.gpsz", "-o", "-"],
    "position in Python": [sys.executable, "-c", ASK.format("small.gpsz")],
    "decompress town": [*GPSZIP, "decompress", "town.gpsz", "-o", "-"],
    "compress 100 points": [*GPSZIP, "compress", "--force", "small.csv", "-o", "new.gpsz"],
}


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = folder
        write_logs()
        for name, command in COMMANDS.items():
            measure(command)
            seconds = statistics.median(measure(command) for _ in range(RUNS))
            print(f"{name:<20} {seconds:.2f} s")
        os.chdir("/")


def write_logs() -> None:
    """Write a log of 100 points, and archives of it and of a town's drives."""
    robot = patrol(1000)
    robot = Track(robot.id, robot.times[:100], robot.positions[:100])
    write_tracks([robot], "small.csv")
    compress(robot).save("small.gpsz")
    town = [Track(name, *drive) for name, drive in drives(vehicles=20, period=5.0).items()]
    compress(town, rmse=5.0, effort=1).save("town.gpsz")
    for name in ("small.csv", "small.gpsz", "town.gpsz"):
        print(f"{name:<20} {Path(name).stat().st_size:,} bytes")


def measure(command: list[str]) -> float:
    """CPU seconds of a command, user and system."""
    before = os.times()
    subprocess.run(command, check=True, capture_output=True)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


if __name__ == "__main__":
    main()
