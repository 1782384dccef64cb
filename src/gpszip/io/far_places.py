"""Write places where two archives or logs are far apart, as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Sequence

from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.storage.sink import open_sink
from gpszip.model.difference import FarPlace

__all__ = ["write_far_places"]


def write_far_places(places: Sequence[FarPlace], target: str, *, geographic: bool) -> None:
    """Write a line between the two positions of each place.

    Parameters
    ----------
    places : sequence of FarPlace
        The properties are ``track_id``, ``time`` in seconds and ``distance_m``.
    target : str
        Name of the file; ``-`` is standard output.
    geographic : bool
        Whether positions are latitudes and longitudes; metres are marked by the member ``gpszip``.
    """
    lines = ",\n".join(json.dumps(_feature(place, geographic=geographic)) for place in places)
    # The slice strips the braces, so that the member stands beside "features".
    member = "" if geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    text = f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n'
    with open_sink(target) as sink:
        sink.write(text.encode())


def _feature(place: FarPlace, *, geographic: bool) -> dict[str, object]:
    """A feature of GeoJSON, which has the longitude first."""
    ends = [list(place.first), list(place.second)]
    if geographic:
        # Of two longitudes on either side of the antimeridian, the second goes on beyond 180.
        ends = [[lon, lat] for lat, lon in ends]
        turn = round((ends[0][0] - ends[1][0]) / 360.0)
        ends[1][0] += 360.0 * turn
    properties = {"track_id": place.id, "time": place.time, "distance_m": place.distance}
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "LineString", "coordinates": ends},
    }
