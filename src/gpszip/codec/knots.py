"""Walks as their knots in a row, which is what kernels take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalks

__all__ = ["concatenate_knots"]


def concatenate_knots(
    walks: GridWalks,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8], NDArray[np.int8]]:
    """All knots of all walks in a row: nodes, cells, whether a gap leads there, whether a track begins there."""
    if not walks.walks:
        return (
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
            np.zeros(0, np.int8),
            np.zeros(0, np.int8),
        )
    nodes = np.concatenate([walk.nodes for walk in walks.walks]).astype(np.int64)
    cells = np.concatenate([walk.time_steps for walk in walks.walks]).astype(np.int64)
    gaps = np.concatenate([np.append(False, walk.gaps) for walk in walks.walks]).astype(np.int8)
    begins = np.zeros(len(nodes), np.int8)
    begins[np.cumsum([0] + [len(walk.nodes) for walk in walks.walks[:-1]])] = 1
    return nodes, cells, gaps, begins
