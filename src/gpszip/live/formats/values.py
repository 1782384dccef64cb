"""Values in messages: numbers, times, names and JSON, of which none is trusted."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, tzinfo
from typing import Any

from gpszip.live.fix import Fix, Unusable

__all__ = [
    "KMH",
    "KNOT",
    "Context",
    "MessageError",
    "clean_name",
    "make_fix",
    "parse_json",
    "parse_time",
    "read_time",
    "to_number",
]

#: Metres a second of a knot and of a kilometre an hour.
KNOT = 1852 / 3600
KMH = 1 / 3.6

#: Letters of a name at most.
_MAX_NAME_LETTERS = 100

#: Objects and lists within each other, at most.
_MAX_DEPTH = 32

#: Numbers from here on are milliseconds since 1970, and microseconds and nanoseconds from there on.
_TIME_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))

#: A text in JSON, and what is no bracket.
_JSON_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_NO_BRACKET = re.compile(rb"[^\[\]{}]+")

#: Digits of a number in a message at most; longer ones take long to read.
_MAX_NUMBER_LETTERS = 40


class MessageError(ValueError):
    """A message that is not what it should be; its text is the reason."""


@dataclass(frozen=True)
class Context:
    """What is known of a message besides its content.

    Parameters
    ----------
    received : float
        Seconds since 1970.
    source : str
        Name of the source, for :attr:`Fix.source`.
    agent : str
        Who sent it, from the topic, the path or the user; empty if that is not known.
    timezone : tzinfo
        Zone of times that name none.
    unseal : callable, optional
        Opens encrypted messages of OwnTracks.
    """

    received: float
    source: str
    agent: str = ""
    timezone: tzinfo = field(default=UTC)
    unseal: Callable[[Any], Any] | None = None


def to_number(value: Any) -> float | None:
    """Return a finite number, which may stand as a text; None for all else.

    Examples
    --------
    >>> to_number("7.5"), to_number(True), to_number("nan"), to_number("1" * 99)
    (7.5, None, None, None)
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and (len(value) > _MAX_NUMBER_LETTERS or "_" in value):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def to_amount(value: Any) -> float | None:
    """Return a number that is not negative: sources write -1 for what they don't know."""
    number = to_number(value)
    return number if number is not None and number >= 0 else None


def parse_time(value: Any, timezone: tzinfo = UTC) -> float | None:
    """Return a time in seconds since 1970; None for what is none.

    Parameters
    ----------
    value : number or str
        Seconds since 1970, milliseconds from 1e11 on, or ISO 8601, with a blank for the T, too.
    timezone : tzinfo, optional
        Zone of a text without one.

    Examples
    --------
    >>> parse_time("2024-05-01T10:00:00Z"), parse_time(1714557600500), parse_time("noon")
    (1714557600.0, 1714557600.5, None)
    """
    number = to_number(value)
    if number is not None:
        size = abs(number)
        factor = next((factor for least, factor in _TIME_UNITS if size >= least), 1.0)
        return number if factor == 1.0 else round(number * factor, 6)
    if not isinstance(value, str) or len(value) > _MAX_NUMBER_LETTERS:
        return None

    # Overland writes +0200, too.
    try:
        parsed = datetime.fromisoformat(value.strip())
        zoned = parsed if parsed.tzinfo else parsed.replace(tzinfo=timezone)
        return zoned.timestamp()
    except (ValueError, OverflowError, OSError):
        return None


def read_time(value: Any, context: Context) -> float | None:
    """Return the time of a message; None where it has none.

    Raises
    ------
    MessageError
        If it has one that can't be read: the time of receipt is not put in its place.
    """
    if value is None or value == "":
        return None
    time = parse_time(value, context.timezone)
    if time is None:
        raise MessageError("messages whose time can't be read left out")
    return time


def clean_name(*candidates: Any) -> str:
    """Return the first name that is given.

    Raises
    ------
    MessageError
        If there is none, or it can't be one.

    Examples
    --------
    >>> clean_name("", None, " bus ")
    'bus'
    """
    for candidate in candidates:
        if not isinstance(candidate, str | int) or isinstance(candidate, bool):
            continue
        if isinstance(candidate, str) and len(candidate) > 10 * _MAX_NAME_LETTERS:
            raise MessageError("messages with a name of too many letters left out")
        name = str(candidate).strip() if isinstance(candidate, str) else _int_name(candidate)
        if not name:
            continue
        if len(name) > _MAX_NAME_LETTERS:
            raise MessageError("messages with a name of too many letters left out")
        if not name.isprintable():
            raise MessageError("messages with a name that can't be shown left out")
        return name
    raise MessageError("messages without a name of their sender left out")


def _int_name(value: int) -> str:
    # Python refuses to write numbers of thousands of digits.
    return str(value) if abs(value) < 10**_MAX_NUMBER_LETTERS else "9" * (_MAX_NAME_LETTERS + 1)


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


def parse_json(
    data: bytes | str, read_constant: Callable[[str], float | None] = _refuse_constant
) -> Any:
    """Read JSON, in which NaN and infinite numbers are an error.

    Parameters
    ----------
    data : bytes or str
        One value.
    read_constant : callable, optional
        Returns what stands for NaN, Infinity and -Infinity.

    Raises
    ------
    MessageError
        If it is none, or has too many levels.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    if _depth(raw) > _MAX_DEPTH:
        raise MessageError("messages with too many levels of JSON left out")
    try:
        return json.loads(raw, parse_constant=read_constant)
    except (ValueError, RecursionError):
        raise MessageError("messages that are no JSON left out") from None


def _depth(data: bytes) -> int:
    """Levels of objects and lists, or of what looks so."""
    # Few brackets can't be many levels.
    if data.count(b"{") + data.count(b"[") <= _MAX_DEPTH:
        return 0
    brackets = _NO_BRACKET.sub(b"", _JSON_TEXT.sub(b"", data))
    depth = deepest = 0
    for bracket in brackets:
        depth += 1 if bracket in b"[{" else -1
        deepest = max(deepest, depth)
    return deepest


def make_fix(
    context: Context,
    agent: str,
    time: float | None,
    position: tuple[float | None, ...],
    *,
    kind: str,
    accuracy: Any = None,
    heading: Any = None,
    speed: float | None = None,
    geographic: bool = True,
) -> Fix | Unusable:
    """Make a fix of values that a message has.

    Parameters
    ----------
    context : Context
        Where the message comes from.
    agent : str
        A clean name.
    time : float or None
        Seconds since 1970; without one, the time of receipt counts.
    position : tuple
        Latitude and longitude, or x, y[, z].
    kind : str
        Kind of message.
    accuracy, heading : any
        Numbers or not, in metres and degrees.
    speed : float or None
        Metres a second.
    geographic : bool, default True
        Whether the position is in degrees.
    """
    if any(value is None for value in position):
        return Unusable(agent, "messages without a position left out")
    angle = to_amount(heading)

    # Sources write 0 where they don't know the accuracy: no fix is perfect.
    return Fix(
        agent=agent,
        source=context.source,
        time=context.received if time is None else time,
        received=context.received,
        position=tuple(value for value in position if value is not None),
        geographic=geographic,
        accuracy=to_amount(accuracy) or None,
        heading=None if angle is None or angle > 360 else angle % 360,
        speed=speed if speed is not None and speed >= 0 else None,
        quality="arrival" if time is None else "",
        kind=kind,
    )


def member(message: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a member that is an object; an empty one where it is none."""
    value = message.get(name)
    return value if isinstance(value, Mapping) else {}


def scaled(value: Any, factor: float) -> float | None:
    """Return a speed in another unit, to the micrometre; None where it is none."""
    number = to_amount(value)
    return None if number is None else round(number * factor, 6)
