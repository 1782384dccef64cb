"""Merge archives of parts of generated logs, and compare with compressing all at once at the error that came out.

    python benchmarks/merging.py [LOG...]

Bytes of the parts together, of the merged archive and of one archive of all logs at the same measured error; then the CPU time
of merging, and how much another order of the parts and merging one after the other change.
"""

import math
import sys
import time
from functools import reduce

import numpy as np

from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol
from gpszip.testing.city import drives


def main() -> None:
    chosen = sys.argv[1:] or list(LOGS)
    widths = {
        "log": 10,
        "parts": 5,
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
    print(" ".join(f"{head:>{width}}" for head, width in widths.items()))
    for name in chosen:
        tracks, bound = LOGS[name]()
        for parts in (2, 4, 8):
            own = [tracks[i::parts] for i in range(parts)]
            archives = [compress(some, Options(rmse=bound))[0] for some in own]
            apart = sum(len(one.to_bytes()) for one in archives)
            start = time.process_time()
            merged, _ = merge(archives)
            spent = time.process_time() - start
            error = rmse(merged, tracks)
            whole = len(compress(tracks, Options(rmse=error))[0].to_bytes())
            size = len(merged.to_bytes())
            order = [archives[i] for i in np.random.default_rng(1).permutation(parts)]
            other = len(merge(order)[0].to_bytes()) / size - 1
            fold = reduce(lambda one, more: merge([one, more])[0], archives)
            print(f"{name:>10} {parts:>5} {apart:>7,} {size:>7,} {whole:>7,} {size / whole:>6.3f} "
                f"{error:>7.3f} {spent:>6.1f} {other:>+6.1%} {len(fold.to_bytes()) / size - 1:>+6.1%} {rmse(fold, tracks):>8.3f}",
                  flush=True)  # fmt: skip


def rmse(archive, tracks) -> float:
    squares = [
        ((archive.position(track.id, track.times, metres=True) - track.positions) ** 2).sum(axis=1)
        for track in tracks
    ]
    return math.sqrt(np.concatenate(squares).mean())


def taxis():
    return [
        Track(f"{i}", *one)
        for i, one in enumerate(driven(period=15.0, duration=3600.0, vehicles=16))
    ], 8.0


def buses():
    return [
        Track(f"{i}", *one) for i, one in enumerate(driven(period=1.0, duration=1200.0, vehicles=8))
    ], 8.0


def robots():
    return rounds(40_000, 16), 0.24


def tiny():
    return rounds(4000, 8), 0.5


def rounds(points, runs):
    whole = patrol(points, seed=4)
    cuts = np.array_split(np.arange(len(whole)), runs)
    return [Track(f"{i}", whole.times[rows], whole.positions[rows]) for i, rows in enumerate(cuts)]


def driven(**options):
    logs = drives(8, seed=3, noise=4.0, block=120.0, speed=9.0, **options)
    return logs.values() if isinstance(logs, dict) else logs


LOGS = {"taxis": taxis, "buses": buses, "robots": robots, "tiny": tiny}


if __name__ == "__main__":
    main()
