"""Blocks of some of a log's samples, and of two such batches together: the leaves and the branches of a tree of coresets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.stream import merge_coresets

__all__ = ["build_fine_blocks", "merge_fine_blocks"]


def build_fine_blocks(most: int, tracks: Sequence[Track]) -> Coreset:
    """Make a block of every two samples, and merge neighbours that cost least as one while there are more than ``most``.

    Parameters
    ----------
    most : int
        Largest number of blocks, but for one of each track.
    tracks : sequence of Track
        Samples of one or more tracks, on one plane.

    Examples
    --------
    >>> track = Track("lane", range(100), [[t % 50] for t in range(100)])
    >>> len(build_fine_blocks(8, [track])), build_fine_blocks(8, [track]).samples
    (8, 100)
    """
    rows = [_absorb_track(most, track) for track in tracks]
    owners = np.repeat(np.arange(len(rows)), [len(own) for own in rows])
    return _reduce_to(
        most,
        Coreset(tuple(track.id for track in tracks), owners, np.concatenate(rows), tracks[0].plane),
    )


def merge_fine_blocks(most: int, one: Coreset, other: Coreset) -> Coreset:
    """Blocks of both, of which neighbours are merged while there are more than ``most``."""
    return _reduce_to(most, merge_coresets([one, other]))


def _absorb_track(most: int, track: Track) -> NDArray[np.float64]:
    weights = np.ones(len(track)) if track.weights is None else track.weights
    whole = len(track) // kernel.LEAF_SAMPLES * kernel.LEAF_SAMPLES
    room = np.empty(
        (min(2 * most, whole // kernel.LEAF_SAMPLES), kernel.FIXED_COLUMNS + 3 * track.dimension)
    )
    count = kernel.absorb_samples(
        room, 0, most, track.times[:whole], track.positions[:whole], weights[:whole]
    )
    rest = kernel.block_rows(
        track.times, track.positions, weights, np.arange(whole, len(track) + 1)
    )
    return np.concatenate([room[:count], rest])


def _reduce_to(most: int, blocks: Coreset) -> Coreset:
    if len(blocks) <= max(most, len(blocks.tracks)):
        return blocks
    rows, owners = blocks.rows.copy(), blocks.owners.copy()
    count = kernel.reduce_blocks(rows, owners, len(rows), max(most, len(blocks.tracks)))
    return replace(blocks, rows=rows[:count], owners=owners[:count])
