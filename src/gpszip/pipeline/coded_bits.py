"""What an archive's own coder takes to write the paths of a log, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.codec.decode import decode_walks
from gpszip.codec.kernels.walk_model import POSITION_BITS
from gpszip.codec.walks import encode_in_modes
from gpszip.model import GridWalks, Track
from gpszip.model.grid import step_size
from gpszip.model.options import Options
from gpszip.pipeline.compress import compress

__all__ = ["CodedBits", "code_paths"]

Floats = NDArray[np.float64]


class CodedBits(NamedTuple):
    """Bits of the steps of a track's walk.

    Parameters
    ----------
    times : float64 array, shape (k,)
        Seconds at which each knot is reached, increasing.
    bits : float64 array, shape (k,)
        What the step to it takes.
    """

    times: Floats
    bits: Floats

    def between(self, start: float, end: float) -> float:
        """Bits of the steps to the knots from one time to another; a part of a step counts whole.

        Examples
        --------
        >>> CodedBits(np.array([0.0, 10.0, 20.0]), np.array([0.0, 3.0, 4.0])).between(5.0, 12.0)
        7.0
        """
        # The step that leads out of the time range begins within it.
        first = int(np.searchsorted(self.times, start, side="right"))
        last = int(np.searchsorted(self.times, end, side="left")) + 1
        return float(self.bits[first:last].sum())


def code_paths(tracks: Sequence[Track], archive: Archive) -> dict[str, CodedBits]:
    """Encode a log after an archive, and tell the bits of each step.

    The log becomes walks on the map of the archive, within its error. The walk coder, trained on
    all walks of the archive, writes each step given the steps before it: its kind, and which edge
    it takes or between which nodes a new one leads. A new node takes the mean bits of the positions
    of all new ones. Durations, and the starts of pieces, don't count.

    Parameters
    ----------
    tracks : sequence of Track
        With times and different ids.
    archive : Archive
        What is known.

    Returns
    -------
    dict of str to CodedBits
        By the names of the tracks.
    """
    # The walks of the log, with the nodes of the archive first.
    coded, _ = compress(tracks, Options(effort=1), map=archive)
    reference = coded.contents.map
    prior = archive.prior(reference.refinements if reference is not None else 0)
    grid, found, names = coded.grid, dict[str, CodedBits](), iter(coded.ids)
    ends_grid = grid if coded.contents.has_piece_ends else None
    for group in coded.contents.groups:
        walks = decode_walks(group.payload, grid.dimension, group.tracks, prior, ends_grid)

        # The bits of all steps of a group, each walk after the other.
        step_bits = np.zeros(sum(len(walk.nodes) for walk in walks.walks))
        _, model = encode_in_modes(walks, prior, 0, step_bits)
        total, count = model.statistics[POSITION_BITS].tolist()
        step_bits[_are_new(walks, prior.nodes)] += total / max(count, 1.0)
        ends = np.cumsum([len(walk.nodes) for walk in walks.walks]).tolist()
        for walk, end in zip(walks.walks, ends, strict=True):
            seconds = grid.epoch / 1000 + walk.time_steps * step_size(grid.time)
            times = np.asarray(seconds, np.float64)
            found[next(names)] = CodedBits(times, step_bits[end - len(walk.nodes) : end])
    return found


def _are_new(walks: GridWalks, known: int) -> NDArray[np.bool_]:
    """Whether each knot is the first one at a node that is not known."""
    nodes = np.concatenate([walk.nodes for walk in walks.walks])
    visited, first = np.unique(nodes, return_index=True)
    is_new = np.zeros(len(nodes), np.bool_)
    is_new[first[visited >= known]] = True
    return is_new
