"""The server of the live page: one page, its map, and a stream of what changes; nothing else."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import ipaddress
import secrets
import time
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

from gpszip.errors import OptionError
from gpszip.live.notices import Notices
from gpszip.live.page.board import TAIL_SECONDS, Board
from gpszip.live.page.messages import (
    agents_message,
    events_message,
    message,
    outlooks_message,
    tails_message,
)
from gpszip.live.serving import (
    address_text,
    bind,
    credentials_of,
    is_token,
    refuse_token,
    require_server,
    serve,
)

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

__all__ = ["PageServer"]

#: Pages that are open at once; each has a stream.
MAX_CLIENTS = 16

#: Connections at once: those of open pages, and a few that load one.
_MAX_CONNECTIONS = 100

#: Bytes of the head of a request.
_HEAD_BYTES = 16_384

#: Fields of a query.
_MAX_FIELDS = 20

#: Seconds between two messages with positions.
_PERIOD = 0.4

#: Seconds after which a page hears something even if nothing changes.
_ALIVE_SECONDS = 2.0

#: Agents in one message with positions; of more, others come in the next one.
_MAX_MOVED = 2_000

#: Agents whose tails and predictions a new page gets; it draws no more of them.
_MAX_TAILS = 400

#: Agents in one message with tails.
_TAILS_AT_ONCE = 50

#: Milliseconds after which a browser connects again.
_RETRY = 1_000

#: Headers of all answers.
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data:; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer:
    """Serves the live page.

    Parameters
    ----------
    host, port : str and int
        Where to listen; port 0 takes a free one.
    notices : Notices
        Its counts are shown.
    page : str
        The page, as HTML.
    scene : bytes
        What the page draws at first, as JSON: the map, or none.
    token : str, optional
        What visitors have to know: as the password of basic authentication, as a bearer token, or
        as the field ``token`` of the query. Needed on an address that other machines reach.

    Raises
    ------
    MissingExtraError
        If starlette or uvicorn is not installed.
    OptionError
        If the address can't be used, or needs a token.

    Attributes
    ----------
    board : Board
        What the page shows.
    address : str
        Host and port.
    """

    def __init__(
        self,
        host: str,
        port: int,
        notices: Notices,
        page: str,
        scene: bytes,
        *,
        token: str | None = None,
    ) -> None:
        require_server("--page")
        self.board = Board()
        self._notices, self._token = notices, token
        self._socket = bind(host, port, "--page")
        if token is None and not _is_loopback(self._socket.getsockname()[0]):
            self._socket.close()
            raise OptionError(
                f"other machines reach the page at {host}",
                remedy="add a token with --token or GPSZIP_TOKEN, or name no host",
            )
        self.address = address_text(self._socket)
        self._files = {
            "/": ("text/html", page.encode(), gzip.compress(page.encode())),
            "/scene": ("application/json", scene, gzip.compress(scene)),
        }

        # Numbers of events begin anew with each run.
        self._boot = secrets.token_hex(4)
        self._clients = 0
        self._is_over = False
        self._moved: tuple[int, int, bytes, int] = (-1, -1, b"", 0)

    async def run(self) -> None:
        """Serve until the task is cancelled."""

        async def app(scope: Any, receive: Any, send: Any) -> None:
            from starlette.requests import Request

            response = await self._answer(Request(scope, receive))
            response.headers.update(_HEADERS)
            await response(scope, receive, send)

        serving = asyncio.create_task(serve(app, self._socket, _MAX_CONNECTIONS, _HEAD_BYTES))
        try:
            await asyncio.shield(serving)
        finally:
            # Streams end by themselves, so that the server need not wait for them.
            self._is_over = True
            serving.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await serving

    async def _answer(self, request: Request) -> Response:
        """Answer a request."""
        from starlette.responses import PlainTextResponse, Response

        # Who may ask, and how.
        if request.method != "GET":
            return PlainTextResponse("only GET\n", 405, headers={"Allow": "GET"})
        if not self._is_known(request):
            self._notices.note("requests to the page with a wrong token refused")
            return await refuse_token()
        if self._token is None and not _is_own(request.headers.get("host", "")):
            # A name of another site that leads here would let that site read the page.
            return PlainTextResponse("ask for it by its address\n", 421)

        # The page and its map.
        path: str = request.scope["path"]
        if path in self._files:
            kind, plain, packed = self._files[path]
            if "gzip" not in request.headers.get("accept-encoding", ""):
                return Response(plain, media_type=kind)
            return Response(packed, media_type=kind, headers={"Content-Encoding": "gzip"})
        return self._stream(request) if path == "/stream" else PlainTextResponse("no page\n", 404)

    def _is_known(self, request: Request) -> bool:
        """Whether a request has the token, if there is one."""
        if self._token is None:
            return True
        query = request.scope["query_string"].decode("latin-1")
        given = credentials_of(request.headers.get("authorization", ""))[1]
        if not given:
            with contextlib.suppress(ValueError):
                given = dict(parse_qsl(query, max_num_fields=_MAX_FIELDS)).get("token", "")
        return is_token(given, self._token)

    def _stream(self, request: Request) -> Response:
        """Begin a stream, if there are not too many."""
        from starlette.responses import PlainTextResponse, StreamingResponse

        if self._clients >= MAX_CLIENTS:
            text = f"{MAX_CLIENTS} pages are open; close one\n"
            return PlainTextResponse(text, 503, headers={"Retry-After": "5"})
        seen = self._seen(request.headers.get("last-event-id", ""))
        return StreamingResponse(self._messages(seen), media_type="text/event-stream")

    def _seen(self, id: str) -> int:
        """Number of the last event that a page has; 0 if it has none of this run."""
        boot, _, number = id.partition("-")
        is_number = number.isascii() and number.isdecimal() and len(number) < 16
        if boot != self._boot or not is_number:
            return 0
        return min(int(number), self.board.number)

    async def _messages(self, seen: int) -> AsyncIterator[bytes]:
        """Yield what a page gets to know: first all that is known, then what changes.

        The next message is made when the last one was taken, so that none waits for a slow page.
        """
        # Counted here, as a browser may be gone before its stream begins.
        self._clients += 1
        try:
            hello = {"tail": TAIL_SECONDS, "boot": self._boot}
            yield f"retry: {_RETRY}\n\n".encode() + message("hello", hello)
            recent = list(self.board.recent_agents(_MAX_TAILS))
            for i in range(0, len(recent), _TAILS_AT_ONCE):
                yield tails_message(recent[i : i + _TAILS_AT_ONCE])
            yield outlooks_message(recent)
            async for part in self._changes(seen):
                yield part
        finally:
            self._clients -= 1

    async def _changes(self, seen: int) -> AsyncIterator[bytes]:
        """Yield what changes, beginning with all agents and the events after one."""
        cursor, said = 0, -_ALIVE_SECONDS
        told: dict[str, int] = {}
        while not self._is_over:
            # Positions, then events.
            parts, cursor = self._moves(cursor)
            events, is_whole = self.board.events_since(seen)
            if events:
                seen = events[-1][0]
                parts += events_message(events, self._boot)
                if not is_whole:
                    parts += outlooks_message(self.board.recent_agents(_MAX_TAILS))

            # How sources are, also to say that the connection lives.
            now = time.monotonic()
            counts = dict(self._notices.counts)
            if now - said >= (_ALIVE_SECONDS if counts == told else _ALIVE_SECONDS / 2):
                state = {"now": time.time(), "agents": len(self.board), "counts": counts}
                parts += message("state", state)
                told, said = counts, now
            if parts:
                yield parts

            # All streams wake at the same moments, and share what they say.
            await asyncio.sleep(_PERIOD - time.monotonic() % _PERIOD)

    def _moves(self, cursor: int) -> tuple[bytes, int]:
        """Messages with the agents that moved after a cursor, and the new cursor."""
        # Nobody moved, or another stream asked the same.
        revision = self.board.revision
        if cursor == revision:
            return b"", cursor
        if self._moved[:2] != (cursor, revision):
            agents, after = self.board.agents_since(cursor, _MAX_MOVED)
            text = agents_message(agents) if agents else b""

            # The ways of those that moved more than once, as of a phone that sends what it kept.
            hasty = [agent for agent in agents if 0 < cursor < agent.before]
            if hasty:
                text += tails_message(hasty[:_TAILS_AT_ONCE])
            self._moved = (cursor, revision, text, after)
        return self._moved[2], self._moved[3]


def _is_loopback(host: str) -> bool:
    return ipaddress.ip_address(host.partition("%")[0]).is_loopback


def _is_own(host: str) -> bool:
    """Whether a Host header names this machine by its own address.

    Examples
    --------
    >>> _is_own("127.0.0.1:8086"), _is_own("localhost:1"), _is_own("[::1]:1"), _is_own("evil.org")
    (True, True, True, False)
    """
    name = host.rpartition(":")[0] if not host.endswith("]") and ":" in host else host
    if name == "localhost":
        return True
    try:
        return _is_loopback(name.strip("[]"))
    except ValueError:
        return False
