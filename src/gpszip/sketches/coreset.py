"""The (k, eps)-coreset: blocks of a log with exact moments that bound the cost of any k-segment."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.kernels.read_only import read_only
from gpszip.model import Plane, SegmentMean
from gpszip.model.text import count_text
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.kernels.block_chain import penalised_block_partition
from gpszip.sketches.kernels.block_costs import block_costs
from gpszip.sketches.pieces import PiecewiseLinear, from_segment_mean

__all__ = ["OVERSAMPLING", "Coreset", "Cost", "eps_of_blocks"]

#: Rounding of a free cost as a share of weight times squared extent, for each merge of a block.
_ROUNDING = 64 * 1.2e-16

#: Factor on the number of blocks among whose edges those of fewer blocks are chosen.
OVERSAMPLING = 8

#: Most steps of the searches for a penalty and for a limit; each halves the logarithm.
_BISECTION_STEPS = 40

#: Share of the time step by which even times may be off: the rounding of epoch seconds.
_EVEN_TOLERANCE = 1e-5

#: Square metres, and weight, in place of zero where a logarithm or a quotient needs more.
_TINY = 1e-300

#: Names of tracks that a message lists.
_MAX_NAMES = 3


class Cost(NamedTuple):
    """Fitting cost of a k-segment in square metres: an estimate, and strict bounds.

    Parameters
    ----------
    estimate : float
        Best guess.
    lower, upper : float
        Bounds on the fitting cost of the samples themselves.
    """

    estimate: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Coreset:
    """Blocks of consecutive samples of tracks, each with its 2 d + 4 moments and its edges.

    It replaces the samples wherever only fitting costs matter. Let tau(f) be the fitting cost of a
    function f, e(B) the cost of block B against its own best line g_B, OPT_k the least cost of
    any k-segment, and EST(f) the sum over blocks of ``|f - g_B|^2 + e(B)``. Then

    - G1, :meth:`cost`: the cost is exact for every f that breaks at block edges only.
    - G2, :meth:`least_cost`: OPT_k is at least the least cost of 2 k - 1 intervals at block
      edges, less the k - 1 largest e(B).
    - G3, :meth:`cost`: ``|tau(f) - EST(f)| <= 2 sum |f - l|_B sqrt(e(B))`` over the blocks B in
      which f breaks, for any lines l. :meth:`cost` returns this interval.
    - :meth:`eps`: if (k - 1) times the largest e(B) is at most ``eps^2 / (4 (1 + eps))`` of OPT_k,
      EST(f) is within eps tau(f) of tau(f) for every k-segment f. Where samples come at even
      times, EST(f) is what :meth:`cost` estimates.
    - G4: a (k,m)-segment is a k-segment, so that all but G2 holds for it as well.

    Parameters
    ----------
    tracks : tuple of str
        Names of the tracks, in the order of their blocks.
    owners : int64 array, shape (B,)
        Track of each block. Blocks of a track are consecutive and in order of time.
    rows : float64 array, shape (B, 10 + 3 d)
        Moments, with the columns of :mod:`gpszip.sketches.kernels.blocks`.
    plane : Plane, optional
        The planes of the positions.
    """

    tracks: tuple[str, ...]
    owners: NDArray[np.int64]
    rows: NDArray[np.float64]
    plane: Plane | None = None

    def __post_init__(self) -> None:
        # Kernels need rows without holes in memory. Nobody may change values that coresets share.
        for name, dtype in (("owners", np.int64), ("rows", np.float64)):
            values = np.ascontiguousarray(getattr(self, name), dtype=dtype)
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def __repr__(self) -> str:
        blocks, tracks = count_text(len(self), "block"), count_text(len(self.tracks), "track")
        return f"Coreset({blocks} of {count_text(self.samples, 'sample')}, {tracks})"

    def __len__(self) -> int:
        """Number of blocks."""
        return len(self.rows)

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int((self.rows.shape[1] - kernel.FIXED_COLUMNS) // 3)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of samples in each block, shape (B,)."""
        return self.rows[:, kernel.COUNT].astype(np.int64)

    @property
    def samples(self) -> int:
        """Number of samples in all blocks."""
        return int(self.counts.sum())

    @property
    def edges(self) -> NDArray[np.float64]:
        """Times of the first and last sample of each block in seconds, shape (B, 2)."""
        return self.rows[:, : kernel.LAST + 1]

    @property
    def free_costs(self) -> NDArray[np.float64]:
        """Cost e(B) of each block against its own best line in square metres, shape (B,)."""
        return np.array([kernel.free_cost(row) for row in self.rows])

    @property
    def error(self) -> float:
        """Sum of the free costs in square metres: the cost of the best lines of all blocks."""
        # fsum rounds once, at the end: bounds must not depend on the order of blocks.
        return math.fsum(self.free_costs)

    @property
    def rmse(self) -> float:
        """Root mean square distance of the samples from their blocks' best lines in metres."""
        return math.sqrt(self.error / max(float(self.rows[:, kernel.WEIGHT].sum()), _TINY))

    def track(self, name: str | None = None) -> Coreset:
        """Return the blocks of one track; the name is optional if there is only one.

        Raises
        ------
        OptionError
            If there is no such track, or several tracks and no name is given.
        """
        if name is None and len(self.tracks) == 1:
            return self
        if name not in self.tracks:
            raise OptionError(
                f"the coreset holds {_list_names(self.tracks)}; name one of these tracks"
                + (f", not {name!r}" if name else "")
            )
        rows = self.rows[self.owners == self.tracks.index(name)]
        return replace(self, tracks=(name,), owners=np.zeros(len(rows), np.int64), rows=rows)

    @property
    def uneven(self) -> NDArray[np.bool_]:
        """Whether the times or weights of each block are uneven, shape (B,).

        :meth:`eps` says nothing about functions that break in such a block.
        """
        # Two samples are always even. JITTER is infinite where weights differ.
        durations = self.rows[:, kernel.LAST] - self.rows[:, kernel.FIRST]
        steps = np.maximum(self.rows[:, kernel.COUNT] - 1, 1)
        return (self.rows[:, kernel.COUNT] > 2) & (
            self.rows[:, kernel.JITTER] > _EVEN_TOLERANCE * durations / steps
        )

    def cost(
        self,
        f: PiecewiseLinear | SegmentMean,
        *,
        times: ArrayLike | None = None,
        track: str | None = None,
    ) -> Cost:
        """Estimate and bound the fitting cost of a k-segment (thesis, definition 4.1.3).

        Parameters
        ----------
        f : PiecewiseLinear or SegmentMean
            A piecewise linear function of time; :func:`~gpszip.sketches.pieces.polyline` makes
            one of knots.
        times : array_like, shape (n,), optional
            Times of the samples, for a segment mean whose intervals start inside blocks.
        track : str, optional
            Name of the track; optional if there is only one.

        Returns
        -------
        Cost
            In square metres. All three agree, up to rounding, if f breaks at block edges only (G1).

        Raises
        ------
        OptionError
            If f has another dimension, or the times are needed and missing.

        Examples
        --------
        >>> from gpszip import Track, coreset
        >>> small = coreset(Track("lane", range(100), [[t % 50] for t in range(100)]), size=4)
        >>> from gpszip.sketches.pieces import polyline
        >>> cost = small.cost(polyline([0, 99], [[24.5], [24.5]]))
        >>> round(cost.lower), round(cost.upper)
        (20825, 20825)
        """
        blocks = self.track(track)
        pieces = f if isinstance(f, PiecewiseLinear) else blocks._pieces_of_mean(f, times)
        if pieces.starts.shape[1] != self.dimension:
            raise OptionError(
                f"the function has {pieces.starts.shape[1]} coordinates, "
                f"the coreset {self.dimension}"
            )

        # Sums over the blocks, rounded outward.
        numbers = (pieces.start_times, pieces.breaks, pieces.starts, pieces.velocities)
        table = block_costs(blocks.rows, *map(read_only, numbers))
        estimate, lower, upper = (math.fsum(column) for column in table.T)
        return Cost(estimate, max(math.nextafter(lower, 0.0), 0.0), math.nextafter(upper, math.inf))

    def _pieces_of_mean(self, mean: SegmentMean, times: ArrayLike | None) -> PiecewiseLinear:
        """Convert a segment mean; without times its boundaries must be block edges."""
        # Given times, intervals may start at any sample.
        if times is not None:
            return from_segment_mean(mean, times)

        # Block at which each interval starts.
        cuts = np.concatenate([[0], np.cumsum(self.counts)])
        blocks = np.searchsorted(cuts, mean.boundaries)
        nearest = cuts[np.minimum(blocks, len(cuts) - 1)]
        if (nearest != mean.boundaries).any() or mean.boundaries[-1] != cuts[-1]:
            raise OptionError(
                "intervals of the segment mean start inside blocks; give the times of the samples"
            )

        # Pieces run from the first sample of an interval's first block to the last of its last one.
        start_times, end_times = self.edges[blocks[:-1], 0], self.edges[blocks[1:] - 1, 1]
        return PiecewiseLinear(
            start_times, end_times, mean.starts[mean.labels], mean.ends[mean.labels]
        )

    def least_cost(self, k: int) -> float:
        """Return a lower bound on the cost of every k-segment, in square metres (G2).

        It is the sum over the tracks, each approximated by a k-segment of its own. At most k - 1
        blocks of a track have a break inside; on the others, any line costs at least as much as
        the block's best line. Two bounds follow, and the better one is taken: the sum of all free
        costs but the k - 1 largest; and the least cost of 2 k - 1 intervals at block edges (by
        duality, with a penalty for each interval), less the k - 1 largest free costs.

        Parameters
        ----------
        k : int
            Number of segments of each track.

        Examples
        --------
        >>> from gpszip import Track, coreset
        >>> small = coreset(Track("bend", range(100), [[abs(t - 50)] for t in range(100)]), size=10)
        >>> small.least_cost(2), small.least_cost(1) > 9000
        (0.0, True)
        """
        if k < 1:
            raise OptionError(f"k is {k}; a track has at least 1 segment")
        return math.fsum(_least_cost(rows, k) for rows in self._by_track())

    def eps(self, k: int) -> float:
        """Return the largest relative error of the estimate for any k-segment.

        It is the least eps for which the sum of the k - 1 largest e(B) is at most
        ``eps^2 / (4 (1 + eps))`` times :meth:`least_cost`; infinite if there is none.
        """
        costliest = math.fsum(_sum_of_costliest(rows, k) for rows in self._by_track())
        return _eps(costliest, self.least_cost(k))

    def reduced(self, size: int) -> Coreset:
        """Merge blocks until at most ``size`` are left, at nearly the least cost.

        The cheapest neighbours are merged until ``8 * size`` blocks are left. From there, two
        methods are tried: merging goes on, or the blocks get a balanced partition. The result with
        the lower total cost is returned. Blocks of different tracks are never merged.

        Raises
        ------
        OptionError
            If ``size`` is less than the number of tracks.
        """
        if size < len(self.tracks):
            raise OptionError(f"{len(self.tracks)} tracks need as many blocks, but size is {size}")
        if len(self) <= size:
            return self
        greedy = self._merge_greedily(size)
        balanced = self._merge_greedily(OVERSAMPLING * size)._balanced_partition(size)
        return balanced if balanced.error < greedy.error else greedy

    def _merge_greedily(self, size: int) -> Coreset:
        """Merge the cheapest neighbours until at most ``size`` blocks are left."""
        rows, owners = self.rows.copy(), self.owners.copy()
        count = kernel.reduce_blocks(rows, owners, len(rows), size)
        return replace(self, rows=rows[:count], owners=owners[:count])

    def _balanced_partition(self, size: int) -> Coreset:
        """Merge blocks under the lowest limit on free costs that leaves at most ``size`` blocks."""
        # Blocks of different tracks are never merged.
        rows_of_tracks = list(self._by_track())

        # Bisect the logarithm of the limit; a higher limit gives fewer blocks.
        low, high, best = 0.0, max(self.error, _TINY), None
        for _ in range(_BISECTION_STEPS):
            limit = math.sqrt(low * high) if low > 0 else high / 2**6
            cuts = [kernel.balanced_blocks(rows, limit) for rows in rows_of_tracks]
            blocks = sum(map(len, cuts)) - len(cuts)
            if blocks > size:
                low = limit
            else:
                high, best = limit, cuts
            is_close = best is not None and low > 0.999 * high
            if blocks == size or is_close or high < 1e-18 * self.error:
                break

            # The first upper end may be too low: raise it if nothing was found below it.
            if best is None and low >= 0.98 * high:
                high = 2**6 * high
        if best is None:
            return self._merge_greedily(size)

        # Merge the blocks of each track between its cuts.
        merged = [
            kernel.merge_between_cuts(rows, cuts)
            for rows, cuts in zip(rows_of_tracks, best, strict=True)
        ]
        owners = np.repeat(self.owners[self._track_starts()], [len(rows) for rows in merged])
        return replace(self, rows=np.concatenate(merged), owners=owners)

    def _track_starts(self) -> NDArray[np.intp]:
        """Return the first block of each track."""
        return np.flatnonzero(np.diff(self.owners, prepend=-1))

    def _by_track(self) -> Iterator[NDArray[np.float64]]:
        """Yield the rows of each track."""
        yield from np.split(self.rows, self._track_starts()[1:])


def eps_of_blocks(rows: NDArray[np.float64], k: int) -> float:
    """Return the largest relative error for any k-segment of one track, see :meth:`Coreset.eps`.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks of a track.
    k : int
        Number of segments, 1 or more.
    """
    return _eps(_sum_of_costliest(rows, k), _least_cost(rows, k))


def _eps(costliest: float, least: float) -> float:
    """Return the least eps with ``costliest <= eps^2 / (4 (1 + eps)) least``.

    The solution of the quadratic equation ``eps^2 - 4 share eps - 4 share = 0``.
    """
    # Blocks that cost nothing leave no error, even where the least cost is 0, too.
    if costliest == 0:
        return 0.0
    share = costliest / least if least > 0 else math.inf
    return 2 * share + 2 * math.sqrt(share * share + share) if math.isfinite(share) else math.inf


def _sum_of_costliest(rows: NDArray[np.float64], k: int) -> float:
    """Return an upper bound on the free costs of the k - 1 most expensive blocks together."""
    return _sum_of_largest(_cost_upper_bounds(rows), k - 1)


def _cost_upper_bounds(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return free costs, rounded up; 0 for blocks of up to two samples, which lie on a line."""
    costs = np.array([kernel.free_cost(row) for row in read_only(rows)])
    return np.where(rows[:, kernel.COUNT] > 2, costs + _rounding_errors(rows), 0.0)


def _rounding_errors(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return bounds on the rounding errors of the free costs."""
    return np.asarray(
        _ROUNDING
        * (rows[:, kernel.DEPTH] + 1)
        * rows[:, kernel.WEIGHT]
        * rows[:, kernel.REACH] ** 2
    )


def _sum_of_largest(values: NDArray[np.float64], count: int) -> float:
    """Return the sum of the largest values."""
    return math.fsum(np.sort(values)[::-1][:count])


def _least_cost(rows: NDArray[np.float64], k: int) -> float:
    """Return a lower bound on the cost of every k-segment of one track."""
    # The blocks without a break.
    rows = read_only(rows)
    costs = np.array([kernel.free_cost(row) for row in rows])
    rounding = math.fsum(_rounding_errors(rows))
    unbroken = math.fsum(costs) - _sum_of_largest(costs, k - 1) - rounding
    if 2 * k - 1 >= len(rows):
        return max(unbroken, 0.0)

    # The entire track as one block bounds the penalty, and the rounding of merged blocks.
    merged = rows[0].copy()
    for row in rows[1:]:
        kernel.append_block(merged, row)
    rounding = (
        _ROUNDING
        * (len(rows) + merged[kernel.DEPTH] + 1)
        * merged[kernel.WEIGHT]
        * merged[kernel.REACH] ** 2
    )

    # 2 k - 1 intervals at block edges
    dual = _dual_bound(rows, 2 * k - 1, kernel.free_cost(read_only(merged)))
    at_edges = float(dual - _sum_of_largest(_cost_upper_bounds(rows), k - 1) - rounding)
    return max(unbroken, at_edges, 0.0)


def _dual_bound(rows: NDArray[np.float64], intervals: int, max_cost: float) -> float:
    """Return a lower bound on the least cost of a number of intervals at block edges.

    For any penalty, ``min (cost + penalty * number) - penalty * intervals`` is one. The best
    penalty, or nearly so, is found by bisection of its logarithm: a higher one gives fewer
    intervals.
    """
    low, high, best = 0.0, max(max_cost, _TINY), 0.0
    for _ in range(_BISECTION_STEPS):
        penalty = math.sqrt(low * high) if low > 0 else high / 2**10
        value, cuts = penalised_block_partition(rows, penalty)
        number = len(cuts) - 1
        best = max(best, value - penalty * intervals)
        if number == intervals or high < 1e-12 * max_cost:
            break
        low, high = (penalty, high) if number > intervals else (low, penalty)
        if low > 0.999 * high:
            break
    return best


def _list_names(names: tuple[str, ...]) -> str:
    """Return the first names, for a message."""
    shown = ", ".join(repr(name) for name in names[:_MAX_NAMES])
    hidden = len(names) - _MAX_NAMES
    return shown + (f" and {hidden} more" if hidden > 0 else "")
