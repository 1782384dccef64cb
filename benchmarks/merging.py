"""Merge archives of parts of generated logs, and compare with compressing all at once at the error that came out.

    python benchmarks/merging.py [LOG...]

Bytes of the parts together, of the merged archive and of one archive of all logs at the same measured error; then the CPU time
of merging, and how much the order of the parts changes.
"""

import math
import sys
import time

import numpy as np

from gpszip.model import Options, Track
from gpszip.pipeline import compress, merge
from gpszip.testing import patrol
from gpszip.testing.city import drives


def main() -> None:
    chosen = sys.argv[1:] or list(LOGS)
    print(f"{'log':>10} {'parts':>5} {'apart':>7} {'merged':>7} {'at once':>7} {'ratio':>6} {'RMSE':>7} {'CPU':>6} {'order':>6}")
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
            print(f"{name:>10} {parts:>5} {apart:>7,} {size:>7,} {whole:>7,} {size / whole:>6.3f} "
                f"{error:>7.3f} {spent:>6.1f} {other:>+6.1%}",
                  flush=True)  # fmt: skip


def rmse(archive, tracks) -> float:
    squares = [((archive.position(track.id, track.times) - track.positions) ** 2).sum(axis=1) for track in tracks]
    return math.sqrt(np.concatenate(squares).mean())


def taxis():
    return [Track(f"{i}", *one) for i, one in enumerate(driven(period=15.0, duration=3600.0, vehicles=16))], 6.0


def buses():
    return [Track(f"{i}", *one) for i, one in enumerate(driven(period=1.0, duration=1200.0, vehicles=8))], 5.0


def robots():
    whole = patrol(40_000, seed=4)
    cuts = np.array_split(np.arange(len(whole)), 16)
    return [Track(f"{i}", whole.times[rows], whole.positions[rows]) for i, rows in enumerate(cuts)], 0.24


def driven(**options):
    logs = drives(8, seed=3, noise=4.0, block=120.0, speed=9.0, **options)
    return logs.values() if isinstance(logs, dict) else logs


LOGS = {"taxis": taxis, "buses": buses, "robots": robots}


if __name__ == "__main__":
    main()
