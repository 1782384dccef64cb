"""Layers, and what colours stand for."""

import numpy as np

from view.browser.conftest import STREETS
from view.browser.driving import PAPER, Page

#: Key and colour of each layer, in light colours.
LAYERS = {
    "1": "#8b959f",
    "2": "#c77c00",
    "3": "#0072b2",
    "4": "#56a0cc",
    "5": "#1d2329",
    "6": "#66707a",
    "7": "#b8528a",
    "8": "#009e73",
    "9": "#d55e00",
    "b": "#dfdcd2",
    "g": "#e6e7e4",
}

#: Key of the layer of gaps.
GAPS = "6"


def turn_off_layers(page):
    on = page.run(
        "return [...document.querySelectorAll('#layers label')].filter((l) => l.control.checked)"
        ".map((l) => l.querySelector('kbd').textContent)"
    )
    page.press(*on)


def rgb(colour):
    return [int(colour[start : start + 2], 16) for start in (1, 3, 5)]


def test_each_layer_is_drawn_while_it_is_on(fleet_page):
    turn_off_layers(fleet_page)
    empty = fleet_page.picture()
    for key, colour in LAYERS.items():
        without = fleet_page.pixels(colour)
        fleet_page.press(key)
        if key != GAPS:
            assert fleet_page.pixels(colour) >= without + 40, key
        fleet_page.press(key)
        assert fleet_page.picture() == empty, key


def test_gaps_are_dashes_of_their_colour(fleet_page):
    """Their lines are thin: a pixel is a mixture of paper and colour, and few are colour alone."""
    turn_off_layers(fleet_page)
    fleet_page.press(GAPS)
    paper = np.array(rgb(PAPER))
    ink = np.array(rgb(LAYERS[GAPS])) - paper
    drawn = fleet_page.pixels_but(PAPER) - paper
    coverage = drawn @ ink / (ink @ ink)
    assert np.abs(drawn - coverage[:, None] * ink).max() <= 3
    assert 0.7 < coverage.max() < 1.02
    assert coverage.sum() > 40


def test_boxes_and_keys_are_the_same_switch(fleet_page):
    checked = "return document.getElementById('layer-tracks').checked"
    assert not fleet_page.run(checked)
    fleet_page.press("2")
    assert fleet_page.run(checked)
    fleet_page.click("layer-tracks")
    assert not fleet_page.run(checked)
    assert fleet_page.pixels(LAYERS["2"]) == 0


def test_colours_have_legends(fleet_page):
    fleet_page.press("2")
    labels = {
        "speed": "km/h",
        "error": " m",
        "time": "22:",
        "hour": "12:00",
        "traversals": "1",
        "direction": "E",
    }
    for colour, label in labels.items():
        fleet_page.choose("colour", colour)
        assert label in fleet_page.text("legend")
        own = "3" if colour == "traversals" else "2"
        assert fleet_page.pixels(LAYERS[own]) == 0, colour
    assert fleet_page.errors() == []


def test_colours_of_samples_lie_above_the_map(fleet_page):
    """Below it, the map would hide nearly all of them."""
    second = "#e69f00"  # colour of the second track
    fleet_page.choose("colour", "track")
    above_map = fleet_page.pixels(second)
    fleet_page.press("3")
    assert above_map == fleet_page.pixels(second) > 200


def test_colours_of_tracks_show_the_tracks_where_there_are_no_samples(fleet_page):
    fleet_page.press("1")
    fleet_page.choose("colour", "traversals")
    assert not fleet_page.element("layer-tracks").is_selected()
    fleet_page.choose("colour", "speed")
    assert fleet_page.element("layer-tracks").is_selected()


def test_a_chosen_track_makes_the_others_dim(fleet_page):
    fleet_page.press("1", "3", "2")
    all_tracks = fleet_page.pixels(LAYERS["2"])
    assert fleet_page.pixels("#dcdedc") == 0
    fleet_page.press("n")
    assert 0 < fleet_page.pixels(LAYERS["2"]) < all_tracks
    assert fleet_page.pixels("#dcdedc") > 100
    fleet_page.press("p")
    assert fleet_page.pixels(LAYERS["2"]) == all_tracks


def test_many_edges_are_painted_where_they_are(browser, odd_paths):
    """Streets of a grid that is too large to be stroked are as many rows and columns of pixels."""
    page = Page(browser, odd_paths["streets"]).open()
    page.press("g", "l")
    rows, columns = page.run(
        "const c = document.querySelector('.pane canvas');"
        "const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);"
        "const pixels = new Uint32Array(data.buffer); const paper = pixels[0];"
        "const rows = new Uint32Array(c.height), columns = new Uint32Array(c.width);"
        "pixels.forEach((p, i) => { if (p === paper) return;"
        "  rows[Math.floor(i / c.width)]++; columns[i % c.width]++; });"
        "return [[...rows], [...columns]]"
    )
    for counts in (rows, columns):
        is_street = np.array(counts) > max(counts) * 0.9
        streets = np.flatnonzero(np.diff(np.r_[0, is_street.astype(int)]) > 0)
        assert len(streets) == STREETS
        assert np.ptp(np.diff(streets)) <= 1
    assert page.errors() == []
