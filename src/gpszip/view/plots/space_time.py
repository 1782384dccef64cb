"""The kind ``space-time``: tracks in x, y and time, above their paths on the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_remark
from gpszip.drawing.map_lines import hidden_planes
from gpszip.drawing.space_figure import SpaceScale, draw_space_lines, space_figure
from gpszip.drawing.style import CYCLE, GREY, printable
from gpszip.view.plots.subject import Area, Subject, require_times

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from gpszip.drawing.style import Layout

__all__ = ["draw_space_time"]

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
    scale = SpaceScale.of([piece.positions for piece in pieces], [piece.times for piece in pieces])
    lines = [scale.points(piece.positions, piece.times) for piece in pieces]

    # Lines above their shadows.
    figure, axes = space_figure(layout, scale)
    numbers = {name: number for number, name in enumerate(archive.ids)}
    colors = [CYCLE[numbers[archive.pieces[piece.id]] % len(CYCLE)] for piece in pieces]
    draw_space_lines(axes, [line * (1, 1, 0) for line in lines], GREY, "ground")
    draw_space_lines(axes, lines, colors, "tracks")
    if layout.legend and 1 < len(archive.ids) <= len(CYCLE):
        _name_tracks(axes, [archive.pieces[piece.id] for piece in pieces], lines)

    # What the axes are.
    axes.set_xlabel(f"{scale.unit} east" if area.plane else f"x in {scale.unit}")
    axes.set_ylabel(f"{scale.unit} north" if area.plane else f"y in {scale.unit}")
    add_remark(figure, layout, hidden_planes(area.plane))
    return figure


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
