"""The page in Firefox, which answers itself (WebDriver BiDi): no other driver is needed.

It takes 4 s of CPU to start, so that only ``GPSZIP_FIREFOX=1`` runs it.
"""

import itertools
import json
import os
import shutil
import socket
import subprocess
import time

import pytest

websocket = pytest.importorskip("websocket", reason="no websocket-client, which selenium brings")
FIREFOX = shutil.which("firefox") or shutil.which("firefox-esr")

pytestmark = pytest.mark.skipif(
    os.environ.get("GPSZIP_FIREFOX") != "1" or FIREFOX is None,
    reason="GPSZIP_FIREFOX=1 runs it, with firefox",
)

#: Seconds for anything.
PATIENCE = 60


class Firefox:
    """A browser without a window, and its one tab."""

    def __init__(self, folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        flags = ["--headless", "--no-remote", "--profile", str(folder)]
        self.process = subprocess.Popen([FIREFOX, *flags, f"--remote-debugging-port={port}"])
        self.events, self.numbers = [], itertools.count()
        self.connection = self._connect(f"ws://127.0.0.1:{port}/session")
        self.call("session.new", capabilities={})
        self.call("session.subscribe", events=["log.entryAdded", "network.beforeRequestSent"])
        self.tab = self.call("browsingContext.getTree")["contexts"][0]["context"]

    def _connect(self, address):
        end = time.monotonic() + PATIENCE
        while True:
            try:
                return websocket.create_connection(address, PATIENCE, suppress_origin=True)
            except (OSError, websocket.WebSocketException):
                assert time.monotonic() < end, "Firefox doesn't answer"
                time.sleep(0.2)

    def call(self, method, **parameters):
        number = next(self.numbers)
        self.connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self.connection.recv())).get("id") != number:
            self.events.append(answer)
        return answer["result"]

    def run(self, script):
        target = {"context": self.tab}
        answer = self.call("script.evaluate", expression=script, target=target, awaitPromise=True)
        assert answer["type"] == "success", answer
        return answer["result"].get("value")

    def press(self, *keys):
        steps = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        actions = [{"type": "key", "id": "keys", "actions": steps}]
        self.call("input.performActions", context=self.tab, actions=actions)
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.fixture
def firefox(tmp_path):
    browser = Firefox(tmp_path)
    try:
        yield browser
    finally:
        browser.connection.close()
        browser.process.terminate()
        browser.process.wait(PATIENCE)


def test_the_page_works_in_firefox(firefox, fleet_path):
    firefox.call(
        "browsingContext.navigate", context=firefox.tab, url=fleet_path.as_uri(), wait="complete"
    )
    end = time.monotonic() + PATIENCE
    while firefox.run("document.documentElement.dataset.ready") != "true":
        assert time.monotonic() < end, "the page is not ready"
        time.sleep(0.1)

    # Keys, a chart, and colours.
    firefox.press("2", "n", "m")
    assert firefox.run("document.getElementById('layer-tracks').checked")
    assert firefox.run("document.documentElement.dataset.theme") == "dark"
    assert firefox.run("document.getElementById('track').selectedIndex") == 1

    # Nothing was asked for, and nothing went wrong.
    sent = [e for e in firefox.events if e["method"] == "network.beforeRequestSent"]
    addresses = [each["params"]["request"]["url"] for each in sent]
    assert [a for a in addresses if not a.startswith(("file:", "data:"))] == []
    logged = [e["params"] for e in firefox.events if e["method"] == "log.entryAdded"]
    assert [each["text"] for each in logged if each["level"] == "error"] == []
    assert firefox.run("fetch('https://example.org/').then(() => 1, () => 2)") == 2
