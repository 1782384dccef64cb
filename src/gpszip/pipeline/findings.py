"""All that the history of an archive tells, part by part, for pages and reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from gpszip.archive import Archive
from gpszip.errors import GPSZipError, InputError, OptionError
from gpszip.history.calendar import Calendar, choose_calendar
from gpszip.history.changes.changes import Changes, find_changes
from gpszip.history.local_time import find_zone
from gpszip.history.rounds import find_rounds
from gpszip.history.stays.find import trips_of_archive, trips_of_log
from gpszip.history.stays.values import Settings
from gpszip.history.traversals import History, read_history
from gpszip.history.trips import choose_trips
from gpszip.history.unusual.own_trips import OwnTrips, score_own_trips
from gpszip.history.usage import Usage, measure_usage
from gpszip.model import Track
from gpszip.model.rounds import Rounds
from gpszip.model.timestamps import counts_from_1970, format_span
from gpszip.model.trips import Trips

__all__ = ["PARTS", "Findings", "check_parts", "find_all"]

#: Parts of a history, by the names of their commands.
PARTS = ("trips", "usage", "changes", "unusual", "rounds")

#: Share of all travel that is before the time from which on changes are sought.
_BEFORE = 0.75

#: False alarms of closures a day that are accepted, as by ``gpszip changes``.
_ALARMS_A_DAY = 0.1

#: The same in the whole time that is compared.
_ALARMS_IN_ALL = 1.0

#: Share of all travel that a usual round tells at least: with less, it is chance.
_MIN_REGULARITY = 0.5

#: Seconds of a day.
_DAY = 86_400.0

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Findings:
    """What the history of an archive tells.

    Parameters
    ----------
    parts : tuple of str
        What was asked for, of :data:`PARTS`.
    history : History or None
        The network of the clean map, and the traversals of its edges; None where nothing moves.
    calendar : Calendar
        Whose hours are told.
    since : float or None
        Time in seconds from which on changes are told, and unusual trips if it was given.
    trips, usage, changes, unusual, rounds : optional
        What was found; None for what was not asked for or can't be told.
    notes : dict of str to str
        Why each part that was asked for can't be told.
    """

    parts: tuple[str, ...]
    history: History | None
    calendar: Calendar
    since: float | None
    trips: Trips | None
    usage: Usage | None
    changes: Changes | None
    unusual: OwnTrips | None
    rounds: Rounds | None
    notes: dict[str, str]


def check_parts(parts: Sequence[str]) -> tuple[str, ...]:
    """Return parts of a history in their order; ``all`` stands for all of them.

    Raises
    ------
    OptionError
        If there is no such part.

    Examples
    --------
    >>> check_parts(["usage", "trips"])
    ('trips', 'usage')
    """
    names = [name.strip() for name in parts]
    unknown = next((name for name in names if name not in (*PARTS, "all")), None)
    if unknown is not None:
        raise OptionError(
            f"{unknown!r} is no part of a history", remedy=f"parts are {', '.join(PARTS)}, and all"
        )
    return tuple(part for part in PARTS if part in names or "all" in names)


def find_all(
    archive: Archive,
    parts: Sequence[str] = PARTS,
    *,
    timezone: str | None = None,
    since: float | None = None,
    tracks: Sequence[Track] = (),
) -> Findings:
    """Find out what the history of an archive tells.

    Traversals, on which all but the trips depend, are listed once.

    Parameters
    ----------
    archive : Archive
        With or without times.
    parts : sequence of str
        What to find, of :data:`PARTS`.
    timezone : str, optional
        Time zone of local hours; by default that of the place, else UTC.
    since : float, optional
        Seconds, as the log counts them: what is new and unusual from then on is told. By default,
        changes are sought in the last quarter of all travel, and all trips are scored.
    tracks : sequence of Track
        The log, if it is at hand: its stated errors tell trips better than an archive can.

    Raises
    ------
    OptionError
        If there is no such part or time zone, or ``since`` lies outside of the archive's times.
    """
    # Refuse what can't be asked.
    parts = check_parts(parts)
    span = archive.time_range
    if since is not None and (span is None or not span[0] < since < span[1]):
        has = "none" if span is None else format_span(*span)
        raise OptionError("since lies outside of the archive's times", remedy=f"it has {has}")
    notes: dict[str, str] = {}

    # Traversals, and whose hours are told.
    try:
        history = read_history(archive)
    except InputError as error:
        history = None
        is_still = not len(archive.clean_map())
        reason = "nothing moves in it" if is_still else error.reason
        notes = dict.fromkeys(PARTS[1:], reason)
    calendar = _choose_calendar(history, span, timezone)
    zone = calendar.name if calendar.source in {"option", "place"} else None

    # Stays and trips: a log that stands still has stays, too.
    trips = None
    log = [track for track in tracks if track.timed and track.id in archive]
    if "trips" in parts or "unusual" in parts:
        trips = _try(
            notes,
            "trips",
            lambda: (
                trips_of_log(log, Settings(), zone)
                if log
                else trips_of_archive(archive, Settings(), zone)
            ),
        )

    # What needs traversals.
    found = _Travel()
    if history is not None:
        found = _find_travel(history, parts, zone, since, trips, notes)
    return Findings(
        parts=parts,
        history=history,
        calendar=calendar,
        since=since if found.changes is None else found.changes.since,
        trips=trips if "trips" in parts else None,
        usage=found.usage,
        changes=found.changes,
        unusual=found.unusual,
        rounds=found.rounds,
        notes={part: text for part, text in notes.items() if part in parts},
    )


def _choose_calendar(
    history: History | None, span: tuple[float, float] | None, timezone: str | None
) -> Calendar:
    """Whose hours are told; where nothing moves, the map doesn't tell the place."""
    if history is not None:
        return choose_calendar(history.network, history.traversals.enter, timezone)
    is_dated = span is not None and counts_from_1970(span[0])
    if timezone is not None and is_dated:
        return Calendar(find_zone(timezone), timezone, "option")
    return Calendar(find_zone("UTC"), "UTC" if is_dated else "", "default" if is_dated else "log")


class _Travel(NamedTuple):
    """What follows from traversals."""

    usage: Usage | None = None
    changes: Changes | None = None
    unusual: OwnTrips | None = None
    rounds: Rounds | None = None


def _find_travel(
    history: History,
    parts: Sequence[str],
    zone: str | None,
    since: float | None,
    trips: Trips | None,
    notes: dict[str, str],
) -> _Travel:
    """Find the parts that follow from traversals."""
    # Without times there are no hours.
    is_timed = bool(np.isfinite(history.traversals.enter).any())
    by = ("hour", "weekday") if is_timed else ()
    cut = choose_trips(history.traversals, trips)

    # Each part by itself, as one that can't be told is no reason to be silent about the others.
    def attempt(part: str, find: Callable[[], T]) -> T | None:
        return _try(notes, part, find) if part in parts else None

    return _Travel(
        usage=attempt("usage", lambda: measure_usage(history, by, zone)),
        changes=attempt("changes", lambda: _compare_times(history, since)),
        unusual=attempt("unusual", lambda: score_own_trips(history, since, cut, zone)),
        rounds=attempt("rounds", lambda: _find_regular_rounds(history, since)),
    )


def _try(notes: dict[str, str], part: str, find: Callable[[], T]) -> T | None:
    """Find a part, or note why it can't be told."""
    try:
        return find()
    except GPSZipError as error:
        notes[part] = error.reason
        return None


def _compare_times(history: History, since: float | None) -> Changes:
    """Changes from a time on; by default in the last quarter of all travel."""
    # Where travel takes days, one false alarm in all is accepted.
    enter = history.traversals.enter
    known = np.sort(enter[np.isfinite(enter)])
    if since is None and len(known):
        since = float(known[int(_BEFORE * len(known))])
        if since == known[0]:
            raise InputError("there is too little travel to compare times")
    after = enter >= (since if since is not None else 0.0)
    days = (known[-1] - since) / _DAY if len(known) and since is not None else 1.0
    alarms = min(_ALARMS_A_DAY, _ALARMS_IN_ALL / max(days, 1e-9))
    return find_changes(history, np.asarray(after, np.bool_), false_alarms=alarms)


def _find_regular_rounds(history: History, since: float | None) -> Rounds:
    """Rounds of a patrol; any long log has some, which tell little of it."""
    found = find_rounds(history, since)
    if found.regularity < _MIN_REGULARITY:
        raise InputError("travel doesn't repeat in rounds")
    return found
