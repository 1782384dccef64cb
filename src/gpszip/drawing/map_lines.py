"""The lines of a map, with widths by traversals, and the samples of a log below them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import from_above
from gpszip.drawing.style import EDGE_COLOR, LOG_COLOR
from gpszip.model import Plane
from gpszip.model.projection import plane_indices
from gpszip.model.text import count_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "MapLines",
    "draw_lines",
    "draw_samples",
    "hidden_planes",
    "line_width",
    "lines_legend",
    "main_plane",
    "on_plane",
    "samples_legend",
]

#: Smallest line width of an edge, in points.
_MIN_WIDTH = 0.6

#: Line width of an edge with one traversal, in points.
_WIDTH_OF_ONE = 0.9

#: Largest line width of an edge, in points.
_MAX_WIDTH = 2.6

#: More samples are drawn as pixels also in SVG and PDF; as shapes they make files slow to open.
_MAX_SHAPES = 5_000

#: Diameters of the dots of samples, in points.
_DOTS = (0.5, 2.5)

#: Opacity of dots, from 0 to 1.
_OPACITY = 0.6

#: Number of samples whose dots have the largest diameter.
_FEW_SAMPLES = 1_000

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MapLines:
    """The lines of a map on one plane.

    Parameters
    ----------
    vertices : sequence of float64 arrays, shape (n, d)
        The vertices of each line in metres.
    traversals : int64 array, shape (E,)
        How often each line was travelled, both directions together.
    """

    vertices: Sequence[Floats]
    traversals: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.vertices)


def main_plane(positions: Sequence[Floats], plane: Plane | None) -> int | None:
    """Return the index of the plane with the most positions; None where there is only one.

    Examples
    --------
    >>> planes = Plane(((0, 0), (0, 900000000)))
    >>> main_plane([np.array([[1.0, 0.0], [Plane.SPREAD, 0.0], [Plane.SPREAD, 5.0]])], planes)
    1
    """
    if plane is None or len(plane.centers) == 1 or not any(map(len, positions)):
        return None
    counts = np.bincount(np.concatenate([plane_indices(each, plane) for each in positions]))
    return int(counts.argmax())


def on_plane(positions: Floats, plane: Plane | None, index: int | None) -> NDArray[np.bool_]:
    """Whether each position lies on a plane; all do where there is only one (None)."""
    if plane is None or index is None:
        return np.ones(len(positions), np.bool_)
    return np.asarray(plane_indices(positions, plane) == index)


def draw_samples(axes: Axes, positions: Sequence[Floats], color: str = LOG_COLOR) -> None:
    """Draw the samples of a log as dots, below everything else."""
    total = sum(map(len, positions))
    if not total:
        return

    # Many samples get small dots, so that they don't cover each other.
    size = np.clip(_DOTS[1] * (_FEW_SAMPLES / total) ** 0.25, *_DOTS)
    samples = np.vstack([from_above(each) for each in positions])
    axes.plot(
        *samples.T,
        linestyle="",
        marker="o",
        markersize=float(size),
        markeredgewidth=0,
        color=color,
        alpha=_OPACITY,
        rasterized=total > _MAX_SHAPES,
        zorder=1,
        gid="samples",
    )


def line_width(traversals: NDArray[np.int64] | int, largest: int) -> Any:
    """Line width of edges in points: the square root of traversals, within bounds.

    In proportion to traversals, an edge travelled a hundred times would hide its neighbours.
    """
    factor = min(_WIDTH_OF_ONE, _MAX_WIDTH / math.sqrt(max(largest, 1)))
    return np.maximum(np.sqrt(traversals) * factor, _MIN_WIDTH)


def draw_lines(axes: Axes, lines: MapLines) -> None:
    """Draw the lines of a map, the busiest on top."""
    from matplotlib.collections import LineCollection

    if not len(lines):
        return
    order = np.argsort(lines.traversals, kind="stable")
    axes.add_collection(
        LineCollection(
            [from_above(lines.vertices[number]) for number in order.tolist()],
            linewidths=line_width(lines.traversals[order], int(lines.traversals.max())),
            colors=EDGE_COLOR,
            capstyle="round",
            joinstyle="round",
            zorder=2,
            gid="map",
        ),
        autolim=False,
    )


def samples_legend(positions: Sequence[Floats], color: str = LOG_COLOR) -> list[Any]:
    """Return the legend of the samples of a log; none where there are no samples."""
    from matplotlib.lines import Line2D

    count = sum(map(len, positions))
    if not count:
        return []
    return [
        Line2D(
            [],
            [],
            linestyle="",
            marker="o",
            markersize=3,
            color=color,
            label=count_text(count, "point"),
        )
    ]


def lines_legend(lines: MapLines) -> list[Any]:
    """Return the legend of line widths: of one traversal, and of the most."""
    from matplotlib.lines import Line2D

    if not len(lines):
        return []
    largest = int(lines.traversals.max())
    labels = {1: "1", largest: count_text(largest, "traversal")}
    return [
        Line2D([], [], color=EDGE_COLOR, linewidth=float(line_width(count, largest)), label=label)
        for count, label in labels.items()
    ]


def hidden_planes(plane: Plane | None) -> str:
    """Say that a picture leaves out the other planes of a log; empty where there are none.

    Examples
    --------
    >>> hidden_planes(Plane(((0, 0), (0, 900000000)))), hidden_planes(None)
    ('the largest of 2 areas', '')
    """
    if plane is None or len(plane.centers) == 1:
        return ""
    return f"the largest of {len(plane.centers):,} areas"
