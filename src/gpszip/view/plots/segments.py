"""The kind ``segments``: the edges of the map as archived, in colours that tell them apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_caption, add_remark, from_above, map_figure
from gpszip.drawing.map_lines import draw_samples, hidden_planes
from gpszip.drawing.style import CYCLE, GREY, INK
from gpszip.model.text import count_text
from gpszip.view.plots.subject import Area, Subject

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gpszip.drawing.style import Layout

__all__ = ["draw_segments"]

#: Line width of segments, in points.
_WIDTH = 1.4

#: Of more ends than this, the dots would hide the segments.
_MAX_DOTS = 200

Floats = NDArray[np.float64]


def draw_segments(subject: Subject, layout: Layout) -> Figure:
    """Draw the segments of all walks, each edge of the map in one colour, over the log in grey.

    Edges are coloured in the order in which they were first travelled, so that edges that follow
    each other differ.
    """
    from matplotlib.collections import LineCollection

    # Samples below.
    pieces = [piece.positions for piece in subject.archive.decompress()]
    area = Area.of(subject, pieces)
    samples = area.samples(subject)
    shown = [from_above(piece) for piece in pieces if area.holds(piece)]
    figure, axes = map_figure([*samples, *shown], layout)
    draw_samples(axes, samples, GREY)

    # Each edge once, with its ends.
    edges, count = _edges(shown)
    colors = [CYCLE[number % len(CYCLE)] for number in range(len(edges))]
    axes.add_collection(
        LineCollection(
            list(edges), colors=colors, linewidths=_WIDTH, capstyle="round", zorder=2, gid="map"
        ),
        autolim=False,
    )
    ends = np.unique(edges.reshape(-1, 2), axis=0)
    if len(ends) <= _MAX_DOTS:
        axes.plot(*ends.T, linestyle="", marker="o", markersize=2, color=INK, mew=0, zorder=3)

    # How many there are.
    text = f"{count_text(count, 'segment')} on {count_text(len(edges), 'edge')}"
    add_caption(figure, layout, text)
    add_remark(figure, layout, hidden_planes(area.plane))
    return figure


def _edges(pieces: list[Floats]) -> tuple[Floats, int]:
    """Return the different edges in the order of their first travel, and the number of segments.

    Parameters
    ----------
    pieces : list of float64 arrays, shape (n, 2)
        Knots of each piece in metres.

    Returns
    -------
    edges : float64 array, shape (E, 2, 2)
        Both ends of each edge; stops have none.
    count : int
        Segments that move.

    Examples
    --------
    >>> there_and_back = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 0.0]])
    >>> edges, count = _edges([there_and_back])
    >>> edges.tolist(), count
    ([[[0.0, 0.0], [5.0, 0.0]]], 2)
    """
    # Both ends of each segment, the lesser one first.
    pairs = [np.stack([piece[:-1], piece[1:]], axis=1) for piece in pieces]
    ends = np.concatenate([*pairs, np.empty((0, 2, 2))])
    ends = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
    turned = (ends[:, 0, 0] > ends[:, 1, 0]) | (
        (ends[:, 0, 0] == ends[:, 1, 0]) & (ends[:, 0, 1] > ends[:, 1, 1])
    )
    ends[turned] = ends[turned][:, ::-1]

    # The first of each.
    _, first = np.unique(ends.reshape(-1, 4), axis=0, return_index=True)
    return ends[np.sort(first)], len(ends)
