"""Messages of apps in JSON, told apart by their members."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.overland import parse_overland
from gpszip.live.formats.owntracks import parse_owntracks
from gpszip.live.formats.traccar import parse_traccar
from gpszip.live.formats.values import Context, MessageError

__all__ = ["App", "app_of", "parse_message"]


class App(Enum):
    """Apps that send positions; the values are the paths of the server."""

    OWNTRACKS = "owntracks"
    OVERLAND = "overland"
    TRACCAR = "traccar"
    OSMAND = "osmand"
    GPSLOGGER = "gpslogger"


_PARSERS = {
    App.OWNTRACKS: parse_owntracks,
    App.OVERLAND: parse_overland,
    App.TRACCAR: parse_traccar,
}


def app_of(message: Any) -> App | None:
    """Find the app that sent a message in JSON; None if it is of none of them.

    Examples
    --------
    >>> app_of({"_type": "location"}), app_of({"locations": []}), app_of([])
    (<App.OWNTRACKS: 'owntracks'>, <App.OVERLAND: 'overland'>, None)
    """
    if not isinstance(message, Mapping):
        return None
    if "_type" in message:
        return App.OWNTRACKS
    if "locations" in message:
        return App.OVERLAND
    if "location" in message and "device_id" in message:
        return App.TRACCAR
    return None


def parse_message(app: App, message: Any, context: Context) -> list[Fix | Unusable]:
    """Return the fixes of a message of an app; what is wrong with it comes back, too."""
    if not isinstance(message, Mapping):
        return [Unusable(context.agent, "messages that are no object of JSON left out")]
    try:
        return _PARSERS[app](message, context)
    except MessageError as error:
        return [Unusable(context.agent, str(error))]
