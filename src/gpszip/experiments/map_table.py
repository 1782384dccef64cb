"""Tables of the maps that the thesis's pipeline makes."""

from __future__ import annotations

from collections.abc import Mapping

from gpszip.experiments.table import Column, Table
from gpszip.experiments.thesis_pipeline import ThesisResult

__all__ = ["map_table"]


def map_table(results: Mapping[str, ThesisResult]) -> Table:
    """Return k and m, the size of each map, and its error, by the names of their pictures."""
    columns = (
        Column("picture", "picture"),
        Column("k", "k"),
        Column("m", "m"),
        Column("nodes", "nodes"),
        Column("edges", "edges"),
        Column("rmse_m", "RMSE m", 2),
        Column("max_m", "max m", 2),
    )
    rows = tuple(_row(name, result) for name, result in results.items())
    return Table("", "Maps of the thesis's pipeline", columns, rows)


def _row(name: str, result: ThesisResult) -> dict[str, str | int | float]:
    return {
        "picture": name,
        "k": result.mean.k,
        "m": result.mean.m,
        "nodes": result.nodes,
        "edges": result.edges,
        "rmse_m": result.rmse,
        "max_m": result.max_error,
    }
