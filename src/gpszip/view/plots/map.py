"""The kind ``map``: the clean map over the samples of the log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpszip.drawing.map_figure import add_legend, add_remark, map_figure
from gpszip.drawing.map_lines import (
    MapLines,
    draw_lines,
    draw_samples,
    hidden_planes,
    lines_legend,
    samples_legend,
)
from gpszip.view.plots.subject import Area, Subject

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gpszip.drawing.style import Layout

__all__ = ["clean_lines", "draw_map"]


def draw_map(subject: Subject, layout: Layout) -> Figure:
    """Draw the clean map, wider where it was travelled more often, over the log if it is given."""
    # What lies on the plane that is shown.
    lines, area = clean_lines(subject)
    samples = area.samples(subject)

    # Samples below, then the map.
    figure, axes = map_figure([*samples, *lines.vertices], layout)
    draw_samples(axes, samples)
    draw_lines(axes, lines)
    add_legend(figure, layout, [*samples_legend(samples), *lines_legend(lines)])
    add_remark(figure, layout, hidden_planes(area.plane))
    return figure


def clean_lines(subject: Subject) -> tuple[MapLines, Area]:
    """Return the lines of the clean map on the plane that is shown, and that plane."""
    clean = subject.archive.clean_map()
    vertices = [clean[edge] for edge in range(len(clean))]
    area = Area.of(subject, vertices)
    shown = [edge for edge, line in enumerate(vertices) if area.holds(line)]
    traversals = clean.forward + clean.backward
    return MapLines([vertices[edge] for edge in shown], traversals[shown]), area
