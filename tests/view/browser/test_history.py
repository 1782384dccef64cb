"""The layers and lists of a history, and the report, in a browser."""

import pytest

from gpszip.view.report.report import build_report
from gpszip.view.scene import ShownArchive, build_scene
from guard_log import NAME, ODD_ROUND, ROUNDS, guard_archive, guard_findings
from view.browser.conftest import save
from view.browser.driving import Page

ROWS = "return [...document.querySelectorAll('#history-rows button')].map((b) => b.textContent)"

#: Colours of layers in light colours.
PLACES, UNUSUAL, ROUND = "#d55e00", "#d55e00", "#009e73"


@pytest.fixture(scope="module")
def path(folder):
    shown = ShownArchive(guard_archive(), "guard.gpsz", findings=guard_findings())
    return save(folder, "guard", build_scene([shown], title="guard"))


@pytest.fixture
def page(browser, path):
    return Page(browser, path).open()


def test_lists_lead_to_what_they_name(page):
    assert page.errors() == []
    assert page.text("history-list").startswith("Places (1)Trips (16)")
    (place,) = page.run(ROWS)
    assert "17 visits" in place

    # A place tells its stays, and each of these is a range.
    page.click_all("#history-rows button", 0)
    table = page.table("here-facts")
    assert table["Visits"] == "17"
    page.click_all("#here-facts .jumps button", 2)
    stay = guard_findings().trips.stays[2]
    minutes = int((stay.end - stay.start) // 60)
    assert page.table("range-facts")["Duration"].startswith(f"{minutes} min")

    # A trip is a range of the clock.
    page.choose("history-list", "trips")
    assert len(page.run(ROWS)) == ROUNDS
    page.click_all("#history-rows button", ODD_ROUND)
    trip = guard_findings().trips.trips[ODD_ROUND]
    seconds = page.table("range-facts")["Duration"]
    assert seconds.startswith(f"{int((trip.end - trip.start) // 60)} min")

    # The short cut is the most unusual, and its jump leads there.
    page.choose("history-list", "unusual")
    assert "rare turn" in page.run(ROWS)[0]
    page.click_all("#history-rows button", 0)
    assert page.shown("range-section")
    assert page.errors() == []


def test_layers_of_the_history_toggle_by_their_keys(page):
    page.press("3", "g", "l")
    for key, colour in (("o", PLACES), ("r", ROUND)):
        shown = page.pixels(colour)
        page.press(key)
        assert shown - page.pixels(colour) > 30
    before = page.pixels(UNUSUAL)
    page.press("u")
    assert page.pixels(UNUSUAL) - before > 10
    page.press("t")
    trips = page.picture()
    page.press("t")
    assert page.picture() != trips


def test_an_hour_is_chosen_with_its_edges(page):
    page.press("o", "r")
    page.choose("colour", "use")
    assert page.shown("hours")
    dim = page.pixels("#dcdedc")
    page.run(
        "const hour = document.getElementById('hour'); hour.value = 12;"
        "hour.dispatchEvent(new Event('input'))"
    )
    page.settle()
    assert page.text("hour-text") == "12\u201313 h Europe/Berlin"
    assert page.pixels("#dcdedc") > dim + 500  # nobody walks at noon
    page.choose("colour", "layer")
    assert not page.shown("hours")


def test_a_report_opens_offline_with_its_map(browser, folder):
    path = folder / "report.html"
    build_report(guard_findings(), guard_archive(), NAME).write(path)
    page = Page(browser, path)
    page.errors(), page.requests()
    browser.get(path.as_uri())
    browser.switch_to.frame(0)
    try:
        page.until(lambda: page.run("return document.documentElement.dataset.ready"))
        page.settle()
        assert page.pixels(ROUND) > 100
        assert page.run("return document.querySelectorAll('#history-rows li').length") == 1
    finally:
        browser.switch_to.default_content()
    assert page.run("return document.querySelector('h1').textContent") == NAME
    assert page.run("return document.querySelectorAll('img, script').length") == 0
    width = page.run("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert width[0] <= width[1]
    assert page.errors() == []
    assert [each for each in page.requests() if each != "about:srcdoc"] == []
