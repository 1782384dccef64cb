"""Write a map as CSV: a row for each edge, with the positions of its ends."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.io.maps.table import MapTable

__all__ = ["write_map_csv"]


def write_map_csv(table: MapTable, path: Path) -> None:
    """Write the columns of edges and the coordinates of both ends.

    Edges with a shape have well-known text in the column ``line``.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    # Properties, ends, shapes.
    columns = {name: _nan_to_null(values) for name, values in table.properties.items()}
    # Both ends give columns such as u_lon, u_lat, v_lon and v_lat.
    for end in ("u", "v"):
        nodes = table.properties[end]
        columns |= {
            f"{end}_{axis}": pa.array(table.node_positions[nodes, i])
            for i, axis in enumerate(table.axes)
        }
    if table.has_shapes:
        columns["line"] = pa.array(table.wkt, pa.string())

    # The header is written apart, since Arrow would quote it.
    with path.open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        pc.write_csv(pa.table(columns), file, pc.WriteOptions(include_header=False))


def _nan_to_null(values: object) -> pa.Array:
    """Return values as an Arrow array in which NaN is null, an empty cell."""
    return pa.array(values, from_pandas=True)
