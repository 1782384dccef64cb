"""A road map as CSV: a row for each edge, with the places of its ends."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.io.map_table import MapTable

__all__ = ["write_map_csv"]


def write_map_csv(table: MapTable, path: Path) -> None:
    """Write edges as ``u,v,forward,backward,length`` and the coordinates of both ends.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    axes = ["lon", "lat"] if table.geographic else list("xyz"[: table.places.shape[1]])
    columns = dict(table.properties)
    for end in ("u", "v"):
        nodes = columns[end]
        columns |= {f"{end}_{axis}": table.places[nodes, i] for i, axis in enumerate(axes)}
    with path.open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        pc.write_csv(pa.table(columns), file, pc.WriteOptions(include_header=False))
