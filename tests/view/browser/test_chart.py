"""The chart: linked with the map both ways, ranges measured as Python measures them."""

import numpy as np
import pytest

from gpszip.walks.error import synchronised_errors
from view.browser.conftest import START, walk_positions
from view.browser.driving import Keys


def metres(text):
    value, unit = text.split(" ")
    return float(value.replace(",", "")) * {"m": 1, "km": 1000, "cm": 0.01}[unit]


def set_range(page, first, last):
    """Measure from one time to another with the keyboard."""
    for text, key in ((first, "["), (last, "]")):
        page.fill("where-time", text)
        page.run("document.activeElement.blur()")
        page.press(key)


def test_a_range_measures_what_python_measures(fleet_page, fleet, fleet_tracks):
    fleet_page.press("n", "n")
    set_range(fleet_page, "22:15:00", "22:20:00")
    facts = fleet_page.table("range-facts")
    assert facts["Duration"] == "5 min"

    # The walk, from knot to knot and from the ends of the range.
    walk = fleet.walks[1]
    first, last = START + 100, START + 400
    times = np.unique(np.r_[first, walk.times[(walk.times > first) & (walk.times < last)], last])
    positions = walk_positions(fleet, 1, times)
    distance = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
    assert metres(facts["Distance"]) == pytest.approx(distance, rel=5e-3)

    # The samples.
    track = fleet_tracks[1]
    inside = (track.times >= first) & (track.times <= last)
    errors = synchronised_errors(track, walk, fleet.road_map.nodes)[inside]
    assert facts["Points"] == str(inside.sum())
    assert metres(facts["RMSE"]) == pytest.approx(np.sqrt(np.mean(errors**2)), rel=2e-2)
    assert metres(facts["Largest error"]) == pytest.approx(errors.max(), rel=2e-2)


def test_numbers_of_a_track_are_those_of_all_its_samples(fleet_page, fleet_tracks):
    fleet_page.press("n")
    facts = fleet_page.table("track-facts")
    assert facts["Points"] == str(len(fleet_tracks[0]))
    assert facts["Gaps"] == "1"
    assert "Without a position" in facts


def test_a_drag_makes_a_range_and_escape_clears_it(fleet_page):
    assert "Drag over the chart" in fleet_page.text("range")
    fleet_page.drag("#plot", 0.4, 0.5, 200, 0)
    assert fleet_page.shown("range-section")
    assert fleet_page.pixels("#d55e00", overlay=True) > 300
    fleet_page.press(Keys.ESCAPE)
    assert not fleet_page.shown("range-section")
    assert "Drag over the chart" in fleet_page.text("range")


def test_a_click_on_the_chart_sets_the_clock(fleet_page):
    before = fleet_page.text("clock")
    fleet_page.actions_at("#plot", 0.5, 0.5).click().perform()
    fleet_page.settle()
    assert fleet_page.text("clock") != before
    assert not fleet_page.shown("range-section")


def test_the_chart_zooms_to_the_range_and_back(fleet_page):
    set_range(fleet_page, "22:15:00", "22:16:00")
    whole = fleet_page.picture("#plot")
    fleet_page.press("z")
    assert fleet_page.picture("#plot") != whole
    assert fleet_page.shown("chart-whole")
    fleet_page.press("x")
    assert fleet_page.picture("#plot") == whole
    assert not fleet_page.shown("chart-whole")


def test_the_pointer_over_the_chart_shows_the_place_on_the_map(fleet_page):
    fleet_page.press("n", "n")
    before = fleet_page.pixels("#1d2329", overlay=True)
    fleet_page.point("#plot", 0.5, 0.5)
    assert fleet_page.pixels("#1d2329", overlay=True) > before + 10


def test_the_pointer_over_the_map_shows_the_time_on_the_chart(fleet_page):
    fleet_page.press("n", "n")
    fleet_page.fill("where-time", "22:20:00")
    fleet_page.point(".pane", 0.02, 0.98)
    away = fleet_page.picture("#plot", number=1)
    fleet_page.point(".pane", 0.5, 0.5)
    assert fleet_page.picture("#plot", number=1) != away
    assert "\u00b0" in fleet_page.text("position")


def test_charts_of_all_kinds_are_drawn(robot_page):
    pictures = set()
    for chart in ("speed", "error", "altitude", "kept:battery"):
        robot_page.choose("chart", chart)
        pictures.add(robot_page.picture("#plot"))
    assert len(pictures) == 4
    assert robot_page.errors() == []


def test_a_kept_column_is_drawn_as_it_is(robot_page):
    """Charge falls from 100 to 90: the line leads from the upper left to the lower right."""
    robot_page.choose("chart", "kept:battery")
    first, last = robot_page.run(
        "const c = document.querySelector('#plot canvas');"
        "const image = c.getContext('2d').getImageData(0, 0, c.width, c.height);"
        "const top = (x) => { for (let y = 0; y < c.height; y++) {"
        "  const at = 4 * (y * c.width + x);"
        "  if (image.data[at + 2] - image.data[at] > 60) return y / c.height; } return -1; };"
        "return [top(60), top(c.width - 24)]"
    )
    assert first < 0.2
    assert last > 0.65


def test_bytes_by_section_add_up(robot_page, robot):
    robot_page.choose("chart", "bytes")
    counts = robot_page.run(
        "return [...document.querySelectorAll('.bar-items strong')].map((each) => each.textContent)"
    )
    sizes = [int(text.replace("\u202f", " ").split(" ")[0].replace(",", "")) for text in counts]
    assert sum(sizes) == robot[0].size


def test_units(fleet_page):
    metric = metres(fleet_page.table("track-facts")["Distance"])
    fleet_page.choose("units", "mi")
    value, unit = fleet_page.table("track-facts")["Distance"].split(" ")
    assert unit == "mi"
    assert float(value) == pytest.approx(metric / 1609.344, rel=1e-2)
    fleet_page.choose("units", "nm")
    assert fleet_page.table("track-facts")["Mean speed"].endswith(" kn")
    fleet_page.choose("units", "mi")
    assert fleet_page.table("numbers")["RMSE at most"] == "26.2 ft"  # 8 m
