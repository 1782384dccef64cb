"""Merge archives of generated logs in trees of different shapes, with the default deviation, and compare sizes and errors.

    python benchmarks/merging_shapes.py [LOG...]

For each shape bytes, RMSE against the logs and the error promised: all at once, two by two, and one after the other.
"""

import math
import sys
from functools import reduce

import numpy as np

from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol
from gpszip.testing.city import drives


def main() -> None:
    for name in sys.argv[1:] or LOGS:
        tracks, bound, parts = LOGS[name]()
        archives = [
            compress(tracks[i::parts], Options(rmse=bound, effort=1))[0] for i in range(parts)
        ]
        made = [merge(archives)[0], paired(archives), reduce(united, archives)]
        sizes = [len(one.to_bytes()) for one in made]
        shapes = (
            f"{size:>5} {rmse(one, tracks):>6.3g} {one.error_bound.metres:>6.3g}"
            for size, one in zip(sizes, made, strict=True)
        )
        print(
            f"{name:>8} {parts}  " + "   ".join(shapes) + f"  {max(sizes) / min(sizes) - 1:>6.1%}",
            flush=True,
        )


def united(one, other):
    return merge([one, other])[0]


def paired(archives):
    while len(archives) > 1:
        archives = [reduce(united, archives[i : i + 2]) for i in range(0, len(archives), 2)]
    return archives[0]


def rmse(archive, tracks) -> float:
    squares = [
        ((archive.position(track.id, track.times, metres=True) - track.positions) ** 2).sum(axis=1)
        for track in tracks
    ]
    return math.sqrt(np.concatenate(squares).mean())


def rounds(points, runs, seed):
    whole = patrol(points, seed=seed)
    cuts = np.array_split(np.arange(len(whole)), runs)
    return [Track(f"{i}", whole.times[rows], whole.positions[rows]) for i, rows in enumerate(cuts)]


def driven(vehicles, period, duration, seed):
    logs = drives(
        6,
        vehicles=vehicles,
        period=period,
        duration=duration,
        seed=seed,
        noise=4.0,
        block=120.0,
        speed=9.0,
    )
    return [
        Track(f"bus {i}", *one)
        for i, one in enumerate(logs.values() if isinstance(logs, dict) else logs)
    ]


LOGS = {
    "tiny 3": lambda: (rounds(2400, 3, 4), 0.5, 3),
    "tiny 4": lambda: (rounds(4000, 8, 7), 0.5, 4),
    "tiny 8": lambda: (rounds(4000, 8, 4), 0.5, 8),
    "tiny 8b": lambda: (rounds(4000, 8, 9), 0.5, 8),
    "robots 4": lambda: (rounds(16_000, 8, 5), 0.24, 4),
    "buses 3": lambda: (driven(6, 1.0, 600.0, 5), 8.0, 3),
    "buses 8": lambda: (driven(8, 2.0, 600.0, 8), 8.0, 8),
    "taxis 3": lambda: (driven(6, 15.0, 900.0, 3), 5.0, 3),
    "taxis 3b": lambda: (driven(6, 15.0, 900.0, 11), 5.0, 3),
    "taxis 4": lambda: (driven(8, 15.0, 900.0, 21), 8.0, 4),
}


if __name__ == "__main__":
    main()
