"""A map as GeoJSON: a line for each edge or way."""

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
    """Write edges or ways with their columns as properties; lengths in metres, speeds in m/s.

    A line that crosses the antimeridian is a MultiLineString, cut there (RFC 7946, 3.1.9).

    Coordinates of a map in x and y are metres, which GeoJSON has no word for: the member ``gpszip`` says so.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    points : bool
        Write the nodes, too, as Points with the property ``node``.
    """
    node_positions, vertices = table.node_positions.tolist(), table.points.tolist()
    columns = [_nan_to_null(column) for column in table.properties.values()]
    features = [
        _line_feature(
            [vertices[part] for part in parts], dict(zip(table.properties, row, strict=True))
        )
        for parts, row in zip(table.line_parts, zip(*columns, strict=True), strict=True)
    ]
    if points:
        features += [
            _feature("Point", node_positions[node], {"node": node}) for node in table.nodes.tolist()
        ]
    member = "" if table.geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    lines = ",\n".join(json.dumps(feature) for feature in features)
    path.write_text(
        f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n', encoding="utf-8"
    )


def _line_feature(parts: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return (
        _feature("LineString", parts[0], properties)
        if len(parts) == 1
        else _feature("MultiLineString", parts, properties)
    )


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _nan_to_null(column: NDArray[np.generic]) -> list[Any]:
    """JSON has no word for NaN."""
    return [None if value != value else value for value in column.tolist()]  # noqa: PLR0124
