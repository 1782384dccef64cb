"""Pictures of a log and of the segments that stand for it, in x, y and time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.space_figure import SpaceScale, draw_space_lines, space_figure
from gpszip.drawing.style import COLUMN_WIDTH, CYCLE, GREY, FigureType, Layout, style
from gpszip.model import SegmentMean, Track

__all__ = ["draw_log", "draw_parts"]

#: Line width of the log behind segments, and of segments, in points.
_LOG_WIDTH, _PART_WIDTH = 0.5, 1.3

Floats = NDArray[np.float64]


def draw_log(track: Track, color: str = GREY) -> FigureType:
    """Draw the samples of a track as a line that rises with time."""
    return _draw(track, [], [], log_color=color)


def draw_parts(track: Track, mean: SegmentMean) -> FigureType:
    """Draw the parts of a segment mean above its log, in the colours of their segments.

    There are six colours, in the order in which segments are first travelled.
    """
    first, last = mean.boundaries[:-1], mean.boundaries[1:] - 1
    starts, ends = mean.starts[mean.labels], mean.ends[mean.labels]
    parts = [
        (np.stack([starts[part], ends[part]]), track.times[[first[part], last[part]]])
        for part in range(mean.k)
    ]
    order = {label: number for number, label in enumerate(dict.fromkeys(mean.labels.tolist()))}
    return _draw(track, parts, [CYCLE[order[label] % len(CYCLE)] for label in mean.labels.tolist()])


def _draw(
    track: Track,
    parts: Sequence[tuple[Floats, Floats]],
    colors: Sequence[str],
    *,
    log_color: str = GREY,
) -> FigureType:
    """Draw a log, and parts above it, each of positions and times."""
    with style():
        # The log, and parts above it.
        scale = SpaceScale.of([track.positions], [track.times])
        figure, axes = space_figure(Layout(COLUMN_WIDTH), scale)
        log = scale.points(track.positions, track.times)
        draw_space_lines(axes, [log], log_color, "log", width=_LOG_WIDTH, order=1)
        lines = [scale.points(*part) for part in parts]
        draw_space_lines(axes, lines, list(colors), "parts", width=_PART_WIDTH)

        # What the axes are.
        east, north = ("east", "north") if track.plane else ("in x", "in y")
        axes.set_xlabel(f"{scale.unit} {east}")
        axes.set_ylabel(f"{scale.unit} {north}")
    return figure
