"""Traccar Client since version 9: one JSON object in each request.

Speeds are m/s, -1 where unknown; times are ISO 8601.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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

__all__ = ["parse_traccar"]


def parse_traccar(message: Mapping[str, Any], context: Context) -> list[Fix | Unusable]:
    """Return the fixes of a message: its location, or a list of them.

    Examples
    --------
    >>> coords = {"latitude": 48.1, "longitude": 11.5, "accuracy": 5, "speed": -1}
    >>> location = {"timestamp": "1970-01-01T00:00:07.000Z", "coords": coords}
    >>> message = {"device_id": "ann", "location": location}
    >>> [fix] = parse_traccar(message, Context(9.0, "traccar"))
    >>> fix.agent, fix.time, fix.accuracy, fix.speed
    ('ann', 7.0, 5.0, None)
    """
    agent = clean_name(message.get("device_id"), context.agent)
    locations = message.get("location")
    if not isinstance(locations, list):
        locations = [locations]
    return [_parse_location(location, agent, context) for location in locations]


def _parse_location(location: Any, agent: str, context: Context) -> Fix | Unusable:
    # One location of several may be wrong.
    if not isinstance(location, Mapping):
        return Unusable(agent, "messages without a position left out")
    coords = member(location, "coords")
    try:
        time = read_time(location.get("timestamp"), context)
    except MessageError as error:
        return Unusable(agent, str(error))

    # Unknown numbers are negative.
    return make_fix(
        context,
        agent,
        time,
        (to_number(coords.get("latitude")), to_number(coords.get("longitude"))),
        kind="location",
        accuracy=coords.get("accuracy"),
        heading=coords.get("heading"),
        speed=to_amount(coords.get("speed")),
    )
