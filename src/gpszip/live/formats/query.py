"""Requests whose fields stand in a query or a form: OsmAnd, GPSLogger, OpenGTS and trackers.

Fields are named as OsmAnd's protocol and as GPSLogger's ``%ALL`` name them. Speeds are m/s, as both
apps send them.
"""

from __future__ import annotations

from collections.abc import Mapping

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import (
    KMH,
    Context,
    clean_name,
    make_fix,
    read_time,
    scaled,
    to_amount,
    to_number,
)

__all__ = ["parse_query"]

#: Names of each field, the preferred one first.
_AGENT = ("id", "deviceid", "device_id", "device", "dev", "aid", "ser")
_LATITUDE = ("lat", "latitude")
_LONGITUDE = ("lon", "lng", "longitude")
_TIME = ("timestamp", "time", "date")
_ACCURACY = ("accuracy", "acc")
_HEADING = ("bearing", "heading", "dir", "direction", "course")
_SPEED = ("speed", "spd")


def parse_query(fields: Mapping[str, str], context: Context) -> list[Fix | Unusable]:
    """Return the fix of a request.

    Examples
    --------
    >>> fields = {"id": "ann", "lat": "48.1", "lon": "11.5", "timestamp": "7000", "speed": "3"}
    >>> [fix] = parse_query(fields, Context(9.0, "osmand"))
    >>> fix.agent, fix.position, fix.time, fix.speed
    ('ann', (48.1, 11.5), 7000.0, 3.0)
    """
    agent = clean_name(_first(fields, _AGENT), context.agent)

    # OpenGTS sends a sentence of the receiver.
    sentence = fields.get("gprmc")
    if sentence:
        return _parse_sentence(sentence, agent, context)
    if fields.get("valid", "").lower() in {"false", "0"}:
        return [Unusable(agent, "positions that the source marks as not valid left out")]

    # The position may stand in one field.
    latitude, longitude = _first(fields, _LATITUDE), _first(fields, _LONGITUDE)
    if latitude is None and "location" in fields:
        latitude, _, longitude = fields["location"].partition(",")
    speed = to_amount(_first(fields, _SPEED))
    if speed is None:
        speed = scaled(fields.get("spd_kph"), KMH)
    return [
        make_fix(
            context,
            agent,
            read_time(_first(fields, _TIME), context),
            (to_number(latitude), to_number(longitude)),
            kind="query",
            accuracy=_first(fields, _ACCURACY),
            heading=_first(fields, _HEADING),
            speed=speed,
        )
    ]


def _first(fields: Mapping[str, str], names: tuple[str, ...]) -> str | None:
    """Return the first field that is there and not empty."""
    return next((fields[name] for name in names if fields.get(name)), None)


def _parse_sentence(sentence: str, agent: str, context: Context) -> list[Fix | Unusable]:
    from gpszip.live.formats.nmea import NmeaParser

    parser = NmeaParser(agent)
    found = parser.push(sentence.strip().encode("ascii", "replace"), context)
    return [*found, *parser.finish(context)]
