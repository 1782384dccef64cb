"""Events: what a monitor says of agents and of the map, and the seam for where it goes."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from gpszip.errors import InputError

__all__ = ["KINDS", "ClosableSink", "Event", "EventSink", "event_id", "standing"]

#: Kinds of events, and what each says.
KINDS: Mapping[str, str] = {
    "trip.start": "the agent left a place, or is on its way when it is first heard of",
    "trip.end": "the agent reached the place where its trip ends",
    "stay.start": "the agent stays in place",
    "stay.end": "the agent left the place where it stayed",
    "silent": "nothing was heard of the agent any more; the time is that of its last fix",
    "back": "the agent is heard of again",
    "source.clock": "the times of the agent's fixes are wrong, or right again",
    "source.stale": "the agent's fixes come more than an hour late, or in time again",
    "source.repeat": "the agent repeats its position exactly while it moves, or no longer",
    "edge.enter": "the agent entered an edge of the map",
    "edge.leave": "the agent left an edge",
    "off_map.start": "the agent left the map",
    "off_map.end": "the agent is on the map again",
    "wrong_way": "the agent travels an edge in the direction in which nobody did",
    "predicted": "the node to which the agent seems to go, and when it arrives, have changed",
    "late": "the agent has not arrived when 9 of 10 would have",
    "unusual.turn": "the agent turned where hardly anybody does",
    "unusual.speed": "the agent was much slower or faster than usual on an edge",
    "unusual.stop": "the agent stopped on the way where nobody stops",
    "closed.suspected": "agents go other ways than over an edge, as if it were closed",
    "closed": "hardly any doubt is left that an edge is closed",
    "reopened": "an agent travelled an edge that was closed",
    "new_edge": "a path off the map was travelled again",
    "visited": "a patrol visited an edge of its round",
    "missed": "a patrol completed a round without an edge",
    "round.complete": "a patrol is back where its rounds begin",
}

#: Letters of an id: 64 bits.
_ID_LETTERS = 16

#: Decimals of degrees (1 cm), metres (1 mm) and seconds (1 ms) in JSON.
_DEGREE_DECIMALS = 7
_DECIMALS = 3

#: Names of coordinates in metres.
_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to an agent, or to the map.

    Later fixes may change what is known. Then another event replaces this one: it has an id of its
    own, and ``revises`` names this one. If it is withdrawn, this one did not happen at all.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    id : str
        16 hexadecimal digits: the same log gives the same ids.
    agent : str
        Whom it is about; empty for the map.
    time : float
        When it happened, in seconds since 1970 (or since the agent's own zero).
    received : float
        When the fix was received that told it.
    seq : int
        Number among all events of a listener or monitor, from 1; 0 before it is numbered.
    revises : str, optional
        Id of the event that this one replaces.
    withdrawn : bool, default False
        Whether the event that it replaces did not happen.
    edge : int, optional
        Edge of the map, as :class:`gpszip.Matcher` numbers them.
    forward : bool, optional
        Whether the edge is travelled from its start to its end.
    offset : float, optional
        Metres from the edge's start.
    position : tuple of float, optional
        Latitude and longitude in degrees, or x, y[, z] in metres.
    geographic : bool, default True
        Whether the position is in degrees.
    confidence : float, optional
        Probability that it is true.
    why : str
        The evidence, for a person.
    details : mapping
        More facts, which depend on the kind.

    Examples
    --------
    >>> event = Event("stay.start", "00d1e5", "bus", 7.0, 307.0, position=(48.1, 11.5))
    >>> Event.from_json(event.to_json()) == event
    True
    """

    kind: str
    id: str
    agent: str
    time: float
    received: float
    seq: int = 0
    revises: str | None = None
    withdrawn: bool = False
    edge: int | None = None
    forward: bool | None = None
    offset: float | None = None
    position: tuple[float, ...] | None = None
    geographic: bool = True
    confidence: float | None = None
    why: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        r"""Return the event as one line of JSON in ASCII, without the line's end.

        Fields that are not known are left out; ``gpszip.cli.schemas.EVENT`` is its schema.

        Examples
        --------
        >>> print(Event("silent", "00d1e5", "\x1b[2J", 7.0, 8.0).to_json()[:51])
        {"kind":"silent","id":"00d1e5","agent":"\u001b[2J",
        """
        # What every event has.
        row: dict[str, Any] = {
            "kind": self.kind,
            "id": self.id,
            "agent": self.agent,
            "time": round(self.time, _DECIMALS),
            "received": round(self.received, _DECIMALS),
            "seq": self.seq,
        }

        # What some have.
        if self.revises is not None:
            row["revises"] = self.revises
        if self.withdrawn:
            row["withdrawn"] = True
        if self.edge is not None:
            row |= {"edge": self.edge, "forward": self.forward}
        if self.offset is not None:
            row["offset"] = round(self.offset, _DECIMALS)
        if self.position is not None:
            row |= self._coordinates(self.position)
        if self.confidence is not None:
            row["confidence"] = round(self.confidence, _DECIMALS)
        if self.why:
            row["why"] = self.why
        if self.details:
            row["details"] = dict(self.details)
        return json.dumps(_finite(row), separators=(",", ":"), allow_nan=False)

    def _coordinates(self, position: tuple[float, ...]) -> dict[str, float]:
        if self.geographic:
            latitude, longitude = position[:2]
            return {
                "lat": round(latitude, _DEGREE_DECIMALS),
                "lon": round(longitude, _DEGREE_DECIMALS),
            }
        rounded = [round(number, _DECIMALS) for number in position]
        return dict(zip(_AXES, rounded, strict=False))

    @classmethod
    def from_json(cls, text: str | bytes) -> Event:
        """Return the event of a line.

        Raises
        ------
        InputError
            If the line is none.
        """
        try:
            row = json.loads(text)
            geographic = "lat" in row
            names = ("lat", "lon") if geographic else _AXES
            position = tuple(float(row.pop(name)) for name in names if name in row)
            return cls(**row, position=position or None, geographic=geographic or not position)
        except (TypeError, ValueError, AttributeError):
            raise InputError("is no event") from None


def _finite(value: Any) -> Any:
    """Return a value of JSON with null for numbers that are not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def event_id(*facts: object) -> str:
    """Return the id of what the facts name: its kind, agent, time, and what it revises.

    Examples
    --------
    >>> event_id("stay.start", "bus", 7.0, None)
    'ca9fce56ef345828'
    """
    digest = hashlib.blake2b(digest_size=_ID_LETTERS // 2)
    # Lengths keep ("ab", "c") and ("a", "bc") apart.
    for fact in facts:
        text = (f"{fact:.3f}" if isinstance(fact, float) else str(fact)).encode(
            "utf-8", "surrogatepass"
        )
        digest.update(b"%d:%s" % (len(text), text))
    return digest.hexdigest()


def standing(events: Iterable[Event]) -> list[Event]:
    """Return the events that no later one revises or withdraws, by agent and time.

    Examples
    --------
    >>> first = Event("stay.start", "1", "bus", 7.0, 307.0)
    >>> moved = Event("stay.start", "2", "bus", 9.0, 607.0, revises="1")
    >>> [event.time for event in standing([first, moved])]
    [9.0]
    """
    left: dict[str, Event] = {}
    for event in events:
        if event.revises is not None:
            left.pop(event.revises, None)
        if not event.withdrawn:
            left[event.id] = event
    return sorted(left.values(), key=lambda event: (event.agent, event.time, event.kind))


class EventSink(Protocol):
    """Takes events: a file, a server, a page."""

    async def send(self, events: Sequence[Event]) -> None:
        """Return once the events are where they go; nothing of them is sent again then.

        Raises
        ------
        OSError
            If that may pass: all of them are sent again after a pause.
        GPSZipError
            If it won't: they are left out, and counted.
        """
        ...


@runtime_checkable
class ClosableSink(EventSink, Protocol):
    """A sink that has something to close."""

    async def close(self) -> None:
        """End connections and files."""
        ...
