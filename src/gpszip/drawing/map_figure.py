"""Figures of places: one scale for both axes, a scale bar, and no ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.style import INK, MM_PER_INCH, Layout, new_figure, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "TITLE_HEIGHT",
    "add_caption",
    "add_color_bar",
    "add_legend",
    "add_remark",
    "add_title",
    "format_metres",
    "from_above",
    "map_figure",
    "round_length",
]

#: Millimetres about the map at left and right.
_MARGIN = 1.5

#: Millimetres above the map for the title.
TITLE_HEIGHT = 6.0

#: Millimetres below the map for the legend and the scale bar.
_FOOTER_HEIGHT = 6.0

#: Millimetres of a second row below the map, where the scale bar finds no space beside the legend.
_ROW_HEIGHT = 4.5

#: Width in millimetres below which legend and scale bar stand in two rows.
_NARROW = 150.0

#: Millimetres from the lower end of the figure to the middle of its last row.
_ROW_MIDDLE = 2.8

#: Least and largest height of the map, relative to its width.
_ASPECTS = (0.3, 1.25)

#: Space between the data and the border of the map, relative to its longer side.
_SPACE = 0.02

#: Longest scale bar, relative to the width of the picture.
_SCALE_BAR = 0.2

#: Millimetres that the length at the left of the scale bar takes.
_LENGTH_WIDTH = 14.0

#: Least extent in metres, in place of zero.
_MIN_EXTENT = 1e-3

Floats = NDArray[np.float64]


def from_above(positions: Floats) -> Floats:
    """Return x and y of positions with any number of coordinates; y is 0 where there is none.

    Examples
    --------
    >>> from_above(np.array([[1.0, 2.0, 3.0]])).tolist(), from_above(np.array([[1.0]])).tolist()
    ([[1.0, 2.0]], [[1.0, 0.0]])
    """
    if positions.shape[1] >= 2:
        return positions[:, :2]
    return np.column_stack([positions, np.zeros(len(positions))])


def map_figure(positions: Sequence[Floats], layout: Layout) -> tuple[Figure, Axes]:
    """Return a figure with axes that show all positions from above, and its scale bar.

    Parameters
    ----------
    positions : sequence of float64 arrays, shape (n, d)
        Metres.
    layout : Layout
        Width and title of the figure; its height follows from the positions.
    """
    # The extent of the data, with some space about it.
    low, high = _extent(positions)
    size = np.maximum(high - low, _MIN_EXTENT)
    size = size + 2 * _SPACE * size.max()

    # Sizes in millimetres. The scale is chosen such that the data fits both ways.
    width = layout.width - 2 * _MARGIN
    height = width * float(np.clip(size[1] / size[0], *_ASPECTS))
    metres_per_mm = max(size[0] / width, size[1] / height)
    top = TITLE_HEIGHT if layout.title else _MARGIN
    footer = _FOOTER_HEIGHT + _legend_offset(layout)
    total = top + height + footer

    # Axes that fill the space between title and footer.
    figure = new_figure(layout.width, total)
    axes = figure.add_axes(
        (_MARGIN / layout.width, footer / total, width / layout.width, height / total)
    )
    axes.set_axis_off()
    reach = np.array([width, height]) * metres_per_mm / 2
    center = (low + high) / 2
    axes.set_xlim(center[0] - reach[0], center[0] + reach[0])
    axes.set_ylim(center[1] - reach[1], center[1] + reach[1])
    axes.set_aspect("equal")
    add_title(figure, layout)
    _add_scale_bar(figure, layout, metres_per_mm)
    return figure, axes


def add_title(figure: Figure, layout: Layout) -> None:
    """Write the title above the picture, at left."""
    if layout.title:
        figure.set_label(printable(layout.title))
        figure.text(
            *_fractions(figure, _MARGIN, _height(figure) - 1.5),
            printable(layout.title),
            ha="left",
            va="top",
            fontsize=9,
            fontweight="bold",
            parse_math=False,
        )


def add_legend(figure: Figure, layout: Layout, handles: Sequence[Any]) -> None:
    """Explain colours and widths below the picture at left, in one row."""
    if layout.legend and handles:
        middle = _ROW_MIDDLE + _legend_offset(layout)
        figure.legend(
            handles=handles,
            loc="center left",
            bbox_to_anchor=_fractions(figure, _MARGIN, middle),
            ncols=len(handles),
            frameon=False,
            borderpad=0,
            borderaxespad=0,
            handlelength=1.4,
            handletextpad=0.5,
            columnspacing=1.2,
        )


def add_color_bar(
    figure: Figure,
    layout: Layout,
    mappable: Any,
    ends: tuple[int, int],
    what: str = "traversals",
) -> None:
    """Explain the colours of traversals, or of something else, below the map at left."""
    if not layout.legend:
        return

    # The bar; its number at left stands in the margin.
    middle = _ROW_MIDDLE + _legend_offset(layout)
    left, bottom = _fractions(figure, _MARGIN + 3, middle - 1)
    width, height = _fractions(figure, 24, 2)
    bar = figure.add_axes((left, bottom, width, height), gid="color-bar")
    colors = figure.colorbar(mappable, cax=bar, orientation="horizontal", ticks=[])
    colors.outline.set_visible(False)
    bar.minorticks_off()

    # What its ends mean.
    low, high = f"{ends[0]:,}", f"{ends[1]:,} {what}"
    for x, text, side in ((-0.04, low, "right"), (1.04, high, "left")):
        bar.text(x, 0.45, text, transform=bar.transAxes, ha=side, va="center")


def add_caption(figure: Figure, layout: Layout, text: str) -> None:
    """Write a text in the place of the legend."""
    if layout.legend:
        middle = _ROW_MIDDLE + _legend_offset(layout)
        figure.text(*_fractions(figure, _MARGIN, middle), text, ha="left", va="center")


def add_remark(figure: Figure, layout: Layout, text: str) -> None:
    """Write a remark in the row of the scale bar, where the legend leaves space."""
    if not (layout.legend and text):
        return
    if layout.width < _NARROW:
        figure.text(*_fractions(figure, _MARGIN, _ROW_MIDDLE), text, ha="left", va="center")
        return
    right = layout.width * (1 - _SCALE_BAR) - _MARGIN - _LENGTH_WIDTH
    figure.text(*_fractions(figure, right, _ROW_MIDDLE), text, ha="right", va="center")


def _legend_offset(layout: Layout) -> float:
    """Millimetres by which the legend stands above the scale bar."""
    return _ROW_HEIGHT if layout.legend and layout.width < _NARROW else 0.0


def _extent(positions: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return the least and the largest x and y; 0 and 1 where there is no position."""
    filled = [from_above(each) for each in positions if len(each)]
    if not filled:
        return np.zeros(2), np.ones(2)
    low = np.min([each.min(axis=0) for each in filled], axis=0)
    high = np.max([each.max(axis=0) for each in filled], axis=0)
    return low, high


def _height(figure: Figure) -> float:
    """Return the height of a figure in millimetres."""
    return float(figure.get_figheight()) * MM_PER_INCH


def _fractions(figure: Figure, x: float, y: float) -> tuple[float, float]:
    """Convert millimetres from the lower left to fractions of the figure."""
    return x / (float(figure.get_figwidth()) * MM_PER_INCH), y / _height(figure)


def _add_scale_bar(figure: Figure, layout: Layout, metres_per_mm: float) -> None:
    """Draw a bar of a round length below the map at right, with its length at its left."""
    from matplotlib.lines import Line2D

    # The bar ends at the right margin, as long as a round length is in the picture.
    length = round_length(layout.width * _SCALE_BAR * metres_per_mm)
    right = layout.width - _MARGIN
    left = right - length / metres_per_mm
    figure.add_artist(
        Line2D(
            *zip(
                _fractions(figure, left, _ROW_MIDDLE),
                _fractions(figure, right, _ROW_MIDDLE),
                strict=True,
            ),
            color=INK,
            linewidth=1.6,
            solid_capstyle="butt",
            gid="scale-bar",
        )
    )

    # Its length, 1.2 mm to the left of it.
    figure.text(
        *_fractions(figure, left - 1.2, _ROW_MIDDLE), format_metres(length), ha="right", va="center"
    )


def format_metres(length: float) -> str:
    """Format a length with a unit that suits it.

    Examples
    --------
    >>> format_metres(2000.0), format_metres(5.0), format_metres(0.2), format_metres(0.005)
    ('2 km', '5 m', '20 cm', '5 mm')
    """
    for metres, unit in ((1e3, "km"), (1.0, "m"), (1e-2, "cm")):
        if length >= metres * (1 - 1e-9):
            return f"{length / metres:.3g} {unit}"
    return f"{length * 1e3:.3g} mm"


def round_length(length: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above a length.

    Examples
    --------
    >>> round_length(37.0), round_length(0.6), round_length(1999.0)
    (20.0, 0.5, 1000.0)
    """
    power = 10.0 ** math.floor(math.log10(length))
    return next((step * power for step in (5.0, 2.0) if step * power <= length), power)
