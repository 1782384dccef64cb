"""Overland: a batch of GeoJSON features in each request.

Format: README of Overland. Coordinates are longitude and latitude, speeds m/s; negative numbers
stand for unknown ones.
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

__all__ = ["parse_overland"]


def parse_overland(message: Mapping[str, Any], context: Context) -> list[Fix | Unusable]:
    """Return the fixes of a batch; ``current`` repeats one of them, or brings it later.

    Examples
    --------
    >>> feature = {
    ...     "type": "Feature",
    ...     "geometry": {"type": "Point", "coordinates": [11.5, 48.1]},
    ...     "properties": {"timestamp": "1970-01-01T00:00:07Z", "speed": -1, "device_id": "ann"},
    ... }
    >>> [fix] = parse_overland({"locations": [feature]}, Context(9.0, "overland"))
    >>> fix.agent, fix.position, fix.speed
    ('ann', (48.1, 11.5), None)
    """
    locations = message.get("locations")
    if not isinstance(locations, list):
        raise MessageError("messages without locations left out")
    return [_parse_feature(feature, context) for feature in locations]


def _parse_feature(feature: Any, context: Context) -> Fix | Unusable:
    # Visits and actions of the app are features of other types.
    if not isinstance(feature, Mapping):
        return Unusable(context.agent, "items that are no features left out")
    properties, geometry = member(feature, "properties"), member(feature, "geometry")
    try:
        agent = clean_name(properties.get("device_id"), context.agent, properties.get("unique_id"))
        time = read_time(properties.get("timestamp"), context)
    except MessageError as error:
        return Unusable(context.agent, str(error))
    if properties.get("action") is not None:
        return Unusable(agent, "visits and actions of Overland left out")

    # The position.
    coordinates = geometry.get("coordinates")
    if not isinstance(coordinates, list) or len(coordinates) < 2:
        return Unusable(agent, "messages without a position left out")
    return make_fix(
        context,
        agent,
        time,
        (to_number(coordinates[1]), to_number(coordinates[0])),
        kind="Feature",
        accuracy=properties.get("horizontal_accuracy"),
        heading=properties.get("course"),
        speed=to_amount(properties.get("speed")),
    )
