"""Vessels by a server of Signal K: a stream of changes over WebSocket.

Nothing is acknowledged: what is sent while the listener is off is gone.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, parse_qsl, urlencode, urlsplit

from gpszip.errors import OptionError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.signalk import SIGNALK_PATHS, SignalKParser
from gpszip.live.formats.values import Context, MessageError, member, parse_json
from gpszip.live.notices import Notices
from gpszip.live.source import Receiver
from gpszip.live.sources.batches import batches_of
from gpszip.live.sources.connection import CONNECT_SECONDS, split_url
from gpszip.live.sources.lines import store_patiently
from gpszip.live.sources.websocket import (
    MAX_MESSAGE_BYTES,
    keep_connected,
    require_websockets,
)

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

__all__ = ["SignalKSource"]

#: Where a server has its stream, and where it says where that is.
_STREAM = "/signalk/v1/stream"
_DISCOVERY = "/signalk"

#: Field of an address that says which vessels are wanted, and what it may say.
_VESSELS = "vessels"
_CONTEXTS = {"all": "vessels.*", "self": "vessels.self"}

_EXAMPLE = "ws://boat:3000 or http://boat:3000"


class SignalKSource:
    """Subscribes to positions of vessels.

    Parameters
    ----------
    text : str
        ``ws://HOST:PORT`` or ``wss://``; or ``http://HOST:PORT`` or ``https://``, where the server
        says at ``/signalk`` where its stream is. ``?vessels=self`` behind it leaves out others.
    name : str
        Agent of the server's own vessel.
    notices : Notices
        Is told what happens.

    Raises
    ------
    MissingExtraError
        If websockets is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(self, text: str, name: str, notices: Notices) -> None:
        require_websockets("--signalk")
        self._url = split_url(text, "--signalk", ("ws", "wss", "http", "https"), _EXAMPLE)
        self._server = f"Signal K at {self._url.hostname}"
        self._name, self._notices = name, notices

        # What isn't for the server.
        fields = dict(parse_qsl(self._url.query, keep_blank_values=True))
        vessels = fields.pop(_VESSELS, "all")
        if vessels not in _CONTEXTS:
            raise OptionError(
                f"--signalk: {_VESSELS}={vessels} is none of {', '.join(_CONTEXTS)}",
                remedy=f"give {_VESSELS}=self, or nothing",
            )
        self._context = _CONTEXTS[vessels]
        self._query = urlencode({"subscribe": "none", **fields})

    async def run(self, receiver: Receiver) -> None:
        """Store positions until the task is cancelled."""
        parser = SignalKParser(self._name, self._notices)

        async def talk(connection: ClientConnection) -> None:
            await connection.send(json.dumps(self._subscription()))
            async for batch in batches_of(connection.recv):
                context = Context(time.time(), "signalk")
                found: list[Fix | Unusable] = []
                for text in batch:
                    found += _parse(parser, text, context)
                await store_patiently(receiver, found)

        await keep_connected(self._find_url, self._server, self._notices, talk)

    def _subscription(self) -> dict[str, Any]:
        paths = [{"path": path, "policy": "instant"} for path in SIGNALK_PATHS]
        return {"context": self._context, "subscribe": paths}

    async def _find_url(self) -> str:
        """Return the address of the stream, for which the server may have to be asked."""
        if self._url.scheme in ("ws", "wss"):
            path = self._url.path if self._url.path.strip("/") else _STREAM
            return self._url._replace(path=path, query=self._query).geturl()
        path = self._url.path if self._url.path.strip("/") else _DISCOVERY
        answer = await asyncio.to_thread(_fetch, self._url._replace(path=path, query=""))
        found = stream_in(answer)
        if found is None:
            # As an error of the network, this is tried again.
            raise ConnectionError(f"{path} names no stream of Signal K")
        return found._replace(query=self._query).geturl()


def stream_in(answer: bytes) -> SplitResult | None:
    """Return the address of a stream that the answer of a server names.

    Examples
    --------
    >>> stream_in(b'{"endpoints": {"v1": {"signalk-ws": "ws://boat/signalk/v1/stream"}}}').hostname
    'boat'
    """
    try:
        document = parse_json(answer)
        versions = member(document, "endpoints") if isinstance(document, Mapping) else {}
        url = urlsplit(str(member(versions, "v1").get("signalk-ws")))
        is_stream = url.scheme in ("ws", "wss") and url.hostname
    except (MessageError, ValueError):
        return None
    return url if is_stream else None


def _fetch(url: SplitResult) -> bytes:
    from http.client import HTTPException
    from urllib.request import ProxyHandler, build_opener

    try:
        # Boats are near: the proxy of the environment is for the web.
        opener = build_opener(ProxyHandler({}))
        with opener.open(url.geturl(), timeout=CONNECT_SECONDS) as answer:
            content: bytes = answer.read(MAX_MESSAGE_BYTES)
            return content
    except HTTPException as error:
        raise ConnectionError(str(error) or type(error).__name__) from error


def _parse(parser: SignalKParser, text: str | bytes, context: Context) -> list[Fix | Unusable]:
    try:
        return parser.parse(parse_json(text), context)
    except MessageError as error:
        return [Unusable("", str(error))]
