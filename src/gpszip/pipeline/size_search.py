"""The smallest error whose archive takes at most a given size.

A secant search on the logarithms of error and size: sizes fall about as a power of the error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

__all__ = ["Try", "smallest_error"]

T = TypeVar("T")

#: Share of the size that is aimed at.
_AIM = 0.99

#: Share of the size from which on a try is good enough.
_GOOD = 0.98

#: Power of the error with which size falls, before two tries tell.
_POWER = -1.1

#: Steepest power that two tries are believed to show.
_STEEPEST = -2.5

#: Flattest power that two tries are believed to show.
_FLATTEST = -0.2

#: Effort of the first tries, which find the neighbourhood.
_COARSE_EFFORT = 2

#: First tries at most.
_COARSE_TRIES = 4

#: Relative distance to the size at which the first tries end.
_COARSE_NEAR = 0.1

#: Relative size by which an archive of little effort is larger than one of more.
_COARSE_EXCESS = 0.03

#: Tries at the effort asked for.
_TRIES = 3

#: Further tries where none has fitted yet.
_MORE_TRIES = 6

#: Largest change of the error from one try to the next: a factor of 16.
_MAX_STEP = math.log(16.0)

#: Least change that is worth a try.
_MIN_STEP = math.log(1.003)

#: Metres below which no error is tried.
_FINEST = 1e-3

#: Shares of an interval within which the next try lies, so that the interval shrinks.
_INSIDE = (0.1, 0.9)


@dataclass(frozen=True, eq=False)
class Try(Generic[T]):
    """What one target led to.

    Parameters
    ----------
    size : int
        Bytes.
    error : float
        RMSE reached, in metres.
    result : object
        What it led to, such as an archive.
    """

    size: int
    error: float
    result: T


def smallest_error(
    attempt: Callable[[float, int], Try[T] | None],
    size: int,
    *,
    first: float,
    coarsest: float,
    effort: int,
) -> tuple[Try[T] | None, int]:
    """Find the smallest error that a size allows.

    A few tries at low effort find the neighbourhood; at most three at the effort asked for come
    as near to the size as they can.

    Parameters
    ----------
    attempt : callable
        Takes a target RMSE in metres and an effort; returns None where nothing can be made.
    size : int
        Bytes that must not be exceeded.
    first : float
        RMSE in metres to begin with.
    coarsest : float
        RMSE in metres above which nothing gets any smaller.
    effort : int
        From 1 to 9.

    Returns
    -------
    Try or None
        The one of the smallest error among those that fit; None if even the coarsest is larger.
    int
        Bytes of the smallest that was made.

    Examples
    --------
    >>> def attempt(rmse, effort):
    ...     return Try(20 + int(300 / rmse), rmse, None)
    >>> best, _ = smallest_error(attempt, 900, first=5.0, coarsest=1e3, effort=5)
    >>> best.size, round(best.error, 2)
    (894, 0.34)
    """
    finest, widest = math.log(_FINEST), math.log(max(coarsest, _FINEST))
    search = _Search(attempt, math.log(size), finest, widest)
    error = min(max(math.log(first), search.finest), search.coarsest)
    if effort <= _COARSE_EFFORT:
        return _search_at(search, error, effort, _COARSE_TRIES + _TRIES)
    return _search_at(search, _find_neighbourhood(search, error), effort, _TRIES)


@dataclass(frozen=True, eq=False)
class _Point(Generic[T]):
    """Logarithms of a target and of the size that it led to."""

    error: float
    size: float
    result: Try[T] | None


@dataclass(eq=False)
class _Search(Generic[T]):
    """All tries so far. Errors and sizes are logarithms."""

    attempt: Callable[[float, int], Try[T] | None]
    limit: float
    finest: float
    coarsest: float

    def __post_init__(self) -> None:
        self.points: list[_Point[T]] = []

    def try_at(self, error: float, effort: int) -> _Point[T]:
        """Make a try, and remember it."""
        result = self.attempt(math.exp(error), effort)
        size = math.inf if result is None else math.log(result.size)
        self.points.append(_Point(error, size, result))
        return self.points[-1]

    def next_error(self, tries: list[_Point[T]], aim: float) -> float:
        """Return the error at which the size should be ``aim``."""
        # The try nearest to the limit on either side.
        too_large = [point for point in tries if point.size > self.limit]
        fitting = [point for point in tries if point.size <= self.limit]
        over = max(too_large, key=lambda point: point.error, default=None)
        under = min(fitting, key=lambda point: point.error, default=None)

        # Between the two.
        if over is not None and under is not None and over.error < under.error:
            share = 0.5
            if math.isfinite(over.size):
                share = (over.size - aim) / (over.size - under.size)
            share = min(max(share, _INSIDE[0]), _INSIDE[1])
            return over.error + share * (under.error - over.error)

        # Beyond the last try, by the power law.
        last = tries[-1]
        step = (aim - last.size) / _power(tries) if math.isfinite(last.size) else _MAX_STEP
        step = min(max(step, -_MAX_STEP), _MAX_STEP)
        return min(max(last.error + step, self.finest), self.coarsest)


def _power(tries: list[_Point[T]]) -> float:
    """Power of the error with which size falls, from the last two tries where these show it."""
    if len(tries) < 2 or not math.isfinite(tries[-2].size):
        return _POWER
    before, last = tries[-2:]
    if abs(last.error - before.error) < _MIN_STEP:
        return _POWER
    power = (last.size - before.size) / (last.error - before.error)
    return min(max(power, _STEEPEST), _FLATTEST)


def _find_neighbourhood(search: _Search[T], error: float) -> float:
    """Return about the error at which the size is met, by tries of little effort."""
    aim = search.limit + math.log(_AIM) + _COARSE_EXCESS
    tries: list[_Point[T]] = []
    for _ in range(_COARSE_TRIES):
        tries.append(search.try_at(error, _COARSE_EFFORT))
        error = search.next_error(tries, aim)
        is_near = abs(tries[-1].size - search.limit) < _COARSE_NEAR
        if is_near or abs(error - tries[-1].error) < _MIN_STEP:
            break
    return error


def _search_at(
    search: _Search[T], error: float, effort: int, count: int
) -> tuple[Try[T] | None, int]:
    """Try at the effort asked for; the best of all tries that fit wins."""
    # Make ``count`` tries, and more while none fits; one within 2 % below the limit ends them.
    good = search.limit + math.log(_GOOD)
    tries: list[_Point[T]] = []
    for number in range(count + _MORE_TRIES):
        tries.append(search.try_at(error, effort))
        fitting = [
            point.result
            for point in search.points
            if point.result is not None and point.size <= search.limit
        ]
        if (fitting and number + 1 >= count) or good <= tries[-1].size <= search.limit:
            break

        # The last try is the coarsest, which fits if anything does.
        next_error = search.next_error(tries, search.limit + math.log(_AIM))
        if number + 2 == count + _MORE_TRIES:
            next_error = search.coarsest
        if abs(next_error - error) < _MIN_STEP:
            break
        error = next_error

    # Return the smallest size of all tries, too: it is what the log needs where none fits.
    sizes = [point.result.size for point in search.points if point.result is not None]
    return min(fitting, key=lambda result: result.error, default=None), min(sizes, default=0)
