"""Merge archives of parts of generated logs, and compare with compressing all logs at once.

    python benchmarks/merging.py [LOG...]

The logs are taxis, buses, robots and tiny; all by default. A row gives the bytes of the archives
together (apart), of the merged archive, and of one archive of all logs at the RMSE of the merged
one (at once); then their ratio, the RMSE and the CPU seconds of merging. The last columns say by
how much sizes change if the archives are merged in another order, and if they are merged one
after the other (fold), with the RMSE of the latter.
"""

import math
import sys
import time
from functools import reduce

import numpy as np

from gpszip.archive import Archive
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol
from gpszip.testing.city import drives

#: Widths of the columns by their heads.
WIDTHS = {
    "log": 10,
    "count": 5,
    "apart": 7,
    "merged": 7,
    "at once": 7,
    "ratio": 6,
    "RMSE": 7,
    "CPU": 6,
    "order": 6,
    "fold": 6,
    "its RMSE": 8,
}


def main() -> None:
    print(" ".join(f"{head:>{width}}" for head, width in WIDTHS.items()))
    for name in sys.argv[1:] or LOGS:
        tracks, bound = LOGS[name]()
        for count in (2, 4, 8):
            print_row(name, tracks, bound, count)


def print_row(name: str, tracks: list[Track], bound: float, count: int) -> None:
    """Compress a log as several archives, merge them, and print the results."""
    groups = [tracks[i::count] for i in range(count)]
    archives = [compress(group, Options(rmse=bound))[0] for group in groups]
    size_apart = sum(len(archive.to_bytes()) for archive in archives)

    start = time.process_time()
    merged, _ = merge(archives)
    seconds = time.process_time() - start
    error = rmse(merged, tracks)
    size = len(merged.to_bytes())
    size_at_once = len(compress(tracks, Options(rmse=error))[0].to_bytes())

    # Another order, and one after the other.
    order = np.random.default_rng(1).permutation(count)
    reordered, _ = merge([archives[i] for i in order])
    folded = reduce(lambda first, second: merge([first, second])[0], archives)
    change_by_order = len(reordered.to_bytes()) / size - 1
    change_by_fold = len(folded.to_bytes()) / size - 1

    cells = (
        name,
        f"{count}",
        f"{size_apart:,}",
        f"{size:,}",
        f"{size_at_once:,}",
        f"{size / size_at_once:.3f}",
        f"{error:.3f}",
        f"{seconds:.1f}",
        f"{change_by_order:+.1%}",
        f"{change_by_fold:+.1%}",
        f"{rmse(folded, tracks):.3f}",
    )
    columns = zip(cells, WIDTHS.values(), strict=True)
    print(" ".join(f"{cell:>{width}}" for cell, width in columns), flush=True)


def rmse(archive: Archive, tracks: list[Track]) -> float:
    squares = [
        ((archive.position(track.id, track.times, metres=True) - track.positions) ** 2).sum(axis=1)
        for track in tracks
    ]
    return math.sqrt(np.concatenate(squares).mean())


def split_patrol(points: int, count: int) -> list[Track]:
    """Return a patrol as consecutive tracks."""
    track = patrol(points, seed=4)
    ranges = np.array_split(np.arange(len(track)), count)
    return [
        Track(f"{i}", track.times[rows], track.positions[rows]) for i, rows in enumerate(ranges)
    ]


def drive_town(vehicles: int, *, period: float, duration: float) -> list[Track]:
    """Return the tracks of vehicles in a town."""
    log = drives(8, vehicles=vehicles, period=period, duration=duration, seed=3)
    return [Track(f"{i}", *drive) for i, drive in enumerate(log.values())]


#: For each log its tracks, and the RMSE in metres at which they are compressed.
LOGS = {
    "taxis": lambda: (drive_town(16, period=15.0, duration=3600.0), 8.0),
    "buses": lambda: (drive_town(8, period=1.0, duration=1200.0), 8.0),
    "robots": lambda: (split_patrol(40_000, 16), 0.24),
    "tiny": lambda: (split_patrol(4000, 8), 0.5),
}


if __name__ == "__main__":
    main()
