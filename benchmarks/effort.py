"""Bytes and seconds at each effort, on a generated robot patrol and a generated town's traffic."""

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
    efforts = [int(word) for word in sys.argv[1:]] or range(1, 10)
    warm()
    for name, (tracks, rmse) in logs.items():
        for effort in efforts:
            start = time.perf_counter()
            _, report = compress(tracks, Options(rmse=rmse, effort=effort))
            print(
                f"{name}: effort {effort}: {report.bytes_out} B, {time.perf_counter() - start:.1f} s, RMSE {report.rmse:.3f} m"
            )


if __name__ == "__main__":
    main()
