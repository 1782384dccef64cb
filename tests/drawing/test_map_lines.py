import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from gpszip.drawing.map_lines import (
    MapLines,
    draw_lines,
    draw_samples,
    line_width,
    lines_legend,
    main_plane,
    on_plane,
    samples_legend,
)
from gpszip.drawing.style import CYCLE, EDGE_COLOR, LOG_COLOR
from gpszip.model import Plane

PLANES = Plane(((0, 0), (0, 900_000_000), (0, -900_000_000)))

LINES = MapLines(
    [np.array([[0.0, 0], [9, 0]]), np.array([[0.0, 0], [0, 5], [9, 5]])], np.array([16, 1])
)


def test_the_busiest_line_is_widest_and_on_top():
    axes = Figure().add_subplot()
    draw_lines(axes, LINES)
    (drawn,) = axes.collections
    assert [len(line) for line in drawn.get_segments()] == [3, 2]
    assert np.array_equal(drawn.get_segments()[1], LINES.vertices[0])
    assert drawn.get_linewidths()[1] > 2 * drawn.get_linewidths()[0]


@pytest.mark.parametrize("largest", [1, 2, 10, 10_000, 10**8])
def test_widths_are_within_bounds(largest):
    widths = line_width(np.array([1, largest]), largest)
    assert 0.5 < widths[0] <= widths[1] < 3.0


def test_the_legend_shows_the_widths_that_are_drawn():
    axes = Figure().add_subplot()
    draw_lines(axes, LINES)
    assert [(item.get_label(), item.get_linewidth()) for item in lines_legend(LINES)] == [
        (label, pytest.approx(width))
        for label, width in zip(
            ("1", "16 traversals"), axes.collections[0].get_linewidths(), strict=True
        )
    ]


def test_the_legend_of_single_traversals_has_one_line():
    once = MapLines(LINES.vertices, np.array([1, 1]))
    assert [item.get_label() for item in lines_legend(once)] == ["1 traversal"]


def test_samples_of_all_tracks_are_drawn_from_above():
    axes = Figure().add_subplot()
    flight = np.array([[1.0, 2.0, 50.0], [3.0, 4.0, 60.0]])
    draw_samples(axes, [flight, flight + 10])
    assert axes.lines[0].get_xydata().tolist() == [[1, 2], [3, 4], [11, 12], [13, 14]]
    assert [item.get_label() for item in samples_legend([flight, flight])] == ["4 points"]


def test_many_samples_are_pixels_and_smaller():
    few, many = Figure().add_subplot(), Figure().add_subplot()
    draw_samples(few, [np.zeros((100, 2))])
    draw_samples(many, [np.zeros((100_000, 2))])
    assert (few.lines[0].get_rasterized(), many.lines[0].get_rasterized()) == (False, True)
    assert many.lines[0].get_markersize() < few.lines[0].get_markersize()


def test_no_samples_draw_nothing():
    axes = Figure().add_subplot()
    draw_samples(axes, [])
    assert not axes.lines
    assert not samples_legend([])


def test_the_plane_with_the_most_positions_is_chosen():
    positions = np.array(
        [[5.0, 0], [Plane.SPREAD, 1], [Plane.SPREAD - 90, 2], [2 * Plane.SPREAD, 3]]
    )
    index = main_plane([positions[:2], positions[2:]], PLANES)
    assert index == 1
    assert on_plane(positions, PLANES, index).tolist() == [False, True, True, False]
    assert main_plane([positions], None) is None
    assert on_plane(positions, None, None).all()


def luminance(color):
    """Relative luminance of sRGB (WCAG 2)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(color)]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def test_map_and_log_differ_in_grey_and_all_colors_show_on_white():
    light, dark = luminance(LOG_COLOR), luminance(EDGE_COLOR)
    assert (light + 0.05) / (dark + 0.05) > 2.3
    assert all(1.05 / (luminance(color) + 0.05) > 2.0 for color in CYCLE)
