"""Tables that compare the thesis's own numbers, its pipeline run here, and the archive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gpszip.experiments.archive_pipeline import ArchiveResult
from gpszip.experiments.published import Published
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.thesis_pipeline import STAGES, ThesisResult

__all__ = ["Compared", "archive_table", "pipeline_table", "stages_table"]

#: Who made a row.
_OURS, _THEIRS = "here", "thesis, own data"

#: Columns of the thesis's table, and k, m and the maximum, which it leaves out.
_PIPELINE_COLUMNS = (
    Column("log", "log"),
    Column("data", "data"),
    Column("points", "points"),
    Column("coreset", "coreset"),
    Column("k", "k"),
    Column("m", "m"),
    Column("nodes", "nodes"),
    Column("edges", "edges"),
    Column("waypoints", "waypoints"),
    Column("bzip2", "bzip2", 1),
    Column("semantic", "semantic", 1),
    Column("semantic_bzip2", "semantic + bzip2", 1),
    Column("improvement", "improvement", 1),
    Column("rmse_m", "RMSE m", 3),
    Column("max_m", "max m", 2),
)

#: Columns that compare bytes and errors of the thesis's pipeline and of the archive.
_ARCHIVE_COLUMNS = (
    Column("log", "log"),
    Column("text_bytes", "text"),
    Column("thesis_bytes", "thesis"),
    Column("archive_bytes", "archive"),
    Column("smaller", "smaller", 1),
    Column("timed_text_bytes", "text with times"),
    Column("timed_thesis_bytes", "thesis"),
    Column("timed_archive_bytes", "archive"),
    Column("timed_smaller", "smaller", 1),
    Column("thesis_rmse_m", "thesis RMSE m", 3),
    Column("archive_rmse_m", "archive RMSE m", 3),
    Column("thesis_max_m", "thesis max m", 2),
    Column("archive_max_m", "archive max m", 2),
)


@dataclass(frozen=True, eq=False)
class Compared:
    """One log, compressed both ways.

    Parameters
    ----------
    log : str
        Its name.
    thesis : ThesisResult
        The thesis's pipeline.
    archive : ArchiveResult
        The archive at the same RMSE.
    published : Published, optional
        What the thesis states of a log of this kind.
    """

    log: str
    thesis: ThesisResult
    archive: ArchiveResult
    published: Published | None = None


def pipeline_table(compared: Sequence[Compared]) -> Table:
    """Return the thesis's table: its own row above the same pipeline here, sizes without times."""
    # The thesis's row stands above that of the log that was generated for it.
    rows: list[dict[str, Value]] = []
    for each in compared:
        if each.published is not None:
            rows.append(_published_row(each.published))
        rows.append(_pipeline_row(each))

    # Times are left out, as in the thesis.
    title = "The thesis's pipeline; ratios of text sizes without times"
    return Table("", title, _PIPELINE_COLUMNS, tuple(rows))


def _published_row(published: Published) -> dict[str, Value]:
    """Return a row of what the thesis states; k and the maximum stay empty."""
    # The log and the map; m is half of the nodes.
    row: dict[str, Value] = {
        "log": published.log,
        "data": _THEIRS,
        "points": published.points,
        "coreset": published.coreset,
        "m": published.nodes // 2,
        "nodes": published.nodes,
        "edges": published.edges,
        "waypoints": published.waypoints,
    }

    # Ratios and the error.
    return row | {
        "bzip2": published.bzip2,
        "semantic": published.semantic,
        "semantic_bzip2": published.both,
        "improvement": published.improvement,
        "rmse_m": published.rmse,
    }


def _pipeline_row(compared: Compared) -> dict[str, Value]:
    """Return the row of the thesis's pipeline here."""
    # The log and the map.
    result = compared.thesis
    row: dict[str, Value] = {
        "log": compared.log,
        "data": _OURS,
        "points": result.points,
        "coreset": result.coreset or result.points,
        "k": result.mean.k,
        "m": result.mean.m,
        "nodes": result.nodes,
        "edges": result.edges,
        "waypoints": result.waypoints,
    }

    # Ratios and errors.
    return row | {
        "bzip2": result.sizes.bzip2_ratio,
        "semantic": result.sizes.semantic_ratio,
        "semantic_bzip2": result.sizes.both_ratio,
        "improvement": result.sizes.improvement,
        "rmse_m": result.rmse,
        "max_m": result.max_error,
    }


def archive_table(compared: Sequence[Compared]) -> Table:
    """Return bytes of both at the same RMSE, without times and with the times of all knots."""
    title = "Bytes at the same RMSE: the thesis's text after bzip2, and the archive"
    return Table("archive", title, _ARCHIVE_COLUMNS, tuple(map(_archive_row, compared)))


def _archive_row(compared: Compared) -> dict[str, Value]:
    """Return the bytes of both, and their errors."""
    # Without times, as the thesis counts.
    thesis, archive = compared.thesis, compared.archive
    row: dict[str, Value] = {
        "log": compared.log,
        "text_bytes": thesis.sizes.log,
        "thesis_bytes": thesis.sizes.semantic_bzip2,
        "archive_bytes": archive.bytes_without_times,
        "smaller": thesis.sizes.semantic_bzip2 / archive.bytes_without_times,
    }

    # With times.
    row |= {
        "timed_text_bytes": thesis.timed_sizes.log,
        "timed_thesis_bytes": thesis.timed_sizes.semantic_bzip2,
        "timed_archive_bytes": archive.bytes,
        "timed_smaller": thesis.timed_sizes.semantic_bzip2 / archive.bytes,
    }

    # Errors.
    return row | {
        "thesis_rmse_m": thesis.rmse,
        "archive_rmse_m": archive.rmse,
        "thesis_max_m": thesis.max_error,
        "archive_max_m": archive.max_error,
    }


def stages_table(compared: Sequence[Compared]) -> Table:
    """Return CPU seconds of each stage of the thesis's pipeline, and of the archive."""
    # The thesis states the hours of whole runs, and those of some logs only.
    rows = tuple(
        {
            "log": each.log,
            **each.thesis.seconds,
            "archive": each.archive.seconds,
            "thesis_hours": each.published.hours if each.published else None,
        }
        for each in compared
    )

    # A column for each stage.
    return Table(
        "seconds",
        "CPU seconds here, and the hours that the thesis states",
        (
            Column("log", "log"),
            *(Column(stage, stage, 3) for stage in STAGES),
            Column("archive", "archive", 2),
            Column("thesis_hours", "thesis, hours", 1),
        ),
        rows,
    )
