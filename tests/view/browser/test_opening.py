"""Pages open, whatever they show, and ask for nothing."""

import pytest

from view.browser.conftest import NAMES
from view.browser.driving import PAPER, Keys, Page


def test_a_page_opens_without_errors_and_requests(fleet_page):
    assert fleet_page.errors() == []
    assert fleet_page.requests() == []
    assert fleet_page.pixels(PAPER) > 100_000
    assert fleet_page.text("summary").startswith("660 points as ")


def test_the_browser_refuses_any_request_of_the_page(fleet_page):
    refused = fleet_page.driver.execute_async_script(
        "const done = arguments[0];"
        "fetch('https://example.org/').then(() => done('sent'), () => done('refused'));"
    )
    assert refused == "refused"
    assert any("Content Security Policy" in each for each in fleet_page.errors())


def test_names_are_text(fleet_page):
    fleet_page.choose("colour", "track")
    options = fleet_page.run(
        "return [...document.querySelectorAll('#track option')].map((each) => each.textContent)"
    )
    assert options[1:] == NAMES
    assert all(name in fleet_page.text("legend") for name in NAMES)
    assert fleet_page.driver.title == "fleet.gpsz"
    assert fleet_page.run("return document.querySelectorAll('img').length") == 0


@pytest.mark.parametrize("name", ["untimed", "point", "map", "many", "ferry"])
def test_pages_of_all_kinds_open_and_draw(browser, odd_paths, name):
    page = Page(browser, odd_paths[name]).open()
    assert page.errors() == []
    page.press("g", "l")  # without graticule and scale
    assert len(page.pixels_but(PAPER)) > 0
    assert page.pixels(PAPER) > 0
    assert page.errors() == []


def test_a_map_alone_has_no_clock(browser, odd_paths):
    page = Page(browser, odd_paths["map"]).open()
    assert not page.shown("timeline")
    assert page.pixels("#56a0cc") > 500


def test_ten_thousand_tracks_are_listed_and_drawn(browser, odd_paths):
    page = Page(browser, odd_paths["many"]).open()
    assert page.run("return document.querySelectorAll('#track option').length") == 10_001
    assert page.text("summary") == "30,000 points"
    page.press("n", "2")
    assert page.run("return document.getElementById('track').value") == "0"
    assert page.errors() == []


def test_a_track_across_the_antimeridian_is_one(browser, odd_paths):
    page = Page(browser, odd_paths["ferry"]).open()
    assert page.table("track-facts")["Distance"] == "76.8 km"
    page.press(Keys.ENTER)
    assert "180.0" in page.text("here-facts") or "179.9" in page.text("here-facts")


def test_a_log_without_times_has_a_distance_instead_of_a_clock(browser, odd_paths):
    page = Page(browser, odd_paths["untimed"]).open()
    assert page.text("clock") == "0 cm"
    page.press(Keys.END)
    assert page.text("clock") == page.table("track-facts")["Distance"]
    assert not page.shown("zone-label")

    # Texts are about distances.
    page.fill("where-time", "1e6")
    assert page.text("where-answer").startswith("Distances are from 0 cm to ")
    page.fill("where-time", "half way")
    assert page.text("where-answer") == "Can't read half way: write metres."
    labels = page.run("return [...document.querySelectorAll('#colour option')].map((o) => o.text)")
    assert "Distance" in labels
    assert "Time" not in labels

    # No sample is joined with the agent: distances along the log and along the walk differ.
    page.fill("where-time", "150")
    page.run("document.activeElement.blur()")
    page.press(*"++++++++")
    assert page.pixels("#d55e00", overlay=True) > 20
    assert page.pixels("#1d2329", overlay=True) == 0


def test_a_page_of_one_point(browser, odd_paths):
    page = Page(browser, odd_paths["point"]).open()
    assert page.text("summary").startswith("1 point as ")
    page.press(Keys.ENTER)
    assert page.table("track-facts")["Points"] == "1"
    passes = page.run("return document.querySelector('.passes button').lastChild.textContent")
    assert passes.strip() == ""  # no speed, and no heading
    labels = page.run("return [...document.querySelectorAll('#colour option')].map((o) => o.text)")
    assert "Traversals" not in labels


def test_a_page_works_in_the_sealed_frame_of_a_notebook(browser, folder, robot):
    path = folder / "notebook.html"
    path.write_text(f"<!DOCTYPE html><title>n</title>{robot[1]._repr_html_()}", encoding="utf-8")
    Page(browser, path).errors()
    browser.get(path.as_uri())
    browser.switch_to.frame(0)
    try:
        page = Page(browser, path)
        page.until(lambda: page.run("return document.documentElement.dataset.ready"))
        page.fill("where-time", "0:00:30")
        assert page.text("clock").startswith("0:00:30")
        page.click("help-open")
        page.click("help-close")
        assert not page.shown("help")
        assert page.errors() == []
    finally:
        browser.switch_to.default_content()
