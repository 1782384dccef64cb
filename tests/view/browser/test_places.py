"""What is at a place, who passes it, and where errors are largest."""

import numpy as np

from gpszip.walks.error import synchronised_errors
from view.browser.conftest import START, walk_positions
from view.browser.driving import Keys, Page

#: CSS pixels around a place in which tracks pass.
RADIUS_PIXELS = 9


def pixels_per_metre(page):
    """From how far the pointer's position changes over 100 pixels."""
    lats = []
    for y in (0.5, 0.5 - 100 / page.run("return document.querySelector('.pane').clientHeight")):
        page.point(".pane", 0.5, y)
        lats.append(float(page.text("position").split("\u00b0")[0]))
    return 100 / ((lats[1] - lats[0]) * 111_000)


def go_to(page, number, seconds, zooms=0):
    """Put the middle of the map where a track is at a time."""
    for _ in range(number):
        page.press("n")
    minutes, rest = divmod(13 * 60 + 20 + seconds, 60)
    page.fill("where-time", f"22:{minutes:02d}:{rest:02d}")
    page.run("document.activeElement.blur()")
    for _ in range(zooms):
        page.press("+")


def test_passes_are_those_of_all_tracks(fleet_page, fleet):
    go_to(fleet_page, 2, 400)
    fleet_page.choose("track", "all")
    fleet_page.press(Keys.ENTER)
    listed = fleet_page.run("return document.querySelectorAll('.passes li').length")

    # A plain search: samples of each walk every 20 ms near the place, in runs.
    place = walk_positions(fleet, 1, START + 400)
    radius = RADIUS_PIXELS / pixels_per_metre(fleet_page)
    passes = 0
    for number, walk in enumerate(fleet.walks):
        times = np.arange(walk.times[0], walk.times[-1], 0.02)
        positions = walk_positions(fleet, number, times)
        near = np.linalg.norm(positions - place, axis=1) <= radius
        passes += int((np.diff(np.r_[0, near.astype(int)]) > 0).sum())
    assert listed == passes > 0


def seconds(clock):
    hours, minutes, rest = clock.split(":")
    return int(hours) * 3600 + int(minutes) * 60 + float(rest)


def test_a_pass_leads_to_its_time_and_track(fleet_page):
    go_to(fleet_page, 2, 400)
    fleet_page.choose("track", "all")
    fleet_page.press(Keys.ENTER)
    times = fleet_page.run(
        "return [...document.querySelectorAll('.passes span:first-child')]"
        ".map((each) => each.textContent)"
    )
    assert len(times) > 1
    for number, text in enumerate(times):
        fleet_page.click_all(".passes button", number)
        assert abs(seconds(fleet_page.text("clock").split(" ")[1]) - seconds(text)) <= 0.6
    assert fleet_page.run("return document.getElementById('track').value") != "all"


def test_an_edge_tells_its_traversals(fleet_page):
    go_to(fleet_page, 2, 400, zooms=2)
    fleet_page.press(Keys.ENTER)
    facts = fleet_page.table("here-facts")
    counts = [int(value) for label, value in facts.items() if label.startswith("Traversals")]
    assert len(counts) == 2
    assert sum(counts) > 0
    fleet_page.press(Keys.ESCAPE)
    assert not fleet_page.shown("here")


def test_a_click_where_nothing_passes_says_so(fleet_page):
    fleet_page.actions_at(".pane", 0.03, 0.9).click().perform()
    fleet_page.settle()
    assert "No track passes here." in fleet_page.text("here-facts")


def test_the_largest_errors_are_listed_and_shown(fleet_page, fleet, fleet_tracks):
    worst = max(
        synchronised_errors(track, walk, fleet.road_map.nodes).max()
        for track, walk in zip(fleet_tracks, fleet.walks, strict=True)
    )
    first = fleet_page.run("return document.querySelector('#worst button').textContent")
    assert first.replace("\u202f", " ").startswith(f"1{worst:.3g} m")

    # It is in the middle, with its line, and the clock shows its time.
    fleet_page.click_all("#worst button", 0)
    assert fleet_page.run("return document.getElementById('layer-errors').checked")
    assert fleet_page.pixels("#d55e00") > 50


def test_the_ten_worst_places_are_in_order(fleet_page):
    texts = fleet_page.run(
        "return [...document.querySelectorAll('#worst button span:nth-child(2)')]"
        ".map((each) => each.textContent)"
    )
    errors = [float(text.split("\u202f")[0]) for text in texts]
    assert len(errors) == 10
    assert errors == sorted(errors, reverse=True)


def test_areas_are_chosen_and_found_by_their_tracks(browser, odd_paths):
    page = Page(browser, odd_paths["travel"]).open()
    options = page.run(
        "return [...document.querySelectorAll('#area option')].map((each) => each.textContent)"
    )
    assert len(options) == 2
    assert any("50.0" in each and "N" in each for each in options)
    assert any("30.0" in each and "S" in each for each in options)

    # A track in another area is shown, and its position is there.
    page.press("n", Keys.ENTER)
    assert "N, 8.00" in page.text("here-facts")
    page.press("n")
    page.press(Keys.ENTER)
    assert "S, 150.00" in page.text("here-facts")
    with_map = page.picture()
    page.press("3")
    assert page.picture() != with_map

    # An area that is chosen is shown, whatever the track is.
    north = next(number for number, each in enumerate(options) if "N" in each.split("E")[0])
    page.choose("area", str(north))
    page.press(Keys.ENTER)
    assert "N, 8.00" in page.text("here-facts")
