"""Writing what was matched: routes as lines, or the place of every point as rows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.degree_lines import cut_at_antimeridian
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.track_rows import DEGREE_DIGITS, TIME_DECIMALS, round_decimals
from gpszip.io.storage.sink import open_sink
from gpszip.model import Network, Plane, Track
from gpszip.model.match import Break, Match, Matching, Piece

__all__ = ["route_format", "write_routes"]

_DECIMALS = 3

_FORMATS = {".geojson": "geojson", ".json": "geojson", ".csv": "csv"}


def route_format(sink: str | Path | BinaryIO, format: str | None = None) -> str:
    """Format in which routes are written: ``"geojson"`` or ``"csv"``, told from a name where left out, GeoJSON for a stream.

    Raises
    ------
    OutputError
        If it is another one.

    Examples
    --------
    >>> route_format("routes.csv"), route_format("-")
    ('csv', 'geojson')
    """
    suffix = Path(str(sink)).suffix.lower() if isinstance(sink, (str, Path)) else ""
    chosen = format or _FORMATS.get(suffix, "geojson" if not suffix else suffix[1:])
    if chosen not in {"geojson", "csv"}:
        raise OutputError(
            f"{sink}: routes are written as geojson or csv, not as {chosen}; name such a file, or give --format"
        )
    return chosen


def write_routes(
    matching: Matching,
    tracks: Sequence[Track],
    network: Network,
    sink: str | Path | BinaryIO,
    format: str | None = None,
) -> None:
    """Write routes; on the earth in degrees.

    Parameters
    ----------
    matching : Matching
        What was matched.
    tracks : sequence of Track
        The log.
    network : Network
        The roads.
    sink : str, Path or binary stream
        The file, which appears whole or not at all and replaces another of its name; ``-`` for standard output.
    format : str, optional
        ``geojson``, a line for each piece; or ``csv``, a row for each point. Told from the name where left out.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    chosen = route_format(sink, format)
    with open_sink(sink) as stream:
        if chosen == "csv":
            _write_csv(matching, tracks, network, stream)
        else:
            _write_geojson(matching, tracks, network, stream)


def _write_geojson(
    matching: Matching, tracks: Sequence[Track], network: Network, stream: BinaryIO
) -> None:
    member = "" if network.plane is not None else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    stream.write(f'{{"type": "FeatureCollection", {member}"features": ['.encode())
    separator = "\n"
    for match, track in zip(matching.matches, tracks, strict=True):
        for feature in _features(match, track, network):
            stream.write((separator + json.dumps(feature, ensure_ascii=False)).encode())
            separator = ",\n"
    stream.write(b'\n], "unmatched": [')
    separator = "\n"
    for match, track in zip(matching.matches, tracks, strict=True):
        for stretch in _unmatched_slices(match, track, network):
            stream.write((separator + json.dumps(stretch, ensure_ascii=False)).encode())
            separator = ",\n"
    stream.write(b"\n]}\n")


def _unmatched_slices(match: Match, track: Track, network: Network) -> Iterator[dict[str, Any]]:
    """Stretches on no road, with the first and last time of their points and why."""
    for one in match.breaks:
        points = one.after + 1 + np.flatnonzero(match.piece[one.after + 1 : one.before] < 0)
        if not len(points):
            continue
        stretch = {
            "track_id": match.track,
            **_times(track, int(points[0]), int(points[-1])),
            "points": len(points),
            "reason": one.reason,
        }
        yield stretch | ({"against": _road_labels(one, network)} if one.edges else {})


def _features(match: Match, track: Track, network: Network) -> Iterator[dict[str, Any]]:
    for number, piece in enumerate(match.pieces):
        line = _to_output_coordinates(
            piece.line if len(piece.line) > 1 else np.repeat(piece.line, 2, axis=0), network.plane
        )
        properties = _properties(match, number, piece, track) | {"roads": _road_ids(piece, network)}
        if network.names is not None:
            properties["names"] = _street_names(piece, network.names)
        against = [
            name
            for one in match.breaks
            if one.after == piece.last and one.edges
            for name in _road_labels(one, network)
        ]
        if against:
            properties["against"] = against
        yield {
            "type": "Feature",
            "properties": properties,
            "geometry": _geometry(line, network.plane),
        }


def _geometry(line: NDArray[np.float64], plane: Plane | None) -> dict[str, Any]:
    """A line, in two or more parts where it crosses the antimeridian (RFC 7946, 3.1.9)."""
    if plane is None:
        return {"type": "LineString", "coordinates": line.tolist()}
    found = cut_at_antimeridian(line, np.array([0, len(line)]), decimals=_DECIMALS + DEGREE_DIGITS)
    parts = [part.tolist() for part in np.split(found.points, found.cuts)]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _properties(match: Match, number: int, piece: Piece, track: Track) -> dict[str, Any]:
    return {
        "track_id": match.track,
        "piece": number,
        **_times(track, piece.first, piece.last),
        "points": int((match.piece == number).sum()),
        "length": round(piece.length, _DECIMALS),
        "confidence": round(piece.confidence, _DECIMALS),
        "matched": round(match.share, 4),
        "end": piece.reason,
    }


def _times(track: Track, first: int, last: int) -> dict[str, float]:
    """Times of the first and the last point of a stretch; none where the track has none."""
    if not track.timed:
        return {}
    start, end = round_decimals(track.times[[first, last]], TIME_DECIMALS).tolist()
    return {"t_start": start, "t_end": end}


def _road_labels(one: Break, network: Network) -> list[str]:
    """What the roads that a break leads against are called."""
    return list(dict.fromkeys(map(network.label, one.edges)))


def _street_names(piece: Piece, names: Sequence[str]) -> list[str]:
    """Street names in the order of travel, those of several roads in a row once; roads without a name are passed over."""
    travelled = [names[edge] for edge in piece.route.edges.tolist()]
    return [name for name, _ in groupby(filter(None, travelled))]


def _road_ids(piece: Piece, network: Network) -> list[Any]:
    """Ids of the roads travelled, those that several in a row share once; their numbers where they have none."""
    edges = piece.route.edges.tolist()
    names = edges if network.ids is None else [network.ids[edge] for edge in edges]
    return [name for name, _ in groupby(names)]


def _to_output_coordinates(
    positions: NDArray[np.float64], plane: Plane | None
) -> NDArray[np.float64]:
    """Longitude and latitude, or metres, rounded."""
    if plane is None:
        return round_decimals(positions, _DECIMALS)
    lat, lon = to_geographic(positions[:, :2], plane)
    return round_decimals(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)


def _write_csv(
    matching: Matching, tracks: Sequence[Track], network: Network, stream: BinaryIO
) -> None:
    header = True
    for match, track in zip(matching.matches, tracks, strict=True):
        table = _point_table(match, track, network)
        if header:
            stream.write((",".join(table.column_names) + "\n").encode())
        pc.write_csv(table, stream, pc.WriteOptions(include_header=False, quoting_style="needed"))
        header = False


def _point_table(match: Match, track: Track, network: Network) -> pa.Table:
    on = match.piece >= 0
    off = ~on
    columns: dict[str, Any] = {"track_id": pa.array([match.track] * len(match), pa.string())}
    columns["t"] = _masked(
        round_decimals(track.times, TIME_DECIMALS), np.full(len(track), not track.timed)
    )
    columns |= _coordinate_columns("", track.positions, track.plane, np.zeros(len(track), np.bool_))
    columns |= _coordinate_columns("road_", match.snapped_positions(network), network.plane, off)
    columns["distance"] = _masked(round_decimals(match.distance, _DECIMALS), off)
    columns["piece"] = pa.array(match.piece, mask=off)
    names = (
        match.edge
        if network.ids is None
        else [network.ids[edge] if edge >= 0 else "" for edge in match.edge.tolist()]
    )
    columns["road"] = pa.array(names, mask=off)
    columns["forward"] = pa.array(match.forward, mask=off)
    columns["offset"] = _masked(round_decimals(match.offset, _DECIMALS), off)
    columns["along"] = _masked(round_decimals(match.along, _DECIMALS), off)
    columns["confidence"] = round_decimals(match.confidence, _DECIMALS)
    if network.names is not None:
        columns["name"] = pa.array(
            [network.names[edge] if edge >= 0 else None for edge in match.edge.tolist()],
            pa.string(),
        )
    columns["reason"], columns["against"] = _reasons(match, network)
    return pa.table(columns)


def _reasons(match: Match, network: Network) -> tuple[pa.Array, pa.Array]:
    """Why points are on no road, and the one-way roads that they travel against; null for those that are on one."""
    which = np.full(len(match), -1)
    for number, one in enumerate(match.breaks):
        which[one.after + 1 : one.before] = number
    which[match.piece >= 0] = -1
    off = pa.array(which, mask=which < 0)
    reasons = pa.array([one.reason for one in match.breaks], pa.string())
    against = pa.array(
        ["; ".join(_road_labels(one, network)) or None for one in match.breaks], pa.string()
    )
    return reasons.take(off), against.take(off)


def _coordinate_columns(
    prefix: str, positions: NDArray[np.float64], plane: Plane | None, missing: NDArray[np.bool_]
) -> dict[str, Any]:
    there = np.where(missing[:, None], 0.0, positions)
    if plane is None:
        names = [*"xyz", *(f"x{i}" for i in range(4, positions.shape[1] + 1))][: positions.shape[1]]
        return {
            prefix + name: _masked(round_decimals(there[:, i], _DECIMALS), missing)
            for i, name in enumerate(names)
        }
    there[missing, 0] = (
        np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), there[~missing, 0])
        if not missing.all()
        else 0.0
    )
    lon, lat = _to_output_coordinates(there, plane).T
    return {prefix + "lat": _masked(lat, missing), prefix + "lon": _masked(lon, missing)}


def _masked(values: NDArray[np.float64], missing: NDArray[np.bool_]) -> pa.Array:
    return pa.array(values, mask=missing)
