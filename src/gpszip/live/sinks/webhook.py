"""Events by HTTP to a server of the user, signed."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import http.client
from collections.abc import Sequence
from http import HTTPStatus
from urllib.parse import SplitResult

from gpszip.errors import OutputError
from gpszip.live.events import Event
from gpszip.live.notices import printable

__all__ = ["WebhookSink", "sign"]

#: Seconds until a server that does not answer counts as gone.
_TIMEOUT = 30.0

#: Bytes of an answer that are read.
_MAX_ANSWER_BYTES = 1 << 16

#: Answers that say that a server has no time, besides those of 500 and more.
_LATER = frozenset({HTTPStatus.REQUEST_TIMEOUT, HTTPStatus.TOO_EARLY, HTTPStatus.TOO_MANY_REQUESTS})


def sign(key: str, timestamp: str, body: bytes) -> str:
    """Return the HMAC-SHA256 of a time, a dot and a body, in hexadecimal digits.

    Examples
    --------
    >>> sign("key", "7", b"{}")[:16]
    '77bc83bd1f404223'
    """
    message = timestamp.encode() + b"." + body
    return hmac.new(key.encode(), message, hashlib.sha256).hexdigest()


class WebhookSink:
    """Posts events as lines of JSON, ``application/x-ndjson``.

    With a key, the header ``X-GPSZip-Signature`` is ``t=TIME,v1=HEX``: TIME is the receipt of the
    newest event in whole seconds, HEX what :func:`sign` returns. ``X-GPSZip-Seq`` is the number of
    the first event. Any answer of 200 to 299 takes the events.

    Parameters
    ----------
    url : SplitResult
        ``http://`` or ``https://``.
    key : str, optional
        Signs what is sent.
    """

    def __init__(self, url: SplitResult, key: str | None = None) -> None:
        self._url, self._key = url, key

    async def send(self, events: Sequence[Event]) -> None:
        """Post the events in one request."""
        if events:
            await asyncio.to_thread(self._post, events)

    def _post(self, events: Sequence[Event]) -> None:
        # What is sent.
        body = "".join(f"{event.to_json()}\n" for event in events).encode("ascii")
        headers = {
            "Content-Type": "application/x-ndjson",
            "User-Agent": "gpszip",
            "X-GPSZip-Seq": str(events[0].seq),
        }
        if self._key is not None:
            timestamp = str(int(max(event.received for event in events)))
            headers["X-GPSZip-Signature"] = f"t={timestamp},v1={sign(self._key, timestamp, body)}"

        # The answer.
        is_tls = self._url.scheme == "https"
        kind = http.client.HTTPSConnection if is_tls else http.client.HTTPConnection
        connection = kind(self._url.hostname or "127.0.0.1", self._url.port, timeout=_TIMEOUT)
        try:
            query = f"?{self._url.query}" if self._url.query else ""
            connection.request("POST", (self._url.path or "/") + query, body, headers)
            answer = connection.getresponse()
            answer.read(_MAX_ANSWER_BYTES)
        except http.client.HTTPException as error:
            raise OSError(str(error) or type(error).__name__) from error
        finally:
            connection.close()
        _check(answer.status, answer.reason)


def _check(status: int, reason: str) -> None:
    """Raise OSError for an answer that may pass, OutputError for one that won't."""
    if HTTPStatus.OK <= status < HTTPStatus.MULTIPLE_CHOICES:
        return
    answer = f"answers {status} {printable(reason)}".strip()
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR or status in _LATER:
        raise OSError(answer)
    raise OutputError(answer, remedy="check the address")
