"""Measure archive size, time and RMSE at each effort, on a robot patrol and a town's traffic.

    python benchmarks/effort.py [EFFORT...]

Both logs are generated. Without arguments all efforts from 1 to 9 are measured.
"""

import sys
import time

from gpszip import testing
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.warm import warm
from gpszip.testing.city import drives


def main() -> None:
    town = [Track(name, *drive) for name, drive in drives(vehicles=20, period=5.0).items()]
    logs = {"patrol, 0.24 m": ([testing.patrol()], 0.24), "town, 5 m": (town, 5.0)}
    efforts = [int(argument) for argument in sys.argv[1:]] or range(1, 10)
    warm()

    for name, (tracks, rmse) in logs.items():
        for effort in efforts:
            start = time.perf_counter()
            _, report = compress(tracks, Options(rmse=rmse, effort=effort))
            seconds = time.perf_counter() - start
            print(
                f"{name}: effort {effort}: {report.bytes_out} B, {seconds:.1f} s, "
                f"RMSE {report.rmse:.3f} m"
            )


if __name__ == "__main__":
    main()
