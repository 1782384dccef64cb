"""Piecewise linear functions of time, continuous or not: what a coreset can price."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.model import SegmentMean
from gpszip.model.text import count_text

__all__ = ["PiecewiseLinear", "from_segment_mean", "polyline"]

#: Metres per second beyond which floats may not hold what a piece costs.
_FASTEST = 1e100


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """k straight pieces, each travelled at constant speed: a k-segment (thesis, definition 4.1.2).

    Piece j runs from ``starts[j]`` at ``begins[j]`` to ``stops[j]`` at ``ends[j]``. Between the end of one and the begin
    of the next, each is continued on its own line to the middle. Before the first and after the last, they are continued, too.

    Parameters
    ----------
    begins, ends : float64 array, shape (k,)
        Seconds, ``begins[j] <= ends[j] <= begins[j + 1]``. Where both are the same, the piece stays at its start.
    starts, stops : float64 array, shape (k, d)
        Metres.

    Raises
    ------
    OptionError
        If the shapes or the times don't go together, a number is not finite, or a piece is faster than 1e100 m/s.
    """

    begins: NDArray[np.float64]
    ends: NDArray[np.float64]
    starts: NDArray[np.float64]
    stops: NDArray[np.float64]

    def __repr__(self) -> str:
        pieces = count_text(len(self.begins), "piece")
        return f"PiecewiseLinear({pieces}, {self.begins[0]:.10g} to {self.ends[-1]:.10g} s)"

    def __post_init__(self) -> None:
        for name in ("begins", "ends", "starts", "stops"):
            object.__setattr__(
                self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            )
        k = len(self.begins)
        if (
            k < 1
            or self.begins.shape != (k,)
            or self.ends.shape != (k,)
            or self.starts.ndim != 2
            or len(self.starts) != k
        ):
            raise OptionError("pieces need as many begins, ends, starts and stops, at least one")
        if self.stops.shape != self.starts.shape:
            raise OptionError(
                f"starts have shape {self.starts.shape}, stops {self.stops.shape}; they must be alike"
            )
        if not all(
            np.isfinite(values).all()
            for values in (self.begins, self.ends, self.starts, self.stops)
        ):
            raise OptionError("pieces hold a number that is not finite")
        if (self.ends < self.begins).any() or (self.begins[1:] < self.ends[:-1]).any():
            raise OptionError("pieces must follow each other in time")
        length = (self.ends - self.begins)[:, None]
        if (np.abs(self.stops - self.starts) > _FASTEST * length)[length[:, 0] > 0].any():
            raise OptionError(
                f"a piece is faster than {_FASTEST:g} m/s; let it stay at its start, with the same begin and end"
            )

    @property
    def breaks(self) -> NDArray[np.float64]:
        """Instants from which the next piece counts, shape (k - 1,)."""
        return self.ends[:-1] + (self.begins[1:] - self.ends[:-1]) / 2

    @property
    def speeds(self) -> NDArray[np.float64]:
        """Metres per second, shape (k, d)."""
        length = (self.ends - self.begins)[:, None]
        return np.asarray((self.stops - self.starts) / np.where(length > 0, length, np.inf))


def polyline(times: ArrayLike, places: ArrayLike) -> PiecewiseLinear:
    """Return the polyline through knots, as an archive decodes to.

    Parameters
    ----------
    times : array_like, shape (k + 1,)
        Increasing seconds.
    places : array_like, shape (k + 1, d)
        Metres.

    Examples
    --------
    >>> polyline([0, 2, 3], [[0.0], [4.0], [0.0]]).speeds.tolist()
    [[2.0], [-4.0]]
    """
    when, where = np.asarray(times, dtype=np.float64), np.asarray(places, dtype=np.float64)
    return PiecewiseLinear(when[:-1], when[1:], where[:-1], where[1:])


def from_segment_mean(mean: SegmentMean, times: ArrayLike) -> PiecewiseLinear:
    """Return a (k,m)-segment mean as a function of time: each part from its first sample to its last.

    Parameters
    ----------
    mean : SegmentMean
        k parts on m segments.
    times : array_like, shape (n,)
        Times of the samples in seconds.

    Examples
    --------
    >>> mean = SegmentMean(np.array([0, 2, 4]), np.array([0, 0], np.int32), np.array([[0.0]]), np.array([[1.0]]), 0.0)
    >>> from_segment_mean(mean, [0, 1, 2, 3]).begins.tolist()
    [0.0, 2.0]
    """
    when = np.asarray(times, dtype=np.float64)
    if mean.boundaries[-1] != len(when):
        raise OptionError(
            f"the segment mean is of {mean.boundaries[-1]} samples, but there are {len(when)} times"
        )
    first, last = mean.boundaries[:-1], mean.boundaries[1:] - 1
    return PiecewiseLinear(
        when[first], when[last], mean.starts[mean.labels], mean.ends[mean.labels]
    )
