"""Slices of tracks too long for memory: where to cut, and how to join their walks again.

Neighbouring slices overlap. Where their walks share a knot in the overlap, they are joined there;
elsewhere a straight segment leads from one walk to the other.
"""

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

__all__ = ["Slice", "batch_slices", "join_at_cut", "slice_tracks"]

#: Share of a slice that overlaps each neighbour.
_OVERLAP = 0.01

#: Samples that overlap, at least: enough for the walks to meet.
_MIN_OVERLAP = 100

#: Knots on either side of a cut from which a joining segment may start or end.
_KNOTS_NEAR_CUT = 12

#: Square metres that a sample without a position counts when joining segments are compared.
_NO_POSITION = 1e12


@dataclass(frozen=True)
class Slice:
    """Samples ``first`` to ``last - 1`` of a track, with overlaps.

    Parameters
    ----------
    track : int
        Number of the track.
    first, last : int
        Samples that are encoded.
    begin, end : int
        Samples for which the walk of this slice counts; the rest overlaps its neighbours.
    """

    track: int
    first: int
    begin: int
    end: int
    last: int

    @property
    def samples(self) -> int:
        """Number of samples, with overlaps."""
        return self.last - self.first

    @property
    def name(self) -> str:
        """Name that no other slice of the log has."""
        return f"{self.track}/{self.begin}"


def slice_tracks(counts: Sequence[int], length: int) -> list[Slice]:
    """Cut tracks into slices of even length.

    Parameters
    ----------
    counts : sequence of int
        Number of samples of each track.
    length : int
        Samples of a slice at most, without overlaps.

    Examples
    --------
    >>> [(each.first, each.begin, each.end, each.last) for each in slice_tracks([700, 3], 400)]
    [(0, 0, 350, 450), (250, 350, 700, 700), (0, 0, 3, 3)]
    """
    overlap = max(int(_OVERLAP * length), _MIN_OVERLAP)
    slices = []
    for track, count in enumerate(counts):
        number = -(-count // length)
        cuts = [count * i // number for i in range(number + 1)]
        for begin, end in pairwise(cuts):
            first, last = max(begin - overlap, 0), min(end + overlap, count)
            slices.append(Slice(track, first, begin, end, last))
    return slices


def batch_slices(slices: Sequence[Slice], length: int) -> list[list[Slice]]:
    """Gather consecutive slices into batches of about ``length`` samples.

    Batches depend on the log alone, so that results don't depend on the number of workers.

    Examples
    --------
    >>> [len(batch) for batch in batch_slices(slice_tracks([100, 100, 250, 80], 400), 200)]
    [2, 1, 1]
    """
    batches: list[list[Slice]] = []
    samples = length
    for each in slices:
        if samples + each.samples > length:
            batches.append([])
            samples = 0
        batches[-1].append(each)
        samples += each.samples
    return batches


def join_at_cut(
    before: GridWalk,
    after: GridWalk,
    overlap: Track,
    cut_time: float,
    grid: QuantisationGrid,
    positions: NDArray[np.float64],
) -> tuple[GridWalk, bool]:
    """Join the walks of two overlapping slices, and say whether they shared a knot.

    Of several shared knots, the one nearest to the cut is taken. Without any, a straight segment
    leads from a knot of the first walk to a later one of the second: the pair with the least
    squared error over the overlap.

    Parameters
    ----------
    before, after : GridWalk
        Walks over the same nodes; both cover ``overlap``.
    overlap : Track
        Samples that both slices have.
    cut_time : float
        Time of the cut in seconds.
    grid : QuantisationGrid
        On which the walks lie.
    positions : float64 array, shape (V, d)
        Positions of the nodes in metres.
    """
    # Express the cut in time steps, and the range of time steps in which both walks have knots.
    cut = (cut_time - grid.epoch / 1000) / step_size(grid.time)
    low, high = int(after.time_steps[0]), int(before.time_steps[-1])

    # a knot that both walks have
    common, in_before, in_after = np.intersect1d(
        before.time_steps, after.time_steps, return_indices=True
    )
    same_node = before.nodes[in_before] == after.nodes[in_after]
    if same_node.any():
        best = np.flatnonzero(same_node)[np.abs(common[same_node] - cut).argmin()]
        i, j = int(in_before[best]), int(in_after[best])
        return _join(before, i, after, j + 1, j), True

    # Else the pair of knots whose segment lies nearest to the samples.
    starts = _nearest_knots(before.time_steps, cut, low - 1, high)
    ends = _nearest_knots(after.time_steps, cut, low, high + 1)
    pairs = [
        (i, j) for i in starts for j in ends if before.time_steps[i] < after.time_steps[j]
    ] or [_outermost_pair(before, after)]
    i, j = min(
        pairs,
        key=lambda pair: _squared_error(
            _join(before, pair[0], after, pair[1], None), overlap, grid, positions
        ),
    )
    return _join(before, i, after, j, None), False


def _outermost_pair(before: GridWalk, after: GridWalk) -> tuple[int, int]:
    """Last knot before the second walk starts, and the first of that; else both last knots."""
    if before.time_steps[0] < after.time_steps[0]:
        return int(np.searchsorted(before.time_steps, after.time_steps[0])) - 1, 0
    return len(before.time_steps) - 1, len(after.time_steps) - 1


def _nearest_knots(time_steps: NDArray[np.int64], cut: float, low: int, high: int) -> list[int]:
    """Indices of the knots nearest to the cut between two times, in order."""
    inside = np.flatnonzero((time_steps >= low) & (time_steps <= high))
    by_distance = np.argsort(np.abs(time_steps[inside] - cut), kind="stable")
    return sorted(inside[by_distance[:_KNOTS_NEAR_CUT]].tolist())


def _join(before: GridWalk, i: int, after: GridWalk, j: int, shared: int | None) -> GridWalk:
    """Knots up to ``i`` of one walk and from ``j`` of the other.

    A straight segment leads from one to the other; none is needed where knot ``shared`` of the
    second walk is knot ``i`` of the first.
    """
    between = np.zeros(1, np.bool_) if shared is None else after.gaps[shared : shared + 1]
    return GridWalk(
        np.concatenate([before.nodes[: i + 1], after.nodes[j:]]),
        np.concatenate([before.time_steps[: i + 1], after.time_steps[j:]]),
        np.concatenate([before.gaps[:i], between, after.gaps[j:]]),
    )


def _squared_error(
    walk: GridWalk, overlap: Track, grid: QuantisationGrid, positions: NDArray[np.float64]
) -> float:
    """Squared error of a walk over the samples of the overlap, in square metres."""
    decoded = Walk(overlap.id, walk.nodes, knot_times(walk.time_steps, grid), walk.gaps)
    errors = synchronised_errors(overlap, decoded, positions)
    return float(np.where(np.isnan(errors), _NO_POSITION, errors**2).sum())
