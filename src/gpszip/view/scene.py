"""Everything that a page shows, as one JSON value: map, walks, samples, roads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import reproject_positions
from gpszip.model.grid import Plane, step_size
from gpszip.model.projection import UNITS_PER_DEGREE
from gpszip.model.timestamps import counts_from_1970
from gpszip.view.blocks import LARGEST_INTEGER, pack_lines, pack_numbers
from gpszip.view.facts import archive_facts, bytes_by_part
from gpszip.view.generator import generator_name
from gpszip.view.history import show_history
from gpszip.view.samples import Samples, collect_samples, thin_samples
from gpszip.view.walk_ends import walks_to_their_ends

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import CleanMap, Network, RoadMap, Track, Walk
    from gpszip.model.match import Matching
    from gpszip.pipeline.findings import Findings

__all__ = ["MAX_SAMPLES", "ShownArchive", "build_scene", "live_scene", "log_scene", "map_scene"]

#: Samples of a log that a page holds at most: 3 to 5 MB.
MAX_SAMPLES = 1_000_000

#: From this many samples on, positions and times are rounded more, to keep the page small.
_MANY_SAMPLES = 250_000

#: Positions are rounded to this share of the error.
_ERROR_SHARE = 1 / 20

#: ... but of many samples to this share of the extent: 0.03 pixels of a screen 2,000 pixels wide.
_EXTENT_SHARE = 1 / 65536

#: Metres and seconds below which nothing is rounded.
_FINEST = 1e-3

#: Errors are rounded to this share of the largest one, and those of many samples to the other.
_FINE_ERRORS = 1 / 4000
_COARSE_ERRORS = 1 / 250

#: Values of a kept column are rounded to this share of their range.
_COLUMN_SHARE = 1 / 65536


@dataclass(frozen=True, eq=False)
class ShownArchive:
    """An archive to show, and what is shown with it.

    Parameters
    ----------
    archive : Archive
        The archive.
    name : str
        Its name.
    tracks : sequence of Track
        The log, on the plane of the archive; empty if it is not shown.
    log_bytes : int or None
        Bytes of the log's files.
    matching : Matching or None
        Routes of the log on a network.
    findings : Findings or None
        What its history tells.
    """

    archive: Archive
    name: str
    tracks: Sequence[Track] = ()
    log_bytes: int | None = None
    matching: Matching | None = None
    findings: Findings | None = None


def build_scene(
    shown: Sequence[ShownArchive],
    network: Network | None = None,
    *,
    title: str,
    max_samples: int = MAX_SAMPLES,
) -> dict[str, Any]:
    """Build the value from which a page draws.

    Parameters
    ----------
    shown : sequence of ShownArchive
        One archive or two, whose coordinates are of one kind.
    network : Network, optional
        Roads behind everything.
    title : str
        Title of the page.
    max_samples : int, default ``MAX_SAMPLES``
        Samples of each log at most; of longer logs, those with the largest errors are kept.
    """
    # All lie on the planes of the first.
    archives = [each.archive for each in shown]
    plane = archives[0].grid.plane
    entries = [_show_archive(each, plane, max_samples) for each in shown]

    ranges = [archive.time_range for archive in archives if archive.time_range is not None]
    scene = _scene(entries, plane, [first for first, _ in ranges], title)
    return {**scene, "network": None if network is None else _show_network(network)}


def _degrees(center: tuple[int, int]) -> list[float]:
    return [center[0] / UNITS_PER_DEGREE, center[1] / UNITS_PER_DEGREE]


def _epoch_of(first_times: Sequence[float]) -> str | None:
    """From where times are counted: 1970, the log's own zero, or nowhere without times."""
    if not first_times:
        return None
    return "unix" if counts_from_1970(min(first_times)) else "log"


def map_scene(road_map: RoadMap, *, title: str) -> dict[str, Any]:
    """Build the scene of a map alone, as :func:`build_scene` does that of an archive."""
    extent = float(np.ptp(road_map.nodes, axis=0).max()) if len(road_map.nodes) else 1.0
    step = max(extent * _EXTENT_SHARE, _FINEST)
    entry = {
        **_empty_entry(title, road_map.nodes.shape[1]),
        "facts": [["Nodes", f"{len(road_map.nodes):,}"], ["Edges", f"{len(road_map.edges):,}"]],
        **_show_map(road_map, step),
    }
    return _scene([entry], road_map.plane, [], title)


def live_scene(archive: Archive | None, *, title: str) -> dict[str, Any]:
    """Build the scene of a live page: the clean map of an archive, or nothing but a plane.

    Parameters
    ----------
    archive : Archive or None
        Its edges have the numbers that events name.
    title : str
        Title of the page.
    """
    if archive is None:
        return _scene([_empty_entry(title, 2)], None, [], title)
    step = _position_step(archive, None)
    entry = {
        **_empty_entry(title, archive.grid.dimension),
        "facts": archive_facts(archive, None),
        "nodes": _pack_positions(archive.road_map.nodes, step),
        "clean": _show_clean_map(archive.clean_map(), step),
    }
    return _scene([entry], archive.grid.plane, [], title)


def log_scene(tracks: Sequence[Track], *, title: str) -> dict[str, Any]:
    """Build the scene of a log alone, as :func:`build_scene` does that of an archive."""
    samples = collect_samples(tracks, (), np.zeros((0, tracks[0].dimension)))
    extent = float(np.ptp(samples.positions, axis=0).max())
    step = max(extent * _EXTENT_SHARE, _FINEST)
    entry = {
        **_empty_entry(title, tracks[0].dimension),
        "facts": [["Tracks", f"{len(tracks):,}"], ["Points", f"{samples.total:,}"]],
        "points": samples.total,
        "raw": _show_samples(thin_samples(samples, MAX_SAMPLES), step),
    }
    first_times = [float(track.times[0]) for track in tracks if track.timed]
    return _scene([entry], tracks[0].plane, first_times, title)


def _scene(
    entries: list[dict[str, Any]],
    plane: Plane | None,
    first_times: Sequence[float],
    title: str,
) -> dict[str, Any]:
    """A scene without roads."""
    return {
        "version": 1,
        "generator": generator_name(),
        "title": title,
        "geographic": plane is not None,
        "planes": [] if plane is None else [_degrees(center) for center in plane.centers],
        "plane_spread": Plane.SPREAD,
        "epoch": _epoch_of(first_times),
        "archives": entries,
        "network": None,
    }


def _empty_entry(name: str, dimension: int) -> dict[str, Any]:
    """What stands for an archive where there is none: no map, no walks, no log."""
    # Blocks and lines of nothing.
    nothing = np.zeros((0, max(dimension, 2)))
    no_lines = pack_lines(nothing, np.zeros(1, np.int64), 1.0)
    none = pack_numbers([])

    # All that the page reads of an archive; callers replace what they have.
    return {
        "name": name,
        "facts": [],
        "bytes": None,
        "log_bytes": None,
        "points": None,
        "sections": [],
        "bound": None,
        "rmse": None,
        "max_error": None,
        "dimension": dimension,
        "nodes": _pack_positions(nothing, 1.0),
        "edges": dict.fromkeys(("from", "to", "forward", "backward"), none),
        "clean": {**no_lines, "forward": none, "backward": none},
        "new_edges": None,
        "tracks": {"ids": [], "timed": [], "offsets": pack_numbers([0])},
        "knots": dict.fromkeys(("node", "time", "gap"), none),
        "raw": None,
        "kept": None,
        "routes": None,
        "history": None,
    }


def _show_archive(shown: ShownArchive, plane: Plane | None, max_samples: int) -> dict[str, Any]:
    """One archive and its log, on a plane that may be that of another archive."""
    # Walks begin and end where their tracks do, at nodes of their own behind those of the map.
    archive = shown.archive
    nodes, walks = walks_to_their_ends(archive.road_map.nodes, archive.walks)
    road_map = replace(archive.road_map, nodes=nodes)
    clean_map, off_map_lines = archive.clean_map(), archive.off_map_lines
    samples = None
    if shown.tracks:
        samples = collect_samples(shown.tracks, archive.walks, archive.road_map.nodes)
    step = _position_step(archive, samples)

    # Two archives of one place were compressed on planes of their own.
    own = archive.grid.plane
    move = None
    if own is not None and plane is not None and own != plane:
        move = partial(reproject_positions, own=own, plane=plane, name=shown.name)
        road_map = replace(road_map, nodes=move(road_map.nodes))
        clean_map = replace(clean_map, points=move(clean_map.points))
        off_map_lines = [move(line) for line in off_map_lines]
        if samples is not None:
            samples = replace(samples, positions=move(samples.positions))

    found = shown.findings
    return {
        "name": shown.name,
        "facts": archive_facts(archive, samples),
        "bytes": archive.size,
        "log_bytes": shown.log_bytes,
        "points": None if samples is None else samples.total,
        "sections": bytes_by_part(archive),
        "bound": None if archive.error_bound is None else str(archive.error_bound),
        "rmse": None if samples is None else samples.rmse,
        "max_error": None if samples is None else samples.max_error,
        "dimension": archive.grid.dimension,
        **_show_map(road_map, step),
        "clean": _show_clean_map(clean_map, step),
        "new_edges": _show_lines(off_map_lines, step),
        "tracks": _show_tracks(walks),
        "knots": _show_knots(walks, nodes),
        "raw": None if samples is None else _show_samples(thin_samples(samples, max_samples), step),
        "kept": _show_kept(archive),
        "routes": None if shown.matching is None else _show_routes(shown.matching, step),
        "history": None if found is None else show_history(found, archive, move),
    }


def _show_map(road_map: RoadMap, step: float) -> dict[str, Any]:
    """Nodes, and edges with their traversals."""
    return {
        "nodes": _pack_positions(road_map.nodes, step),
        "edges": {
            "from": pack_numbers(road_map.edges[:, 0]),
            "to": pack_numbers(road_map.edges[:, 1]),
            "forward": pack_numbers(road_map.forward),
            "backward": pack_numbers(road_map.backward),
        },
    }


def _position_step(archive: Archive, samples: Samples | None) -> float:
    """Metres to which positions are rounded: a small part of the error."""
    # Of many samples, what a screen can show decides.
    error = step_size(archive.grid.space) if samples is None else samples.rmse or _FINEST
    nodes = archive.road_map.nodes
    extent = float(np.ptp(nodes, axis=0).max()) if len(nodes) else 1.0
    step = max(error * _ERROR_SHARE, _FINEST, extent / LARGEST_INTEGER)
    if samples is not None and len(samples.times) > _MANY_SAMPLES:
        step = max(step, min(extent, Plane.SPREAD / 2) * _EXTENT_SHARE)
    return step


def _pack_positions(positions: NDArray[np.float64], step: float) -> dict[str, Any]:
    """Pack up to three coordinates of positions."""
    names = "xyz"[: positions.shape[1]]
    packed = {name: pack_numbers(positions[:, axis], step) for axis, name in enumerate(names)}
    if "y" not in packed:  # positions along a line
        packed["y"] = pack_numbers(np.zeros(len(positions)))
    return packed


def _show_clean_map(clean: CleanMap, step: float) -> dict[str, Any]:
    """The clean map's edges as lines, with their traversals."""
    return {
        **pack_lines(_planar(clean.points), clean.offsets, step),
        "forward": pack_numbers(clean.forward),
        "backward": pack_numbers(clean.backward),
    }


def _show_lines(lines: Sequence[NDArray[np.float64]], step: float) -> dict[str, Any] | None:
    """Lines; None where there are none."""
    if not lines:
        return None
    offsets = np.concatenate([[0], np.cumsum([len(line) for line in lines])])
    return pack_lines(_planar(np.concatenate(lines)), offsets, step)


def _planar(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points with two coordinates at least."""
    if points.shape[1] > 1:
        return points
    return np.concatenate([points, np.zeros_like(points)], axis=1)


def _show_network(network: Network) -> dict[str, Any]:
    """Roads as lines, to a decimetre."""
    return pack_lines(network.points, network.offsets, 0.1)


def _show_routes(matching: Matching, step: float) -> dict[str, Any] | None:
    """Matched routes as lines."""
    lines = [piece.line for match in matching for piece in match.pieces if len(piece.line) > 1]
    return _show_lines(lines, step)


def _show_tracks(walks: Sequence[Walk]) -> dict[str, Any]:
    """Names of tracks, and where the knots of each begin."""
    counts = [len(walk.nodes) for walk in walks]
    return {
        "ids": [walk.id for walk in walks],
        "timed": [walk.times is not None for walk in walks],
        "offsets": pack_numbers(np.concatenate([[0], np.cumsum(counts)])),
    }


def _show_knots(walks: Sequence[Walk], nodes: NDArray[np.float64]) -> dict[str, Any]:
    """Nodes, times and gaps of all walks, one after the other."""
    times = [_times_or_distances(walk, nodes) for walk in walks]
    gaps = [np.concatenate([[False], walk.gaps]) for walk in walks]
    return {
        "node": pack_numbers(np.concatenate([walk.nodes for walk in walks])),
        "time": pack_numbers(np.concatenate(times), _FINEST),
        "gap": pack_numbers(np.concatenate(gaps)),
    }


def _times_or_distances(walk: Walk, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Seconds at the knots of a walk; metres along a walk without times."""
    if walk.times is not None:
        return walk.times
    steps = np.linalg.norm(np.diff(nodes[walk.nodes], axis=0), axis=1)
    distances: NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(steps)])
    return distances


def _show_samples(samples: Samples, step: float) -> dict[str, Any]:
    """Samples of the log, with their errors."""
    # Of many samples, times are rounded to a sixteenth of their usual distance.
    time_step, error_share = _FINEST, _FINE_ERRORS
    if len(samples.times) > _MANY_SAMPLES:
        time_step = max(float(np.median(np.abs(np.diff(samples.times)))) / 16, _FINEST)
        error_share = _COARSE_ERRORS
    error_step = max((samples.max_error or 0.0) * error_share, _FINEST)

    return {
        "tracks": {
            "ids": list(samples.ids),
            "timed": list(samples.timed),
            "offsets": pack_numbers(samples.offsets),
        },
        "walk": pack_numbers(samples.walks),
        **_pack_positions(samples.positions, step),
        "time": pack_numbers(samples.times, time_step),
        "error": pack_numbers(samples.errors, error_step, with_nan=True),
        "total": samples.total,
        "drawn": len(samples.times),
    }


def _show_kept(archive: Archive) -> dict[str, Any] | None:
    """Numeric columns that an archive keeps, at the times of the log."""
    if not archive.kept_columns:
        return None

    # Text is not for a chart.
    times = [archive.sample_times(name) for name in archive.ids]
    columns: dict[str, Any] = {}
    for column in archive.kept_columns:
        parts = [archive.attributes(name)[column] for name in archive.ids]
        if all(np.issubdtype(part.dtype, np.number) for part in parts):
            columns[column] = _pack_column(np.concatenate(parts).astype(np.float64))

    return {
        "offsets": pack_numbers(np.concatenate([[0], np.cumsum([len(each) for each in times])])),
        "time": pack_numbers(np.concatenate(times), _FINEST),
        "columns": columns,
    }


def _pack_column(values: NDArray[np.float64]) -> dict[str, Any]:
    """Values of a column, rounded to a small part of their range."""
    values = np.where(np.isfinite(values), values, np.nan)
    known = values[~np.isnan(values)]
    extent = float(np.ptp(known)) if len(known) else 0.0
    return pack_numbers(values, extent * _COLUMN_SHARE or 1.0, with_nan=True)
