"""The (k, eps)-coreset: blocks of a log, each an exact sketch, that price any k-segment within bounds that never fail."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.model import Plane, SegmentMean
from gpszip.model.text import count_text
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.kernels.block_chain import penalised_block_partition
from gpszip.sketches.kernels.block_costs import block_costs
from gpszip.sketches.pieces import PiecewiseLinear, from_segment_mean

__all__ = ["OVERSAMPLING", "Coreset", "Cost", "eps_of_blocks"]

#: Free costs of blocks are known up to this share of weight times squared reach, for each merge behind them.
_ROUNDING = 64 * 1.2e-16

#: When blocks become fewer, they are chosen among so many times more.
OVERSAMPLING = 8

#: Halvings of the interval in which the price of a part is searched.
_BISECTION_STEPS = 40

#: Share of the time step by which times may be off even steps and still count as even: the rounding of epoch seconds.
_EVEN_TOLERANCE = 1e-5


class Cost(NamedTuple):
    """What a k-segment costs, in square metres.

    Parameters
    ----------
    estimate : float
        The best guess.
    lower, upper : float
        The fitting cost of the samples themselves lies between these.
    """

    estimate: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Coreset:
    """Blocks of consecutive samples of one or more tracks, each with its 2 d + 4 moments and its edges.

    It stands for the samples wherever only fitting costs count. With e(B) the cost of block B against its own best line,
    OPT_k the least cost of any k-segment, and EST(f) the sum over blocks of |f - g_B|^2 + e(B) (theory of coresets):

    - G1, :meth:`cost`: exact for every f that breaks at block edges only, (k,m)-segment or not.
    - G2, :meth:`least_cost`: OPT_k is at least OPT of 2 k - 1 parts at block edges less the k - 1 largest e(B).
    - G3, :meth:`cost`: |tau(f) - EST(f)| <= 2 sum over the blocks in which f breaks of \
|f - l|_B sqrt(e(B)), for any lines l; :meth:`cost` returns the interval, so that it is rigorous for each f.
    - With (k - 1) times the largest e(B) at most eps^2 / (4 (1 + eps)) of OPT_k, EST is within eps tau(f) of tau(f) for
      every k-segment f, :meth:`eps`; where samples come at even times, EST itself is what :meth:`cost` estimates.
    - G4: a (k,m)-segment is a k-segment: all but G2 holds for it as well.

    Parameters
    ----------
    tracks : tuple of str
        Names of the tracks, in the order of their blocks.
    owners : int64 array, shape (B,)
        Track of each block; blocks of a track are together and in order of time.
    rows : float64 array, shape (B, 10 + 3 d)
        Moments, with the columns of :mod:`gpszip.sketches.kernels.blocks`.
    plane : Plane, optional
        Where the positions lie on the earth.
    """

    tracks: tuple[str, ...]
    owners: NDArray[np.int64]
    rows: NDArray[np.float64]
    plane: Plane | None = None

    def __post_init__(self) -> None:
        for name, kind in (("owners", np.int64), ("rows", np.float64)):
            values = np.ascontiguousarray(getattr(self, name), dtype=kind)
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
        """Number of samples that the coreset stands for."""
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
        """Sum of the free costs in square metres: what the blocks as a B-segment cost."""
        return math.fsum(self.free_costs)

    @property
    def rmse(self) -> float:
        """Root mean square distance of the samples from their blocks' best lines in metres."""
        return math.sqrt(self.error / max(float(self.rows[:, kernel.WEIGHT].sum()), 1e-300))

    def track(self, name: str | None = None) -> Coreset:
        """Return the blocks of one track; the name may be left out where there is one only.

        Raises
        ------
        OptionError
            If there is no such track, or several and none is named.
        """
        if name is None and len(self.tracks) == 1:
            return self
        if name not in self.tracks:
            raise OptionError(
                f"the coreset holds {_list_names(self.tracks)}; name one of these tracks"
                + (f", not {name!r}" if name else "")
            )
        mine = self.owners == self.tracks.index(name)
        return replace(
            self, tracks=(name,), owners=np.zeros(int(mine.sum()), np.int64), rows=self.rows[mine]
        )

    @property
    def uneven(self) -> NDArray[np.bool_]:
        """Whether a block's times (or weights) are uneven, so that :meth:`eps` tells nothing of breaks in it, shape (B,)."""
        span = self.rows[:, kernel.LAST] - self.rows[:, kernel.FIRST]
        steps = np.maximum(self.rows[:, kernel.COUNT] - 1, 1)
        return (self.rows[:, kernel.COUNT] > 2) & (
            self.rows[:, kernel.JITTER] > _EVEN_TOLERANCE * span / steps
        )

    def cost(
        self,
        f: PiecewiseLinear | SegmentMean,
        *,
        times: ArrayLike | None = None,
        track: str | None = None,
    ) -> Cost:
        """Price a k-segment or (k,m)-segment: its fitting cost (thesis, definition 4.1.3), estimated, and bounds that hold.

        Parameters
        ----------
        f : Pieces or SegmentMean
            Any piecewise linear function of time: see :func:`~gpszip.sketches.pieces.polyline` for a polyline.
        times : array_like, shape (n,), optional
            Times of the samples, for a segment mean whose parts begin or end within blocks.
        track : str, optional
            Which track; may be left out where there is one only.

        Returns
        -------
        Cost
            In square metres. All three are the same, up to rounding, where f breaks at block edges only (G1).

        Raises
        ------
        OptionError
            If f has another dimension, or its parts can't be told without the times.

        Examples
        --------
        >>> from gpszip import Track, coreset
        >>> small = coreset(Track("lane", range(100), [[t % 50] for t in range(100)]), size=4)
        >>> from gpszip.sketches.pieces import polyline
        >>> price = small.cost(polyline([0, 99], [[24.5], [24.5]]))
        >>> round(price.lower), round(price.upper)
        (20825, 20825)
        """
        own = self.track(track)
        pieces = f if isinstance(f, PiecewiseLinear) else own._pieces_of_mean(f, times)
        if pieces.starts.shape[1] != self.dimension:
            raise OptionError(
                f"the function has {pieces.starts.shape[1]} coordinates, the coreset {self.dimension}"
            )
        table = block_costs(own.rows, pieces.begins, pieces.breaks, pieces.starts, pieces.speeds)
        estimate, lower, upper = (math.fsum(column) for column in table.T)
        return Cost(estimate, max(math.nextafter(lower, 0.0), 0.0), math.nextafter(upper, math.inf))

    def _pieces_of_mean(self, mean: SegmentMean, times: ArrayLike | None) -> PiecewiseLinear:
        if times is not None:
            return from_segment_mean(mean, times)
        before = np.concatenate([[0], np.cumsum(self.counts)])
        at = np.searchsorted(before, mean.boundaries)
        if (before[np.minimum(at, len(before) - 1)] != mean.boundaries).any() or mean.boundaries[
            -1
        ] != before[-1]:
            raise OptionError(
                "parts of the segment mean begin within blocks; give the times of the samples"
            )
        first, last = self.edges[at[:-1], 0], self.edges[at[1:] - 1, 1]
        return PiecewiseLinear(first, last, mean.starts[mean.labels], mean.ends[mean.labels])

    def least_cost(self, k: int) -> float:
        """Lower bound in square metres on the cost of every k-segment of each track, all tracks together (G2).

        No k-segment is cheaper: at most k - 1 blocks of a track have a break, on the others each line costs at least the
        block's own. The bound is the better one of the sum of these costs but the k - 1 largest, and, by duality with a
        price for each part, of the best partition into 2 k - 1 parts at block edges less the k - 1 largest costs.

        Parameters
        ----------
        k : int
            Parts of each track.

        Examples
        --------
        >>> from gpszip import Track, coreset
        >>> small = coreset(Track("bend", range(100), [[abs(t - 50)] for t in range(100)]), size=10)
        >>> small.least_cost(2), small.least_cost(1) > 9000
        (0.0, True)
        """
        if k < 1:
            raise OptionError(f"k is {k}; a track has at least 1 part")
        return math.fsum(_least_cost(rows, k) for rows in self._by_track())

    def eps(self, k: int) -> float:
        """Relative error that the estimate keeps for every k-segment, from the blocks alone; infinite where nothing is known.

        The least eps with sum of the k - 1 largest e(B) <= eps^2 / (4 (1 + eps)) times :meth:`least_cost`.
        """
        return _eps(
            math.fsum(_sum_of_costliest(rows, k) for rows in self._by_track()), self.least_cost(k)
        )

    def reduced(self, size: int) -> Coreset:
        """Return the same with at most ``size`` blocks, never across tracks, of about the least cost at these edges.

        Neighbours that cost least as one are merged until ``8 * size`` blocks are left. From there, either that goes on, or
        their edges are partitioned anew, balanced; what costs less in all is returned.

        Raises
        ------
        OptionError
            If there are more tracks than blocks allowed.
        """
        if size < len(self.tracks):
            raise OptionError(f"{len(self.tracks)} tracks need as many blocks, but size is {size}")
        if len(self) <= size:
            return self
        fine, coarse = self._merge_greedily(OVERSAMPLING * size), self._merge_greedily(size)
        best = fine._balanced_partition(size)
        return best if best.error < coarse.error else coarse

    def _merge_greedily(self, size: int) -> Coreset:
        rows, owners = self.rows.copy(), self.owners.copy()
        count = kernel.reduce_blocks(rows, owners, len(rows), size)
        return replace(self, rows=rows[:count], owners=owners[:count])

    def _balanced_partition(self, size: int) -> Coreset:
        """The balanced partition at block edges for the least limit at which there are at most ``size`` blocks."""
        parts = list(self._by_track())
        low, high, best = 0.0, max(self.error, 1e-300), None
        for _ in range(_BISECTION_STEPS):
            limit = math.sqrt(low * high) if low > 0 else high / 2**6
            cuts = [kernel.balanced_blocks(rows, limit) for rows in parts]
            number = sum(map(len, cuts)) - len(cuts)
            low, high = (limit, high) if number > size else (low, limit)
            best = best if number > size else cuts
            if (
                number == size
                or (best is not None and low > 0.999 * high)
                or high < 1e-18 * self.error
            ):
                break
            high = high if best is not None or low < 0.98 * high else 2**6 * high
        if best is None:
            return self._merge_greedily(size)
        joined = [
            kernel.merge_between_cuts(rows, own) for rows, own in zip(parts, best, strict=True)
        ]
        return replace(
            self,
            rows=np.concatenate(joined),
            owners=np.repeat(self.owners[self._track_starts()], [len(own) for own in joined]),
        )

    def _track_starts(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diff(self.owners, prepend=-1))

    def _by_track(self) -> Iterator[NDArray[np.float64]]:
        yield from np.split(self.rows, self._track_starts()[1:])


def eps_of_blocks(rows: NDArray[np.float64], k: int) -> float:
    """Relative error that the blocks of one track keep for every k-segment, as :meth:`Coreset.eps` tells it.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks of a track.
    k : int
        Parts, 1 or more.
    """
    return _eps(_sum_of_costliest(rows, k), _least_cost(rows, k))


def _eps(worst: float, least: float) -> float:
    """The least eps with ``worst <= eps^2 / (4 (1 + eps)) least``."""
    if worst == 0:
        return 0.0
    share = worst / least if least > 0 else math.inf
    return 2 * share + 2 * math.sqrt(share * share + share) if math.isfinite(share) else math.inf


def _sum_of_costliest(rows: NDArray[np.float64], k: int) -> float:
    """What the k - 1 most expensive blocks of a track cost together."""
    return _sum_of_largest(_cost_upper_bounds(rows), k - 1)


def _cost_upper_bounds(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Free costs, rounded up; 0 where two samples or fewer lie on their line by themselves."""
    costs = np.array([kernel.free_cost(row) for row in rows])
    return np.where(rows[:, kernel.COUNT] > 2, costs + _rounding_errors(rows), 0.0)


def _rounding_errors(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(
        _ROUNDING
        * (rows[:, kernel.DEPTH] + 1)
        * rows[:, kernel.WEIGHT]
        * rows[:, kernel.REACH] ** 2
    )


def _sum_of_largest(values: NDArray[np.float64], count: int) -> float:
    return math.fsum(np.sort(values)[::-1][:count])


def _least_cost(rows: NDArray[np.float64], k: int) -> float:
    costs = np.array([kernel.free_cost(row) for row in rows])
    doubt = math.fsum(_rounding_errors(rows))
    unbroken = math.fsum(costs) - _sum_of_largest(costs, k - 1) - doubt
    if 2 * k - 1 >= len(rows):
        return max(unbroken, 0.0)
    whole = rows[0].copy()
    for row in rows[1:]:
        kernel.append_block(whole, row)
    dual = _dual_bound(rows, 2 * k - 1, kernel.free_cost(whole))
    rounding = (
        _ROUNDING
        * (len(rows) + whole[kernel.DEPTH] + 1)
        * whole[kernel.WEIGHT]
        * whole[kernel.REACH] ** 2
    )
    return max(
        unbroken, float(dual - _sum_of_largest(_cost_upper_bounds(rows), k - 1) - rounding), 0.0
    )


def _dual_bound(rows: NDArray[np.float64], parts: int, most: float) -> float:
    """Largest known lower bound on the cost of so many parts: min (cost + price * number) - price * parts, for any price."""
    low, high, best = 0.0, max(most, 1e-300), 0.0
    for _ in range(_BISECTION_STEPS):
        price = math.sqrt(low * high) if low > 0 else high / 2**10
        value, cuts = penalised_block_partition(rows, price)
        number = len(cuts) - 1
        best = max(best, value - price * parts)
        if number == parts or high < 1e-12 * most:
            break
        low, high = (price, high) if number > parts else (low, price)
        if low > 0.999 * high:
            break
    return best


def _list_names(names: tuple[str, ...]) -> str:
    shown = ", ".join(repr(name) for name in names[:3])
    return shown + (f" and {len(names) - 3} more" if len(names) > 3 else "")
