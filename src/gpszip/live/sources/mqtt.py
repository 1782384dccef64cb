"""OwnTracks over MQTT: what the broker has is acknowledged once it is on disk.

The session outlives the connection, so that the broker keeps messages (of QoS 1 and 2) while the
listener is off.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from gpszip.errors import MissingExtraError, OptionError
from gpszip.live.fix import Unusable
from gpszip.live.formats.apps import App, parse_message
from gpszip.live.formats.owntracks import agent_of_topic
from gpszip.live.formats.values import Context, MessageError, clean_name, parse_json
from gpszip.live.notices import Notices
from gpszip.live.source import Receiver
from gpszip.live.sources.connection import session_name, split_url
from gpszip.live.sources.lines import store_patiently

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

    from gpszip.live.fix import Fix

__all__ = ["MqttSource", "client_for", "require_paho"]

#: Ports without and with TLS.
_PORT = 1883
_TLS_PORT = 8883

#: Messages that are being stored; the broker's own limit is lower for all but QoS 0.
_MAX_WAITING = 1_000

#: Bytes of a message; those of OwnTracks have a few hundred.
_MAX_MESSAGE_BYTES = 1 << 16

#: Seconds between attempts to connect, at first and at most.
_RETRY_SECONDS = (1, 60)

#: Topic of OwnTracks, below which users and devices are.
_BASE = "owntracks"

_EXAMPLE = "mqtt://user:password@host:1883/owntracks"


class MqttSource:
    """Subscribes to the positions of OwnTracks.

    Parameters
    ----------
    text : str
        ``mqtt://[USER:PASSWORD@]HOST[:PORT][/BASE]``, or ``mqtts://`` with TLS. The topics are
        ``BASE/USER/DEVICE``; BASE is ``owntracks`` by default.
    journal : path
        The journal; names the session.
    notices : Notices
        Is told what happens.
    unseal : callable, optional
        Opens encrypted messages.

    Raises
    ------
    MissingExtraError
        If paho-mqtt is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(
        self,
        text: str,
        journal: str | os.PathLike[str],
        notices: Notices,
        unseal: Callable[[Any], Any] | None = None,
    ) -> None:
        require_paho("--mqtt")
        self._url = text
        self._base = split_url(text, "--mqtt", ("mqtt", "mqtts"), _EXAMPLE).path.strip("/") or _BASE
        if "+" in self._base:
            raise OptionError(
                f"--mqtt: topics begin with one base, not with {self._base}",
                remedy=f"give one such as {_EXAMPLE}",
            )
        self._notices, self._unseal = notices, unseal
        self._is_away = False
        # One machine and journal are one session.
        self._client_id = session_name(journal)
        self._is_ending = False
        self._space = threading.BoundedSemaphore(_MAX_WAITING)

    async def run(self, receiver: Receiver) -> None:
        """Store positions until the task is cancelled."""
        client, host, port = client_for(self._url, self._client_id)
        loop = asyncio.get_running_loop()

        def on_connect(_client: Client, _data: Any, _flags: Any, code: Any, _more: Any) -> None:
            loop.call_soon_threadsafe(self._note_connection, host, code)
            if not code.is_failure:
                client.subscribe(f"{self._base}/+/+", qos=1)

        def on_subscribe(_client: Client, _data: Any, _mid: int, codes: Any, _more: Any) -> None:
            if any(code.is_failure for code in codes):
                loop.call_soon_threadsafe(
                    self._notices.note, "MQTT subscription refused", host, str(codes[0])
                )

        def on_connect_fail(_client: Client, _data: Any) -> None:
            loop.call_soon_threadsafe(self._note_away, host)

        def on_disconnect(_client: Client, _data: Any, _flags: Any, code: Any, _more: Any) -> None:
            if code.is_failure and not self._is_ending:
                loop.call_soon_threadsafe(self._note_away, host)

        def on_message(_client: Client, _data: Any, message: MQTTMessage) -> None:
            # The broker sends no more than it may until older ones are acknowledged.
            while not self._space.acquire(timeout=1):
                if self._is_ending:
                    return
            asyncio.run_coroutine_threadsafe(self._store(client, message, receiver), loop)

        client.on_connect, client.on_message = on_connect, on_message
        client.on_connect_fail, client.on_disconnect = on_connect_fail, on_disconnect
        client.on_subscribe = on_subscribe
        client.connect_async(host, port)
        client.loop_start()
        try:
            await asyncio.Event().wait()
        finally:
            self._is_ending = True
            client.disconnect()
            await asyncio.to_thread(client.loop_stop)

    def _note_connection(self, host: str, code: Any) -> None:
        if code.is_failure:
            self._notices.note("MQTT connection refused", host, str(code))
            self._is_away = True
            return
        if self._is_away:
            self._notices.note("connected again", host)
        self._is_away = False
        self._notices.count("connections to MQTT")

    def _note_away(self, host: str) -> None:
        """Tell once that the broker can't be reached, until it is back."""
        if not self._is_away:
            self._notices.note("can't be reached; will be tried again", host)
        self._is_away = True

    async def _store(self, client: Client, message: MQTTMessage, receiver: Receiver) -> None:
        """Store a message, and acknowledge it then."""
        try:
            await store_patiently(receiver, self._parse(message))
            client.ack(message.mid, message.qos)
        finally:
            self._space.release()

    def _parse(self, message: MQTTMessage) -> list[Fix | Unusable]:
        """Return the fixes of a message."""
        try:
            agent = clean_name(agent_of_topic(message.topic))
            if message.retain:
                # The broker sends the last position again to whoever subscribes.
                return [Unusable(agent, "retained messages left out")]
            if len(message.payload) > _MAX_MESSAGE_BYTES:
                return [Unusable(agent, "messages that are too large left out")]
            content = parse_json(bytes(message.payload))
        except (MessageError, UnicodeDecodeError) as error:
            return [Unusable("", str(error))]
        context = Context(time.time(), "mqtt", agent, unseal=self._unseal)
        return parse_message(App.OWNTRACKS, content, context)


def require_paho(purpose: str) -> None:
    """Raise MissingExtraError unless paho-mqtt is installed."""
    try:
        import paho.mqtt.client
    except ImportError:
        raise MissingExtraError("live", purpose) from None
    del paho


def client_for(text: str, client_id: str) -> tuple[Client, str, int]:
    """Return a client for a URL, its host and its port; it acknowledges nothing by itself."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    url = split_url(text, "MQTT", ("mqtt", "mqtts"), _EXAMPLE)
    client = Client(
        CallbackAPIVersion.VERSION2,
        client_id=client_id,
        clean_session=not client_id,
        manual_ack=True,
    )

    # What the URL says of it.
    client.reconnect_delay_set(*_RETRY_SECONDS)
    if url.username is not None:
        client.username_pw_set(unquote(url.username), unquote(url.password or ""))
    is_tls = url.scheme == "mqtts"
    if is_tls:
        client.tls_set()
    return client, url.hostname or "127.0.0.1", url.port or (_TLS_PORT if is_tls else _PORT)
