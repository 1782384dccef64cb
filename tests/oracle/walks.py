"""Random walks on a grid, and whether two of them are equal."""

import numpy as np

from gpszip.codec.numbering import number_by_visit
from gpszip.model import GridWalk, GridWalks


def walk(nodes, time_steps, gaps=None):
    nodes = np.array(nodes, np.int32)
    return GridWalk(
        nodes,
        np.array(time_steps, np.int64),
        np.zeros(len(nodes) - 1, bool) if gaps is None else np.array(gaps, bool),
    )


def random_walks(seed, longest=60):
    """Walks with revisits, stops and gaps, with times or without, of 1 to 5 axes.

    They go along a line of nodes or at random between them.
    """
    rng = np.random.default_rng(seed)
    dimension, count = 1 + seed % 5, int(rng.integers(2, 40))
    nodes = rng.integers(-300, 300, (count, dimension)) * (2**30 if seed % 7 == 3 else 1)
    timed = seed % 4 > 0
    walks = []
    for _ in range(int(rng.integers(1, 6))):
        knots = int(rng.integers(1, longest))
        along = np.clip(np.cumsum(rng.integers(-2, 3, knots)), 0, count - 1)
        route = along if seed % 2 else rng.integers(0, count, knots)
        time_steps = (
            rng.integers(-99, 99) + np.cumsum(rng.geometric(0.1, knots))
            if timed
            else np.zeros(knots)
        )
        walks.append(walk(route, time_steps, rng.random(knots - 1) < (0.2 if seed % 3 else 0)))
    return number_by_visit(GridWalks(nodes, tuple(walks), timed))


def assert_same(walks, other):
    np.testing.assert_array_equal(walks.nodes, other.nodes)
    assert (walks.timed, len(walks.walks)) == (other.timed, len(other.walks))
    assert walks.nodes.dtype == other.nodes.dtype
    for walk_, twin in zip(walks.walks, other.walks, strict=True):
        for array, twin_array in zip(vars(walk_).values(), vars(twin).values(), strict=True):
            assert array.dtype == twin_array.dtype
        np.testing.assert_array_equal(walk_.nodes, twin.nodes)
        np.testing.assert_array_equal(walk_.time_steps, twin.time_steps)
        np.testing.assert_array_equal(walk_.gaps, twin.gaps)
