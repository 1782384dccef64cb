"""Random walks on lattices, and what makes two of them the same."""

import numpy as np

from gpszip.codec.walks import number_by_visit
from gpszip.model import GridWalk, GridWalks


def walk(nodes, cells, gaps=None):
    nodes = np.array(nodes, np.int32)
    return GridWalk(
        nodes,
        np.array(cells, np.int64),
        np.zeros(len(nodes) - 1, bool) if gaps is None else np.array(gaps, bool),
    )


def random_walks(seed, longest=60):
    """Walks along a line of places or at random between them, with revisits, stops and gaps, timed or not, of 1 to 5 axes."""
    rng = np.random.default_rng(seed)
    dimension, count = 1 + seed % 5, int(rng.integers(2, 40))
    nodes = rng.integers(-300, 300, (count, dimension)) * (2**30 if seed % 7 == 3 else 1)
    timed = seed % 4 > 0
    walks = []
    for _ in range(int(rng.integers(1, 6))):
        knots = int(rng.integers(1, longest))
        stroll = np.clip(np.cumsum(rng.integers(-2, 3, knots)), 0, count - 1)
        route = stroll if seed % 2 else rng.integers(0, count, knots)
        cells = (
            rng.integers(-99, 99) + np.cumsum(rng.geometric(0.1, knots))
            if timed
            else np.zeros(knots)
        )
        walks.append(walk(route, cells, rng.random(knots - 1) < (0.2 if seed % 3 else 0)))
    return number_by_visit(GridWalks(nodes, tuple(walks), timed))


def assert_same(one, other):
    np.testing.assert_array_equal(one.nodes, other.nodes)
    assert (one.timed, len(one.walks)) == (other.timed, len(other.walks))
    for a, b in zip(one.walks, other.walks, strict=True):
        np.testing.assert_array_equal(a.nodes, b.nodes)
        np.testing.assert_array_equal(a.time_steps, b.time_steps)
        np.testing.assert_array_equal(a.gaps, b.gaps)
