"""The clock, and where tracks are at a time."""

import re

import pytest

from view.browser.conftest import START
from view.browser.driving import Keys


def clock_seconds(page):
    """Seconds of the fleet's clock since its start."""
    hours, minutes, seconds = page.text("clock").split(" ")[-1].split(":")
    return int(hours) * 3600 + int(minutes) * 60 + float(seconds) - (22 * 3600 + 13 * 60 + 20)


def test_the_clock_runs_and_stops(fleet_page):
    assert clock_seconds(fleet_page) == 0
    fleet_page.press(" ")
    assert fleet_page.element("play").get_attribute("aria-label") == "Pause"
    fleet_page.until(lambda: clock_seconds(fleet_page) > 20)
    fleet_page.press(" ")
    stopped = clock_seconds(fleet_page)
    fleet_page.settle()
    assert clock_seconds(fleet_page) == stopped
    assert fleet_page.element("play").get_attribute("aria-label") == "Play"


def test_the_clock_runs_by_elapsed_time(fleet_page):
    """At 100 times the speed, 100 seconds of the log take one, whatever its samples are."""
    fleet_page.choose("speed", "100")
    before = fleet_page.run("return performance.now()")
    fleet_page.click("play")
    fleet_page.until(lambda: clock_seconds(fleet_page) > 50)
    seconds = clock_seconds(fleet_page)
    elapsed = (fleet_page.run("return performance.now()") - before) / 1000
    fleet_page.click("play")
    assert seconds <= 100 * elapsed + 1


def test_steps_and_ends(fleet_page):
    fleet_page.press(Keys.ARROW_RIGHT)
    step = clock_seconds(fleet_page)
    assert step > 0
    fleet_page.press_with_shift(Keys.ARROW_RIGHT)
    assert clock_seconds(fleet_page) == pytest.approx(11 * step)
    fleet_page.press(Keys.ARROW_LEFT)
    assert clock_seconds(fleet_page) == pytest.approx(10 * step)
    fleet_page.press(Keys.END)
    assert clock_seconds(fleet_page) == pytest.approx(895, abs=5)
    fleet_page.press(Keys.HOME)
    assert clock_seconds(fleet_page) == 0


def test_space_plays_after_a_click_on_another_button(fleet_page):
    fleet_page.element("zoom-in").click()
    fleet_page.settle()
    zoomed = fleet_page.picture()
    fleet_page.press(" ")
    fleet_page.until(lambda: clock_seconds(fleet_page) > 0)
    assert fleet_page.picture() == zoomed


def test_the_clock_starts_again_at_its_end(fleet_page):
    fleet_page.press(Keys.END, " ")
    fleet_page.until(lambda: clock_seconds(fleet_page) < 800)


def test_where_a_track_is_at_a_time_is_what_python_says(fleet_page, fleet):
    fleet_page.press("n", "n")
    for seconds in (100, 433, 700):
        check_position(fleet_page, fleet, seconds)


def check_position(fleet_page, fleet, seconds):
    minutes, rest = divmod(13 * 60 + 20 + seconds, 60)
    fleet_page.fill("where-time", f"22:{minutes:02d}:{rest:02d}")
    assert fleet_page.text("where-answer").startswith(f"2023-11-14 22:{minutes:02d}:{rest:02d}: ")
    fleet_page.run("document.activeElement.blur()")
    for _ in range(8):
        fleet_page.press("+")
    fleet_page.press(Keys.ENTER)

    name = fleet.ids[1]
    expected = fleet.position(name, START + seconds)
    shown = re.findall(r"([\d.]+)\u00b0", fleet_page.text("here-facts"))[:2]
    assert [float(each) for each in shown] == pytest.approx(expected, abs=2e-6)


def test_times_outside_of_the_log_are_refused(fleet_page):
    fleet_page.fill("where-time", "2023-11-15 09:00")
    assert fleet_page.text("where-answer").startswith("Times are from 2023-11-14 22:13:20 to")
    fleet_page.fill("where-time", "noon")
    assert fleet_page.text("where-answer") == ("Can't read noon: write 14:05 or 2024-05-03 14:05.")
    assert clock_seconds(fleet_page) == 0


def test_a_zone_changes_the_clock_and_what_is_looked_for(fleet_page):
    fleet_page.choose("zone", "Asia/Tokyo")
    assert fleet_page.text("clock").startswith("2023-11-15 07:13:20")
    fleet_page.fill("where-time", "07:15")
    assert fleet_page.text("clock").startswith("2023-11-15 07:15:00")
    fleet_page.choose("zone", "UTC")
    assert clock_seconds(fleet_page) == 100


def test_all_tracks_start_at_0(fleet_page):
    fleet_page.click("aligned")
    assert fleet_page.text("clock").startswith("0:00:00")
    fleet_page.fill("where-time", "0:01:40")
    assert fleet_page.text("clock").startswith("0:01:40")
    fleet_page.fill("where-time", "2023-11-14 22:20")
    assert fleet_page.text("where-answer").endswith("write 0:14:05 or seconds.")

    # Places of the largest errors have the clock's times, too.
    listed = fleet_page.run("return document.querySelector('#worst button').lastChild.textContent")
    fleet_page.click_all("#worst button", 0)
    assert fleet_page.text("clock").startswith(listed)


def test_agents_move_and_have_tails(fleet_page):
    first = fleet_page.picture(number=1)
    fleet_page.choose("tail", "0")
    fleet_page.fill("where-time", "22:20")
    moved = fleet_page.picture(number=1)
    assert moved != first
    dots = fleet_page.pixels("#009e73", overlay=True)
    assert dots > 40
    fleet_page.choose("tail", "Infinity")
    assert fleet_page.pixels("#009e73", overlay=True) > 4 * dots


def test_no_agent_is_drawn_in_a_gap(fleet_page):
    """The first track has no samples from 300 s to 600 s."""
    fleet_page.press("n")
    fleet_page.choose("tail", "0")
    fleet_page.fill("where-time", "22:17")
    assert fleet_page.pixels("#d55e00", overlay=True) > 40
    fleet_page.fill("where-time", "22:20")
    assert fleet_page.pixels("#d55e00", overlay=True) == 0
    assert fleet_page.text("where-answer").endswith(
        "no track has a position. Last before: 2023-11-14 22:18:17. Next: 2023-11-14 22:23:20."
    )


def test_gaps_are_skipped_while_playing(fleet_page):
    fleet_page.press("n")
    fleet_page.fill("where-time", "22:18:10")
    fleet_page.run("document.activeElement.blur()")
    fleet_page.choose("speed", "10")
    fleet_page.press(" ")
    fleet_page.until(lambda: clock_seconds(fleet_page) > 320)
    fleet_page.press(" ")
    assert clock_seconds(fleet_page) >= 590


def test_the_map_follows_the_agent(fleet_page):
    fleet_page.press("n", "f", Keys.HOME)
    fleet_page.press(Keys.ENTER)
    position = fleet_page.text("here-facts")
    fleet_page.press(Keys.END)
    fleet_page.press(Keys.ENTER)
    assert fleet_page.text("here-facts") != position
    assert fleet_page.run("return document.getElementById('follow').checked")
    fleet_page.drag(".pane", 0.5, 0.5, 60, 0)
    assert not fleet_page.run("return document.getElementById('follow').checked")
