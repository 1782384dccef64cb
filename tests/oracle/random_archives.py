"""Archives made up from random walks on random maps."""

from __future__ import annotations

import numpy as np

from gpszip.archive import new_archive
from gpszip.model import GridWalk, GridWalks, Plane, QuantisationGrid

PLANE = Plane(((525_000_000, 134_000_000),))

#: Milliseconds since 1970.
EPOCH = 1_400_000_000_500


def random_walks(
    tracks=2, knots=30, dimension=2, seed=0, timed=True, gaps=0.2, spread=400, first_step=0
):
    """Walks that visit and visit again the nodes of a random map, numbered in first-visit order."""
    rng = np.random.default_rng(seed)
    sequence = rng.integers(0, max(2, tracks * knots // 6), tracks * knots)
    _, first, index = np.unique(sequence, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first)).astype(np.int32)
    walks = tuple(
        GridWalk(
            nodes,
            (first_step + np.cumsum(rng.integers(1, 50, knots))) * timed,
            rng.random(knots - 1) < gaps,
        )
        for nodes in np.split(rank[index], tracks)
    )
    return GridWalks(rng.integers(-spread, spread, (len(first), dimension)), walks, timed)


def random_archive(dimension=2, plane=None, ids=None, **options):
    walks = random_walks(dimension=dimension, **options)
    ids = ids or [f"walk {i}" for i in range(len(walks.walks))]
    grid = QuantisationGrid((1000,) * dimension, EPOCH, 130, 125, plane)
    return new_archive(grid, ids, walks)
