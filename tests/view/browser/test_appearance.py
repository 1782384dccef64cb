"""Dark mode, print, narrow windows, the keyboard and screen readers."""

import base64

import pytest

from view.browser.driving import COUNT, PAPER, Keys, Page

DARK_PAPER = "#14181c"


def prefer(browser, scheme):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def test_a_page_takes_the_colours_of_the_system(browser, fleet_path):
    prefer(browser, "dark")
    try:
        page = Page(browser, fleet_path).open()
        assert page.pixels(DARK_PAPER) > 100_000
        prefer(browser, "light")
        page.settle()
        assert page.pixels(DARK_PAPER) == 0
    finally:
        prefer(browser, "light")


def test_a_key_and_a_button_switch_between_light_and_dark(fleet_page):
    fleet_page.press("m")
    assert fleet_page.pixels(DARK_PAPER) > 100_000
    body = fleet_page.run("return getComputedStyle(document.body).backgroundColor")
    assert body == "rgb(26, 31, 36)"
    fleet_page.click("theme")
    assert fleet_page.pixels(PAPER) > 100_000


def test_a_page_prints_in_light_colours_and_without_controls(fleet_page):
    fleet_page.press("m")
    fleet_page.fill("where-time", "22:20")
    agents = fleet_page.pixels("#e69f00", overlay=True)
    fleet_page.run(
        f"const count = function () {{ {COUNT} }};"
        "window.addEventListener('beforeprint', () => {"
        f"  window.printed = [count(0, ['{PAPER}']), count(0, ['#e69f00'])];"
        "});"
    )
    pdf = fleet_page.driver.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert base64.b64decode(pdf["data"])[:5] == b"%PDF-"

    # The canvas that is printed has light colours, and shows the agents, too.
    paper, printed_agents = fleet_page.run("return window.printed")
    assert paper > 100_000
    assert printed_agents >= agents > 40
    fleet_page.settle()
    assert fleet_page.pixels(DARK_PAPER) > 100_000

    # Controls are left out.
    fleet_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert not fleet_page.shown("play")
        assert not fleet_page.shown("zoom-in")
        assert fleet_page.shown("numbers")
    finally:
        fleet_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (900, 520)])
def test_nothing_sticks_out_of_a_window(browser, odd_paths, width, height):
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        page = Page(browser, odd_paths["travel"]).open()
        outside = page.run(
            "return [...document.querySelectorAll('button, select, input, output, canvas')]"
            ".filter((each) => each.checkVisibility() && !each.closest('#panel'))"
            ".filter((each) => { const box = each.getBoundingClientRect();"
            "  const isLow = box.bottom > innerHeight + 0.5;"
            "  return box.right > innerWidth + 0.5 || isLow || box.width < 1; })"
            ".map((each) => each.id)"
        )
        assert [each for each in outside if each != "position"] == []
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_narrow_window_scrolls_down_but_not_sideways(browser, fleet_path):
    size = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        page = Page(browser, fleet_path).open()
        assert page.run("return document.documentElement.scrollWidth") == 390
        assert page.run("return document.querySelector('.pane canvas').width") == 780
        assert page.pixels("#0072b2") > 500
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_every_control_has_a_name(fleet_page):
    unnamed = fleet_page.run(
        "return [...document.querySelectorAll('button, input, select, canvas[tabindex]')]"
        ".filter((each) => !(each.ariaLabel || each.textContent.trim() || each.labels?.length))"
        ".map((each) => each.outerHTML)"
    )
    assert unnamed == []


def test_all_controls_are_reached_by_the_tab_key_and_show_the_focus(fleet_page):
    expected = fleet_page.run(
        "return [...document.querySelectorAll('button, input, select, canvas[tabindex]')]"
        ".filter((each) => each.checkVisibility()).length"
    )
    reached, outlined = set(), 0
    for _ in range(expected + 2):
        fleet_page.driver.switch_to.active_element.send_keys(Keys.TAB)
        number, outline = fleet_page.run(
            "const all = [...document.querySelectorAll('button, input, select, canvas[tabindex]')];"
            "const style = getComputedStyle(document.activeElement);"
            "return [all.indexOf(document.activeElement), style.outlineStyle];"
        )
        if number >= 0 and number not in reached:
            reached.add(number)
            outlined += outline != "none"
    assert len(reached) == expected == outlined


def test_the_help_lists_keys(fleet_page):
    fleet_page.press("?")
    assert fleet_page.shown("help")
    assert "Play or pause" in fleet_page.text("keys")
    assert "Raw points" in fleet_page.text("keys")
    fleet_page.press("?")
    assert not fleet_page.shown("help")


def test_keys_written_into_a_field_are_text(fleet_page):
    fleet_page.element("where-time").send_keys("123 m")
    fleet_page.settle()
    assert fleet_page.run("return document.getElementById('where-time').value") == "123 m"
    assert fleet_page.run("return document.getElementById('layer-raw').checked")
    assert fleet_page.run("return document.documentElement.dataset.theme") == "light"


def test_keys_move_the_map_and_0_shows_everything(fleet_page):
    whole = fleet_page.picture()
    for key in "+-wasd":
        fleet_page.press(key)
        assert fleet_page.picture() != whole, key
        fleet_page.press("0")
        assert fleet_page.picture() == whole, key


def test_the_mouse_moves_and_zooms_the_map(fleet_page):
    fleet_page.point(".pane", 0.5, 0.5)
    middle = fleet_page.text("position")
    fleet_page.drag(".pane", 0.5, 0.5, 100, 40)
    moved = fleet_page.text("position")
    assert moved == middle  # the place under the pointer moves with it
    fleet_page.point(".pane", 0.5, 0.5)
    assert fleet_page.text("position") != middle

    # The place under the pointer stays where it is.
    fleet_page.point(".pane", 0.3, 0.4)
    place = fleet_page.text("position").split(",")[0][:7]
    before = fleet_page.picture()
    canvas = fleet_page.driver.find_elements("css selector", ".pane canvas")[1]
    fleet_page.run(
        "const box = arguments[0].getBoundingClientRect();"
        "arguments[0].dispatchEvent(new WheelEvent('wheel', {deltaY: -200, cancelable: true,"
        "clientX: box.left + 0.3 * box.width, clientY: box.top + 0.4 * box.height}));",
        canvas,
    )
    fleet_page.settle()
    assert fleet_page.picture() != before
    fleet_page.point(".pane", 0.3, 0.401)
    assert fleet_page.text("position").split(",")[0][:7] == place


def test_two_fingers_zoom_the_map(fleet_page):
    fleet_page.point(".pane", 0.5, 0.5)
    before = fleet_page.picture()
    box = fleet_page.run(
        "const box = document.querySelector('.pane').getBoundingClientRect();"
        "return [box.left + box.width / 2, box.top + box.height / 2]"
    )

    def touch(kind, apart):
        points = [{"x": box[0] + sign * apart, "y": box[1], "id": sign + 1} for sign in (-1, 1)]
        event = {"type": kind, "touchPoints": points if apart else []}
        fleet_page.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)

    touch("touchStart", 40)
    for apart in (50, 60, 80):
        touch("touchMove", apart)
    touch("touchEnd", 0)
    fleet_page.settle()
    assert fleet_page.picture() != before
    assert not fleet_page.shown("here")
