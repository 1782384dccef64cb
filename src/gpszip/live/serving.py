"""What servers of a listener share: sockets, tokens, and uvicorn as a part of the program."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hmac
import socket
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gpszip.errors import MissingExtraError, OptionError

if TYPE_CHECKING:
    from starlette.responses import Response

__all__ = [
    "address_text",
    "bind",
    "credentials_of",
    "is_token",
    "refuse_token",
    "require_server",
    "serve",
]

#: Seconds that the answer to a wrong token takes, so that few can be tried.
_PAUSE_SECONDS = 0.5

#: Seconds until the head of a request is there; connections that send none are closed.
_HEAD_SECONDS = 30.0

#: Seconds that a connection stays open for another request, as in uvicorn without this setting.
_IDLE_SECONDS = 5

#: Connections that the system keeps until the server takes them.
_BACKLOG = 1_024

#: Seconds in which requests are finished when a server ends.
_END_SECONDS = 5

#: Peers whose X-Forwarded-For is believed: proxies on this machine. Others could write any address.
_PROXIES = ("127.0.0.1", "::1", "::ffff:127.0.0.1")


def require_server(option: str) -> None:
    """Refuse an option whose packages are missing.

    Raises
    ------
    MissingExtraError
        If starlette or uvicorn is not installed.
    """
    try:
        import starlette
        import uvicorn
    except ImportError:
        raise MissingExtraError("live", option) from None
    del starlette, uvicorn


def bind(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that listens; port 0 takes a free one.

    Raises
    ------
    OptionError
        If the address of the option can't be used.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        bound = socket.socket(family, socket.SOCK_STREAM)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    except OSError as error:
        raise _address_error(host, port, option, error) from error
    try:
        bound.bind((host, port))
        bound.listen(_BACKLOG)
    except OSError as error:
        bound.close()
        raise _address_error(host, port, option, error) from error
    return bound


def _address_error(host: str, port: int, option: str, error: OSError) -> OptionError:
    return OptionError(
        f"can't listen at {host}:{port}: {error.strerror or error}",
        remedy=f"name another address or port with {option}",
    )


def address_text(bound: socket.socket) -> str:
    """HOST:PORT of a socket, as URLs have it."""
    host, port = bound.getsockname()[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def credentials_of(header: str) -> tuple[str, str]:
    """User and secret of the header Authorization; bearer tokens have no user.

    Examples
    --------
    >>> credentials_of("Bearer abc"), credentials_of("Basic YW5uOmFiYw=="), credentials_of("")
    (('', 'abc'), ('ann', 'abc'), ('', ''))
    """
    scheme, _, credentials = header.partition(" ")
    if scheme.lower() == "bearer":
        return "", credentials.strip()
    if scheme.lower() != "basic":
        return "", ""

    # Basic authentication names a user; what can't be read is none.
    try:
        text = base64.b64decode(credentials.strip(), validate=True).decode("utf-8")
    except ValueError:
        return "", ""
    user, _, password = text.partition(":")
    return user, password


def is_token(given: str, token: str) -> bool:
    """Compare two tokens in a time that does not tell where they differ."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


async def refuse_token() -> Response:
    """Return the answer to a wrong token, after a while: few can be tried."""
    from starlette.responses import PlainTextResponse

    await asyncio.sleep(_PAUSE_SECONDS)
    challenge = {"WWW-Authenticate": 'Basic realm="gpszip"'}
    return PlainTextResponse("wrong token\n", 401, headers=challenge)


async def serve(app: Any, bound: socket.socket, max_connections: int, head_bytes: int) -> None:
    """Serve until the task is cancelled; then finish the requests that were taken.

    Parameters
    ----------
    app : ASGI application
        Answers requests.
    bound : socket
        Where it listens; it is closed at the end.
    max_connections : int
        Connections at once; more are told to come again.
    head_bytes : int
        Bytes of the head of a request, at most.
    """
    import uvicorn

    config = uvicorn.Config(
        app,
        # Other parsers than h11 have no limit for headers.
        http=_protocol_class(),
        ws="none",
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        # By default, a variable of the environment may name others.
        forwarded_allow_ips=list(_PROXIES),
        limit_concurrency=max_connections,
        h11_max_incomplete_event_size=head_bytes,
        timeout_keep_alive=_IDLE_SECONDS,
        timeout_graceful_shutdown=_END_SECONDS,
    )

    # The server must leave signals to the program that it is a part of.
    server = _server_class()(config)
    serving = asyncio.create_task(server.serve(sockets=[bound]))
    try:
        await asyncio.shield(serving)
    except asyncio.CancelledError:
        server.should_exit = True
        await serving
        raise
    finally:
        bound.close()


def _protocol_class() -> Any:
    """A protocol that closes connections whose request does not come."""
    import h11
    from uvicorn.protocols.http.h11_impl import H11Protocol

    class Protocol(H11Protocol):
        waiting: asyncio.TimerHandle | None = None

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self.watch()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self.watch()

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            self.stop_waiting()

        def watch(self) -> None:
            """Wait for the end of a head from its first byte on."""
            if self.conn.their_state is not h11.IDLE:
                self.stop_waiting()
            elif self.waiting is None:
                self.waiting = self.loop.call_later(_HEAD_SECONDS, self.transport.close)

        def stop_waiting(self) -> None:
            if self.waiting is not None:
                self.waiting.cancel()
                self.waiting = None

    return Protocol


def _server_class() -> Any:
    """A server that leaves signals alone."""
    import uvicorn

    class Server(uvicorn.Server):
        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield

    return Server
