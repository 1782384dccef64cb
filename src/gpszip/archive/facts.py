"""What an archive is, as plain values: for ``Archive.info()`` and ``gpszip info``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gpszip.model.grid import step_size

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.model.error_bound import ErrorBound

__all__ = ["count_facts", "error_bound_facts", "file_facts"]


def file_facts(archive: Archive) -> dict[str, Any]:
    """Facts that need no walk to be decoded."""
    # Name the unit, m or s, in the key of each length and duration.
    grid, contents = archive.grid, archive.contents
    facts = {
        "tracks": len(archive.ids),
        "bytes": archive.size,
        "groups": len(contents.groups),
        "dimension": grid.dimension,
        "geographic": grid.plane is not None,
        "node_step_m": step_size(grid.space),
        "time_step_s": step_size(grid.time),
        "layer": contents.layer,
    }

    # What is kept besides the walks.
    kept = {
        "kept": None if archive.kept_columns is None else list(archive.kept_columns),
        "exact_logs": list(archive.exact_names),
        "curves": [
            {"name": name, "bound": bound, "bytes": size}
            for name, (bound, size) in archive.curve_sizes.items()
        ],
    }

    # The map that the walks lie on, if the archive holds none, the bound, and the times.
    return {
        **facts,
        **kept,
        "map": None if contents.map is None else contents.map.hash.hex(),
        **error_bound_facts(archive.error_bound),
        "sampling_s": archive.sampling,
        "timed": archive.timed,
    }


def error_bound_facts(bound: ErrorBound | None) -> dict[str, Any]:
    """Value and kind of the error bound, and the maximum beside an RMSE; None without one."""
    return {
        "error_bound_m": None if bound is None else bound.metres,
        "error_bound_max_m": None if bound is None else bound.max_error,
        "error_bound": None if bound is None else "max_error" if bound.maximum else "rmse",
    }


def count_facts(archive: Archive) -> dict[str, Any]:
    """Counts of the map and the walks, and the span of time, for which all walks are decoded."""
    # Where the ends of pieces are kept, they are those of the samples; knots may lie beyond.
    times = [
        walk.times if walk.time_ranges is None else walk.time_ranges.ravel()
        for walk in archive.walks
        if walk.times is not None
    ]
    return {
        "nodes": len(archive.road_map.nodes),
        "edges": len(archive.road_map.edges),
        "segments": sum(len(walk.gaps) for walk in archive.walks),
        "waypoints": sum(len(archive.waypoints(name)) for name in archive.ids),
        "gaps": sum(int(walk.gaps.sum()) for walk in archive.walks),
        "untimed": list(archive.untimed),
        "t_start": min((float(seconds[0]) for seconds in times), default=None),
        "t_end": max((float(seconds[-1]) for seconds in times), default=None),
    }
