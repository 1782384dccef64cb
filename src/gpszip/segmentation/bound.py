"""The least number of intervals that meets an error bound, by bisection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

from gpszip.errors import BoundError, OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor
from gpszip.segmentation.em import SegmentMeanOptions, segment_mean
from gpszip.segmentation.evaluate import distances
from gpszip.segmentation.evaluate import rmse as rmse_of

__all__ = ["segment_mean_within"]


def segment_mean_within(
    track: Track,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    m: int | float | None = None,
    executor: Executor | None = None,
    **options: Unpack[SegmentMeanOptions],
) -> SegmentMean:
    """Find a segment mean within an error bound, with as few intervals k as bisection finds.

    Doubles k until the bound is met, then bisects between the last k that failed and the first
    one that met it. With a fixed number of segments, more intervals do not always fit better; k
    then grows by an eighth instead.

    Parameters
    ----------
    track : Track
        n samples.
    rmse, max_error : float, optional
        Bounds in metres on the root mean squared and on the largest synchronised distance; at
        least one.
    m : int or float, optional
        Number of segments, or their share of k between 0 and 1. Default: k.
    executor, **options
        Passed to :func:`gpszip.segmentation.em.segment_mean`.

    Raises
    ------
    OptionError
        If no bound is given, or one is not positive, or m is out of range.
    BoundError
        If no k that was tried meets the bound, up to one interval for each sample.

    Examples
    --------
    >>> positions = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [2, 3]]
    >>> segment_mean_within(Track("bend", range(6), positions), max_error=0.01).k
    2
    """
    # Reject bad options before the first run.
    _check_options(rmse, max_error, m)
    problem = _BoundedProblem(track, rmse, max_error, m, executor, options)

    # a k that meets the bound; low is the last one that failed
    low, high = 0, _min_k(m)
    best = None
    while best is None:
        high = min(high, len(track))
        best = problem.solve(high)
        if best is None:
            if high == len(track):
                raise BoundError(
                    f"track {track.id!r}: no number of intervals up to {high} keeps the bound; "
                    "allow more segments or a larger error"
                )
            # With m fixed, to double k could pass over all that fit.
            growth = max(1, high // 8) if isinstance(m, int) else high
            low, high = high, high + growth

    # Bisection.
    while high - low > 1:
        middle = (low + high) // 2
        mean = problem.solve(middle) if middle >= _min_k(m) else None
        if mean is None:
            low = middle
        else:
            high, best = middle, mean
    return best


@dataclass(frozen=True, eq=False)
class _BoundedProblem:
    """The arguments of :func:`segment_mean_within`."""

    track: Track
    rmse: float | None
    max_error: float | None
    m: int | float | None
    executor: Executor | None
    options: SegmentMeanOptions

    def solve(self, k: int) -> SegmentMean | None:
        """Return the segment mean with k intervals, or None if it exceeds a bound."""
        if self.m is None:
            segments = k
        elif isinstance(self.m, int):
            segments = self.m
        else:
            segments = max(1, round(self.m * k))

        mean = segment_mean(self.track, k, segments, executor=self.executor, **self.options)
        if self.rmse is not None and rmse_of(mean, self.track) > self.rmse:
            return None
        if self.max_error is not None and distances(mean, self.track).max() > self.max_error:
            return None
        return mean


def _check_options(rmse: float | None, max_error: float | None, m: int | float | None) -> None:
    """Raise OptionError if bounds or m are out of range."""
    bounds = [bound for bound in (rmse, max_error) if bound is not None]
    if not bounds or min(bounds) <= 0:
        raise OptionError("give rmse or max_error, or both, in metres above 0")
    if m is not None and (m < 1 if isinstance(m, int) else not 0 < m <= 1):
        raise OptionError(
            f"m = {m} must be a whole number from 1 on, or a share of k above 0 and up to 1"
        )


def _min_k(m: int | float | None) -> int:
    """Return the least k that is allowed: m segments need as many intervals."""
    return m if isinstance(m, int) else 1
