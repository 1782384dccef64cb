"""Events to a broker: one message each, acknowledged by the broker."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gpszip.live.events import Event
from gpszip.live.sources.connection import split_url
from gpszip.live.sources.mqtt import client_for, require_paho

if TYPE_CHECKING:
    from paho.mqtt.client import Client

__all__ = ["MqttSink", "topic_level"]

#: Topic below which agents are.
_BASE = "gpszip"

#: Level of the topic of events without an agent.
_MAP = "map"

#: Seconds until a broker that does not answer counts as gone.
_TIMEOUT = 30.0

#: Signs that levels of topics don't have, and what stands for them.
_SIGNS = str.maketrans({"/": "-", "+": "-", "#": "-", "$": "-", "\0": "-"})

_EXAMPLE = "mqtt://user:password@host:1883/gpszip"


class MqttSink:
    """Publishes events with QoS 1, not retained; the topic is ``BASE/AGENT/KIND``.

    Parameters
    ----------
    url : str
        ``mqtt://[USER:PASSWORD@]HOST[:PORT][/BASE]`` or ``mqtts://``; BASE is ``gpszip`` by
        default.

    Raises
    ------
    MissingExtraError
        If paho-mqtt is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(self, url: str) -> None:
        require_paho("--output mqtt://")
        self._base = split_url(url, "--output", ("mqtt", "mqtts"), _EXAMPLE).path.strip("/")
        self._base = self._base or _BASE
        self._url = url
        self._client: Client | None = None

    async def send(self, events: Sequence[Event]) -> None:
        """Publish the events, and wait until the broker has them."""
        await asyncio.to_thread(self._publish, events)

    async def close(self) -> None:
        """End the connection."""
        if self._client is not None:
            await asyncio.to_thread(self._disconnect, self._client)

    def _publish(self, events: Sequence[Event]) -> None:
        # After an error, what paho has queued would be sent beside what is sent again.
        try:
            client = self._client = self._client or self._connect()
            for event in events:
                self._publish_one(client, event)
        except (OSError, RuntimeError) as error:
            if self._client is not None:
                self._disconnect(self._client)
            raise OSError(str(error)) from error

    def _publish_one(self, client: Client, event: Event) -> None:
        topic = f"{self._base}/{topic_level(event.agent)}/{event.kind}"
        sent = client.publish(topic, event.to_json(), qos=1)
        sent.wait_for_publish(_TIMEOUT)
        if not sent.is_published():
            raise OSError("the broker does not answer")

    def _connect(self) -> Client:
        client, host, port = client_for(self._url, "")
        client.connect(host, port)
        client.loop_start()
        return client

    def _disconnect(self, client: Client) -> None:
        client.disconnect()
        client.loop_stop()
        self._client = None


def topic_level(agent: str) -> str:
    """Return the level of a topic for an agent.

    Examples
    --------
    >>> topic_level("ann/phone#2"), topic_level("")
    ('ann-phone-2', 'map')
    """
    return agent.translate(_SIGNS).encode("utf-8", "replace").decode() or _MAP
