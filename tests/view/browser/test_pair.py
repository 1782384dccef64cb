"""Two archives side by side."""

from view.browser.driving import Keys


def test_both_maps_are_drawn_and_named(pair_page):
    assert pair_page.pixels("#0072b2", pane=0) > 500
    assert pair_page.pixels("#0072b2", pane=1) > 500
    names = pair_page.run(
        "return [...document.querySelectorAll('.pane-name')].map((each) => each.textContent)"
    )
    assert names == ["A  a.gpsz", "B  b.gpsz"]


def test_maps_move_together_and_show_the_same_pointer(pair_page):
    before = [pair_page.picture(number=2 * pane) for pane in (0, 1)]
    pair_page.drag(".pane", 0.5, 0.5, 80, 30)
    after = [pair_page.picture(number=2 * pane) for pane in (0, 1)]
    assert before[0] != after[0]
    assert before[1] != after[1]

    # The pointer over one map is shown on both.
    pair_page.run("document.activeElement.blur()")
    pair_page.point("#plot", 0.5, 0.5)
    without = [pair_page.picture(number=2 * pane + 1) for pane in (0, 1)]
    pair_page.point(".pane", 0.1, 0.1)
    assert all(pair_page.picture(number=2 * pane + 1) != without[pane] for pane in (0, 1))


def test_the_clock_moves_both(pair_page):
    before = [pair_page.picture(number=2 * pane + 1) for pane in (0, 1)]
    pair_page.press(Keys.END)
    assert all(pair_page.picture(number=2 * pane + 1) != before[pane] for pane in (0, 1))


def test_a_track_has_one_colour_on_both_maps(pair_page):
    """The first track, which only the first archive has, is blue."""
    pair_page.fill("where-time", "22:15")
    assert pair_page.pixels("#0072b2", overlay=True, pane=0) > 40
    assert pair_page.pixels("#0072b2", overlay=True, pane=1) == 0
    assert pair_page.pixels("#e69f00", overlay=True, pane=1) > 40


def test_numbers_of_both_are_listed(pair_page):
    captions = pair_page.run(
        "return [...document.querySelectorAll('#track-facts caption')].map((c) => c.textContent)"
    )
    assert captions == ["a.gpsz", "b.gpsz"]
    pair_page.press(Keys.ENTER)
    assert pair_page.errors() == []


def test_two_maps_are_printed_side_by_side(pair_page):
    """Paper is as narrow as windows in which one map is below the other."""
    metrics = {"width": 700, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    direction = "return getComputedStyle(document.getElementById('panes')).flexDirection"
    pair_page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        assert pair_page.run(direction) == "column"
        pair_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
        assert pair_page.run(direction) == "row"
    finally:
        pair_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
        pair_page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
