"""Figure 8-6: the maps of two taxis, and the map that merging makes of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.drawing.layers import Label, Lines, draw_layers
from gpszip.drawing.map_figure import from_above
from gpszip.drawing.style import CYCLE, FigureType
from gpszip.experiments.archive_map import archive_lines
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.target_rmse import target_rmse
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import taxis

__all__ = ["run"]

#: Samples of each generated taxi, and those of a quick run.
_SAMPLES, _QUICK = 3_000, 400

#: Seconds between two samples: with the thesis's minute, chords cut the corners of streets.
_PERIOD = 10.0

#: RMSE in metres of each archive.
_RMSE = 20.0

#: Cells along the longer side, of which the one is circled in which both maps have most roads.
_CELLS = 8

#: Metres between two points along roads that are counted there.
_SPACING = 10.0

Floats = NDArray[np.float64]


def run(setting: Setting) -> Outcome:
    """Draw the map of each of two tracks, and the merged map, with a place that both passed."""
    # Two archives, and the one that is merged of them.
    tracks = _find(setting)
    options = Options(rmse=target_rmse(setting, tracks[0], _RMSE))
    if setting.quick:
        options = Options(rmse=options.rmse, effort=1)
    archives = [compress([track], options)[0] for track in tracks]
    merged, _ = merge(archives)

    # A picture of each, with the same circle.
    circle = _shared_place([archive_lines(archive) for archive in archives])
    shown = {"first": archives[0], "second": archives[1], "merged": merged}
    colors = dict(zip(shown, (CYCLE[0], CYCLE[5], CYCLE[2]), strict=True))
    pictures = tuple(
        Picture(
            name,
            f"The map of {_described(name, archive)}.",
            _draw(archive, colors[name], tracks, circle),
        )
        for name, archive in shown.items()
    )
    return Outcome((_table(shown),), pictures)


def _find(setting: Setting) -> list[Track]:
    """Return two generated taxis, the user's first two tracks, or the halves of the only one."""
    if not setting.logs:
        samples = _QUICK if setting.quick else _SAMPLES
        return list(taxis(2, points=samples, period=_PERIOD, seed=setting.seed).tracks)
    tracks = list(setting.logs[:2])
    if len(tracks) == 1:
        track = tracks[0]
        half = len(track) // 2
        tracks = [
            Track(f"{track.id} {name}", track.times[part], track.positions[part], plane=track.plane)
            for name, part in (("begin", slice(half)), ("end", slice(half, None)))
        ]
    return [first_samples(track, _QUICK) if setting.quick else track for track in tracks]


def _shared_place(maps: list[list[Floats]]) -> list[Label]:
    """Return the square in which both maps have most roads, as a circle; none if none is shared."""
    # A track that stands still has no road.
    if not all(maps):
        return []

    # Points along the roads of each map, in square cells.
    points = [np.concatenate([_along(line) for line in lines]) for lines in maps]
    low, high = (find(np.concatenate(points), axis=0) for find in (np.min, np.max))
    side = max(float((high - low).max()) / _CELLS, 1e-6)
    bins = [np.arange(_CELLS + 2) * side + start for start in low]
    counts = [np.histogram2d(each[:, 0], each[:, 1], bins=bins)[0] for each in points]

    # The one that both share most.
    shared = np.minimum(*counts)
    if not shared.any():
        return []
    x, y = np.unravel_index(int(shared.argmax()), shared.shape)
    center = np.array([bins[0][x], bins[1][y]]) + side / 2
    return [Label("", center, side * np.sqrt(0.5))]


def _along(line: Floats) -> Floats:
    """Return points every few metres along a line."""
    corners = from_above(line)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    at = np.arange(0.0, along[-1], _SPACING)
    return np.column_stack([np.interp(at, along, axis) for axis in corners.T])


def _described(name: str, archive: Archive) -> str:
    whose = "both tracks" if name == "merged" else f"the {name} track"
    return f"{whose}: {len(archive.clean_map())} edges, {archive.size:,} bytes"


def _table(archives: dict[str, Archive]) -> Table:
    """Return the size of each archive and of its map, and the sum of both."""
    # A row for each archive.
    rows: list[dict[str, Value]] = []
    for name, archive in archives.items():
        clean = archive.clean_map()
        rows.append(
            {
                "archive": name,
                "bytes": archive.size,
                "junctions": len(clean.junctions),
                "edges": len(clean),
                "length_m": float(clean.length.sum()),
            }
        )

    # The sum stands before the merged one.
    total: dict[str, Value] = {"archive": "both, not merged"}
    for key in ("bytes", "junctions", "edges", "length_m"):
        total[key] = sum(float(row[key] or 0) for row in rows[:2])
    columns = (
        Column("archive", "archive"),
        Column("bytes", "bytes"),
        Column("junctions", "junctions"),
        Column("edges", "edges"),
        Column("length_m", "length m"),
    )
    return Table("", "Archives and their clean maps", columns, (*rows[:2], total, rows[2]))


def _draw(archive: Archive, color: str, tracks: list[Track], circle: list[Label]) -> FigureType:
    """Draw the clean map over the samples of its tracks."""
    samples = [track.positions for track in tracks if track.id in archive.ids]
    frame = [track.positions for track in tracks]
    return draw_layers(samples, [Lines("map", archive_lines(archive), color)], circle, frame=frame)
