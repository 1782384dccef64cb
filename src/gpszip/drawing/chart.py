"""Figures of charts: two axes with ticks, and labels beside the data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpszip.drawing.map_figure import TITLE_HEIGHT, add_title
from gpszip.drawing.style import Layout, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["chart_figure"]

#: Millimetres at left, for the numbers and the label of the upright axis.
_LEFT = 14.0

#: Millimetres from the left end to the middle of that label.
_LABEL = 2.5

#: Millimetres at right, for labels of what is drawn.
_RIGHT = 17.0

#: Millimetres at right without them, for half of a number at the end of the axis.
_RIGHT_END = 5.0

#: Millimetres below, for the numbers and the label of the other axis.
_BELOW = 9.0

#: Millimetres above the axes.
_ABOVE = 2.5


def chart_figure(layout: Layout, aspect: float, right: float = _RIGHT) -> tuple[Figure, Axes]:
    """Return a figure with empty axes, and space at their right for labels of the data.

    Parameters
    ----------
    layout : Layout
        Width and title of the figure.
    aspect : float
        Height of the figure without its title, relative to its width.
    right : float, default 17
        Millimetres at right for the legend; few without one.
    """
    # The legend needs the space at right.
    right = right if layout.legend else _RIGHT_END
    above = TITLE_HEIGHT if layout.title else _ABOVE
    width, height = layout.width, layout.width * aspect + above
    figure = new_figure(width, height)
    axes = figure.add_axes(
        (
            _LEFT / width,
            _BELOW / height,
            (width - _LEFT - right) / width,
            (height - _BELOW - above) / height,
        )
    )

    # A border at left and below only, a quiet grid, and the upright label at a fixed place.
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid()
    axes.set_axisbelow(True)
    axes.yaxis.set_label_coords(-(_LEFT - _LABEL) / (width - _LEFT - right), 0.5)
    add_title(figure, layout)
    return figure, axes
