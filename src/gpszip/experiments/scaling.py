"""How time, memory and bytes grow with points, k, m, dimensions, workers, and the kind of map."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.waypoints import find_waypoints_by_bisection
from gpszip.experiments.curves import Curve, draw_curves
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.memory import measured_memory
from gpszip.experiments.stages import measured
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.target_rmse import target_rmse
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import build_route
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.run import Threads
from gpszip.segmentation.em import segment_mean
from gpszip.testing import LogWithTruth, complete_graph, patrol, ring

__all__ = ["embedded", "run", "waypoints_of"]

#: Points of the logs, and those of a quick run.
_POINTS, _QUICK_POINTS = (10_000, 100_000, 1_000_000, 10_000_000), (500, 2_000)

#: Points of the log on which all but points are varied, and those of a quick run.
_FIXED, _QUICK_FIXED = 72_273, 1_000

#: k and m of the segment mean, of which one is varied at a time; a quick run has a tenth.
_K, _M = 200, 80

#: k with the fixed m, and m with the fixed k.
_KS, _MS = (100, 200, 400, 800, 1_600), (10, 20, 40, 80, 160)

#: Samples of a part at least.
_PER_PART = 4

#: Blocks of the coreset.
_BLOCKS = 400

#: Dimensions, and those of a quick run.
_DIMENSIONS, _QUICK_DIMENSIONS = (2, 3, 4, 8, 16), (2, 5)

#: Dimensions of an archive at most.
_MOST_AXES = 15

#: Workers.
_WORKERS = (1, 2)

#: Nodes of ring and complete graph, and steps of the walks; a quick run has the first of each.
_NODES, _STEPS = 24, (240, 960, 3_840, 15_360)

#: Samples for each step, and RMSE in metres: less than a hundredth of an edge.
_SAMPLES, _GRAPH_RMSE = 4, 1.0

#: RMSE in metres of the patrol, that of the thesis.
_RMSE = 0.24

#: Effort of archives: the least one, with which 10 million points take minutes.
_EFFORT = 1

#: Bytes of a megabyte, and bits of a byte.
_MEGABYTE, _BITS = 1e6, 8

_SECONDS = Column("seconds", "CPU s", 3)
_MEMORY = Column("memory_mb", "memory MB", 1)
_BYTES = Column("bytes", "bytes")
_WHAT = Column("what", "what")

#: Columns of ring and complete graph.
_GRAPH_COLUMNS = (
    Column("graph", "graph"),
    Column("steps", "steps"),
    Column("waypoints", "waypoints"),
    _BYTES,
    Column("bits_per_step", "bits/step", 2),
    Column("shape_bytes", "bytes without times"),
    Column("shape_bits_per_step", "bits/step", 2),
)

#: What pictures are called after their columns.
_NAMES = {"seconds": "seconds", "memory_mb": "memory", "bytes": "bytes"}

#: Column that is varied in the tables of pictures.
_VARIED = {"points": "points", "parameters": "value", "graphs": "steps"}

Floats = NDArray[np.float64]

#: A row of a table.
Row = dict[str, Value]


def run(setting: Setting) -> Outcome:
    """Vary one number at a time, on the patrol or on the user's first track."""
    # Compile everything first, so that no row waits for the compiler.
    track = _log(setting, _QUICK_FIXED if setting.quick else _FIXED)
    rmse = target_rmse(setting, track, _RMSE)
    _warm_up(rmse)

    # One number after the other.
    points = _points_table(setting, rmse)
    parameters = _parameters_table(track, quick=setting.quick)
    graphs = _graphs_table(setting)
    tables = (
        points,
        parameters,
        _dimensions_table(track, rmse, quick=setting.quick),
        _workers_table(track, rmse),
        graphs,
    )
    pictures = (
        *_picture(points, "what", "seconds", "CPU seconds", "Time over points."),
        *_picture(points, "what", "memory_mb", "megabytes", "Memory over points."),
        *_picture(parameters, "varied", "seconds", "CPU seconds", "Time over k and m."),
        *_picture(graphs, "graph", "bytes", "bytes", "Bytes over steps of a walk."),
    )
    notes = (
        f"Archives hold an RMSE of {rmse:.3g} m with effort {_EFFORT}; the segment mean has "
        f"k = {_K} and m = {_M}, or a tenth with --quick.",
        "Seconds are CPU seconds of all threads. Memory is what a step takes beyond what the "
        "process holds already, some of which earlier steps have left free.",
        f"An archive has at most {_MOST_AXES} dimensions.",
    )
    return Outcome(tables, pictures, notes)


def _log(setting: Setting, points: int) -> Track:
    if setting.logs:
        return first_samples(setting.logs[0], points)
    return patrol(points, seed=setting.seed)


def _warm_up(rmse: float) -> None:
    """Run everything once on a short log."""
    track = patrol(300)
    segment_mean(track, 8, 4)
    _coreset(track)
    compress([track], Options(rmse=max(rmse, _RMSE), effort=_EFFORT))


def _coreset(track: Track) -> Track:
    no_gaps = np.zeros(len(track) - 1, np.bool_)
    (coreset,), _ = reduce_to_coreset([track], [no_gaps], _BLOCKS)
    return coreset


def _measured_row(what: str, compute: Callable[[], int | None]) -> Row:
    """Return a row with the time and memory of a computation, which returns bytes if it has any."""
    seconds: dict[str, float] = {}
    with measured_memory() as memory, measured(seconds, what):
        size = compute()
    megabytes = None if memory.bytes is None else memory.bytes / _MEGABYTE
    return {"what": what, "seconds": seconds[what], "memory_mb": megabytes, "bytes": size}


def _rows(track: Track, rmse: float, k: int, m: int) -> list[Row]:
    """Return rows of the coreset, the segment mean and the archive of a log."""
    # A short log has fewer parts.
    parts = max(min(k, len(track) // _PER_PART), 1)

    def learn() -> None:
        segment_mean(track, parts, min(m, parts))

    def sketch() -> None:
        _coreset(track)

    def archive() -> int:
        return compress([track], Options(rmse=rmse, effort=_EFFORT))[0].size

    rows = [_measured_row("coreset", sketch), _measured_row("segment mean", learn)]
    return rows if track.dimension > _MOST_AXES else [*rows, _measured_row("archive", archive)]


def _points_table(setting: Setting, rmse: float) -> Table:
    """Vary the points. A log of the user ends the series with all of its points."""
    # Numbers of points, k and m.
    k, m = (number // 10 if setting.quick else number for number in (_K, _M))
    numbers = list(_QUICK_POINTS if setting.quick else _POINTS)
    if setting.logs:
        most = len(setting.logs[0])
        numbers = [*(number for number in numbers if number < most), most]

    # A row for each step on each log.
    rows: list[Row] = []
    for number in numbers:
        track = _log(setting, number)
        rows += [{"points": len(track)} | row for row in _rows(track, rmse, k, m)]
    columns = (Column("points", "points"), _WHAT, _SECONDS, _MEMORY, _BYTES)
    return Table("points", "Points", columns, tuple(rows))


def _parameters_table(track: Track, *, quick: bool) -> Table:
    """Vary k, then m."""
    # Pairs of both, a tenth in a quick run.
    share = 10 if quick else 1
    pairs = [("k", k // share, _M // share) for k in _KS]
    pairs += [("m", _K // share, m // share) for m in _MS]

    # A row for each that the log has samples for.
    rows: list[Row] = []
    for varied, k, m in pairs:
        if m <= k <= len(track):
            seconds: dict[str, float] = {}
            with measured(seconds, "all"):
                mean = segment_mean(track, k, m)
            value = k if varied == "k" else m
            row: Row = {"varied": varied, "value": value, "k": k, "m": m}
            rmse = float(np.sqrt(mean.cost / len(track)))
            rows.append(row | {"seconds": seconds["all"], "rmse_m": rmse})
    columns = (
        Column("varied", "varied"),
        Column("k", "k"),
        Column("m", "m"),
        _SECONDS,
        Column("rmse_m", "RMSE m", 3),
    )
    return Table("parameters", "k and m of the segment mean", columns, tuple(rows))


def embedded(track: Track, dimension: int, seed: int = 1) -> Track:
    """Return a track turned into a space of more dimensions, with the same distances.

    Examples
    --------
    >>> track = Track("a", [0, 1], [[0, 0], [3, 4]])
    >>> turned = embedded(track, 5)
    >>> turned.dimension, float(np.linalg.norm(np.diff(turned.positions, axis=0)).round(9))
    (5, 5.0)
    """
    if dimension <= track.dimension:
        return Track(track.id, track.times, track.positions[:, :dimension])
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(dimension, track.dimension)))
    return Track(track.id, track.times, track.positions @ axes.T)


def _dimensions_table(track: Track, rmse: float, *, quick: bool) -> Table:
    """Vary the dimensions of a log whose distances stay the same."""
    k, m = (number // 10 if quick else number for number in (_K, _M))
    rows: list[Row] = []
    for dimension in _QUICK_DIMENSIONS if quick else _DIMENSIONS:
        turned = embedded(track, dimension)
        rows += [{"dimensions": dimension} | row for row in _rows(turned, rmse, k, m)]
    columns = (Column("dimensions", "dimensions"), _WHAT, _SECONDS, _MEMORY, _BYTES)
    return Table("dimensions", "Dimensions", columns, tuple(rows))


def _workers_table(track: Track, rmse: float) -> Table:
    """Vary the threads of an archive, whose bytes stay the same."""
    # The same archive with each number of threads.
    rows: list[Row] = []
    for workers in _WORKERS:
        seconds: dict[str, float] = {}
        begin = time.perf_counter()
        with measured(seconds, "all"):
            options = Options(rmse=rmse, effort=_EFFORT)
            archive, _ = compress([track], options, executor=Threads(workers))
        elapsed = time.perf_counter() - begin
        rows.append(
            {
                "workers": workers,
                "seconds": seconds["all"],
                "elapsed": elapsed,
                "bytes": archive.size,
            }
        )

    # Elapsed time depends on what else the machine does.
    columns = (Column("workers", "workers"), _SECONDS, Column("elapsed", "elapsed s", 3), _BYTES)
    return Table("workers", "Workers of the archive", columns, tuple(rows))


def waypoints_of(log: LogWithTruth) -> int:
    """Return the waypoints of the true walk of a log (algorithm 6).

    Examples
    --------
    >>> waypoints_of(ring(6, laps=1)), waypoints_of(complete_graph(6, steps=100))
    (4, 101)
    """
    graph = build_road_graph(log.road_map.nodes, log.road_map.edges)
    walk = log.walks[0]
    return len(find_waypoints_by_bisection(graph, build_route(graph, walk.nodes, walk.gaps)))


def _graphs_table(setting: Setting) -> Table:
    """Vary the steps of walks about a ring, and at random on a complete graph."""
    rows: list[Row] = []
    for steps in _STEPS[:1] if setting.quick else _STEPS:
        logs = {
            "ring": ring(_NODES, laps=steps // _NODES, samples=_SAMPLES, seed=setting.seed),
            "complete": complete_graph(_NODES, steps=steps, samples=_SAMPLES, seed=setting.seed),
        }
        rows += [_graph_row(name, log, steps) for name, log in logs.items()]
    return Table("graphs", "The best and the worst map for walks", _GRAPH_COLUMNS, tuple(rows))


def _graph_row(name: str, log: LogWithTruth, steps: int) -> Row:
    """Return waypoints and bytes of a walk, with its times and without."""
    options = Options(rmse=_GRAPH_RMSE, effort=_EFFORT)
    shape = Options(rmse=_GRAPH_RMSE, effort=_EFFORT, times=False)
    timed, untimed = (compress(log.tracks, each)[0].size for each in (options, shape))
    return {
        "graph": name,
        "steps": steps,
        "waypoints": waypoints_of(log),
        "bytes": timed,
        "bits_per_step": _BITS * timed / steps,
        "shape_bytes": untimed,
        "shape_bits_per_step": _BITS * untimed / steps,
    }


def _picture(table: Table, name: str, y: str, y_label: str, caption: str) -> tuple[Picture, ...]:
    """Draw a column over the number that is varied, a curve for each name.

    Zeros have no place on logarithmic axes; without anything else there is no picture.
    """
    # Curves.
    x = _VARIED[table.name]
    curves = []
    for each in dict.fromkeys(str(row[name]) for row in table.rows):
        pairs = [
            (float(row[x] or 0), float(row[y] or 0))
            for row in table.rows
            if row[name] == each and row[y]
        ]
        if pairs:
            curves.append(Curve(each, [first for first, _ in pairs], [last for _, last in pairs]))
    if not curves:
        return ()

    # The picture.
    x_label = "k or m" if table.name == "parameters" else x
    figure = draw_curves(curves, x_label, y_label, log_x=True, log_y=True)
    return (Picture(f"{table.name}-{_NAMES[y]}", caption, figure),)
