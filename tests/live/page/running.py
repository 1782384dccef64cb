"""The server of the live page, in a thread of a test."""

import asyncio
import http.client
import json
import threading
from contextlib import contextmanager

from gpszip.live import Fix, Notices
from gpszip.live.events import Event
from gpszip.live.page.server import PageServer
from gpszip.view.live import build_live_page, build_live_scene

#: Seconds since 1970 of the first fix.
TIME = 1.7e9


def fix(agent, t=0.0, position=(48.0, 11.5), **more):
    return Fix(agent, "gpsd", TIME + t, TIME + t, position, **more)


def event(kind, id, agent="ann", **more):
    return Event(kind, id, agent, TIME, TIME, position=(48.0, 11.5), **more)


class Page:
    """A server that runs; what it shows is set from the thread of the test."""

    def __init__(self, port=0, token=None, archive=None, page=None):
        self.notices = Notices(lambda _line: None)
        scene = build_live_scene(archive)
        html = build_live_page() if page is None else page
        self.server = PageServer("127.0.0.1", port, self.notices, html, scene, token=token)
        self.port = int(self.server.address.rpartition(":")[2])
        self._loop = asyncio.new_event_loop()
        self._task = self._loop.create_task(self.server.run())
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        try:
            self._loop.run_until_complete(self._task)
        except asyncio.CancelledError:
            pass
        finally:
            self._loop.close()

    def take(self, *fixes):
        self._do(self._take, fixes)

    async def _take(self, fixes):
        self.server.board.take(fixes)

    def send(self, *events):
        self._do(self.server.board.send, events)

    def _do(self, call, values):
        asyncio.run_coroutine_threadsafe(call(values), self._loop).result(30)

    def close(self):
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(30)
        assert not self._thread.is_alive()


@contextmanager
def serving(*arguments, **more):
    page = Page(*arguments, **more)
    try:
        yield page
    finally:
        page.close()


class Stream:
    """Messages of the stream, one after the other."""

    def __init__(self, port, **headers):
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        self._connection.request("GET", "/stream", headers=named)
        self.answer = self._connection.getresponse()
        self.id = None

    def next(self, kind):
        """Value of the next message of a kind."""
        found = None
        for raw in self.answer:
            field, _, value = raw.decode().strip().partition(": ")
            if field == "event":
                found = value
            elif field == "id":
                self.id = value
            elif field == "data" and found == kind:
                return json.loads(value)
        raise AssertionError("the stream ended")

    def close(self):
        # The answer holds the connection, too.
        self.answer.close()
        self._connection.close()
