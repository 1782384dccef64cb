"""Write a map as GeoJSON (RFC 7946): a line for each edge."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.maps.table import MapTable

__all__ = ["write_map_geojson"]


def write_map_geojson(table: MapTable, path: Path, *, points: bool = False) -> None:
    """Write edges with their columns as properties; lengths in metres, speeds in m/s.

    A line that crosses the antimeridian is a MultiLineString, cut there (RFC 7946, 3.1.9).
    GeoJSON can't say that coordinates are metres; for a map in x and y, the member ``gpszip`` does.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    points : bool
        Write the nodes, too, as Points with the property ``node``.
    """
    # Lines.
    vertices = table.points.tolist()
    columns = [_nan_to_null(column) for column in table.properties.values()]
    features = [
        _line_feature(
            [vertices[fragment] for fragment in fragments],
            dict(zip(table.properties, values, strict=True)),
        )
        for fragments, values in zip(table.fragments, zip(*columns, strict=True), strict=True)
    ]

    # Nodes.
    if points:
        positions = table.node_positions.tolist()
        features += [
            _feature("Point", positions[node], {"node": node}) for node in table.nodes.tolist()
        ]

    # Write one feature a line; mark metres, as GeoJSON itself knows degrees only.
    # The slice strips the braces, so that the member stands beside "features".
    member = "" if table.geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    lines = ",\n".join(json.dumps(feature) for feature in features)
    path.write_text(
        f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n', encoding="utf-8"
    )


def _line_feature(fragments: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    # Only a line that crosses the antimeridian has several fragments.
    if len(fragments) == 1:
        return _feature("LineString", fragments[0], properties)
    return _feature("MultiLineString", fragments, properties)


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _nan_to_null(column: NDArray[np.generic]) -> list[Any]:
    """Return a column as a list in which NaN, which JSON can't hold, is None."""
    # Only NaN differs from itself.
    return [None if value != value else value for value in column.tolist()]  # noqa: PLR0124
