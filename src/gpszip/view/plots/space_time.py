"""The kind ``space-time``: tracks in x, y and time, above their paths on the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_remark, add_title, from_above
from gpszip.drawing.map_lines import hidden_planes
from gpszip.drawing.style import CYCLE, GREY, new_figure, printable
from gpszip.view.plots.elapsed import time_unit
from gpszip.view.plots.subject import Area, Subject, require_times

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from gpszip.drawing.style import Layout

__all__ = ["draw_space_time"]

#: Height of the picture relative to its width.
_ASPECT = 0.8

#: Length of the axis of time relative to the longer side of the map.
_TIME_AXIS = 0.9

#: Least length of the shorter side of the map relative to the longer one.
_MIN_SIDE = 0.35

#: Least extent, in place of zero.
_MIN_EXTENT = 1e-3

#: Metres from which the axes count kilometres.
_KILOMETRES = 5_000.0

#: Size of the drawing in a narrow and a wide figure, so that the labels of its axes fit.
_ZOOMS = (0.78, 0.95)

#: Width in millimetres from which a figure is wide.
_WIDE = 130.0

#: A side of the map below this share of the longer one has space for few ticks.
_SHORT = 0.6

#: From where the picture is seen, in degrees above the ground and about the axis of time.
_ELEVATION, _AZIMUTH = 22, -58

#: Line width of tracks, in points.
_WIDTH = 0.9

Floats = NDArray[np.float64]


def draw_space_time(subject: Subject, layout: Layout) -> Figure:
    """Draw the knots of each track as a line that rises with time, above its path on the ground."""
    # Pieces with times on the plane that is shown.
    require_times(subject, "space-time")
    archive = subject.archive
    pieces = [piece for piece in archive.decompress() if piece.timed]
    area = Area.of(subject, [piece.positions for piece in pieces])
    pieces = [piece for piece in pieces if area.holds(piece.positions)]

    # Time in a unit that suits it, place in metres or kilometres from the south-west.
    first = min(float(piece.times[0]) for piece in pieces)
    last = max(float(piece.times[-1]) for piece in pieces)
    seconds, time_label = time_unit(first, last)
    places = [from_above(piece.positions) for piece in pieces]
    origin = np.min([place.min(axis=0) for place in places], axis=0)
    reach = np.max([place.max(axis=0) for place in places], axis=0) - origin
    metres, unit = (1000.0, "km") if reach.max() >= _KILOMETRES else (1.0, "m")
    lines = [
        np.column_stack([(place - origin) / metres, (piece.times - first) / seconds])
        for piece, place in zip(pieces, places, strict=True)
    ]

    # Lines above their shadows.
    figure, axes = _space_figure(layout, reach / metres, (last - first) / seconds)
    numbers = {name: number for number, name in enumerate(archive.ids)}
    colors = [CYCLE[numbers[archive.pieces[piece.id]] % len(CYCLE)] for piece in pieces]
    _draw_lines(axes, [line * (1, 1, 0) for line in lines], GREY, "ground")
    _draw_lines(axes, lines, colors, "tracks")
    if layout.legend and 1 < len(archive.ids) <= len(CYCLE):
        _name_tracks(axes, [archive.pieces[piece.id] for piece in pieces], lines)

    # What the axes are.
    axes.set_xlabel(f"{unit} east" if area.plane else f"x in {unit}")
    axes.set_ylabel(f"{unit} north" if area.plane else f"y in {unit}")
    axes.set_zlabel(time_label)
    add_remark(figure, layout, hidden_planes(area.plane))
    return figure


def _space_figure(layout: Layout, reach: Floats, duration: float) -> tuple[Figure, Axes3D]:
    """Return a figure with three axes; x and y have one scale."""
    from matplotlib.ticker import MaxNLocator

    # One scale on the ground, and a height that suits it.
    figure = new_figure(layout.width, layout.width * _ASPECT)
    axes = cast("Axes3D", figure.add_axes((-0.06, 0.06, 0.99, 0.94), projection="3d"))
    sides = np.maximum(reach, _MIN_SIDE * max(float(reach.max()), _MIN_EXTENT))
    axes.set_xlim(0, sides[0])
    axes.set_ylim(0, sides[1])
    axes.set_zlim(0, duration or 1.0)
    axes.set_box_aspect((*sides, _TIME_AXIS * sides.max()), zoom=_ZOOMS[layout.width >= _WIDE])
    axes.set_proj_type("ortho")
    axes.view_init(_ELEVATION, _AZIMUTH)

    # Few ticks, fewer on a short side, and white walls.
    shares = (*(sides / sides.max()), 1.0)
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shares, strict=True):
        axis.set_major_locator(MaxNLocator(4 if share > _SHORT else 2))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.tick_params(pad=-1)
    add_title(figure, layout)
    return figure, axes


def _draw_lines(axes: Axes3D, lines: list[Floats], colors: Any, name: str) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    axes.add_collection(
        Line3DCollection(lines, colors=colors, linewidths=_WIDTH, capstyle="round", gid=name)
    )


def _name_tracks(axes: Axes3D, names: list[str], lines: list[Floats]) -> None:
    """Write the name of each track at its end."""
    for name, line in dict(zip(names, lines, strict=True)).items():
        axes.text(
            *line[-1],
            f" {printable(name)}",
            va="center",
            fontsize=6,
            zorder=100,  # above all tracks
            parse_math=False,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.3},
        )
