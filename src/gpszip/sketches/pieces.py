"""Piecewise linear functions of time, continuous or not, whose cost a coreset can estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.model import SegmentMean
from gpszip.model.text import count_text

__all__ = ["PiecewiseLinear", "from_segment_mean", "polyline"]

#: Metres per second above which the cost of a piece may not fit in a float.
_MAX_SPEED = 1e100


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """k straight pieces, each at constant velocity: a k-segment (thesis, definition 4.1.2).

    Piece j runs from ``starts[j]`` at ``start_times[j]`` to ``ends[j]`` at ``end_times[j]``. If
    there is time between two pieces, each is extended along its own line to the middle. The first
    and the last piece are extended without end.

    Parameters
    ----------
    start_times, end_times : float64 array, shape (k,)
        Seconds, ``start_times[j] <= end_times[j] <= start_times[j + 1]``. A piece without duration
        stays at its start.
    starts, ends : float64 array, shape (k, d)
        Metres.

    Raises
    ------
    OptionError
        If shapes don't fit, times decrease, a number is not finite, or a piece is faster than
        1e100 m/s.
    """

    start_times: NDArray[np.float64]
    end_times: NDArray[np.float64]
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]

    def __repr__(self) -> str:
        pieces, first, last = len(self.starts), self.start_times[0], self.end_times[-1]
        return f"PiecewiseLinear({count_text(pieces, 'piece')}, {first:.10g} to {last:.10g} s)"

    def __post_init__(self) -> None:
        fields = ("start_times", "end_times", "starts", "ends")
        for name in fields:
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, values)
        self._check_shapes()
        if not all(np.isfinite(getattr(self, name)).all() for name in fields):
            raise OptionError("pieces hold a number that is not finite")
        self._check_times_and_speeds()

    def _check_shapes(self) -> None:
        """Raise OptionError if shapes don't fit."""
        # k times and k points
        k = len(self.start_times)
        has_k_pieces = (
            k >= 1
            and self.start_times.shape == (k,)
            and self.end_times.shape == (k,)
            and self.starts.ndim == 2
            and len(self.starts) == k
        )
        if not has_k_pieces:
            raise OptionError(
                "pieces need as many start times, end times, starts and ends, at least one"
            )

        # The same number of axes.
        if self.ends.shape != self.starts.shape:
            raise OptionError(
                f"starts have shape {self.starts.shape}, ends {self.ends.shape}; they must be alike"
            )

    def _check_times_and_speeds(self) -> None:
        """Raise OptionError if times decrease or a piece is too fast."""
        # Pieces in order of time.
        if (self.end_times < self.start_times).any() or (
            self.start_times[1:] < self.end_times[:-1]
        ).any():
            raise OptionError("pieces must follow each other in time")
        duration = (self.end_times - self.start_times)[:, None]
        is_too_fast = np.abs(self.ends - self.starts) > _MAX_SPEED * duration
        if is_too_fast[duration[:, 0] > 0].any():
            raise OptionError(
                f"a piece is faster than {_MAX_SPEED:g} m/s; "
                "let it stay at its start, with the same start and end time"
            )

    @property
    def breaks(self) -> NDArray[np.float64]:
        """Times from which on the next piece counts, shape (k - 1,)."""
        # The middle, from the earlier time on: a sum of two epochs would lose a bit.
        return self.end_times[:-1] + (self.start_times[1:] - self.end_times[:-1]) / 2

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Metres per second, shape (k, d)."""
        duration = (self.end_times - self.start_times)[:, None]
        # Over an infinite duration, a piece that stays at its start has velocity 0.
        return np.asarray((self.ends - self.starts) / np.where(duration > 0, duration, np.inf))


def polyline(times: ArrayLike, positions: ArrayLike) -> PiecewiseLinear:
    """Return the polyline through knots, such as those of an archive's track.

    Parameters
    ----------
    times : array_like, shape (k + 1,)
        Increasing seconds.
    positions : array_like, shape (k + 1, d)
        Metres.

    Examples
    --------
    >>> polyline([0, 2, 3], [[0.0], [4.0], [0.0]]).velocities.tolist()
    [[2.0], [-4.0]]
    """
    times = np.asarray(times, dtype=np.float64)
    positions = np.asarray(positions, dtype=np.float64)
    return PiecewiseLinear(times[:-1], times[1:], positions[:-1], positions[1:])


def from_segment_mean(mean: SegmentMean, times: ArrayLike) -> PiecewiseLinear:
    """Return a (k,m)-segment mean as a function of time.

    Each interval runs from its first sample to its last one.

    Parameters
    ----------
    mean : SegmentMean
        k intervals and m segments.
    times : array_like, shape (n,)
        Times of the samples in seconds.

    Examples
    --------
    >>> starts, ends = np.array([[0.0]]), np.array([[1.0]])
    >>> mean = SegmentMean(np.array([0, 2, 4]), np.array([0, 0], np.int32), starts, ends, 0.0)
    >>> from_segment_mean(mean, [0, 1, 2, 3]).start_times.tolist()
    [0.0, 2.0]
    """
    times = np.asarray(times, dtype=np.float64)
    if mean.boundaries[-1] != len(times):
        raise OptionError(
            f"the segment mean is of {mean.boundaries[-1]} samples, "
            f"but there are {len(times)} times"
        )
    first, last = mean.boundaries[:-1], mean.boundaries[1:] - 1
    return PiecewiseLinear(
        times[first], times[last], mean.starts[mean.labels], mean.ends[mean.labels]
    )
