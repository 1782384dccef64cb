"""Pictures of a map, and of the log that it was learned from. Needs the extra ``plot``."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import MissingExtraError
from gpszip.files.atomic_write import atomic_write
from gpszip.model import Plane, RoadMap, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gpszip.archive import Archive

__all__ = ["draw_comparison", "draw_map"]

# Blue and orange of Okabe and Ito (2008), distinct with any kind of colour vision and in grey.

#: Color of the map's edges.
_EDGE_COLOR = "#0072B2"

#: Color of the log's samples.
_LOG_COLOR = "#E69F00"

#: Color of text, node outlines and the scale bar.
_INK_COLOR = "#222222"

#: Smallest line width of an edge, in points.
_MIN_WIDTH = 0.5

#: Line width of an edge with one traversal, in points.
_WIDTH_OF_ONE = 1.1

#: Largest line width of an edge, in points.
_MAX_WIDTH = 6.0

#: Largest number of samples that are drawn; more make files slow to open.
_MAX_DOTS = 200_000

#: Resolution of raster pictures, in dots per inch.
_DPI = 150

#: Longer side of the map area, in inches.
_LONG_SIDE = 9.0

#: Smallest ratio of the sides of the map area, so that the title fits.
_MIN_ASPECT = 0.35

#: Inches for the margins at left and right.
_MARGIN_WIDTH = 0.6

#: Inches for the title and the legend.
_MARGIN_HEIGHT = 1.2

#: Half the side of the enlarged square, relative to the extent of the picture.
_SQUARE_REACH = 0.09

#: Margin about the map, relative to its extent.
_MAP_MARGIN = 0.03

#: Least extent in metres, in place of zero.
_MIN_EXTENT = 1e-9


def draw_map(
    source: Archive | RoadMap, target: Axes | str | Path, *, title: str | None = None
) -> None:
    """Draw a road map. Line widths show how often edges were travelled.

    Parameters
    ----------
    source : Archive or RoadMap
        The map. If it has several planes, the one with the most nodes is drawn.
    target : matplotlib Axes, or path
        Axes, or a file whose suffix selects the format, such as ``map.png``.
    title : str, optional
        Title; by default the numbers of nodes and edges.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OutputError
        If the file can't be written.
    """
    road_map = _main_plane(_road_map(source))
    if not isinstance(target, str | Path):
        _draw_edges(target, road_map)
        _finish_axes(target, title or _title(road_map), road_map.nodes)
        return

    # Draw on the axes of a new figure.
    figure = _figure(*_figure_size(road_map.nodes))
    axes = figure.add_subplot()
    draw_map(road_map, axes, title=title)
    _legend(axes, _width_legend(road_map))
    _save(figure, target)


def draw_comparison(
    tracks: Iterable[Track],
    source: Archive | RoadMap,
    path: str | Path,
    *,
    title: str | None = None,
) -> None:
    """Draw the samples of tracks under the map that was learned from them.

    The picture shows the full map, and its busiest square enlarged.

    Parameters
    ----------
    tracks : iterable of Track
        The compressed tracks, on the map's plane.
    source : Archive or RoadMap
        The archive of these tracks, or its map.
    path : str or Path
        File to write; its suffix selects the format.
    title : str, optional
        Title; by default the numbers of nodes and edges.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OutputError
        If the file can't be written.
    """
    # The full map stands beside a square.
    road_map = _main_plane(_road_map(source))
    samples = _subsample([track.positions[:, :2] for track in tracks])
    extent = np.vstack([samples, road_map.nodes[:, :2]])
    center, reach = _find_busiest_square(road_map, extent)
    width, height = _figure_size(extent)
    figure = _figure(width + height, height)
    overview, detail = figure.subplots(1, 2, width_ratios=(width, height))

    # Draw samples and edges in both.
    for axes, dot_size in ((overview, 1.5), (detail, 5.0)):
        axes.scatter(
            samples[:, 0],
            samples[:, 1],
            s=dot_size,
            color=_LOG_COLOR,
            alpha=0.5,
            linewidths=0,
            rasterized=True,
            zorder=1,
        )
        _draw_edges(axes, road_map)

    # Add titles, scale bars and the legend.
    _finish_axes(overview, title or _title(road_map), extent)
    _mark_square(overview, center, reach)
    window = np.array([center - reach, center + reach])
    _finish_axes(detail, "the marked square, enlarged", window, tight=True)
    _legend(overview, [_dot_legend(), *_width_legend(road_map)])
    _save(figure, path)


def _save(figure: Figure, path: str | Path) -> None:
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=_DPI)


def _figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches, without pyplot's global state."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("plot", "drawing") from error
    return Figure(figsize=(width, height), layout="constrained")


def _road_map(source: Archive | RoadMap) -> RoadMap:
    return source if isinstance(source, RoadMap) else source.trimmed_map


def _main_plane(road_map: RoadMap) -> RoadMap:
    """The nodes of the plane with the most nodes, and the edges between them."""
    # Leave a map as it is that has no more than one plane, or no nodes.
    if road_map.plane is None or len(road_map.plane.centers) < 2 or not len(road_map.nodes):
        return road_map

    # Planes are side by side, ``Plane.SPREAD`` metres apart.
    # They would be dots in one picture: that is 33,554 km.
    planes = np.round(road_map.nodes[:, 0] / Plane.SPREAD).astype(np.int64)
    is_main = planes == np.bincount(planes - planes.min()).argmax() + planes.min()

    # Keep the edges between its nodes.
    kept = is_main[road_map.edges].all(axis=1)
    # Nodes that stay are numbered from 0 in their old order.
    number = np.cumsum(is_main) - 1
    return RoadMap(
        road_map.nodes[is_main],
        number[road_map.edges[kept]].astype(np.int32),
        road_map.forward[kept],
        road_map.backward[kept],
        road_map.plane,
    )


def _subsample(positions: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Every k-th sample, so that there are at most ``_MAX_DOTS``."""
    samples = np.vstack(positions)
    return samples[:: math.ceil(len(samples) / _MAX_DOTS)]


def _figure_size(positions: NDArray[np.float64]) -> tuple[float, float]:
    """Width and height in inches of a picture of the positions, with space for its text."""
    extent = np.ptp(positions[:, :2], axis=0) if len(positions) else np.ones(2)
    largest = max(float(extent.max()), _MIN_EXTENT)
    width, height = np.maximum(extent, largest * _MIN_ASPECT)
    scale = _LONG_SIDE / max(width, height)
    return float(width * scale) + _MARGIN_WIDTH, float(height * scale) + _MARGIN_HEIGHT


def _traversals(road_map: RoadMap) -> NDArray[np.int64]:
    return road_map.forward + road_map.backward


def _line_width(counts: NDArray[np.int64] | int, largest: int) -> Any:
    """Line width of edges in points: the square root of traversals, within bounds.

    In proportion to traversals, an edge travelled a hundred times would hide its neighbours.
    """
    factor = min(_WIDTH_OF_ONE, _MAX_WIDTH / math.sqrt(max(largest, 1)))
    return np.maximum(np.sqrt(counts) * factor, _MIN_WIDTH)


def _draw_edges(axes: Axes, road_map: RoadMap) -> None:
    """Draw the edges, the busiest on top, and the nodes."""
    from matplotlib.collections import LineCollection

    # Edges other than stops.
    is_line = road_map.edges[:, 0] != road_map.edges[:, 1]
    lines = road_map.nodes[road_map.edges[is_line]][:, :, :2]
    counts = _traversals(road_map)[is_line]
    order = np.argsort(counts, kind="stable")
    if len(order):
        axes.add_collection(
            LineCollection(
                list(lines[order]),
                linewidths=_line_width(counts[order], int(counts.max())),
                colors=_EDGE_COLOR,
                capstyle="round",
                zorder=2,
            )
        )

    # Nodes.
    axes.scatter(
        road_map.nodes[:, 0],
        road_map.nodes[:, 1],
        s=7,
        color="white",
        edgecolors=_INK_COLOR,
        linewidths=0.7,
        zorder=3,
    )


def _title(road_map: RoadMap) -> str:
    return f"{len(road_map.nodes):,} nodes, {len(road_map.edges):,} edges"


def _finish_axes(
    axes: Axes, title: str, extent: NDArray[np.float64], *, tight: bool = False
) -> None:
    """Set equal scales and the title, hide the ticks, and add a scale bar.

    Parameters
    ----------
    axes : Axes
        The axes.
    title : str
        Title.
    extent : float64 array, shape (n, d)
        Positions that the axes must show.
    tight : bool, default False
        Whether the axes get a border instead of a margin.
    """
    # Limits.
    low, high = np.zeros(2), np.ones(2)
    if len(extent):
        low, high = extent[:, :2].min(axis=0), extent[:, :2].max(axis=0)
    margin = 0.0 if tight else _MAP_MARGIN * max(float((high - low).max()), _MIN_EXTENT)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")

    # Border and text.
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(tight)
        side.set_color(_INK_COLOR)
    axes.set_title(title, loc="left", fontsize=11, color=_INK_COLOR)
    _scale_bar(axes, float(max(high[0] - low[0], _MIN_EXTENT)))


def _scale_bar(axes: Axes, width: float) -> None:
    """Draw a scale bar of a round length, at most a fifth of the width in metres."""
    # Length in axes coordinates, 0 to 1.
    length = _round_length(width / 5)
    low, high = axes.get_xlim()
    fraction = length / (high - low)

    # The bar, at the lower right.
    x, y = 0.97, 0.03
    axes.plot(
        [x - fraction, x],
        [y, y],
        transform=axes.transAxes,
        color=_INK_COLOR,
        linewidth=3,
        solid_capstyle="butt",
        zorder=5,
    )

    # Its label above it.
    axes.text(
        x - fraction / 2,
        y + 0.012,
        _format_length(length),
        transform=axes.transAxes,
        ha="center",
        va="bottom",
        fontsize=9,
        color=_INK_COLOR,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0},
        zorder=4,
    )


def _format_length(length: float) -> str:
    """A length in metres with a unit that suits it.

    Examples
    --------
    >>> _format_length(2000.0), _format_length(5.0), _format_length(0.2)
    ('2 km', '5 m', '20 cm')
    """
    if length >= 1000:
        return f"{length / 1000:g} km"
    return f"{length:g} m" if length >= 1 else f"{length * 100:g} cm"


def _round_length(length: float) -> float:
    """Largest length of 1, 2 or 5 times a power of ten that is not above a given length.

    Examples
    --------
    >>> _round_length(37.0), _round_length(0.6), _round_length(1999.0)
    (20.0, 0.5, 1000.0)
    """
    power = 10.0 ** math.floor(math.log10(length))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= length)


def _find_busiest_square(
    road_map: RoadMap, extent: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Center and half the side of a square about the node with the most traversals."""
    reach = max(float(np.ptp(extent, axis=0).max()), _MIN_EXTENT) * _SQUARE_REACH
    if not len(road_map.edges):
        return extent.mean(axis=0), reach
    counts = np.bincount(
        road_map.edges.ravel(),
        # Both ends of an edge get its traversals, as ravel() lists them in turn.
        weights=np.repeat(_traversals(road_map), 2),
        minlength=len(road_map.nodes),
    )
    return road_map.nodes[int(counts.argmax()), :2], reach


def _mark_square(axes: Axes, center: NDArray[np.float64], reach: float) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(
        Rectangle(
            (center[0] - reach, center[1] - reach),
            2 * reach,
            2 * reach,
            fill=False,
            edgecolor=_INK_COLOR,
            zorder=4,
        )
    )


def _legend(axes: Axes, handles: list[Any]) -> None:
    """Add a legend below the axes, in one row."""
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0, 0),
        ncols=len(handles),
        frameon=False,
        fontsize=9,
    )


def _dot_legend() -> Any:
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], linestyle="", marker="o", markersize=4, color=_LOG_COLOR, label="sample of the log"
    )


def _width_legend(road_map: RoadMap) -> list[Any]:
    """Legend of line widths: of one traversal, of the most, and of a quarter of it."""
    from matplotlib.lines import Line2D

    largest = int(_traversals(road_map).max()) if len(road_map.edges) else 1
    counts = sorted({1, max(round(largest / 4), 1), largest})
    return [
        Line2D(
            [],
            [],
            color=_EDGE_COLOR,
            linewidth=float(_line_width(n, largest)),
            label=f"edge travelled {n:,} x",
        )
        for n in counts
    ]
