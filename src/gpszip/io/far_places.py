"""Write places where two archives or logs are far apart, as GeoJSON (RFC 7946)."""

from __future__ import annotations

from collections.abc import Sequence

from gpszip.io.feature_tables import write_features
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
    rows = ({"track_id": p.id, "time": p.time, "distance_m": p.distance} for p in places)
    geometries = (_geometry(place, geographic=geographic) for place in places)
    write_features(rows, geometries, target, geographic=geographic)


def _geometry(place: FarPlace, *, geographic: bool) -> dict[str, object]:
    """A line of GeoJSON, which has the longitude first."""
    ends = [list(place.first), list(place.second)]
    if geographic:
        # Of two longitudes on either side of the antimeridian, the second goes on beyond 180.
        ends = [[lon, lat] for lat, lon in ends]
        turn = round((ends[0][0] - ends[1][0]) / 360.0)
        ends[1][0] += 360.0 * turn
    return {"type": "LineString", "coordinates": ends}
