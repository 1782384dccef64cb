"""Few samples that stand for the blocks of a coreset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.kernels import blocks as kernel

__all__ = ["StandIns", "stand_ins"]


@dataclass(frozen=True, eq=False)
class StandIns:
    """Samples that stand for blocks.

    Parameters
    ----------
    tracks : tuple of Track
        The tracks of the coreset, with weights.
    numbers : int64 array, shape (n,)
        Number of each of them among the samples of the log, all tracks one after the other.
    """

    tracks: tuple[Track, ...]
    numbers: NDArray[np.int64]


def stand_ins(coreset: Coreset, most: int) -> StandIns:
    """Return evenly spaced samples on the best line of each block, which share its weight.

    Where the samples of a block come at even times, weight, mean time and drift are those of the
    block, and its spread nearly is. So the cost of a line is that of the block, but for its free
    cost, which is the same for all lines.

    Parameters
    ----------
    coreset : Coreset
        B blocks.
    most : int
        Samples of a block, at least 2; a block of fewer samples has as many.

    Examples
    --------
    >>> from gpszip import coreset
    >>> lane = Track("lane", range(9), [[2.0 * t] for t in range(9)])
    >>> found = stand_ins(coreset(lane, size=1), 3)
    >>> found.tracks[0].times.tolist(), found.tracks[0].positions.ravel().tolist()
    ([0.0, 4.0, 8.0], [0.0, 8.0, 16.0])
    >>> found.tracks[0].weights.tolist(), found.numbers.tolist()
    ([3.0, 3.0, 3.0], [0, 4, 8])
    """
    # How many each block gets, and the share of its duration at which each is.
    rows, d = coreset.rows, coreset.dimension
    counts, durations = coreset.counts, coreset.edges[:, 1] - coreset.edges[:, 0]
    shares = np.where(durations > 0, np.minimum(counts, most), 1)
    blocks = np.repeat(np.arange(len(rows)), shares)
    within = np.arange(len(blocks)) - np.repeat(np.cumsum(shares) - shares, shares)
    fractions = within / np.maximum(shares[blocks] - 1, 1)

    # Positions on the best lines; a block at one time has its mean.
    fixed = kernel.FIXED_COLUMNS
    start, mean, drift = (rows[:, fixed + i * d : fixed + (i + 1) * d] for i in range(3))
    spread = rows[:, kernel.SPREAD, None]
    slope = np.where(spread > 0, drift / np.where(spread > 0, spread, 1.0), 0.0)
    elapsed = fractions * durations[blocks]
    positions = (start + mean)[blocks]
    positions += (elapsed - rows[blocks, kernel.MEAN_TIME])[:, None] * slope[blocks]

    # Cut them into tracks, and number them.
    times, weights = rows[blocks, kernel.FIRST] + elapsed, (rows[:, kernel.WEIGHT] / shares)[blocks]
    firsts = np.cumsum(counts) - counts
    numbers = firsts[blocks] + np.rint(fractions * (counts[blocks] - 1)).astype(np.int64)
    owners = coreset.owners[blocks]
    tracks = tuple(
        Track(name, times[own], positions[own], weights[own], plane=coreset.plane)
        for name, own in ((name, owners == i) for i, name in enumerate(coreset.tracks))
    )
    return StandIns(tracks, numbers)
