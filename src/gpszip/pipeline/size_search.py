"""The smallest error whose archive takes at most so many bytes: a secant search on the logarithms of both."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

__all__ = ["Try", "smallest_error"]

T = TypeVar("T")

#: Sizes are aimed at this share of what is allowed, and good enough from that share on.
_AIM, _GOOD = 0.99, 0.98

#: Size falls about as this power of the error.
_POWER = -1.1

#: Effort of the drafts, how many there are at most, how near to the size the last one should come, and how much more they take.
_DRAFT_EFFORT, _DRAFTS, _DRAFT_NEAR, _DRAFT_EXCESS = 2, 4, 0.1, 0.03

#: Tries at the effort asked for, and how many more where none has fitted yet.
_TRIES, _MORE_TRIES = 3, 6

#: Largest factor by which one try changes the error, and the least by which it should.
_LEAP, _STEP = math.log(16.0), math.log(1.003)

#: Metres; nothing finer is tried.
_FINEST = 1e-3


@dataclass(frozen=True, eq=False)
class Try(Generic[T]):
    """What came of one target.

    Parameters
    ----------
    size : int
        Bytes.
    error : float
        RMSE reached, in metres.
    made : object
        What was made.
    """

    size: int
    error: float
    made: T


def smallest_error(
    attempt: Callable[[float, int], Try[T] | None],
    size: int,
    *,
    first: float,
    coarsest: float,
    effort: int,
) -> tuple[Try[T] | None, int]:
    """Find the smallest error that so many bytes allow.

    A few drafts at low effort find the neighbourhood, at most three tries at the effort asked for come as near to the
    size as they can.

    Parameters
    ----------
    attempt : callable
        Takes a target of RMSE in metres and an effort; returns None where nothing could be made.
    size : int
        Bytes that must not be exceeded.
    first, coarsest : float
        RMSE in metres to begin with, and above which nothing gets any smaller.
    effort : int
        From 1 to 9.

    Returns
    -------
    Try or None
        The one of the smallest error among those that fit; None if even the coarsest takes more.
    int
        Bytes of the smallest that was made.

    Examples
    --------
    >>> found, _ = smallest_error(lambda rmse, _: Try(20 + int(300 / rmse), rmse, None), 900, first=5.0, coarsest=1e3, effort=5)
    >>> found.size, round(found.error, 2)
    (894, 0.34)
    """
    search = _Search(attempt, math.log(size), math.log(_FINEST), math.log(max(coarsest, _FINEST)))
    place = min(max(math.log(first), search.finest), search.coarsest)
    if effort <= _DRAFT_EFFORT:
        return _settled(search, place, effort, _DRAFTS + _TRIES)
    return _settled(search, _drafted(search, place), effort, _TRIES)


@dataclass(frozen=True, eq=False)
class _Point(Generic[T]):
    """Logarithms of the target and of the size that it led to."""

    place: float
    size: float
    found: Try[T] | None


@dataclass(eq=False)
class _Search(Generic[T]):
    """All tries so far; every number is a logarithm."""

    attempt: Callable[[float, int], Try[T] | None]
    limit: float
    finest: float
    coarsest: float

    def __post_init__(self) -> None:
        self.made: list[_Point[T]] = []

    def at(self, place: float, effort: int) -> _Point[T]:
        found = self.attempt(math.exp(place), effort)
        self.made.append(_Point(place, math.inf if found is None else math.log(found.size), found))
        return self.made[-1]

    def following(self, tries: list[_Point[T]], aim: float) -> float:
        """Return the place where the size should be ``aim``."""
        over = max(
            (one for one in tries if one.size > self.limit), key=lambda one: one.place, default=None
        )
        under = min(
            (one for one in tries if one.size <= self.limit),
            key=lambda one: one.place,
            default=None,
        )
        if over is not None and under is not None and over.place < under.place:
            share = (
                (over.size - aim) / (over.size - under.size) if math.isfinite(over.size) else 0.5
            )
            return over.place + min(max(share, 0.1), 0.9) * (under.place - over.place)
        last = tries[-1]
        leap = (aim - last.size) / _power(tries) if math.isfinite(last.size) else _LEAP
        return min(max(last.place + min(max(leap, -_LEAP), _LEAP), self.finest), self.coarsest)


def _power(tries: list[_Point[T]]) -> float:
    """Power of the error with which size falls, from the last two tries where these tell."""
    if (
        len(tries) < 2
        or not math.isfinite(tries[-2].size)
        or abs(tries[-1].place - tries[-2].place) < _STEP
    ):
        return _POWER
    found = (tries[-1].size - tries[-2].size) / (tries[-1].place - tries[-2].place)
    return min(max(found, -2.5), -0.2)


def _drafted(search: _Search[T], place: float) -> float:
    """Return about where the size will be met."""
    tries: list[_Point[T]] = []
    for _ in range(_DRAFTS):
        tries.append(search.at(place, _DRAFT_EFFORT))
        place = search.following(tries, search.limit + math.log(_AIM) + _DRAFT_EXCESS)
        if abs(tries[-1].size - search.limit) < _DRAFT_NEAR or abs(place - tries[-1].place) < _STEP:
            break
    return place


def _settled(
    search: _Search[T], place: float, effort: int, count: int
) -> tuple[Try[T] | None, int]:
    """Tries at the effort asked for; all that fit compete."""
    tries: list[_Point[T]] = []
    for number in range(count + _MORE_TRIES):
        tries.append(search.at(place, effort))
        fitting = [
            one.found for one in search.made if one.found is not None and one.size <= search.limit
        ]
        if (fitting and number + 1 >= count) or search.limit + math.log(_GOOD) <= tries[
            -1
        ].size <= search.limit:
            break
        following = search.following(tries, search.limit + math.log(_AIM))
        if number + 2 == count + _MORE_TRIES:
            following = search.coarsest
        if abs(following - place) < _STEP:
            break
        place = following
    smallest = min((one.found.size for one in search.made if one.found is not None), default=0)
    return min(fitting, key=lambda one: one.error, default=None), smallest
