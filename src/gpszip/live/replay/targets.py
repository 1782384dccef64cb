"""Where replayed samples go: a server, a socket, or a file."""

from __future__ import annotations

import http.client
import socket
import string
import sys
import time
from collections.abc import Sequence
from http import HTTPStatus
from typing import IO
from urllib.parse import SplitResult, quote

from gpszip.errors import OutputError
from gpszip.live.notices import printable
from gpszip.live.replay.messages import BATCHES, Sample, app_message, nmea_sentences

__all__ = ["DatagramTarget", "HttpTarget", "MqttTarget", "StreamTarget", "accept_client"]

#: Signs that levels of topics don't have, and what stands for them.
_TOPIC_SIGNS = str.maketrans({"/": "-", "+": "-", "#": "-", "\0": "-"})

#: Seconds until a server that does not answer counts as gone.
_TIMEOUT = 60.0


class HttpTarget:
    """Sends the requests of an app, over one connection.

    Parameters
    ----------
    url : SplitResult
        Address and path of the server.
    app : str
        One of :data:`gpszip.live.replay.messages.APPS`.
    token : str, optional
        Is sent as a bearer token.
    """

    def __init__(self, url: SplitResult, app: str, token: str | None) -> None:
        kind = http.client.HTTPSConnection if url.scheme == "https" else http.client.HTTPConnection
        self._connection = kind(url.hostname or "127.0.0.1", url.port, timeout=_TIMEOUT)
        self._url, self._app = url, app
        self._headers: dict[str, str | bytes] = {"User-Agent": "gpszip"}
        if token:
            self._headers["Authorization"] = f"Bearer {token}".encode()
        self.max_samples = BATCHES.get(app, 1)

    def send(self, samples: Sequence[Sample]) -> None:
        """Send a request, and check its answer."""
        message = app_message(self._app, samples)
        path = _joined(self._url, message.path)
        headers = dict(self._headers)
        if message.body is not None:
            headers["Content-Type"] = "application/json"
        try:
            method = "GET" if message.body is None else "POST"
            self._connection.request(method, path, message.body, headers)
            answer = self._connection.getresponse()
            text = answer.read()
        except (OSError, http.client.HTTPException) as error:
            # The next attempt opens the connection anew.
            self._connection.close()
            raise OSError(str(error) or type(error).__name__) from error

        # Errors of the server may pass, and a server that finds this too fast says when to go on.
        if answer.status == HTTPStatus.TOO_MANY_REQUESTS:
            time.sleep(_pause(answer.getheader("Retry-After", "")))
            raise OSError(f"answers {answer.status} {printable(answer.reason)}")
        if answer.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            raise OSError(f"answers {answer.status} {printable(answer.reason)}")
        if answer.status >= HTTPStatus.MULTIPLE_CHOICES:
            shown = printable(f"{answer.reason}: {text.decode('utf-8', 'replace').strip()}")
            raise OutputError(
                f"answers {answer.status} {shown}",
                remedy="check the path of --to, and --token",
            )

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _pause(text: str) -> float:
    """Seconds of a header Retry-After; a second where it has none."""
    return min(float(text[:6]), _TIMEOUT) if text.isdecimal() else 1.0


def _joined(url: SplitResult, path: str) -> str:
    """Join the path and query of a URL with those of a message."""
    own, _, query = path.partition("?")
    queries = "&".join(part for part in (url.query, query) if part)
    joined = f"{url.path.rstrip('/') + own or '/'}{'?' if queries else ''}{queries}"
    # Users write other letters and blanks as they are.
    return quote(joined, safe=string.punctuation)


class MqttTarget:
    """Publishes the messages of OwnTracks; the topic of a track is ``BASE/replay/TRACK``.

    Parameters
    ----------
    url : SplitResult
        ``mqtt://`` or ``mqtts://``, host, port, and the base of topics.
    """

    max_samples = 1

    def __init__(self, url: SplitResult) -> None:
        from gpszip.live.sources.mqtt import client_for, require_paho

        require_paho("--to mqtt://")
        self._base = url.path.strip("/") or "owntracks"
        self._client, host, port = client_for(url.geturl(), "")
        try:
            self._client.connect(host, port)
        except OSError as error:
            raise OutputError(f"can't be reached: {error}", remedy="check --to") from error
        self._client.loop_start()

    def send(self, samples: Sequence[Sample]) -> None:
        """Publish a message, and wait until the broker has it."""
        for sample in samples:
            message = app_message("owntracks", [sample])
            level = sample.track.translate(_TOPIC_SIGNS)
            sent = self._client.publish(f"{self._base}/replay/{level}", message.body, qos=1)
            try:
                sent.wait_for_publish(_TIMEOUT)
            except RuntimeError as error:
                raise OSError(str(error)) from error
            if not sent.is_published():
                raise OSError("the broker does not answer")

    def close(self) -> None:
        """End the connection."""
        self._client.disconnect()
        self._client.loop_stop()


class DatagramTarget:
    """Sends sentences of NMEA as datagrams."""

    max_samples = 1

    def __init__(self, host: str, port: int) -> None:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._address = found[4]
        self._socket = socket.socket(found[0], found[1])

    def send(self, samples: Sequence[Sample]) -> None:
        """Send a datagram for each sample."""
        for sample in samples:
            self._socket.sendto(nmea_sentences(sample), self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class StreamTarget:
    """Writes sentences of NMEA to a file, a pipe or a connection.

    Parameters
    ----------
    stream : binary file
        Is closed at the end, unless it is standard output.
    """

    max_samples = 1

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def send(self, samples: Sequence[Sample]) -> None:
        """Write the sentences of each sample."""
        for sample in samples:
            data = nmea_sentences(sample)
            try:
                self._stream.write(data)
                self._stream.flush()
            except OSError as error:
                # What was written of a sentence can't be taken back, nor sent again.
                raise OutputError(f"can't be written: {error.strerror or error}") from error

    def close(self) -> None:
        """Close the stream."""
        if self._stream is not sys.stdout.buffer:
            self._stream.close()


def accept_client(host: str, port: int) -> IO[bytes]:
    """Wait for a client, as receivers in a network do, and return the connection."""
    with socket.create_server((host, port)) as server:
        connection, _ = server.accept()
        with connection:
            return connection.makefile("wb")
