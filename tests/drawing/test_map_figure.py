import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.drawing.map_figure import (
    add_legend,
    add_remark,
    format_metres,
    map_figure,
    round_length,
)
from gpszip.drawing.map_lines import MapLines, hidden_planes, lines_legend, samples_legend
from gpszip.drawing.style import Layout, style
from gpszip.model import Plane
from random_tests import examples

#: Millimetres in an inch.
INCH = 25.4

#: Lengths in metres as words of the scale bar.
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3}


PAGE = Layout()


def drawn(positions, layout=PAGE):
    with style():
        return map_figure([np.array(each, float) for each in positions], layout)


def millimetres_of(figure, axes):
    """Size of the axes in millimetres."""
    return axes.get_position().size * figure.get_size_inches() * INCH


def in_metres(label):
    number, unit = label.split()
    return float(number) * UNITS[unit]


coordinates = st.floats(-1e6, 1e6, allow_subnormal=False)


@examples(30)
@given(
    st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=9), st.floats(60.0, 300.0)
)
def test_a_map_shows_all_positions_in_one_scale(positions, width):
    figure, axes = drawn([positions], Layout(width))
    assert figure.get_figwidth() * INCH == pytest.approx(width)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    points = np.array(positions)
    assert left < points[:, 0].min() <= points[:, 0].max() < right
    assert low < points[:, 1].min() <= points[:, 1].max() < high

    # Metres per millimetre, both ways; millimetres of a coordinate of 1000 km are rounded.
    scale = np.array([right - left, high - low]) / millimetres_of(figure, axes)
    assert scale[0] == pytest.approx(scale[1], rel=1e-4)
    assert axes.get_aspect() == 1


@examples(30)
@given(st.floats(1e-2, 1e6))
def test_the_scale_bar_has_the_length_of_its_label(extent):
    figure, axes = drawn([[[0, 0], [extent, extent / 2]]])
    (bar,) = [item for item in figure.findobj() if item.get_gid() == "scale-bar"]
    (label,) = figure.texts
    share = np.ptp(bar.get_xdata())
    left, right = axes.get_xlim()
    metres_per_mm = (right - left) / millimetres_of(figure, axes)[0]
    assert share * 175.0 * metres_per_mm == pytest.approx(in_metres(label.get_text()), rel=1e-6)
    assert 0.05 < share <= 0.2


@given(st.floats(1e-3, 1e7))
def test_round_lengths_are_the_largest_below(length):
    found = round_length(length)
    assert found <= length * (1 + 1e-9)
    assert length < 2.5 * found * (1 + 1e-9)
    assert f"{found:e}"[0] in "125"
    assert f"{found:.6e}"[1:8] == ".000000"


@pytest.mark.parametrize(
    ("length", "text"),
    [(0.001, "1 mm"), (0.5, "50 cm"), (1, "1 m"), (999, "999 m"), (5e5, "500 km")],
)
def test_lengths_have_units_that_suit_them(length, text):
    assert format_metres(length) == text


def test_a_title_takes_space_above():
    plain, _ = drawn([[[0, 0], [4, 1]]])
    titled, _ = drawn([[[0, 0], [4, 1]]], Layout(title="72,273 points"))
    assert titled.get_figheight() > plain.get_figheight()
    assert "72,273 points" in [text.get_text() for text in titled.texts]


def test_nothing_at_all_has_axes_too():
    _, axes = drawn([])
    assert axes.get_xlim()[0] < axes.get_xlim()[1]


@pytest.mark.parametrize(
    ("width", "points", "traversals"),
    [
        (60.0, 72_273, 99),
        (85.0, 1_234_567, 12_345),
        (149.0, 1_234_567, 12_345),
        (150.0, 1_234_567, 12_345),
    ],
)
def test_texts_below_the_map_do_not_overlap(width, points, traversals):
    layout = Layout(width)
    figure, _ = drawn([[[0, 0], [400_000, 90_000]]], layout)
    lines = MapLines([np.zeros((2, 2))], np.array([traversals]))
    planes = Plane(tuple((0, 60 * k) for k in range(30)))
    with style():
        add_legend(figure, layout, [*samples_legend([np.zeros((points, 2))]), *lines_legend(lines)])
        add_remark(figure, layout, hidden_planes(planes))
        figure.draw_without_rendering()
        boxes = [item.get_window_extent() for item in (*figure.legends, *figure.texts)]
        boxes += [item.get_window_extent() for item in figure.findobj(lambda item: item.get_gid())]
    assert len(boxes) == 4
    for number, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
        assert box.y0 >= 0
        assert not any(box.overlaps(other) for other in boxes[:number])
