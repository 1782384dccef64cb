"""Measure archive size, CPU time and RMSE at each effort, on a patrol, a town and a sparse fleet.

    python benchmarks/effort.py [EFFORT...]

The logs are generated. Without arguments all efforts from 1 to 9 are measured.
"""

import sys
import time

from gpszip import testing
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.warm import warm
from gpszip.testing.city import drives


def main() -> None:
    town, fleet = (
        [Track(name, *drive) for name, drive in drives(vehicles=20, period=period).items()]
        for period in (5.0, 30.0)
    )
    logs = {
        "patrol, 0.24 m": ([testing.patrol()], 0.24),
        "town, 5 m": (town, 5.0),
        "fleet, 20 m": (fleet, 20.0),
    }
    efforts = [int(argument) for argument in sys.argv[1:]] or range(1, 10)
    warm()

    for name, (tracks, rmse) in logs.items():
        for effort in efforts:
            start = time.process_time()
            _, report = compress(tracks, Options(rmse=rmse, effort=effort))
            seconds = time.process_time() - start
            print(
                f"{name}: effort {effort}: {report.bytes_out} B, {seconds:.1f} s of CPU, "
                f"RMSE {report.rmse:.3f} m"
            )


if __name__ == "__main__":
    main()
