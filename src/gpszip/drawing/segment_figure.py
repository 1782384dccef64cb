"""Figure of a segment mean: the m segments as arrows over the log, and the transitions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_caption, add_remark, from_above, map_figure
from gpszip.drawing.map_lines import draw_samples, hidden_planes, main_plane, on_plane
from gpszip.drawing.style import CYCLE, GREY, INK, Layout
from gpszip.model import MarkovModel, Track
from gpszip.model.text import count_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_segment_mean"]

#: Line widths of a segment with one part and of those with most, in points.
_WIDTHS = (0.9, 2.2)

#: Size of the heads of arrows, in points.
_HEAD = 6.0

#: Metres below which a segment has no direction that could be drawn.
_SHORTEST = 1e-6

#: Line width of transitions, in points.
_TRANSITION = 0.5

Floats = NDArray[np.float64]


def draw_segment_mean(
    model: MarkovModel, parts: NDArray[np.int64], tracks: Sequence[Track], layout: Layout
) -> Figure:
    """Draw segments as arrows, wider with more parts, over the samples of the log.

    Parameters
    ----------
    model : MarkovModel
        Segments and transitions; transitions are thin lines from an end to a start.
    parts : int64 array, shape (m,)
        Number of parts of each segment.
    tracks : sequence of Track
        The log.
    layout : Layout
        Width, title and legend.
    """
    # What lies on the plane with the most samples.
    positions = [track.positions for track in tracks]
    plane = main_plane(positions, model.plane)
    samples = [from_above(each[on_plane(each, model.plane, plane)]) for each in positions]
    shown = np.flatnonzero(
        on_plane(model.starts, model.plane, plane)
        & on_plane(model.ends, model.plane, plane)
        & (parts > 0)
    )
    starts, ends = from_above(model.starts), from_above(model.ends)
    figure, axes = map_figure([*samples, starts[shown], ends[shown]], layout)
    draw_samples(axes, samples, GREY)

    # Transitions between segments that are shown, and the segments.
    pairs = model.transitions[np.isin(model.transitions, shown).all(axis=1)]
    _draw_transitions(axes, model, pairs)
    most = max(int(parts.max(initial=1)), 1)
    for number in shown.tolist():
        width = _WIDTHS[0] + (_WIDTHS[1] - _WIDTHS[0]) * np.sqrt(parts[number] / most)
        _draw_arrow(axes, starts[number], ends[number], CYCLE[number % len(CYCLE)], float(width))

    # How many there are.
    total = count_text(int(parts.sum()), "part")
    add_caption(figure, layout, f"{total} on {count_text(model.m, 'segment')}")
    add_remark(figure, layout, hidden_planes(model.plane))
    return figure


def _draw_transitions(axes: Axes, model: MarkovModel, pairs: NDArray[np.int32]) -> None:
    """Draw the transitions as lines from the end of a segment to the start of the next."""
    from matplotlib.collections import LineCollection

    before, after = pairs.T
    lines = np.stack([from_above(model.ends[before]), from_above(model.starts[after])], axis=1)
    axes.add_collection(
        LineCollection(
            list(lines), colors=INK, linewidths=_TRANSITION, alpha=0.5, zorder=2, gid="transitions"
        ),
        autolim=False,
    )


def _draw_arrow(axes: Axes, start: Floats, end: Floats, color: str, width: float) -> None:
    """Draw a segment; one without a length, a stop, is a dot."""
    if float(np.abs(end - start).max()) < _SHORTEST:
        axes.plot(*start, marker="o", markersize=3, color=color, mew=0, zorder=3)
        return
    axes.annotate(
        "",
        xy=(float(end[0]), float(end[1])),
        xytext=(float(start[0]), float(start[1])),
        arrowprops={
            "arrowstyle": "-|>",
            "mutation_scale": _HEAD,
            "color": color,
            "linewidth": width,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=3,
    )
