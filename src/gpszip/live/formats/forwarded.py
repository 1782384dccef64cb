"""Positions that a Traccar server forwards: a position and its device in one object of JSON.

Format: PositionForwarder of Traccar's server. Speeds are knots.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import (
    KNOT,
    Context,
    clean_name,
    make_fix,
    member,
    read_time,
    scaled,
    to_number,
)

__all__ = ["is_forwarded", "parse_forwarded"]


def is_forwarded(message: Mapping[str, Any]) -> bool:
    """Whether a message is one that a Traccar server forwards."""
    return isinstance(message.get("position"), Mapping) and "device" in message


def parse_forwarded(message: Mapping[str, Any], context: Context) -> Fix | Unusable:
    """Return the fix of a message.

    Raises
    ------
    MessageError
        If it has no name, or a time that can't be read.

    Examples
    --------
    >>> position = {"latitude": 48.1, "longitude": 11.5, "speed": 36.0, "fixTime": 7000,
    ...             "valid": True}
    >>> message = {"position": position, "device": {"uniqueId": "bus"}}
    >>> fix = parse_forwarded(message, Context(9.0, "kafka"))
    >>> fix.agent, fix.time, round(fix.speed, 2)
    ('bus', 7000.0, 18.52)
    """
    position, device = member(message, "position"), member(message, "device")
    agent = clean_name(device.get("uniqueId"), context.agent, device.get("name"))
    if position.get("valid") is False or position.get("outdated") is True:
        return Unusable(agent, "positions that the source marks as not valid left out")
    return make_fix(
        context,
        agent,
        read_time(position.get("fixTime") or position.get("deviceTime"), context),
        (to_number(position.get("latitude")), to_number(position.get("longitude"))),
        kind="position",
        accuracy=position.get("accuracy"),
        heading=position.get("course"),
        speed=scaled(position.get("speed"), KNOT),
    )
