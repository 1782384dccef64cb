"""The logs of :mod:`gpszip.testing`, drawn over their true maps."""

from __future__ import annotations

from collections.abc import Callable

from gpszip.drawing.map_figure import add_legend, map_figure
from gpszip.drawing.map_lines import (
    MapLines,
    draw_lines,
    draw_samples,
    lines_legend,
    samples_legend,
)
from gpszip.drawing.style import GREY, FigureType, Layout, require_matplotlib, style
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.table import Column, Table, Value
from gpszip.testing import (
    LogWithTruth,
    complete_graph,
    fleet,
    patrol_with_truth,
    person,
    quadrotor,
    ring,
    shuttles,
    taxis,
)

__all__ = ["run"]

#: Width of the pictures in millimetres.
_WIDTH = 85.0

#: Line width of roads that nobody travelled, in points.
_UNTRAVELLED = 0.5

#: Standard deviation of errors of ring and complete graph, in metres, so that samples are seen.
_NOISE = 2.0

#: Name, description, and generator of each log, by seed.
_LOGS: tuple[tuple[str, str, Callable[[int], LogWithTruth]], ...] = (
    ("patrol", "a robot's rounds of a building", lambda seed: patrol_with_truth(seed=seed)),
    ("quadrotor", "a quadrotor's laps in the wind", lambda seed: quadrotor(seed=seed)),
    ("person", "a person's months with a phone", lambda seed: person(seed=seed)),
    ("taxis", "taxis in a city, about a sample a minute", lambda seed: taxis(seed=seed)),
    ("fleet", "a fleet on lines that share roads", lambda seed: fleet(seed=seed)),
    (
        "shuttles",
        "shuttle buses on lines that share roads",
        lambda seed: shuttles(4, days=1, seed=seed),
    ),
    ("ring", "laps on a ring", lambda seed: ring(samples=4, noise=_NOISE, seed=seed)),
    (
        "complete-graph",
        "a random walk on a complete graph",
        lambda seed: complete_graph(12, steps=200, samples=8, noise=_NOISE, seed=seed),
    ),
)


def run(setting: Setting) -> Outcome:
    """Draw each log over its map, and count what it holds. Logs of the user are not used."""
    # A picture of each log.
    logs = [(name, text, generate(setting.seed)) for name, text, generate in _LOGS]
    pictures = tuple(
        Picture(name, f"{text[0].upper()}{text[1:]}: the log over its true map.", _draw(log))
        for name, text, log in logs
    )

    # A row for each.
    columns = (
        Column("log", "log"),
        Column("about", "what it is"),
        Column("tracks", "tracks"),
        Column("points", "points"),
        Column("nodes", "nodes"),
        Column("edges", "edges"),
        Column("travelled", "of these travelled"),
        Column("traversals", "traversals"),
    )
    rows = tuple(_row(name, text, log) for name, text, log in logs)
    return Outcome((Table("", "Generated logs and their true maps", columns, rows),), pictures)


def _row(name: str, text: str, log: LogWithTruth) -> dict[str, Value]:
    traversals = log.road_map.forward + log.road_map.backward
    return {
        "log": name,
        "about": text,
        "tracks": len(log.tracks),
        "points": len(log),
        "nodes": len(log.road_map.nodes),
        "edges": len(log.road_map.edges),
        "travelled": int((traversals > 0).sum()),
        "traversals": int(traversals.sum()),
    }


def _draw(log: LogWithTruth) -> FigureType:
    """Draw samples below the roads, in grey those that nobody travelled.

    Outliers beyond the map and the true positions are cut off.
    """
    # Roads, and how often each was travelled.
    require_matplotlib()
    road_map = log.road_map
    traversals = road_map.forward + road_map.backward
    travelled = traversals > 0
    roads = road_map.nodes[road_map.edges]
    lines = MapLines(list(roads[travelled]), traversals[travelled])
    samples = [track.positions for track in log.tracks]

    # Samples, roads that nobody travelled, and the others.
    with style():
        layout = Layout(_WIDTH)
        figure, axes = map_figure([road_map.nodes, *log.positions], layout)
        draw_samples(axes, samples)
        for road in roads[~travelled]:
            axes.plot(*road.T, color=GREY, linewidth=_UNTRAVELLED, zorder=0.5)
        draw_lines(axes, lines)
        add_legend(figure, layout, [*samples_legend(samples), *lines_legend(lines)])
    return figure
