"""Deltas of Signal K: changes of values of vessels, each with its source and time.

Format: Signal K specification, data model and subscription protocol. Angles are radians, speeds
m/s, times ISO 8601.
"""

from __future__ import annotations

import contextlib
import math
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gpszip.live.choice import Choice
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import (
    Context,
    MessageError,
    clean_name,
    make_fix,
    member,
    read_time,
    to_amount,
    to_number,
)
from gpszip.live.notices import Notices

__all__ = ["SIGNALK_PATHS", "SignalKParser"]

#: Paths of the values that make a fix: position, speed and course over ground.
_POSITION = "navigation.position"
_SPEED = "navigation.speedOverGround"
_COURSE = "navigation.courseOverGroundTrue"
SIGNALK_PATHS = (_POSITION, _SPEED, _COURSE)

#: Seconds for which a speed, a course or a date belongs to positions of its source.
_MAX_AGE = 5.0

#: Sentences of NMEA that have a time of day and no date: a server takes its own date for them. And
#: the one that has a date.
_UNDATED, _DATED = frozenset({"GGA", "GLL", "GNS"}), "RMC"

#: Seconds of a day.
_DAY = 86_400.0

#: Vessels and their sources whose last speed and course are kept.
_MAX_STATES = 20_000

#: Letters of a source's name that are compared.
_MAX_SOURCE_LETTERS = 100


@dataclass(slots=True)
class _State:
    """What a source said last: speed in m/s, course in degrees, a time with its date; and when."""

    speed: float | None = None
    speed_at: float = -math.inf
    course: float | None = None
    course_at: float = -math.inf
    date: float = math.nan
    date_at: float = -math.inf


class SignalKParser:
    """Turns deltas into fixes.

    Parameters
    ----------
    name : str
        Agent of the vessel that the server is on board of; its own identifier where it is empty.
    notices : Notices
        Is told what is special.

    Examples
    --------
    >>> parser = SignalKParser("", Notices(print))
    >>> parser.parse({"self": "vessels.urn:mrn:imo:mmsi:230099999"}, Context(9.0, "signalk"))
    []
    >>> value = {"path": "navigation.position", "value": {"latitude": 60.1, "longitude": 24.9}}
    >>> update = {"$source": "gps.1", "timestamp": "1970-01-01T00:00:07Z", "values": [value]}
    >>> [fix] = parser.parse({"updates": [update]}, Context(9.0, "signalk"))
    >>> fix.agent, fix.time, fix.position
    ('230099999', 7.0, (60.1, 24.9))
    """

    def __init__(self, name: str, notices: Notices) -> None:
        self._name, self._notices = name, notices
        self._own = ""
        self._choice = Choice()
        self._states: OrderedDict[tuple[str, str], _State] = OrderedDict()

    def parse(self, message: Any, context: Context) -> list[Fix | Unusable]:
        """Return the fixes of a delta; the greeting of a server has none."""
        # The greeting names the server's own vessel.
        if not isinstance(message, Mapping):
            return [Unusable("", "messages that are no object of JSON left out")]
        own = message.get("self")
        if isinstance(own, str):
            self._own = own.removeprefix("vessels.")
        updates = message.get("updates")
        if not isinstance(updates, list):
            return []

        # Each update has one source and time.
        try:
            agent = self._agent(message.get("context"))
        except MessageError as error:
            return [Unusable("", str(error))]
        found: list[Fix | Unusable] = []
        for update in updates:
            if isinstance(update, Mapping):
                found += self._parse_update(update, agent, context)
        return found

    def _agent(self, vessel: Any) -> str:
        """Return the agent of a context, such as ``vessels.urn:mrn:imo:mmsi:230099999``."""
        urn = vessel.removeprefix("vessels.") if isinstance(vessel, str) else "self"
        if urn in ("self", self._own):
            return clean_name(self._name, _end_of(self._own), "self")
        return clean_name(_end_of(urn))

    def _parse_update(
        self, update: Mapping[str, Any], agent: str, context: Context
    ) -> list[Fix | Unusable]:
        """Return the fix of an update, and keep the speed and course that it has."""
        # A speed and a course may come in other updates than the position.
        listed = update.get("values")
        items = listed if isinstance(listed, list) else []
        values = {
            item["path"]: item.get("value")
            for item in items
            if isinstance(item, Mapping) and isinstance(item.get("path"), str)
        }
        source = _source_of(update)
        state = self._keep(agent, source, values, context.received)

        # A date, too, may come in another sentence.
        sentence = _sentence_of(update)
        if sentence == _DATED:
            with contextlib.suppress(MessageError):
                date = read_time(update.get("timestamp"), context)
                if date is not None:
                    state.date, state.date_at = date, context.received
        if _POSITION not in values:
            return []
        position = values[_POSITION]
        if not isinstance(position, Mapping):
            return [Unusable(agent, "positions that a vessel has lost left out")]

        # One source of each vessel counts.
        try:
            time = read_time(update.get("timestamp"), context)
        except MessageError as error:
            return [Unusable(agent, str(error))]
        if time is not None and sentence in _UNDATED:
            is_new = context.received - state.date_at < _MAX_AGE
            time = self._with_date(time, state.date if is_new else context.received)
        fix = make_fix(
            context,
            agent,
            time,
            (to_number(position.get("latitude")), to_number(position.get("longitude"))),
            kind="delta",
            heading=state.course if context.received - state.course_at < _MAX_AGE else None,
            speed=state.speed if context.received - state.speed_at < _MAX_AGE else None,
        )
        if isinstance(fix, Fix) and not self._choice.takes(
            agent, source, 0, fix.time, context.received
        ):
            self._notices.count("positions of a second source of one vessel left out")
            return []
        return [fix]

    def _with_date(self, time: float, near: float) -> float:
        """A time of day on the day that brings it nearest to another time."""
        days = round((near - time) / _DAY)
        if days:
            self._notices.count("times of sentences without a date put on the right day")
        return time + days * _DAY

    def _keep(self, agent: str, source: str, values: Mapping[str, Any], received: float) -> _State:
        """Keep speed and course, and return those of the source."""
        key = agent, source
        state = self._states.pop(key, None) or _State()
        self._states[key] = state
        if len(self._states) > _MAX_STATES:
            self._states.popitem(last=False)

        # A value that is null is lost.
        if _SPEED in values:
            state.speed, state.speed_at = to_amount(values[_SPEED]), received
        if _COURSE in values:
            radians = to_number(values[_COURSE])
            degrees = None if radians is None else round(math.degrees(radians) % 360, 6)
            state.course, state.course_at = degrees, received
        return state


def _end_of(urn: str) -> str:
    """Return the end of a URN, which is an MMSI or a UUID; URLs stay whole."""
    return urn.rpartition(":")[2] if urn.startswith("urn:") else urn


def _sentence_of(update: Mapping[str, Any]) -> str:
    """Return the kind of the sentence of NMEA that an update was; nothing for others."""
    source = update.get("source")
    sentence = source.get("sentence") if isinstance(source, Mapping) else None
    return sentence if isinstance(sentence, str) else ""


def _source_of(update: Mapping[str, Any]) -> str:
    """Return what identifies the source of an update, the same in all of its messages."""
    named = update.get("$source")
    if isinstance(named, str):
        return named[:_MAX_SOURCE_LETTERS]
    source = member(update, "source")
    parts = (source.get(name) for name in ("label", "type", "src", "talker"))
    return ".".join(str(part)[:_MAX_SOURCE_LETTERS] for part in parts if part is not None)
