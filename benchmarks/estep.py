"""Time the expectation step, one odd and one even sweep, on a patrol of a million points.

    python benchmarks/estep.py [--points N] [--segments M]

One core works. Each function runs twice, and the second run counts, so that compiling does not.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation import estep
from gpszip.segmentation.bottom_up import bottom_up
from gpszip.segmentation.clustering import ward
from gpszip.segmentation.mstep import fit_segments, maximize
from gpszip.segmentation.state import EMState, total_cost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--segments", type=int, default=20)
    options = parser.parse_args()

    for k in (200, 1000, 5000):
        print(f"n = {options.points}, k = {k}, m = {options.segments}")
        track = generate_patrol(options.points, k)
        sums = measure_time("prefix sums", track_sums, track)
        bottom_up_start = measure_time("bottom-up and relaxation", bottom_up, sums, k)
        even_start = np.linspace(0, options.points, k + 1).astype(np.int64)

        # Two iterations of EM from either start.
        starts = {"bottom-up start": bottom_up_start, "even start": even_start}
        for start, boundaries in starts.items():
            labels = measure_time(f"Ward, {start}", ward, sums, boundaries, options.segments)
            segments = fit_segments(sums, boundaries, labels, options.segments)
            state = EMState(boundaries, labels, *segments)
            for _ in range(2):
                expected = measure_time("expectation step", estep.odd_even, sums, state)
                state = measure_time("maximisation step", maximize, sums, expected)
            rmse = np.sqrt(total_cost(sums, state) / options.points) * sums.position_tick
            print(f"    rmse {rmse:.3f} m")


def generate_patrol(points: int, legs: int, seed: int = 0) -> Track:
    """Return a walk between 12 stations along straight legs, at 1 Hz, with noise of 0.2 m."""
    rng = np.random.default_rng(seed)
    stations = rng.uniform(0, 100, (12, 2))
    route = np.concatenate([[0], np.cumsum(rng.integers(1, 4, legs)) % 12])

    # The leg of each sample, and its share of the leg.
    knots = np.sort(rng.choice(np.arange(1, points - 1), legs - 1, replace=False))
    knots = np.concatenate([[0], knots, [points - 1]])
    progress = np.interp(np.arange(points), knots, np.arange(legs + 1))
    leg = np.minimum(progress.astype(int), legs - 1)
    share = (progress - leg)[:, None]

    positions = stations[route[leg]] * (1 - share) + stations[route[leg + 1]] * share
    noise = rng.normal(0, 0.2, (points, 2))
    return Track("patrol", np.arange(float(points)), positions + noise)


def measure_time(name: str, function, *arguments):
    """Call a function twice, print the time of the second call, and return its result."""
    function(*arguments)
    start = time.perf_counter()
    result = function(*arguments)
    print(f"  {name:24s} {time.perf_counter() - start:8.3f} s")
    return result


if __name__ == "__main__":
    main()
