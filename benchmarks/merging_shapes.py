"""Merge archives of generated logs in trees of different shapes, and compare sizes and errors.

    python benchmarks/merging_shapes.py [LOG...]

The shapes are all at once, two by two, and one after the other, with the default deviation. A row
gives, for each shape, the bytes, the RMSE against the logs and the error bound; then by how much
the largest archive exceeds the smallest.
"""

import math
import sys
from functools import reduce

import numpy as np

from gpszip.archive import Archive
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol
from gpszip.testing.city import drives


def main() -> None:
    for name in sys.argv[1:] or LOGS:
        tracks, bound, count = LOGS[name]()
        groups = [tracks[i::count] for i in range(count)]
        archives = [compress(group, Options(rmse=bound, effort=1))[0] for group in groups]

        merged = [merge(archives)[0], merge_by_pairs(archives), reduce(merge_two, archives)]
        sizes = [len(archive.to_bytes()) for archive in merged]
        shapes = "   ".join(
            f"{size:>5} {rmse(archive, tracks):>6.3g} {archive.error_bound.metres:>6.3g}"
            for size, archive in zip(sizes, merged, strict=True)
        )
        excess = max(sizes) / min(sizes) - 1
        print(f"{name:>8} {count}  {shapes}  {excess:>6.1%}", flush=True)


def merge_two(first: Archive, second: Archive) -> Archive:
    return merge([first, second])[0]


def merge_by_pairs(archives: list[Archive]) -> Archive:
    """Merge neighbours two by two until one archive is left."""
    while len(archives) > 1:
        archives = [reduce(merge_two, archives[i : i + 2]) for i in range(0, len(archives), 2)]
    return archives[0]


def rmse(archive: Archive, tracks: list[Track]) -> float:
    squares = [
        ((archive.position(track.id, track.times, metres=True) - track.positions) ** 2).sum(axis=1)
        for track in tracks
    ]
    return math.sqrt(np.concatenate(squares).mean())


def split_patrol(points: int, count: int, seed: int) -> list[Track]:
    """Return a patrol as consecutive tracks."""
    track = patrol(points, seed=seed)
    ranges = np.array_split(np.arange(len(track)), count)
    return [
        Track(f"{i}", track.times[rows], track.positions[rows]) for i, rows in enumerate(ranges)
    ]


def drive_town(vehicles: int, period: float, duration: float, seed: int) -> list[Track]:
    """Return the tracks of vehicles in a town."""
    log = drives(6, vehicles=vehicles, period=period, duration=duration, seed=seed)
    return [Track(f"bus {i}", *drive) for i, drive in enumerate(log.values())]


#: For each log its tracks, the RMSE in metres at which they are compressed, and the number of
#: archives.
LOGS = {
    "tiny 3": lambda: (split_patrol(2400, 3, 4), 0.5, 3),
    "tiny 4": lambda: (split_patrol(4000, 8, 7), 0.5, 4),
    "tiny 8": lambda: (split_patrol(4000, 8, 4), 0.5, 8),
    "tiny 8b": lambda: (split_patrol(4000, 8, 9), 0.5, 8),
    "robots 4": lambda: (split_patrol(16_000, 8, 5), 0.24, 4),
    "buses 3": lambda: (drive_town(6, 1.0, 600.0, 5), 8.0, 3),
    "buses 8": lambda: (drive_town(8, 2.0, 600.0, 8), 8.0, 8),
    "taxis 3": lambda: (drive_town(6, 15.0, 900.0, 3), 5.0, 3),
    "taxis 3b": lambda: (drive_town(6, 15.0, 900.0, 11), 5.0, 3),
    "taxis 4": lambda: (drive_town(8, 15.0, 900.0, 21), 8.0, 4),
}


if __name__ == "__main__":
    main()
