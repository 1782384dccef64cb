"""Time of one expectation sweep (odd and even) on a patrol of a million points, on one core, after compilation."""

from __future__ import annotations

import argparse
import time

import numpy as np

from gpszip.model import Track
from gpszip.segmentation import estep
from gpszip.segmentation.bottom_up import bottom_up
from gpszip.segmentation.clustering import ward
from gpszip.segmentation.mstep import fit_segments, maximize
from gpszip.segmentation.state import EMState, total_cost, track_sums


def patrol(n: int, legs: int, seed: int = 0) -> Track:
    """Return a walk between 12 places along straight legs, 1 Hz, with noise of 0.2 m."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 100, (12, 2))
    stops = np.concatenate([[0], np.cumsum(rng.integers(1, 4, legs)) % 12])
    knots = np.sort(rng.choice(np.arange(1, n - 1), legs - 1, replace=False))
    at = np.interp(np.arange(n), np.concatenate([[0], knots, [n - 1]]), np.arange(legs + 1))
    leg = np.minimum(at.astype(int), legs - 1)
    u = (at - leg)[:, None]
    positions = places[stops[leg]] * (1 - u) + places[stops[leg + 1]] * u
    return Track("patrol", np.arange(float(n)), positions + rng.normal(0, 0.2, (n, 2)))


def timed(name: str, function, *arguments, **options):
    function(*arguments, **options)
    began = time.perf_counter()
    result = function(*arguments, **options)
    print(f"  {name:24s} {time.perf_counter() - began:8.3f} s")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--segments", type=int, default=20)
    options = parser.parse_args()
    for k in (200, 1000, 5000):
        print(f"n = {options.points}, k = {k}, m = {options.segments}")
        track = patrol(options.points, k)
        sums = timed("prefix sums", track_sums, track)
        boundaries = timed("bottom-up and relaxation", bottom_up, sums, k)
        uneven = np.linspace(0, options.points, k + 1).astype(np.int64)
        for start, cuts in (("bottom-up start", boundaries), ("even start", uneven)):
            labels = timed(f"Ward, {start}", ward, sums, cuts, options.segments)
            state = EMState(cuts, labels, *fit_segments(sums, cuts, labels, options.segments))
            for _ in range(2):
                swept = timed("expectation sweep", estep.odd_even, sums, state)
                state = timed("maximisation", maximize, sums, swept)
            print(
                f"    rmse {np.sqrt(total_cost(sums, state) / options.points) * sums.position_tick:.3f} m"
            )


if __name__ == "__main__":
    main()
