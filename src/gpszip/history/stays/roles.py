"""What places are to those who stay there, by the hours of their stays: home or work."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Role", "find_roles", "usual_hours"]

#: Local hours of the night, in which people are at home: from midnight to 6.
_NIGHT = (0, 6)

#: Local hours of work.
_WORK = (9, 17)

#: Seconds at a place that make a night or a day of work: a good third of its hours.
_MIN_NIGHT = 2.5 * 3600
_MIN_WORK = 3.0 * 3600

#: Nights or days at a place from which it has a role: fewer may be chance.
_MIN_DAYS = 3

#: Share of the nights about which anything is known that are spent at home.
_HOME_SHARE = 0.5

#: Share of such working days that are spent at work: two of five.
_WORK_SHARE = 0.4

#: Share of the days with a visit on which an hour belongs to the usual ones.
_USUAL_SHARE = 0.5

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Role(NamedTuple):
    """What a place seems to be.

    Parameters
    ----------
    name : str
        ``home``, ``work``, or empty.
    evidence : str
        The counts that say so; also where they are too few for a role.
    """

    name: str
    evidence: str


def find_roles(
    place: Integers, owner: Integers, duration: Floats, hour: Integers, day: Integers, count: int
) -> list[Role]:
    """Infer which places are home and work.

    Home is where most nights are spent, at least three and half of those about which anything is
    known; work the other place with most working days (Monday to Friday, 9 to 17 h), at least three
    and two of five.

    Parameters
    ----------
    place, owner : int64 array, shape (n,)
        Place and track of each part of a stay.
    duration : float64 array, shape (n,)
        Seconds.
    hour, day : int64 array, shape (n,)
        Local hour, and local date in days from 1970-01-01.
    count : int
        Number of places.

    Returns
    -------
    list of Role, length count

    Examples
    --------
    >>> day = np.repeat(np.arange(4), 4)
    >>> hour, zeros = np.tile(np.arange(4), 4), np.zeros(16, np.int64)
    >>> find_roles(zeros, zeros, np.full(16, 3600.0), hour, day, 1)
    [Role(name='home', evidence='4 of 4 nights known')]
    """
    # Nights, and working days: 1970-01-01 was a Thursday, day 3 of a week from Monday.
    is_night = (hour >= _NIGHT[0]) & (hour < _NIGHT[1])
    is_weekday = (day + 3) % 7 < 5
    is_work = is_weekday & (hour >= _WORK[0]) & (hour < _WORK[1])
    nights, known_nights = _count_days(place, owner, duration, day, is_night, _MIN_NIGHT, count)
    days, known_days = _count_days(place, owner, duration, day, is_work, _MIN_WORK, count)

    # The best place for each, if there are enough.
    home = _best(nights, known_nights, _HOME_SHARE)
    days_elsewhere = days.copy()
    if home is not None:
        days_elsewhere[home] = 0
    work = _best(days_elsewhere, known_days, _WORK_SHARE)

    roles = []
    for number in range(count):
        name = "home" if number == home else "work" if number == work else ""
        evidence = []
        if nights[number] and name != "work":
            evidence.append(f"{nights[number]} of {known_nights} nights known")
        if days[number] and name != "home":
            evidence.append(f"{days[number]} of {known_days} working days known")
        roles.append(Role(name, "; ".join(evidence)))
    return roles


def _count_days(
    place: Integers,
    owner: Integers,
    duration: Floats,
    day: Integers,
    chosen: NDArray[np.bool_],
    least: float,
    count: int,
) -> tuple[Integers, int]:
    """Count the days of each track on which it is at each place for long enough, and at any."""
    if not chosen.any():
        return np.zeros(count, np.int64), 0
    rows = np.stack([owner[chosen], day[chosen], place[chosen]], axis=1)
    groups, member = np.unique(rows, axis=0, return_inverse=True)
    total = np.bincount(member.reshape(-1), duration[chosen])
    at_place = np.bincount(groups[total >= least, 2], minlength=count)

    days, member = np.unique(rows[:, :2], axis=0, return_inverse=True)
    known = np.bincount(member.reshape(-1), duration[chosen], len(days)) >= least
    return at_place.astype(np.int64), int(known.sum())


def _best(counts: Integers, known: int, share: float) -> int | None:
    if not len(counts):
        return None
    best = int(counts.argmax())
    enough = counts[best] >= max(_MIN_DAYS, share * known)
    return best if enough else None


def usual_hours(duration: Floats, hour: Integers, day: Integers, owner: Integers) -> str:
    """Hours of the day in which a place is occupied on half of the days with a visit, or more.

    Returns
    -------
    str
        Ranges of local hours such as ``0-7, 18-24``; empty if there are none.

    Examples
    --------
    >>> usual_hours(np.full(3, 3600.0), np.array([8, 9, 23]), np.zeros(3, int), np.zeros(3, int))
    '8-10, 23-24'
    """
    if not len(duration):
        return ""
    days = len(np.unique(np.stack([owner, day], axis=1), axis=0))
    share = np.bincount(hour, duration, 24) / (3600.0 * days)
    is_usual = np.concatenate([[False], share >= _USUAL_SHARE, [False]])
    changes = np.diff(is_usual.astype(np.int8))
    begins, ends = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0)
    return ", ".join(f"{begin}-{end}" for begin, end in zip(begins, ends, strict=True))
