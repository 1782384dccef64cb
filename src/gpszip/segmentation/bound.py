"""The fewest parts that meet an error bound, by bisection."""

from __future__ import annotations

from typing import Any

from gpszip.errors import BoundError, OptionError
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import distances
from gpszip.segmentation.evaluate import rmse as rmse_of

__all__ = ["segment_mean_within"]


def segment_mean_within(
    track: Track,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    m: int | float | None = None,
    **options: Any,
) -> SegmentMean:
    """Find the fewest parts k, up to the search's noise, whose segment mean keeps an error bound.

    Doubles k until the bound is met, then bisects between the last k that failed and the first that met it. With a fixed
    number of segments more parts do not always fit better, so that k then grows by an eighth.

    Parameters
    ----------
    track : Track
        n samples.
    rmse, max_error : float, optional
        Bounds in metres on the root mean squared and on the largest synchronised distance; at least one.
    m : int or float, optional
        Number of segments, or their share of k between 0 and 1; as many as parts where left out.
    **options
        Passed on to :func:`gpszip.segmentation.em.segment_mean`.

    Raises
    ------
    OptionError
        If no bound is given, or one is not positive, or m is out of range.
    BoundError
        If no k that was tried keeps the bound, up to one part a sample.

    Examples
    --------
    >>> track = Track("bend", [0, 1, 2, 3, 4, 5], [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [2, 3]])
    >>> segment_mean_within(track, max_error=0.01).k
    2
    """
    _check_options(rmse, max_error, m)
    low, high, found = 0, _min_k(m), None
    while found is None:
        high = min(high, len(track))
        found = _mean_within_bound(track, high, m, rmse, max_error, options)
        if found is None:
            if high == len(track):
                raise BoundError(
                    f"track {track.id!r}: no number of parts up to {high} keeps the bound; allow more segments or a larger error"
                )
            low, high = high, high + (max(1, high // 8) if isinstance(m, int) else high)
    while high - low > 1:
        middle = (low + high) // 2
        better = (
            _mean_within_bound(track, middle, m, rmse, max_error, options)
            if middle >= _min_k(m)
            else None
        )
        low, high, found = (middle, high, found) if better is None else (low, middle, better)
    return found


def _check_options(rmse: float | None, max_error: float | None, m: int | float | None) -> None:
    bounds = [bound for bound in (rmse, max_error) if bound is not None]
    if not bounds or min(bounds) <= 0:
        raise OptionError("give rmse or max_error, or both, in metres above 0")
    if m is not None and (m < 1 if isinstance(m, int) else not 0 < m <= 1):
        raise OptionError(
            f"m = {m} must be a whole number from 1 on, or a share of k above 0 and up to 1"
        )


def _min_k(m: int | float | None) -> int:
    return m if isinstance(m, int) else 1


def _mean_within_bound(
    track: Track,
    k: int,
    m: int | float | None,
    rmse: float | None,
    max_error: float | None,
    options: dict[str, Any],
) -> SegmentMean | None:
    segments = k if m is None else m if isinstance(m, int) else max(1, round(m * k))
    mean = segment_mean(track, k, segments, **options)
    if rmse is not None and rmse_of(mean, track) > rmse:
        return None
    if max_error is not None and distances(mean, track).max() > max_error:
        return None
    return mean
