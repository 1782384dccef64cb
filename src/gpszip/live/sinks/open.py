"""Sinks by their addresses."""

from __future__ import annotations

from gpszip.errors import OptionError
from gpszip.live.events import EventSink
from gpszip.live.sources.connection import split_url

__all__ = ["open_sink"]


def open_sink(text: str, key: str | None = None) -> EventSink:
    """Open the sink of an address.

    Parameters
    ----------
    text : str
        ``-`` for standard output, ``http://`` or ``https://`` for a webhook, ``mqtt://`` or
        ``mqtts://`` for a broker, or a path.
    key : str, optional
        Signs what is posted to a webhook.

    Raises
    ------
    GPSZipError
        If it can't be opened.
    """
    if not text:
        raise OptionError(
            "an empty text is no address of events", remedy="give -, a file, https:// or mqtt://"
        )
    scheme, colon, _ = text.partition("://")
    if text == "-":
        from gpszip.live.sinks.file import StreamSink

        return StreamSink()
    if not colon:
        from gpszip.live.sinks.file import FileSink

        return FileSink(text)
    if scheme in {"mqtt", "mqtts"}:
        from gpszip.live.sinks.mqtt import MqttSink

        return MqttSink(text)
    if scheme in {"http", "https"}:
        from gpszip.live.sinks.webhook import WebhookSink

        url = split_url(text, "--output", ("http", "https"), "https://host/events")
        return WebhookSink(url, key)
    raise OptionError(
        f"events can't be sent to {scheme}://",
        remedy="give -, a file, http://, https:// or mqtt://",
    )
