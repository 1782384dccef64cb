"""A road map as GeoJSON: a LineString for each edge."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gpszip.io.geojson import METRES
from gpszip.io.map_table import MapTable

__all__ = ["write_map_geojson"]


def write_map_geojson(table: MapTable, path: Path, *, points: bool = False) -> None:
    """Write edges with u, v, forward, backward and length (metres).

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
    places = table.places.tolist()
    columns = [column.tolist() for column in table.properties.values()]
    features = [
        _feature("LineString", [places[row[0]], places[row[1]]], dict(zip(table.properties, row, strict=True)))
        for row in zip(*columns, strict=True)
    ]
    if points:
        features += [_feature("Point", places[node], {"node": node}) for node in np.asarray(table.nodes).tolist()]
    member = "" if table.geographic else f"{json.dumps(METRES)[1:-1]}, "
    lines = ",\n".join(json.dumps(feature) for feature in features)
    path.write_text(f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n', encoding="utf-8")


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
