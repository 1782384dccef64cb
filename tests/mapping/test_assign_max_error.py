from itertools import combinations, product

import numpy as np
import pytest

from calling import from_python
from gpszip.mapping.kernels.assign_max_error import build_directions, fill_table_within_max_error
from gpszip.mapping.kernels.time_grid import DPTable, TimeGridArrays

# Inner kernels, as Python calls them.
fill_table_within_max_error = from_python(fill_table_within_max_error)

TIME, STAY = 3.0, 4.5


class Problem:
    """A few slots with a few candidates each, and samples about a curve among them."""

    def __init__(self, seed, dimension, reach):
        rng = np.random.default_rng(seed)
        self.rows, width = 6, 3
        self.time_steps = np.cumsum(rng.integers(1, 4, self.rows)).astype(float)
        times = np.sort(rng.uniform(self.time_steps[0], self.time_steps[-1], 14))
        # A sample at the very start: no velocity makes up for its offset.
        times[0] = self.time_steps[0]
        bends = rng.normal(0, 4, (self.rows, dimension))
        curve = np.stack(
            [np.interp(times, self.time_steps, bends[:, axis]) for axis in range(dimension)], axis=1
        )
        self.positions = (
            bends[:, None]
            + rng.normal(0, 1.2, (self.rows, width, dimension)) * np.arange(width)[None, :, None]
        )
        ends = np.searchsorted(times, self.time_steps)
        ends[-1] = len(times)
        directions, self.share = build_directions(dimension)
        self.reach = reach
        nothing = np.zeros((0, 0), np.int64)
        self.limits = TimeGridArrays(
            sums=nothing,
            ticks=nothing.ravel(),
            centers=nothing,
            positions=np.zeros((0, dimension)),
            ticks_per_step=1.0,
            ends=ends,
            times=times,
            sample_positions=curve + rng.normal(0, 0.2, curve.shape),
            time_steps=self.time_steps,
            directions=directions,
            max_distance=self.share * reach,
        )
        self.candidates = rng.integers(0, 9, (self.rows, width))
        self.numbers = self.candidates % 4
        self.step_bits = rng.uniform(1, 9, (4, 4))
        self.counts = np.full(self.rows, width)

    def solve(self):
        best = np.full(self.candidates.shape, np.inf)
        best[0] = 0.0
        rows, choices = np.full(best.shape, -1), np.zeros(best.shape, np.int64)
        dp_table = DPTable(
            self.candidates,
            self.counts,
            self.positions,
            self.numbers,
            self.step_bits,
            np.minimum(self.step_bits.min(axis=0) + TIME, STAY)[self.numbers],
            best,
            rows,
            choices,
        )
        fill_table_within_max_error(self.limits, dp_table, 0, self.rows, TIME, STAY)
        return best, rows, choices

    def errors(self, path):
        """Distances of the samples from a path of (row, choice), at their own times."""
        knots = np.array([self.positions[knot] for knot in path])
        when = self.time_steps[[row for row, _ in path]]
        inside = slice(self.limits.ends[path[0][0]], self.limits.ends[path[-1][0]])
        columns = [
            np.interp(self.limits.times[inside], when, knots[:, axis])
            for axis in range(knots.shape[1])
        ]
        return np.sqrt(
            ((np.stack(columns, axis=1) - self.limits.sample_positions[inside]) ** 2).sum(axis=1)
        )

    def step(self, a, b):
        if self.candidates[a] == self.candidates[b]:
            return STAY
        return TIME + self.step_bits[self.numbers[a], self.numbers[b]]

    def cheapest(self, reach):
        """Least bits to each candidate of the last row, over all paths within ``reach``."""
        least = np.full(3, np.inf)
        for count in range(self.rows - 1):
            for middle in combinations(range(1, self.rows - 1), count):
                rows = (0, *middle, self.rows - 1)
                for choices in product(range(3), repeat=len(rows)):
                    path = list(zip(rows, choices, strict=True))
                    cost = sum(self.step(a, b) for a, b in zip(path, path[1:], strict=False))
                    if cost < least[choices[-1]] and (self.errors(path) <= reach).all():
                        least[choices[-1]] = cost
        return least


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_the_cheapest_path_within_the_limit_is_found(seed, dimension):
    problem = Problem(seed, dimension, reach=2.5)
    best, _, _ = problem.solve()
    strict, loose = problem.cheapest(problem.share * problem.reach), problem.cheapest(problem.reach)
    # The intersection of the strips is between the ball and its inner share.
    assert (best[-1] <= strict + 1e-9).all()
    assert (best[-1] >= loose - 1e-9).all()


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
def test_no_sample_is_farther_than_the_limit_on_the_paths_found(dimension):
    reached = 0
    for seed in range(60):
        problem = Problem(seed, dimension, reach=1.5)
        best, rows, choices = problem.solve()
        for choice in np.flatnonzero(np.isfinite(best[-1])).tolist():
            knot, path = (problem.rows - 1, choice), []
            while knot[0] >= 0:
                path.append(knot)
                knot = int(rows[knot]), int(choices[knot])
            assert (problem.errors(path[::-1]) <= problem.reach * (1 + 1e-9)).all()
            reached += 1
    assert reached > 20


def test_the_intersection_of_strips_is_within_the_ball():
    rng = np.random.default_rng(0)
    for dimension in (1, 2, 3, 4):
        directions, share = build_directions(dimension)
        points = rng.normal(0, 1, (4000, dimension))
        inside = (np.abs(points @ directions.T) <= share).all(axis=1)
        assert inside.any()
        assert (np.linalg.norm(points[inside], axis=1) <= 1 + 1e-12).all()
