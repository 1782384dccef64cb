"""Leaves and inner nodes of a tree of coresets over the batches of a log.

Batches become many small blocks; two neighbouring nodes become one with a bounded number of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.stream import merge_coresets
from gpszip.sketches.weights import sample_weights

__all__ = ["build_fine_blocks", "merge_fine_blocks"]


def build_fine_blocks(max_blocks: int, tracks: Sequence[Track]) -> Coreset:
    """Make a block of every two samples; merge the cheapest neighbours while there are too many.

    Parameters
    ----------
    max_blocks : int
        Largest number of blocks; each track has one at least.
    tracks : sequence of Track
        Samples of one or more tracks, on one plane.

    Examples
    --------
    >>> track = Track("lane", range(100), [[t % 50] for t in range(100)])
    >>> len(build_fine_blocks(8, [track])), build_fine_blocks(8, [track]).samples
    (8, 100)
    """
    rows = [_absorb_track(max_blocks, track) for track in tracks]
    owners = np.repeat(np.arange(len(rows)), [len(track_rows) for track_rows in rows])
    names = tuple(track.id for track in tracks)
    blocks = Coreset(names, owners, np.concatenate(rows), tracks[0].plane)
    return _reduce_to(max_blocks, blocks)


def merge_fine_blocks(max_blocks: int, first: Coreset, second: Coreset) -> Coreset:
    """Merge two coresets; merge the cheapest neighbours while there are too many blocks."""
    return _reduce_to(max_blocks, merge_coresets([first, second]))


def _absorb_track(max_blocks: int, track: Track) -> NDArray[np.float64]:
    """Return the rows of a track's blocks: up to ``2 * max_blocks``, and one more."""
    weights = sample_weights(track)

    # Full leaves.
    leaves = len(track) // kernel.LEAF_SAMPLES
    end = leaves * kernel.LEAF_SAMPLES
    rows = np.empty((min(2 * max_blocks, leaves), kernel.FIXED_COLUMNS + 3 * track.dimension))
    count = kernel.absorb_samples(
        rows, 0, max_blocks, track.times[:end], track.positions[:end], weights[:end]
    )

    # The samples that don't fill a leaf, each a block of its own.
    rest = kernel.block_rows(track.times, track.positions, weights, np.arange(end, len(track) + 1))
    return np.concatenate([rows[:count], rest])


def _reduce_to(max_blocks: int, blocks: Coreset) -> Coreset:
    """Merge the cheapest neighbours while there are too many blocks."""
    # Blocks of different tracks are never merged, so there are at least as many as tracks.
    size = max(max_blocks, len(blocks.tracks))
    if len(blocks) <= size:
        return blocks
    rows, owners = blocks.rows.copy(), blocks.owners.copy()
    count = kernel.reduce_blocks(rows, owners, len(rows), size)
    return replace(blocks, rows=rows[:count], owners=owners[:count])
