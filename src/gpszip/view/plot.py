"""Pictures of the map, and of the log that it was learned from. Needs the extra ``plot``."""

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

# Blue and orange of Okabe and Ito, told apart with any kind of colour vision and in grey.
_EDGE_COLOR = "#0072B2"
_LOG_COLOR = "#E69F00"
_INK_COLOR = "#222222"
_THINNEST, _ONCE, _WIDEST = 0.5, 1.1, 6.0  # points
_MAX_DOTS = 200_000
_DPI = 150


def draw_map(
    source: Archive | RoadMap, target: Axes | str | Path, *, title: str | None = None
) -> None:
    """Draw a road map, each way as wide as it was travelled often.

    Parameters
    ----------
    source : Archive or RoadMap
        What to draw. Of a map on several planes, the one with the most nodes.
    target : matplotlib Axes, or path
        Where to draw: axes, or a file whose suffix names the format, such as ``map.png``.
    title : str, optional
        Instead of the numbers of nodes and ways.

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
    """Draw the samples of tracks under the map that they became: all of it, and its busiest place from near.

    Parameters
    ----------
    tracks : iterable of Track
        The tracks that were compressed, on the map's plane.
    source : Archive or RoadMap
        The archive that they became, or its map.
    path : str or Path
        File to write; its suffix names the format.
    title : str, optional
        Line above the picture.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    road_map = _main_plane(_road_map(source))
    samples = _subsample([track.positions[:, :2] for track in tracks])
    extent = np.vstack([samples, road_map.nodes[:, :2]])
    center, reach = _find_busiest_square(road_map, extent)
    width, height = _figure_size(extent)
    figure = _figure(width + height, height)
    whole, near = figure.subplots(1, 2, width_ratios=(width, height))
    for axes, dot in ((whole, 1.5), (near, 5.0)):
        axes.scatter(
            samples[:, 0],
            samples[:, 1],
            s=dot,
            color=_LOG_COLOR,
            alpha=0.5,
            linewidths=0,
            rasterized=True,
            zorder=1,
        )
        _draw_edges(axes, road_map)
    _finish_axes(whole, title or _title(road_map), extent)
    _mark_square(whole, center, reach)
    window = np.array([center - reach, center + reach])
    _finish_axes(near, "the marked square, from near", window, tight=True)
    _legend(whole, [_dot_legend(), *_width_legend(road_map)])
    _save(figure, path)


def _save(figure: Figure, path: str | Path) -> None:
    with atomic_write(path) as part:
        figure.savefig(part, dpi=_DPI)


def _figure(width: float, height: float) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("plot", "drawing") from error
    return Figure(figsize=(width, height), layout="constrained")


def _road_map(source: Archive | RoadMap) -> RoadMap:
    return source if isinstance(source, RoadMap) else source.trimmed_map


def _main_plane(road_map: RoadMap) -> RoadMap:
    """The nodes of the plane that has the most of them, and the ways between these."""
    if road_map.plane is None or len(road_map.plane.centers) < 2 or not len(road_map.nodes):
        return road_map
    planes = np.round(road_map.nodes[:, 0] / Plane.SPREAD).astype(np.int64)
    here = planes == np.bincount(planes - planes.min()).argmax() + planes.min()
    kept = here[road_map.edges].all(axis=1)
    names = np.cumsum(here) - 1
    return RoadMap(
        road_map.nodes[here],
        names[road_map.edges[kept]].astype(np.int32),
        road_map.forward[kept],
        road_map.backward[kept],
        road_map.plane,
    )


def _subsample(positions: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    samples = np.vstack(positions)
    return samples[:: math.ceil(len(samples) / _MAX_DOTS)]


def _figure_size(positions: NDArray[np.float64]) -> tuple[float, float]:
    """Inches: ten for the longer side of the picture, with room for its words."""
    across = np.ptp(positions[:, :2], axis=0) if len(positions) else np.ones(2)
    width, height = np.maximum(across, max(float(across.max()), 1e-9) * 0.35)
    scale = 9.0 / max(width, height)
    return float(width * scale) + 0.6, float(height * scale) + 1.2


def _traversals(road_map: RoadMap) -> NDArray[np.int64]:
    return road_map.forward + road_map.backward


def _line_width(travels: NDArray[np.int64] | int, most: int) -> Any:
    """As the square root: a way travelled a hundred times must not hide its neighbours."""
    return np.maximum(np.sqrt(travels) * min(_ONCE, _WIDEST / math.sqrt(max(most, 1))), _THINNEST)


def _draw_edges(axes: Axes, road_map: RoadMap) -> None:
    from matplotlib.collections import LineCollection

    ways = road_map.edges[:, 0] != road_map.edges[:, 1]
    lines = road_map.nodes[road_map.edges[ways]][:, :, :2]
    travels = _traversals(road_map)[ways]
    order = np.argsort(travels, kind="stable")
    if len(order):
        widths = _line_width(travels[order], int(travels.max()))
        axes.add_collection(
            LineCollection(
                list(lines[order]),
                linewidths=widths,
                colors=_EDGE_COLOR,
                capstyle="round",
                zorder=2,
            )
        )
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
    return f"{len(road_map.nodes):,} nodes, {len(road_map.edges):,} ways"


def _finish_axes(
    axes: Axes, title: str, extent: NDArray[np.float64], *, tight: bool = False
) -> None:
    """Equal scales, no axes, a bar that says how long ten (or two, or five) metres are."""
    low, high = (
        (extent[:, :2].min(axis=0), extent[:, :2].max(axis=0))
        if len(extent)
        else (np.zeros(2), np.ones(2))
    )
    margin = 0.0 if tight else 0.03 * max(float((high - low).max()), 1e-9)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(tight)
        side.set_color(_INK_COLOR)
    axes.set_title(title, loc="left", fontsize=11, color=_INK_COLOR)
    _scale_bar(axes, float(max(high[0] - low[0], 1e-9)))


def _scale_bar(axes: Axes, width: float) -> None:
    length = _round_length(width / 5)
    x, y = 0.97, 0.03
    label = (
        f"{length / 1000:g} km"
        if length >= 1000
        else f"{length:g} m"
        if length >= 1
        else f"{length * 100:g} cm"
    )
    left, right = axes.get_xlim()
    share = length / (right - left)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0}
    axes.plot(
        [x - share, x],
        [y, y],
        transform=axes.transAxes,
        color=_INK_COLOR,
        linewidth=3,
        solid_capstyle="butt",
        zorder=5,
    )
    axes.text(
        x - share / 2,
        y + 0.012,
        label,
        transform=axes.transAxes,
        ha="center",
        va="bottom",
        fontsize=9,
        color=_INK_COLOR,
        bbox=box,
        zorder=4,
    )


def _round_length(length: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not longer.

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
    """The node where most travels end or pass, and half the side of a square about it."""
    reach = max(float(np.ptp(extent, axis=0).max()), 1e-9) * 0.09
    if not len(road_map.edges):
        return extent.mean(axis=0), reach
    travels = np.bincount(
        road_map.edges.ravel(),
        weights=np.repeat(_traversals(road_map), 2),
        minlength=len(road_map.nodes),
    )
    return road_map.nodes[int(travels.argmax()), :2], reach


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


def _legend(axes: Axes, samples: list[Any]) -> None:
    axes.legend(
        handles=samples,
        loc="upper left",
        bbox_to_anchor=(0, 0),
        ncols=len(samples),
        frameon=False,
        fontsize=9,
    )


def _dot_legend() -> Any:
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], linestyle="", marker="o", markersize=4, color=_LOG_COLOR, label="sample of the log"
    )


def _width_legend(road_map: RoadMap) -> list[Any]:
    """Lines that say how wide a way is that was travelled once, and most often, and between."""
    from matplotlib.lines import Line2D

    most = int(_traversals(road_map).max()) if len(road_map.edges) else 1
    counts = sorted({1, max(round(most / 4), 1), most})
    return [
        Line2D(
            [],
            [],
            color=_EDGE_COLOR,
            linewidth=float(_line_width(n, most)),
            label=f"way travelled {n:,} x",
        )
        for n in counts
    ]
