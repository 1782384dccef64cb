"""Servers that a listener subscribes to, as rosbridge and Signal K are: they wait for one."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gpszip.live.formats.values import MessageError, parse_json
from gpszip.live.replay.messages import Sample, ros_message, ros_topic, signalk_delta
from gpszip.live.sources.websocket import require_websockets

if TYPE_CHECKING:
    from websockets.sync.server import Server, ServerConnection

__all__ = ["RosTarget", "SignalKTarget"]

#: Seconds to wait for a client until this counts as a failure, which is told.
_CLIENT_SECONDS = 10.0


class _ServerTarget:
    """Waits for a client over WebSocket, and sends messages once it has subscribed."""

    max_samples = 1

    def __init__(self, host: str, port: int) -> None:
        from websockets.sync.server import serve

        self._client: ServerConnection | None = None
        self._is_ready = threading.Event()
        self._server: Server = serve(self._talk, host, port)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def send(self, samples: Sequence[Sample]) -> None:
        """Send a message for each sample.

        Raises
        ------
        OSError
            If no client has subscribed, or it is gone.
        """
        from websockets.exceptions import ConnectionClosed

        if not self._is_ready.wait(_CLIENT_SECONDS) or self._client is None:
            raise OSError("no client has subscribed")
        for sample in samples:
            try:
                self._client.send(self._message(sample).decode())
            except ConnectionClosed as error:
                self._is_ready.clear()
                raise OSError("the client went away") from error

    def close(self) -> None:
        """Close the connection, once all is sent."""
        if self._client is not None:
            self._client.close()
        self._server.shutdown()
        self._thread.join()

    def _talk(self, client: ServerConnection) -> None:
        """Answer the requests of a client; the one that came last gets the messages."""
        self._greet(client)
        for text in client:
            try:
                request = parse_json(text)
            except MessageError:
                continue
            if isinstance(request, dict) and self._answer(client, request):
                self._client = client
                self._is_ready.set()

    def _greet(self, client: ServerConnection) -> None:
        """Send what a server sends first."""

    def _answer(self, client: ServerConnection, request: dict[str, Any]) -> bool:
        """Answer a request, and say whether the client has subscribed to all now."""
        raise NotImplementedError

    def _message(self, sample: Sample) -> bytes:
        raise NotImplementedError


class RosTarget(_ServerTarget):
    """A rosbridge with rosapi; each track is a robot with the topic ``/TRACK/fix``.

    Parameters
    ----------
    host, port : str and int
        Where to listen.
    tracks : sequence of str
        The tracks, whose topics are advertised from the beginning.
    """

    def __init__(self, host: str, port: int, tracks: Sequence[str]) -> None:
        require_websockets("--as ros")
        self._topics = sorted({ros_topic(track) for track in tracks})
        self._subscribed: set[str] = set()
        super().__init__(host, port)

    def _greet(self, client: ServerConnection) -> None:  # noqa: ARG002
        self._subscribed = set()

    def _answer(self, client: ServerConnection, request: dict[str, Any]) -> bool:
        if request.get("op") == "call_service":
            types = ["sensor_msgs/msg/NavSatFix"] * len(self._topics)
            answer = {
                "op": "service_response",
                "id": request.get("id"),
                "service": request.get("service"),
                "values": {"topics": self._topics, "types": types},
                "result": True,
            }
            client.send(json.dumps(answer))
        if request.get("op") == "subscribe":
            self._subscribed.add(str(request.get("topic")))
        return self._subscribed >= set(self._topics)

    def _message(self, sample: Sample) -> bytes:
        return ros_message(sample)


class SignalKTarget(_ServerTarget):
    """A server of Signal K; each track is a vessel.

    Parameters
    ----------
    host, port : str and int
        Where to listen.
    """

    def __init__(self, host: str, port: int) -> None:
        require_websockets("--as signalk")
        super().__init__(host, port)

    def _greet(self, client: ServerConnection) -> None:
        hello = {"name": "gpszip", "version": "1", "roles": ["main"]}
        client.send(json.dumps(hello))

    def _answer(self, _client: ServerConnection, request: dict[str, Any]) -> bool:
        return "subscribe" in request

    def _message(self, sample: Sample) -> bytes:
        return signalk_delta(sample)
