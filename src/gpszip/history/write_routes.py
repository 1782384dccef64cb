"""Write planned routes as GPX or GeoJSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gpszip.errors import OutputError
from gpszip.history.routes import PlannedRoute
from gpszip.io.history_tables import edge_geometry
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.write import write_tracks
from gpszip.io.storage.sink import open_sink
from gpszip.model import Network, Track

__all__ = ["check_route_format", "route_facts", "write_planned_routes"]

#: Formats by suffix; standard output is GeoJSON.
_FORMATS = {".gpx": "gpx", ".geojson": "geojson", ".json": "geojson"}

#: Decimals of metres and seconds.
_DECIMALS = 1


def check_route_format(target: str) -> str:
    """Return the format of a file of routes.

    Raises
    ------
    OutputError
        If there is no such format.

    Examples
    --------
    >>> check_route_format("R.gpx"), check_route_format("-")
    ('gpx', 'geojson')
    """
    if target == "-":
        return "geojson"
    suffix = Path(target).suffix.lower()
    if suffix not in _FORMATS:
        raise OutputError(
            f"routes are written as GPX or GeoJSON, not as {suffix[1:] or 'nothing'}",
            path=target,
            remedy="name a .gpx or .geojson file",
        )
    return _FORMATS[suffix]


def write_planned_routes(routes: Sequence[PlannedRoute], network: Network, target: str) -> None:
    """Write routes, the best one first.

    Parameters
    ----------
    routes : sequence of PlannedRoute
        GPX has a track without times for each, ``route``, ``alternative 1`` and so on; GeoJSON a
        line with the facts of :func:`route_facts`.
    network : Network
        The map.
    target : str
        Name of the file; ``-`` is standard output.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    names = ["route", *(f"alternative {number}" for number in range(1, len(routes)))]
    if check_route_format(target) == "gpx":
        write_tracks(
            [_shape(name, route, network) for name, route in zip(names, routes, strict=True)],
            target,
        )
        return
    features = [
        {
            "type": "Feature",
            "properties": {"name": name, **route_facts(route)},
            "geometry": edge_geometry(route.line, network),
        }
        for name, route in zip(names, routes, strict=True)
    ]
    document: dict[str, Any] = {"type": "FeatureCollection"}
    document |= {} if network.plane is not None else METRES_MEMBER
    with open_sink(target) as sink:
        sink.write(json.dumps({**document, "features": features}).encode() + b"\n")


def route_facts(route: PlannedRoute) -> dict[str, Any]:
    """Facts of a route as plain values: lengths in metres, times in seconds."""
    arrival = route.arrival
    return {
        "length": round(route.length, _DECIMALS),
        "seconds": None if arrival is None else round(arrival.seconds, _DECIMALS),
        "seconds_low": None if arrival is None else round(arrival.low, _DECIMALS),
        "seconds_high": None if arrival is None else round(arrival.high, _DECIMALS),
        "traversals": route.traversals,
        "edges": route.edges.tolist(),
        "forward": route.forward.tolist(),
    }


def _shape(name: str, route: PlannedRoute, network: Network) -> Track:
    """A route as a track without times, whose vertices count metres along it."""
    steps = np.linalg.norm(np.diff(route.line, axis=0), axis=1)
    kept = np.append(True, steps > 0)
    along = np.append(0.0, np.cumsum(steps))[kept]
    return Track(name, along, route.line[kept], plane=network.plane, timed=False)
