"""Time learning and the expectation step with one worker and with two, on generated logs.

    python benchmarks/workers.py [--points N] [--rmse METRES] [--turns N] [--engines ENGINE...]

Learning a fleet's map is timed with each engine; the expectation step of EM, which works on k/2
intervals at a time (thesis, section 6.3.3), with threads. Runs with one worker and with two
alternate, so that other load on the machine affects both alike; the best time counts.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gpszip import testing
from gpszip.kernels.sums import PrefixSums, track_sums
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.warm import warm
from gpszip.run import Processes, Threads
from gpszip.run.executor import share_value
from gpszip.segmentation import estep
from gpszip.segmentation.bottom_up import bottom_up
from gpszip.segmentation.clustering import ward
from gpszip.segmentation.kernels.shift import shift_boundaries
from gpszip.segmentation.mstep import fit_segments
from gpszip.segmentation.state import EMState
from gpszip.testing.city import drives

#: Classes of executors by the names of engines.
ENGINES = {"threads": Threads, "processes": Processes}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--rmse", type=float, default=8.0)
    parser.add_argument("--turns", type=int, default=1)
    parser.add_argument("--engines", nargs="+", choices=ENGINES, default=list(ENGINES))
    options = parser.parse_args()
    warm()
    time_expectation(200_000, 2000, max(options.turns, 3))
    time_learning(options.points, options.rmse, options.engines, options.turns)


def time_expectation(points: int, k: int, turns: int) -> None:
    """Print the time of an expectation step with one worker and with two."""
    sums = track_sums(testing.patrol(points))
    boundaries = np.linspace(0, points, k + 1).astype(np.int64)
    labels = ward(sums, bottom_up(sums, k), 20)
    state = EMState(boundaries, labels, *fit_segments(sums, boundaries, labels, 20))

    best = {1: np.inf, 2: np.inf}
    for _ in range(turns):
        for workers in (1, 2):
            start = time.perf_counter()
            for _ in range(5):
                estep.odd_even(sums, state, executor=Threads(workers))
            best[workers] = min(best[workers], (time.perf_counter() - start) / 5)
    print(
        f"EM over k/2 intervals, n = {points}, k = {k}: 1 worker {1000 * best[1]:.0f} ms, "
        f"2 workers {1000 * best[2]:.0f} ms a step, {best[1] / best[2]:.2f} times the speed"
    )
    time_expectation_on_processes(sums, state, turns)


def time_expectation_on_processes(sums: PrefixSums, state: EMState, turns: int) -> None:
    """Print the time of an expectation step whose windows are sent to two processes.

    They get the sums once; windows and segments go to them with each half of a step.
    """
    with Processes(2) as executor, share_value(executor, sums) as shared:
        times = []
        for _ in range(turns + 1):
            start = time.perf_counter()
            for first in (2, 1):
                list(shared.map(shift_window, windows(state, first)))
            times.append(time.perf_counter() - start)
    print(
        f"  on processes: {1000 * min(times[1:]):.0f} ms a step, and {times[0]:.1f} s for the "
        "first, which starts them"
    )


def windows(state: EMState, first: int) -> Iterator[EMState]:
    """Yield states of 128 intervals each, whose every second boundary is to be shifted."""
    for low in range(first, len(state.labels), 128):
        last = low + (min(low + 128, len(state.labels)) - 1 - low) // 2 * 2
        boundaries, labels = state.boundaries[low - 1 : last + 2], state.labels[low - 1 : last + 1]
        yield EMState(boundaries.copy(), labels.copy(), state.starts, state.ends)


def shift_window(sums: PrefixSums, state: EMState) -> EMState:
    """Shift every second boundary of a state."""
    boundaries, labels = state.boundaries.copy(), state.labels.copy()
    shift_boundaries(
        sums, boundaries, labels, state.starts, state.ends, 1, len(labels), 2, 1, False
    )
    return replace(state, boundaries=boundaries, labels=labels)


def time_learning(points: int, rmse: float, engines: list[str], turns: int) -> None:
    """Print the time of compressing a fleet's log, and whether all archives are the same."""
    tracks = generate_fleet(points)
    print(f"fleet of {sum(map(len, tracks))} points in {len(tracks)} tracks, RMSE {rmse} m")
    for engine in engines:
        best, digests = {1: np.inf, 2: np.inf}, set()
        for _ in range(turns):
            for workers in (1, 2):
                executor = ENGINES[engine](workers)
                start = time.perf_counter()
                archive, report = compress(tracks, Options(rmse=rmse), executor=executor)
                best[workers] = min(best[workers], time.perf_counter() - start)
                digests.add(hashlib.sha256(archive.to_bytes()).hexdigest())
                if engine == "processes":
                    executor.close()
        verdict = "the same bytes" if len(digests) == 1 else "DIFFERENT BYTES"
        print(
            f"  {engine}: 1 worker {best[1]:.1f} s, 2 workers {best[2]:.1f} s, "
            f"{best[1] / best[2]:.2f} times the speed; {report.bytes_out} B, {verdict}"
        )


def generate_fleet(points: int) -> list[Track]:
    """Return vehicles of a town, half an hour each, with a sample each second."""
    log = drives(blocks=12, vehicles=max(points // 1800, 1), period=1.0)
    return [Track(name, *drive) for name, drive in log.items()]


if __name__ == "__main__":
    main()
