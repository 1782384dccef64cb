"""The least numbers of intervals and segments that meet an error bound, by bisection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import BoundError, OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor
from gpszip.segmentation.em import Problem, SegmentMeanOptions, as_problem

__all__ = ["Report", "segment_mean_within", "shortest_mean_within"]

#: Multiples of the least k that :func:`shortest_mean_within` tries: with more intervals, fewer
#: segments suffice.
_MULTIPLES = (1.0, 1.15, 1.3, 1.6, 2.0, 2.5, 3.0)

#: A search for k with a given m ends once k is this many times the one with the least error: more
#: intervals do not help then. On a patrol of 72,273 samples, 40 segments have their least RMSE,
#: 0.69 m, with about 300 intervals, and 0.72 m with 4,000.
_PATIENCE = 4

#: Told the share of a search that is done.
Report = Callable[[float], None]


def segment_mean_within(
    track: Track | Problem,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    k: int | None = None,
    m: int | float | None = None,
    begins: NDArray[np.int64] | None = None,
    executor: Executor | None = None,
    **options: Unpack[SegmentMeanOptions],
) -> SegmentMean:
    """Find a segment mean within an error bound, with as few intervals or segments as possible.

    Without k, doubles k until the bound is met, then bisects between the last k that failed and the
    first one that met it. With a fixed number of segments, more intervals do not always fit better;
    k then grows by an eighth instead. With k, does the same with m.

    Parameters
    ----------
    track : Track or Problem
        n samples; a problem has its begins and options.
    rmse, max_error : float, optional
        Bounds in metres on the root mean squared and on the largest synchronised distance; at
        least one.
    k : int, optional
        Number of intervals. Default: the least that meets the bound.
    m : int or float, optional
        Number of segments, or their share of k between 0 and 1. Default: k; where k is given, the
        least that meets the bound.
    begins : int64 array, shape (r,), optional
        First sample of each run, as for :func:`gpszip.segmentation.em.segment_mean`.
    executor, **options
        Passed to :func:`gpszip.segmentation.em.segment_mean`.

    Raises
    ------
    OptionError
        If no bound is given, or one is not positive, or k or m is out of range.
    BoundError
        If no number that was tried meets the bound: up to one interval for each sample, or with m
        as long as more intervals lower the error; up to one segment for each of k intervals.

    Examples
    --------
    >>> positions = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [2, 3]]
    >>> track = Track("bend", range(6), positions)
    >>> segment_mean_within(track, max_error=0.01).k
    2
    >>> lane = Track("lane", range(24), [[x] for x in 2 * [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]])
    >>> segment_mean_within(lane, max_error=0.01, k=4).m
    2
    """
    # Search what is not given.
    _check_options(rmse, max_error, m)
    problem = _BoundedProblem(as_problem(track, begins, options), rmse, max_error, executor)
    if k is None:
        return _fewest_intervals(problem, m)
    if m is None:
        return _fewest_segments(problem, k)

    # Both are given: they hold the bound, or not.
    segments = m if isinstance(m, int) else max(1, round(m * k))
    mean = problem.solve(k, segments)
    if problem.excess(mean) > 1:
        raise BoundError(
            f"track {problem.track.id!r}: {k} intervals of {segments} segments don't keep the "
            f"bound; they have {problem.describe(mean)}",
            remedy="leave out k or m, or allow a larger error",
        )
    return mean


def shortest_mean_within(
    track: Track | Problem,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    begins: NDArray[np.int64] | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
    **options: Unpack[SegmentMeanOptions],
) -> SegmentMean:
    """Find a segment mean within an error bound that few numbers describe.

    That are ``2 d m + 2 k``: both ends of each segment, and label and time of each interval. Tries
    the least k that meets the bound with m = k, and up to three times as many; finds the least m
    for each.

    Parameters
    ----------
    track, rmse, max_error, begins, executor, **options
        As for :func:`segment_mean_within`.
    report : callable, optional
        Told the share that is done.

    Examples
    --------
    >>> there_and_back = [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]
    >>> track = Track("lane", range(48), [[x] for x in 4 * there_and_back])
    >>> mean = shortest_mean_within(track, rmse=0.1)
    >>> mean.k, mean.m
    (8, 2)
    """
    # The fewest intervals with segments of their own.
    _check_options(rmse, max_error, None)
    problem = _BoundedProblem(as_problem(track, begins, options), rmse, max_error, executor)
    tell = report or (lambda _share: None)
    best = _fewest_intervals(problem, None)
    ks = sorted({min(round(best.k * multiple), problem.most) for multiple in _MULTIPLES})

    # The fewest segments for that k and for more.
    for done, k in enumerate(ks, 1):
        tell(done / (1 + len(ks)))
        mean = _find_least(problem, partial(problem.solve, k), 1, k)
        if problem.excess(mean) <= 1:
            best = min(best, mean, key=_count_numbers)
    return best


def _count_numbers(mean: SegmentMean) -> int:
    """Numbers that describe a segment mean."""
    return 2 * mean.starts.size + 2 * mean.k


@dataclass(frozen=True, eq=False)
class _BoundedProblem:
    """A problem, and the bounds that its solution is to meet."""

    problem: Problem
    rmse: float | None
    max_error: float | None
    executor: Executor | None

    @property
    def track(self) -> Track:
        """The samples."""
        return self.problem.track

    @property
    def most(self) -> int:
        """Most intervals."""
        return self.problem.most

    @property
    def runs(self) -> int:
        """Number of runs, the least k."""
        return len(self.problem.begins)

    def solve(self, k: int, m: int) -> SegmentMean:
        """Return the segment mean with k intervals and m segments."""
        return self.problem.solve(k, m, executor=self.executor)

    def excess(self, mean: SegmentMean) -> float:
        """Errors of a segment mean as a multiple of their bounds; above 1 beyond one of them."""
        ratios = [0.0]
        if self.rmse is not None:
            ratios.append(self.problem.rmse(mean) / self.rmse)
        if self.max_error is not None:
            ratios.append(self.problem.max_error(mean) / self.max_error)
        return max(ratios)

    def describe(self, mean: SegmentMean) -> str:
        """Name the errors that are bounded, in metres."""
        errors = []
        if self.rmse is not None:
            errors.append(f"an RMSE of {self.problem.rmse(mean):.3g} m")
        if self.max_error is not None:
            errors.append(f"a maximum of {self.problem.max_error(mean):.3g} m")
        return " and ".join(errors)


def _fewest_intervals(problem: _BoundedProblem, m: int | float | None) -> SegmentMean:
    """Return the segment mean with the least k that meets the bound."""

    def solve(k: int) -> SegmentMean:
        if m is None:
            return problem.solve(k, k)
        return problem.solve(k, m if isinstance(m, int) else max(1, round(m * k)))

    # With m fixed, to double k could pass over all that fit.
    least = max(problem.runs, m if isinstance(m, int) else 1)
    found = _find_least(problem, solve, least, problem.most, slowly=isinstance(m, int))
    if problem.excess(found) <= 1:
        return found
    if m is None:
        raise BoundError(
            f"track {problem.track.id!r}: no number of intervals up to {problem.most} keeps "
            "the bound",
            remedy="allow a larger error",
        )
    raise BoundError(
        f"track {problem.track.id!r}: no number of intervals of {found.m} segments keeps the "
        f"bound; {found.k} have {problem.describe(found)}",
        remedy="allow more segments (m), or a larger error",
    )


def _fewest_segments(problem: _BoundedProblem, k: int) -> SegmentMean:
    """Return the segment mean with k intervals and the least m that meets the bound."""
    found = _find_least(problem, partial(problem.solve, k), 1, k)
    if problem.excess(found) <= 1:
        return found

    # Say how many intervals would do, each with a segment of its own.
    own = problem.solve(k, k)
    enough = _fewest_intervals(problem, None).k
    raise BoundError(
        f"track {problem.track.id!r}: {k} intervals don't keep the bound, whatever the number of "
        f"segments; with {k} of their own they have {problem.describe(own)}",
        remedy=f"allow {enough} intervals (k), or a larger error",
    )


def _find_least(
    problem: _BoundedProblem,
    solve: Callable[[int], SegmentMean],
    least: int,
    most: int,
    *,
    slowly: bool = False,
) -> SegmentMean:
    """Return the solution for the least number that meets the bound, else that of least error.

    Numbers double, or grow slowly by an eighth, until one meets it; then they are bisected. Slow
    growth ends where it doesn't lower the error any more.
    """
    # A number that meets the bound; low is the last one that doesn't.
    low, high = 0, min(least, most)
    best, best_number = solve(high), high
    excess = least_excess = problem.excess(best)
    while excess > 1 and high < most and not (slowly and high >= _PATIENCE * best_number):
        growth = max(1, high // 8) if slowly else high
        low, high = high, min(high + growth, most)
        mean = solve(high)
        excess = problem.excess(mean)
        if excess < least_excess:
            best, best_number, least_excess = mean, high, excess
    if least_excess > 1:
        return best

    # Bisection.
    low = max(low, least - 1)
    while high - low > 1:
        middle = (low + high) // 2
        mean = solve(middle)
        if problem.excess(mean) > 1:
            low = middle
        else:
            high, best = middle, mean
    return best


def _check_options(rmse: float | None, max_error: float | None, m: int | float | None) -> None:
    """Raise OptionError if bounds or m are out of range."""
    bounds = [bound for bound in (rmse, max_error) if bound is not None]
    if not bounds or min(bounds) <= 0:
        raise OptionError("give rmse or max_error, or both, in metres above 0")
    if m is not None and (m < 1 if isinstance(m, int) else not 0 < m <= 1):
        raise OptionError(
            f"m = {m} must be a whole number from 1 on, or a share of k above 0 and up to 1"
        )
