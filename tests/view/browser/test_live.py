"""The live page in a browser."""

import time
from dataclasses import dataclass
from importlib.util import find_spec

import pytest

from live.page.running import TIME, event, fix, serving
from live.page.running import Page as Server
from view.browser.driving import Page

pytestmark = pytest.mark.skipif(
    find_spec("starlette") is None or find_spec("uvicorn") is None, reason="needs gpszip[live]"
)

#: A name that must not become markup.
HOSTILE = "<img src=x onerror=document.title='bad'>"


@dataclass
class LivePage(Page):
    """A live page that is open."""

    server: Server | None = None

    def open(self, user="", query=""):
        self.errors()
        self.driver.get(f"http://{user}{self.server.server.address}/{query}")
        self.until(lambda: self.run("return document.documentElement.dataset.ready"))
        self.until(lambda: self.text("connection") == "Live")
        return self

    def rows(self, id):
        """Texts of the rows of a list."""
        # At once, as rows may go while they are read.
        script = (
            "return [...document.getElementById(arguments[0]).children].map((r) => r.innerText)"
        )
        return [text.replace("\u202f", " ") for text in self.run(script, id)]


@pytest.fixture(scope="module")
def server(fleet, tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "fleet.gpsz"
    fleet.save(path)
    with serving(archive=path) as running:
        yield running


@pytest.fixture
def page(browser, server):
    return LivePage(browser, None, server).open()


def test_agents_events_and_sources_appear(page, server):
    assert page.text("title") == "fleet.gpsz"
    assert page.pixels("#0072b2") > 500  # the map
    t = time.time() - TIME
    ann = fix("ann", t, (37.98, 23.73), heading=90.0, speed=10.0)
    server.take(ann, fix(HOSTILE, t, (37.981, 23.73)))
    server.notices.count("stored", 2)
    page.until(lambda: len(page.rows("agents")) == 2)
    assert page.rows("agents") == [HOSTILE, "ann\n36 km/h"]
    page.until(lambda: page.table("sources").get("stored") == "2")
    page.until(lambda: page.pixels("#d55e00", overlay=True) > 20)

    # Where it goes, and what happened to it.
    goal = {"node": 3, "arrival": TIME + t + 120, "low": TIME + t + 90, "high": TIME + t + 150}
    server.send(
        event("stay.start", "1", HOSTILE, why="<b>5 min</b>"),
        event("predicted", "2", confidence=0.8, details=goal | {"metres": 700, "next": []}),
    )
    page.until(lambda: page.rows("events"))
    assert "stay start" in page.rows("events")[0]
    assert "<b>5 min</b>" in page.rows("events")[0]
    page.click_all("#agents button", 1)
    page.until(lambda: page.shown("here"))
    assert page.text("here-title") == "ann"
    assert page.table("here-facts")["Goes to"] == "node 3 (80 %)"

    # Nothing became markup.
    assert page.run("return document.querySelectorAll('#panel img, #panel b').length") == 0
    assert "bad" not in page.driver.title
    assert page.errors() == []


def test_events_are_filtered_revised_and_lead_to_their_place(page, server):
    server.send(event("trip.start", "11"), event("edge.enter", "12"), event("silent", "13"))
    page.until(lambda: "silent" in page.rows("events")[0])
    assert not any("edge enter" in row for row in page.rows("events"))
    page.choose("kinds", "edge.enter")
    assert ["edge enter" in row for row in page.rows("events")] == [True]
    page.choose("kinds", "all")
    assert "edge enter" in page.rows("events")[1]

    # Another one takes its place; or none does.
    server.send(
        event("trip.start", "21", why="earlier", revises="11"),
        event("silent", "22", revises="13", withdrawn=True),
    )
    page.until(lambda: "earlier" in page.rows("events")[0])
    assert not any("silent" in row for row in page.rows("events"))
    before = page.picture(number=1)
    page.click_all("#events button", 0)
    assert page.picture(number=1) != before
    assert page.errors() == []


def test_keys_choose_zoom_and_darken(page):
    page.until(lambda: len(page.rows("agents")) == 2)
    page.press("n")
    page.until(lambda: page.shown("here"))
    chosen = page.text("here-title")
    page.press("n")
    page.until(lambda: page.text("here-title") != chosen)
    before = page.picture()
    page.press("+")
    assert page.picture() != before
    theme = page.run("return document.documentElement.dataset.theme")
    page.press("m")
    assert page.run("return document.documentElement.dataset.theme") != theme
    page.press("\ue00c")
    assert not page.shown("here")


def test_a_page_connects_again_when_the_listener_is_back(browser):
    with serving() as first:
        page = LivePage(browser, None, first).open()
        first.take(fix("robot", -TIME, (1.0, 2.0), geographic=False))
        first.send(event("silent", "1", "robot"))
        page.until(lambda: page.rows("events"))
    page.until(lambda: page.text("connection") == "Connection lost, trying again")

    # Another run knows nothing of the first one; the page does.
    with serving(first.port) as second:
        page.until(lambda: page.text("connection") == "Live")
        second.take(fix("other", 7 - TIME, (300.0, 2.0), geographic=False))
        second.send(event("back", "2", "robot"))
        page.until(lambda: len(page.rows("events")) == 2)
        page.until(lambda: len(page.rows("agents")) == 2)
        assert page.pixels("#009e73", overlay=True) > 20


@pytest.mark.parametrize("place", [{"user": "ann:secret@"}, {"query": "?token=secret"}])
def test_a_token_in_the_address_opens_the_page(browser, place):
    with serving(token="secret") as server:
        page = LivePage(browser, None, server).open(**place)
        assert page.text("title") == "Live positions"
        assert page.errors() == []
