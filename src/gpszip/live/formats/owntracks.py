"""OwnTracks: one JSON object for each message, over HTTP or MQTT.

Format: OwnTracks booklet, docs/tech/json.md. Times are seconds, speeds km/h, headings degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import (
    KMH,
    Context,
    clean_name,
    make_fix,
    read_time,
    scaled,
    to_number,
)

__all__ = ["agent_of_topic", "parse_owntracks"]

#: Levels of a topic: owntracks/USER/DEVICE. Messages below are no positions.
_TOPIC_LEVELS = 3


def parse_owntracks(message: Mapping[str, Any], context: Context) -> list[Fix | Unusable]:
    """Return the fix of a message; other types of messages than locations have none.

    Examples
    --------
    >>> message = {"_type": "location", "tst": 7, "lat": 48.1, "lon": 11.5, "vel": 36, "acc": 0}
    >>> [fix] = parse_owntracks(message, Context(9.0, "owntracks", "ann/phone"))
    >>> fix.speed, fix.accuracy, fix.time
    (10.0, None, 7.0)
    """
    # An encrypted message holds another one.
    kind = message.get("_type")
    if kind == "encrypted":
        if context.unseal is None:
            return [Unusable(context.agent, "encrypted messages of OwnTracks left out")]
        message = context.unseal(message.get("data"))
        kind = message.get("_type") if isinstance(message, Mapping) else None
    if kind != "location":
        reason = "messages of OwnTracks other than locations left out"
        return [Unusable(context.agent, reason, str(kind)[:30])]

    # tid has two letters, and several phones may have the same.
    topic = message.get("topic")
    named = agent_of_topic(topic) if isinstance(topic, str) else ""
    agent = clean_name(context.agent, named, message.get("tid"))
    return [
        make_fix(
            context,
            agent,
            read_time(message.get("tst"), context),
            (to_number(message.get("lat")), to_number(message.get("lon"))),
            kind="location",
            accuracy=message.get("acc"),
            heading=message.get("cog"),
            speed=scaled(message.get("vel"), KMH),
        )
    ]


def agent_of_topic(topic: str) -> str:
    """Return user and device of a topic.

    Examples
    --------
    >>> agent_of_topic("owntracks/ann/phone"), agent_of_topic("my/base/ann/phone")
    ('ann/phone', 'ann/phone')
    """
    levels = [level for level in topic.split("/") if level]
    return "/".join(levels[-(_TOPIC_LEVELS - 1) :])
