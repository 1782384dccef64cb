"""The kind ``heat``: the clean map, coloured by how often each street was travelled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gpszip.drawing.map_figure import (
    add_caption,
    add_color_bar,
    add_remark,
    from_above,
    map_figure,
)
from gpszip.drawing.map_lines import draw_samples, hidden_planes
from gpszip.drawing.style import GREY
from gpszip.view.plots.map import clean_lines
from gpszip.view.plots.subject import Subject

if TYPE_CHECKING:
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

    from gpszip.drawing.style import Layout

__all__ = ["draw_heat"]

#: Line width of all edges, in points.
_WIDTH = 1.8

#: Part of the color map inferno that stands out from white paper, dark for many traversals.
_SHADES = (0.85, 0.05)


def draw_heat(subject: Subject, layout: Layout) -> Figure:
    """Draw the clean map in colours on a logarithmic scale, over the log in grey if it is given."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm

    # Samples below.
    lines, area = clean_lines(subject)
    samples = area.samples(subject)
    figure, axes = map_figure([*samples, *lines.vertices], layout)
    draw_samples(axes, samples, GREY)

    # The map, the busiest streets on top.
    order = np.argsort(lines.traversals, kind="stable").tolist()
    largest = int(lines.traversals.max(initial=1))
    streets = LineCollection(
        [from_above(lines.vertices[number]) for number in order],
        array=lines.traversals[order].astype(np.float64),
        cmap=_color_map(),
        norm=LogNorm(1, max(largest, 2)),
        linewidths=_WIDTH,
        capstyle="round",
        joinstyle="round",
        zorder=2,
        gid="map",
    )
    axes.add_collection(streets, autolim=False)

    # What the colours mean.
    if largest > 1:
        add_color_bar(figure, layout, streets, (1, largest))
    else:
        add_caption(figure, layout, "each street travelled once")
    add_remark(figure, layout, hidden_planes(area.plane))
    return figure


def _color_map() -> Colormap:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["inferno"](np.linspace(*_SHADES, 256)))
