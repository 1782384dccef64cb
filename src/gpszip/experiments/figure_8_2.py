"""Figure 8-2: the quadrotor's log, and the map that the thesis's pipeline makes of it."""

from __future__ import annotations

from gpszip.drawing.map_figure import add_legend, map_figure
from gpszip.drawing.map_lines import (
    MapLines,
    draw_lines,
    draw_samples,
    lines_legend,
    samples_legend,
)
from gpszip.drawing.style import COLUMN_WIDTH, FigureType, Layout, require_matplotlib, style
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.map_table import map_table
from gpszip.experiments.target_rmse import target_rmse
from gpszip.experiments.thesis_pipeline import ThesisResult, run_thesis
from gpszip.model import Track
from gpszip.testing import quadrotor

__all__ = ["run"]

#: RMSE in metres that the thesis states, and one of a finer map.
_RMSES = (10.0, 3.0)

#: Samples of a quick run.
_QUICK = 2_000


def run(setting: Setting) -> Outcome:
    """Draw the log of the quadrotor, or the user's first track, and its maps."""
    track = setting.logs[0] if setting.logs else quadrotor(seed=setting.seed).tracks[0]
    track = first_samples(track, _QUICK) if setting.quick else track
    bounds = dict.fromkeys(target_rmse(setting, track, published) for published in _RMSES)
    results = [run_thesis(track, rmse) for rmse in bounds]

    # The log alone, and each map over it.
    named = {f"map-{number}": result for number, result in enumerate(results, 1)}
    pictures = [Picture("log", "The log.", _draw(track, None))]
    for name, result in named.items():
        caption = f"The map of {result.nodes} nodes over the log, RMSE {result.rmse:.2f} m."
        pictures.append(Picture(name, caption, _draw(track, result)))
    return Outcome((map_table(named),), tuple(pictures))


def _draw(track: Track, result: ThesisResult | None) -> FigureType:
    """Draw the samples, and the edges of the map above them."""
    # The edges of the map, both directions in one line.
    require_matplotlib()
    vertices, traversals = [], None
    if result is not None:
        road_map = result.segment_map.road_map
        vertices = list(road_map.nodes[road_map.edges])
        traversals = road_map.forward + road_map.backward

    # Samples below.
    with style():
        layout = Layout(COLUMN_WIDTH)
        figure, axes = map_figure([track.positions, *vertices], layout)
        draw_samples(axes, [track.positions])
        legend = samples_legend([track.positions])
        if traversals is not None:
            lines = MapLines(vertices, traversals)
            draw_lines(axes, lines)
            legend += lines_legend(lines)
        add_legend(figure, layout, legend)
    return figure
