"""Pictures of a log with lines and dots above it, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_legend, from_above, map_figure
from gpszip.drawing.map_lines import draw_samples, samples_legend
from gpszip.drawing.style import COLUMN_WIDTH, GREY, INK, FigureType, Layout, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Dots", "Label", "Lines", "draw_layers"]

#: Diameter of dots, in points.
_DOT = 3.0

#: Points between a place and its name.
_LABEL_GAP = 4.0

#: Share of the samples of each axis, at either end, that a picture may cut off: outliers.
_CUT = 0.002

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one kind.

    Parameters
    ----------
    name : str
        Stands in the legend; without one they are not explained.
    paths : sequence of float64 arrays, shape (n, d)
        Vertices of each line in metres.
    color : str, or sequence of str
        Colour of all, or of each.
    width : float
        Points.
    dashed : bool
        Whether they are dashed.
    """

    name: str
    paths: Sequence[Floats]
    color: str | Sequence[str]
    width: float = 1.2
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Dots:
    """Dots of one kind.

    Parameters
    ----------
    name : str
        Stands in the legend; without one they are not explained.
    positions : float64 array, shape (n, d)
        Metres.
    color : str
        Their colour.
    """

    name: str
    positions: Floats
    color: str = INK


@dataclass(frozen=True, eq=False)
class Label:
    """A place with its name, and a circle about it.

    Parameters
    ----------
    text : str
        Its name; may be empty.
    position : float64 array, shape (d,)
        Metres.
    radius : float, optional
        Metres of the circle; without one the place is a dot.
    """

    text: str
    position: Floats
    radius: float | None = None


def draw_layers(
    samples: Sequence[Floats],
    layers: Sequence[Lines | Dots],
    labels: Sequence[Label] = (),
    *,
    frame: Sequence[Floats] | None = None,
    width: float = COLUMN_WIDTH,
    color: str = GREY,
) -> FigureType:
    """Draw the samples of a log, layers above them in their order, and names of places.

    The picture shows all lines and dots, and of the samples all but outliers, unless a frame is
    given.

    Parameters
    ----------
    samples : sequence of float64 arrays, shape (n, d)
        Positions of the samples of each track in metres.
    layers : sequence of Lines or Dots
        What is drawn above them.
    labels : sequence of Label
        Places with names.
    frame : sequence of float64 arrays, shape (n, d), optional
        Positions of which the picture shows all but outliers, whatever else it cuts off.
    width : float, default 85
        Millimetres of the picture.
    color : str
        Colour of the samples.
    """
    with style():
        # The extent of all that is shown.
        shown = [_without_outliers(samples if frame is None else frame)]
        for layer in layers if frame is None else ():
            shown += layer.paths if isinstance(layer, Lines) else [layer.positions]
        layout = Layout(width)
        figure, axes = map_figure(shown, layout)

        # Samples below, then the layers.
        draw_samples(axes, samples, color)
        handles = samples_legend(samples, color)
        for order, layer in enumerate(layers):
            if isinstance(layer, Lines):
                handles += _draw_lines(axes, layer, 2 + 0.1 * order)
            else:
                handles += _draw_dots(axes, layer, 2 + 0.1 * order)
        for label in labels:
            _draw_label(axes, label)
        add_legend(figure, layout, handles)
    return figure


def _without_outliers(samples: Sequence[Floats]) -> Floats:
    """Return the corners of what is shown of the samples; none where there are no samples."""
    filled = [from_above(each) for each in samples if len(each)]
    if not filled:
        return np.empty((0, 2))
    corners: Floats = np.quantile(np.concatenate(filled), [_CUT, 1 - _CUT], axis=0)
    return corners


def _draw_lines(axes: Axes, lines: Lines, order: float) -> list[Any]:
    """Draw lines, and return their entry of the legend."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    # The lines.
    axes.add_collection(
        LineCollection(
            [from_above(path) for path in lines.paths],
            colors=lines.color,
            linewidths=lines.width,
            linestyles="--" if lines.dashed else "-",
            capstyle="butt" if lines.dashed else "round",
            zorder=order,
            gid=lines.name or None,
        ),
        autolim=False,
    )

    # A line of their colour, or of the first colour.
    if not lines.name or not len(lines.paths):
        return []
    color = lines.color if isinstance(lines.color, str) else lines.color[0]
    dash: Any = "--" if lines.dashed else "-"
    return [Line2D([], [], color=color, linewidth=lines.width, linestyle=dash, label=lines.name)]


def _draw_dots(axes: Axes, dots: Dots, order: float) -> list[Any]:
    """Draw dots, and return their entry of the legend."""
    (line,) = axes.plot(
        *from_above(dots.positions).T,
        linestyle="",
        marker="o",
        markersize=_DOT,
        markeredgewidth=0,
        color=dots.color,
        label=dots.name,
        zorder=order,
    )
    return [line] if dots.name and len(dots.positions) else []


def _draw_label(axes: Axes, label: Label) -> None:
    """Draw a place as a dot or a circle, with its name beside it."""
    from matplotlib.patches import Circle

    # The place.
    (x, y) = from_above(label.position[None])[0]
    if label.radius is None:
        axes.plot(x, y, marker="o", markersize=_DOT + 1, color=INK, markeredgecolor="w", zorder=4)
    else:
        circle = Circle((x, y), label.radius, fill=False, color=INK, linewidth=1.0, zorder=4)
        axes.add_patch(circle)

    # Its name, on the side where the picture has space.
    is_right = x > np.mean(axes.get_xlim())
    axes.annotate(
        label.text,
        (x, y),
        xytext=(-_LABEL_GAP if is_right else _LABEL_GAP, 0),
        textcoords="offset points",
        ha="right" if is_right else "left",
        va="center",
        zorder=5,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6},
    )
