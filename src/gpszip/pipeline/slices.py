"""Tracks too long for memory, cut in stretches that overlap: where to cut, and how their walks become one again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalk, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.walks.error import synchronised_errors
from gpszip.walks.quantised import knot_times

__all__ = ["Stretch", "cut_stretches", "gather", "seam"]

#: Share of a stretch that overlaps its neighbour on either side, and the fewest samples that do.
_OVERLAP, _LEAST_OVERLAP = 0.01, 100

#: Knots on either side of a cut between which the best way from one walk to the other is looked for.
_KNOTS = 12


@dataclass(frozen=True)
class Stretch:
    """Samples ``first`` to ``last - 1`` of track ``track``; the walk counts from ``begin`` to ``end``, overlaps lie around."""

    track: int
    first: int
    begin: int
    end: int
    last: int

    @property
    def samples(self) -> int:
        """Number of samples, with overlaps."""
        return self.last - self.first


def cut_stretches(counts: Sequence[int], length: int) -> list[Stretch]:
    """Cut tracks in stretches of about even length, none above ``length`` samples but for the overlaps.

    Examples
    --------
    >>> [(one.first, one.begin, one.end, one.last) for one in cut_stretches([700, 3], 400)]
    [(0, 0, 350, 450), (250, 350, 700, 700), (0, 0, 3, 3)]
    """
    out = []
    for track, count in enumerate(counts):
        parts = -(-count // length)
        cuts = [count * i // parts for i in range(parts + 1)]
        overlap = max(int(_OVERLAP * length), _LEAST_OVERLAP)
        for begin, end in pairwise(cuts):
            out.append(
                Stretch(track, max(begin - overlap, 0), begin, end, min(end + overlap, count))
            )
    return out


def gather(stretches: Sequence[Stretch], length: int) -> list[list[Stretch]]:
    """Batches of consecutive stretches, each of about ``length`` samples; they don't depend on who works on them.

    Examples
    --------
    >>> [len(batch) for batch in gather(cut_stretches([100, 100, 250, 80], 400), 200)]
    [2, 1, 1]
    """
    batches: list[list[Stretch]] = []
    held = length
    for stretch in stretches:
        if held + stretch.samples > length:
            batches.append([])
            held = 0
        batches[-1].append(stretch)
        held += stretch.samples
    return batches


def seam(
    before: GridWalk,
    after: GridWalk,
    overlap: Track,
    when: float,
    grid: QuantisationGrid,
    places: NDArray[np.float64],
) -> tuple[GridWalk, bool]:
    """Make one walk of two that overlap, and say whether they met.

    A knot that both have in the overlap is the seam; of several, the one nearest to the cut. Where there is none, a straight
    part leads from a knot of the first walk to a later one of the second, the pair whose parts lie nearest to the samples.

    Parameters
    ----------
    before, after : LatticeWalk
        Walks over the same nodes; both cover ``overlap``.
    overlap : Track
        The samples that both stretches have.
    when : float
        Time of the cut in seconds.
    grid : Frame
        The lattice.
    places : float64 array, shape (V, d)
        Positions of the nodes in metres.
    """
    cut = (when - grid.epoch / 1000) / step_size(grid.time)
    low, high = int(after.time_steps[0]), int(before.time_steps[-1])
    shared, ours, theirs = np.intersect1d(before.time_steps, after.time_steps, return_indices=True)
    met = before.nodes[ours] == after.nodes[theirs]
    if met.any():
        best = np.flatnonzero(met)[np.abs(shared[met] - cut).argmin()]
        return _joined(
            before, int(ours[best]), after, int(theirs[best]) + 1, int(theirs[best])
        ), True
    starts = _near(before.time_steps, cut, low - 1, high)
    ends = _near(after.time_steps, cut, low, high + 1)
    tries = [(i, j) for i in starts for j in ends if before.time_steps[i] < after.time_steps[j]]
    if not tries:
        tries = (
            [(int(np.searchsorted(before.time_steps, low)) - 1, 0)]
            if before.time_steps[0] < low
            else [(len(before.time_steps) - 1, len(after.time_steps) - 1)]
        )
    i, j = min(
        tries,
        key=lambda pair: _misfit(
            _joined(before, pair[0], after, pair[1], None), overlap, grid, places
        ),
    )
    return _joined(before, i, after, j, None), False


def _near(cells: NDArray[np.int64], cut: float, low: int, high: int) -> list[int]:
    inside = np.flatnonzero((cells >= low) & (cells <= high))
    return sorted(inside[np.argsort(np.abs(cells[inside] - cut), kind="stable")[:_KNOTS]].tolist())


def _joined(before: GridWalk, i: int, after: GridWalk, j: int, same: int | None) -> GridWalk:
    """Knots up to i of one walk, those from j of the other; a straight part between, or none where they are the same knot."""
    between = after.gaps[same : same + 1] if same is not None else np.zeros(1, np.bool_)
    gaps = np.concatenate([before.gaps[:i], between, after.gaps[j:]])
    return GridWalk(
        np.concatenate([before.nodes[: i + 1], after.nodes[j:]]),
        np.concatenate([before.time_steps[: i + 1], after.time_steps[j:]]),
        gaps,
    )


def _misfit(
    walk: GridWalk, overlap: Track, grid: QuantisationGrid, places: NDArray[np.float64]
) -> float:
    errors = synchronised_errors(
        overlap, Walk(overlap.id, walk.nodes, knot_times(walk.time_steps, grid), walk.gaps), places
    )
    return float(np.where(np.isnan(errors), 1e12, errors**2).sum())
