"""Write a map as a picture: its lines from above, wider where they were travelled more often."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from gpszip.drawing.map_figure import add_legend, map_figure
from gpszip.drawing.map_lines import MapLines, draw_lines, lines_legend, main_plane, on_plane
from gpszip.drawing.style import Layout, save_figure, style
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.maps.table import MapTable

__all__ = ["write_map_picture"]


def write_map_picture(table: MapTable, path: Path, kind: str) -> None:
    """Write a map as a picture of 175 mm in width: PNG with 300 dots per inch, SVG or PDF.

    Of a map that lies on several planes, the one with the most vertices is drawn.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    kind : str
        ``png``, ``svg`` or ``pdf``.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    layout = Layout()
    lines = _lines_on_main_plane(table)
    with style():
        figure, axes = map_figure(lines.vertices, layout)
        draw_lines(axes, lines)
        add_legend(figure, layout, lines_legend(lines))
    save_figure(figure, path, kind)


def _lines_on_main_plane(table: MapTable) -> MapLines:
    """Return the lines in metres, without those of stops."""
    # Degrees are projected to a plane for this map.
    points, plane = table.points, None
    if table.geographic and len(points):
        plane = choose_plane(points[:, 1], points[:, 0])
        points = to_plane(points[:, 1], points[:, 0], plane)

    # A line has all its vertices on one plane, since no edge leads from one to another.
    shown = on_plane(points, plane, main_plane([points], plane))
    vertices = [points[start:stop] for start, stop in pairwise(table.offsets.tolist())]
    is_drawn = [bool(shown[start]) for start in table.offsets[:-1].tolist()]
    chosen = [
        number
        for number, line in enumerate(vertices)
        if is_drawn[number] and np.ptp(line, axis=0).any()
    ]
    return MapLines([vertices[number] for number in chosen], table.traversals[chosen])
