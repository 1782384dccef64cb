"""A server for phones and trackers: each app gets the answer after which it drops its queue.

An app keeps what it sent, and sends it again, unless it gets the answer that it expects. So what
can't be used gets that answer, too, and is counted. Only what could not be stored is an error of
the server (503).
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

from gpszip.errors import InputError, OptionError, OutputError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.apps import App, app_of, parse_message
from gpszip.live.formats.owntracks import agent_of_topic
from gpszip.live.formats.query import parse_query
from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context, MessageError, clean_name, parse_json
from gpszip.live.notices import Notices
from gpszip.live.serving import (
    address_text,
    bind,
    credentials_of,
    is_token,
    refuse_token,
    require_server,
    serve,
)
from gpszip.live.source import Receiver
from gpszip.live.sources.rates import Rates

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

__all__ = ["MAX_RATE", "HttpSource"]

#: Bytes of a body; a batch of Overland has 600 kB at most.
_MAX_BODY_BYTES = 2 << 20

#: Bytes of a table or log, which is stored as it comes; one of a day at 1 Hz has 10 MB.
_MAX_TABLE_BYTES = 256 << 20

#: Bytes of a query.
_MAX_QUERY_BYTES = 8_192

#: Fields of a query or form.
_MAX_FIELDS = 200

#: Bytes from which a body is large, and how many of these are taken at once: 32 MiB in all.
_LARGE_BYTES = 1 << 16
_MAX_LARGE = 16

#: Seconds that a body may take.
_BODY_SECONDS = 30.0

#: Requests of one sender in a second. Apps send one after the other, and none comes near it.
MAX_RATE = 1_000.0

#: Letters of each part of what tells senders apart.
_MAX_SENDER_LETTERS = 100

#: Connections at once; more are told to come again.
_MAX_CONNECTIONS = 2_000

#: The answer after which each app drops what it sent.
_ANSWERS = {
    App.OWNTRACKS: ("application/json", b"[]"),
    App.OVERLAND: ("application/json", b'{"result":"ok"}'),
    App.TRACCAR: ("application/json", b"{}"),
    App.OSMAND: ("text/plain", b"OK"),
    App.GPSLOGGER: ("text/plain", b"OK"),
}

#: The answer to what is of no app.
_OTHER_ANSWER = ("application/json", b"[]")


class _TooLargeError(Exception):
    """A request that has more bytes than it may have."""


@dataclass(frozen=True)
class _Message:
    """A request without its transport."""

    path: str
    query: Mapping[str, str]
    headers: Mapping[str, str]
    body: bytes
    user: str


class HttpSource:
    """Serves the protocols of OwnTracks, Overland, Traccar Client, OsmAnd and GPSLogger.

    Parameters
    ----------
    host, port : str and int
        Where to listen; port 0 takes a free one.
    notices : Notices
        Is told of requests that are refused, and gives ``/health`` its counts.
    token : str, optional
        What senders have to know: as a bearer token, as the password of basic authentication, or
        as the field ``token`` of the query.
    timezone : tzinfo
        Zone of times without one.
    health : callable, optional
        Further facts for ``/health``.
    max_rate : float
        Requests of one sender in a second. Faster ones are told to come again (429).
    unseal : callable, optional
        Opens encrypted messages of OwnTracks.

    Raises
    ------
    MissingExtraError
        If starlette or uvicorn is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(
        self,
        host: str,
        port: int,
        notices: Notices,
        *,
        token: str | None = None,
        timezone: tzinfo = UTC,
        health: Callable[[], Mapping[str, Any]] | None = None,
        max_rate: float = MAX_RATE,
        unseal: Callable[[Any], Any] | None = None,
    ) -> None:
        require_server("--http")
        self._notices, self._token, self._timezone = notices, token, timezone
        self._rates, self._unseal = Rates(max_rate), unseal
        self._health = health or dict
        self._large = asyncio.Semaphore(_MAX_LARGE)
        self._socket = bind(host, port, "--http")
        self.address = address_text(self._socket)

    async def run(self, receiver: Receiver) -> None:
        """Serve until the task is cancelled; then finish the requests that were taken."""
        from starlette.applications import Starlette
        from starlette.routing import Route

        # One function takes all paths.
        async def answer(request: Request) -> Response:
            return await self._answer(request, receiver)

        methods = ["GET", "POST", "PUT"]
        app = Starlette(routes=[Route("/{path:path}", answer, methods=methods)])
        await serve(app, self._socket, _MAX_CONNECTIONS, 2 * _MAX_QUERY_BYTES)

    async def _answer(self, request: Request, receiver: Receiver) -> Response:
        """Answer a request."""
        from starlette.responses import JSONResponse, PlainTextResponse

        # Monitors need no token: they see counts only.
        if _path(request) == "health":
            return JSONResponse(self._report())

        # The token first, then the body.
        headers = {name.lower(): _as_utf8(value) for name, value in request.headers.items()}
        query = _fields(_query(request))
        user = self._user(headers, query)
        if user is None:
            self._notices.note("requests with a wrong token refused")
            return await refuse_token()
        pause = self._rates.wait(_sender(request, query, headers, user), time.monotonic())
        if pause:
            self._notices.note("requests that came too fast refused for a while", _host(request))
            later = {"Retry-After": str(math.ceil(pause))}
            return PlainTextResponse("too fast; send it again later\n", 429, headers=later)
        turn = self._large if _is_large(headers) else contextlib.nullcontext()
        async with turn:
            return await self._take(request, query, headers, user, receiver)

    async def _take(
        self,
        request: Request,
        query: Mapping[str, str],
        headers: Mapping[str, str],
        user: str,
        receiver: Receiver,
    ) -> Response:
        """Read a body, store what is in it, and answer."""
        from starlette.requests import ClientDisconnect
        from starlette.responses import PlainTextResponse, Response

        # The body may be large, slow, or cut off. What follows of a table is stored as it comes.
        chunks = _chunks(request)
        try:
            async with asyncio.timeout(_BODY_SECONDS):
                body, is_whole = await _read_body(chunks, _declared(headers))
            message = _Message(_path(request), query, headers, body, user)
            _check_size(request, message, is_whole=is_whole)
            app = await self._store(message, None if is_whole else chunks, receiver)
        except (TimeoutError, ClientDisconnect):
            self._notices.note("requests that were not sent to their end left out")
            return PlainTextResponse("the body takes too long\n", 408)
        except _TooLargeError:
            self._notices.note("requests that are too large refused")
            return PlainTextResponse(f"at most {_MAX_BODY_BYTES:,} bytes\n", 413)
        except OutputError:
            return PlainTextResponse("not stored; send it again\n", 503)
        kind, content = _ANSWERS[app] if app is not None else _OTHER_ANSWER
        return Response(content, media_type=kind)

    async def _store(
        self, message: _Message, more: AsyncIterator[bytes] | None, receiver: Receiver
    ) -> App | None:
        """Store what is in a message, and return the app that sent it."""
        if more is not None:
            app, agent = self._app_and_agent(message)
            await _store_table(message.body, more, self._context(message, app, agent), receiver)
            return app

        # A day's log takes a second, in which others are answered.
        if len(message.body) > _LARGE_BYTES:
            app, items = await asyncio.to_thread(self._parse, message)
        else:
            app, items = self._parse(message)
        await receiver.store(items)
        return app

    def _report(self) -> dict[str, Any]:
        """What monitors get to know."""
        report: dict[str, Any] = {"status": "ok", "counts": dict(self._notices.counts)}
        report.update(self._health())
        return report

    def _user(self, headers: Mapping[str, str], query: Mapping[str, str]) -> str | None:
        """Return who is asking, an empty name for anybody; None if the token is wrong."""
        user, given = credentials_of(headers.get("authorization", ""))
        given = given or query.get("token", "")
        return user if self._token is None or is_token(given, self._token) else None

    def _parse(self, message: _Message) -> tuple[App | None, list[Fix | Unusable]]:
        """Find the app that sent a message, and the fixes in it."""
        app, agent = self._app_and_agent(message)
        found: list[Fix | Unusable]
        try:
            context = self._context(message, app, agent)
            app, found = self._parse_content(message, app, context)
        except MessageError as error:
            found = [Unusable("", str(error))]
        return app, found

    def _app_and_agent(self, message: _Message) -> tuple[App | None, str]:
        """Return what the path says: the app, and the sender behind it, as in /osmand/ann."""
        name, _, agent = message.path.partition("/")
        app = next((each for each in App if each.value == name.lower()), None)
        return app, message.path if app is None else agent

    def _context(self, message: _Message, app: App | None, agent: str) -> Context:
        """What is known of the sender: its path, its user, what its headers or query say."""
        query, headers = message.query, message.headers
        user = query.get("u") or headers.get("x-limit-u") or message.user
        device = query.get("d") or headers.get("x-limit-d") or ""
        named = "/".join(part for part in (user, device) if part)
        name = clean_name(agent, named) if agent or named else ""
        source = "http" if app is None else app.value
        return Context(time.time(), source, name, self._timezone, self._unseal)

    def _parse_content(
        self, message: _Message, app: App | None, context: Context
    ) -> tuple[App | None, list[Fix | Unusable]]:
        """Return the fixes of a message."""
        body = message.body.strip()
        is_form = "form-urlencoded" in message.headers.get("content-type", "")

        # JSON tells its app, which counts where the path names another one. No form begins like it,
        # even if the header says so, as that of curl does.
        if body[:1] in (b"{", b"["):
            content = parse_json(body)
            known = app_of(content)
            by_content = known or app
            if by_content in (App.OWNTRACKS, App.OVERLAND, App.TRACCAR):
                assert by_content is not None
                named = _with_topic(content, context, by_content)
                return app or known, parse_message(by_content, content, named)
            return app, [Unusable(context.agent, "messages of unknown apps left out")]

        # Fields of a query or form. Apps that read their answer as JSON send none.
        fields = dict(message.query)
        if body and (is_form or b"=" in body.partition(b"\n")[0]):
            fields.update(_fields(body.decode("utf-8", "replace")))
        elif body:
            return app, _parse_table(body, context)
        fields.pop("token", None)
        if not fields.keys() - {"u", "d"}:
            return app, [Unusable(context.agent, "empty messages left out")]
        by_query = app if app in (App.OSMAND, App.GPSLOGGER) else App.OSMAND
        return app or by_query, parse_query(fields, replace(context, source=by_query.value))


def _with_topic(content: Any, context: Context, app: App) -> Context:
    """Return the context of a message of OwnTracks whose topic names its sender.

    The path and the user come first, as anybody can write a topic; but the topic tells the devices
    of a user apart.
    """
    topic = content.get("topic") if isinstance(content, Mapping) else None
    if app is not App.OWNTRACKS or not isinstance(topic, str):
        return replace(context, source=app.value)
    named = agent_of_topic(topic)
    is_device = not context.agent or named.startswith(f"{context.agent}/")
    name = clean_name(named, context.agent) if is_device else context.agent
    return replace(context, source=app.value, agent=name)


def _parse_table(body: bytes, context: Context) -> list[Fix | Unusable]:
    """Return the fixes of a table or log: such files are sent again and again as they grow."""
    parser = TextParser(context.agent)
    return _parse_lines(parser, body.splitlines(), context) + parser.finish(context)


def _parse_lines(
    parser: TextParser, lines: Iterable[bytes], context: Context
) -> list[Fix | Unusable]:
    """Return the fixes of lines; a text that is no table is of no app."""
    found: list[Fix | Unusable] = []
    try:
        for line in lines:
            found += parser.push(line, context)
    except (InputError, OptionError):
        return [Unusable(context.agent, "messages of unknown apps left out")]
    return found


async def _store_table(
    first: bytes, more: AsyncIterator[bytes], context: Context, receiver: Receiver
) -> None:
    """Store a table that is larger than other bodies may be, as it comes.

    What is stored when it breaks off stays; whoever sends it again repeats that, which is left out.

    Raises
    ------
    OutputError
        If a part can't be stored.
    """
    parser = TextParser(context.agent)
    chunk, rest, size = first, b"", 0
    while chunk:
        size += len(chunk)
        if size > _MAX_TABLE_BYTES:
            raise _TooLargeError
        *lines, rest = (rest + chunk).split(b"\n")
        rest = rest[:_LARGE_BYTES]
        await receiver.store(await asyncio.to_thread(_parse_lines, parser, lines, context))
        chunk = await _next_chunk(more)

    # The last line may have no end.
    last = _parse_lines(parser, [rest], context)
    await receiver.store(last + parser.finish(context))


async def _next_chunk(chunks: AsyncIterator[bytes]) -> bytes:
    """Return the next bytes of a body, none at its end."""
    async with asyncio.timeout(_BODY_SECONDS):
        return await anext(chunks, b"")


def _sender(
    request: Request, query: Mapping[str, str], headers: Mapping[str, str], user: str
) -> str:
    """Return what tells senders apart before their messages are read: address, path and names."""
    named = (query.get(name, "") for name in ("id", "deviceid", "u", "d", "aid", "ser"))
    devices = (headers.get(name, "") for name in ("x-limit-u", "x-limit-d"))
    parts = (_host(request), _path(request), user, *named, *devices)
    return "\n".join(part[:_MAX_SENDER_LETTERS] for part in parts)


def _host(request: Request) -> str:
    return "" if request.client is None else request.client.host


def _path(request: Request) -> str:
    """The path without its outer slashes; names in it may have any letter, such as # and ?."""
    # request.url joins path and query to one text, and divides it again at such letters.
    path: str = request.scope["path"]
    return path.strip("/")


def _as_utf8(header: str) -> str:
    """Read a header again that was taken for Latin-1: names and tokens are UTF-8."""
    return header.encode("latin-1").decode("utf-8", "replace")


def _query(request: Request) -> str:
    query: bytes = request.scope["query_string"]
    return query.decode("latin-1")


def _fields(text: str) -> dict[str, str]:
    """Return the fields of a query, the first of each name, with names in small letters."""
    try:
        pairs = parse_qsl(text, keep_blank_values=True, max_num_fields=_MAX_FIELDS)
    except ValueError:
        return {}
    return {name.lower(): value for name, value in reversed(pairs)}


def _is_large(headers: Mapping[str, str]) -> bool:
    """Whether a body may be large: it says so, or does not say how large it is."""
    return "transfer-encoding" in headers or _declared(headers) > _LARGE_BYTES


def _declared(headers: Mapping[str, str]) -> int:
    """Bytes that a body has, as far as its headers say so."""
    text = headers.get("content-length", "")
    return int(text[:20]) if text.isdecimal() else 0


def _check_size(request: Request, message: _Message, *, is_whole: bool) -> None:
    """Refuse a query or a body that is too large."""
    if len(_query(request)) > _MAX_QUERY_BYTES or not (is_whole or _is_table(message)):
        raise _TooLargeError


def _is_table(message: _Message) -> bool:
    """Whether a body is a table or log, as far as its beginning and its header show."""
    line = message.body.strip().partition(b"\n")[0]
    is_form = "form-urlencoded" in message.headers.get("content-type", "")
    if is_form or line[:1] in (b"{", b"[") or b"=" in line:
        return False
    return line[:1] == b"$" or any(separator in line for separator in (b",", b";", b"\t", b"|"))


async def _chunks(request: Request) -> AsyncIterator[bytes]:
    """Yield the parts of a body that have bytes."""
    async for chunk in request.stream():
        if chunk:
            yield chunk


async def _read_body(chunks: AsyncIterator[bytes], declared: int) -> tuple[bytes, bool]:
    """Return the body, or its beginning if it is too large, and whether it is whole."""
    parts, size = [], 0
    async for chunk in chunks:
        size += len(chunk)
        parts.append(chunk)
        if max(size, declared) > _MAX_BODY_BYTES:
            return b"".join(parts), False
    return b"".join(parts), True
