"""Write matched routes: a line for each piece, or a row for each point."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.degree_lines import cut_at_antimeridian
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.track_rows import DEGREE_DIGITS, TIME_DECIMALS, round_decimals
from gpszip.io.storage.sink import open_sink
from gpszip.model import Network, Plane, Track
from gpszip.model.match import Break, Match, Matching, Piece

if TYPE_CHECKING:
    import pyarrow as pa  # imported by what writes CSV: help texts list the formats

__all__ = ["ROUTE_FORMATS", "route_format", "write_routes"]

#: Decimals of metres and of shares.
_DECIMALS = 3

#: Decimals of the share of points that are matched.
_SHARE_DECIMALS = 4

#: Formats of routes with their suffixes; the first is that of a stream.
ROUTE_FORMATS = {"geojson": (".geojson", ".json"), "csv": (".csv",)}

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def route_format(sink: str | Path | BinaryIO, format: str | None = None) -> str:
    """Return the name of the format in which routes are written.

    Parameters
    ----------
    sink : str, Path or binary stream
        Where they are written.
    format : str, optional
        The format; found from the suffix of ``sink`` if left out, GeoJSON for a stream.

    Raises
    ------
    OutputError
        If there is no such format.

    Examples
    --------
    >>> route_format("routes.csv"), route_format("-")
    ('csv', 'geojson')
    """
    # A stream, and standard output, have no suffix: they get the first format.
    suffix = Path(str(sink)).suffix.lower() if isinstance(sink, (str, Path)) else ""
    if format is None and not suffix:
        return next(iter(ROUTE_FORMATS))
    for name, suffixes in ROUTE_FORMATS.items():
        if format == name or (format is None and suffix in suffixes):
            return name
    raise OutputError(
        f"routes are written as {' or '.join(ROUTE_FORMATS)}, not as {format or suffix[1:]}",
        path=str(sink),
        remedy="name such a file, or give --format",
    )


def write_routes(
    matching: Matching,
    tracks: Sequence[Track],
    network: Network,
    sink: str | Path | BinaryIO,
    format: str | None = None,
) -> None:
    """Write routes; positions on the earth in degrees.

    Parameters
    ----------
    matching : Matching
        The matched routes.
    tracks : sequence of Track
        The log.
    network : Network
        The roads.
    sink : str, Path or binary stream
        The file; ``-`` for standard output. It replaces another file of this name once it is
        complete.
    format : str, optional
        ``geojson``, a line for each piece, or ``csv``, a row for each point. Found from the file's
        suffix if left out.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    format_name = route_format(sink, format)
    with open_sink(sink) as stream:
        if format_name == "csv":
            _write_csv(matching, tracks, network, stream)
        else:
            _write_geojson(matching, tracks, network, stream)


# GeoJSON.


def _write_geojson(
    matching: Matching, tracks: Sequence[Track], network: Network, stream: BinaryIO
) -> None:
    """Write pieces as features, and unmatched slices as the member ``unmatched``."""
    pairs = list(zip(matching.matches, tracks, strict=True))
    member = "" if network.plane is not None else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    stream.write(f'{{"type": "FeatureCollection", {member}"features": ['.encode())
    _write_items(
        (feature for match, track in pairs for feature in _features(match, track, network)), stream
    )

    # GeoJSON allows members of a collection that it does not know.
    stream.write(b'\n], "unmatched": [')
    _write_items(
        (item for match, track in pairs for item in _unmatched_slices(match, track, network)),
        stream,
    )
    stream.write(b"\n]}\n")


def _write_items(items: Iterable[dict[str, Any]], stream: BinaryIO) -> None:
    """Write the items of a JSON array, one a line."""
    separator = "\n"
    for item in items:
        stream.write((separator + json.dumps(item, ensure_ascii=False)).encode())
        separator = ",\n"


def _unmatched_slices(match: Match, track: Track, network: Network) -> Iterator[dict[str, Any]]:
    """Yield slices of a track on no road, with their first and last time and the reason."""
    # Find the points of each break that are on no road; a break between neighbours has none.
    for break_ in match.breaks:
        points = (
            break_.after + 1 + np.flatnonzero(match.piece[break_.after + 1 : break_.before] < 0)
        )
        if not len(points):
            continue

        # Describe the slice, with the roads that it would travel against their direction.
        item = {
            "track_id": match.track,
            **_times(track, int(points[0]), int(points[-1])),
            "points": len(points),
            "reason": break_.reason,
        }
        if break_.edges:
            item["against"] = _road_labels(break_, network)
        yield item


def _features(match: Match, track: Track, network: Network) -> Iterator[dict[str, Any]]:
    """Yield the pieces of a route as features."""
    # A piece becomes one feature, even if it is a single point.
    for number, piece in enumerate(match.pieces):
        # A line needs two vertices.
        vertices = piece.line if len(piece.line) > 1 else np.repeat(piece.line, 2, axis=0)
        line = _to_output_coordinates(vertices, network.plane)

        # Describe the roads, and those that the break after this piece goes against.
        properties = _properties(match, number, piece, track)
        properties["roads"] = _road_ids(piece, network)
        if network.names is not None:
            properties["names"] = _street_names(piece, network.names)
        against = [
            label
            for break_ in match.breaks
            if break_.after == piece.last and break_.edges
            for label in _road_labels(break_, network)
        ]
        if against:
            properties["against"] = against
        yield {
            "type": "Feature",
            "properties": properties,
            "geometry": _geometry(line, network.plane),
        }


def _geometry(line: Floats, plane: Plane | None) -> dict[str, Any]:
    """Return a line as a geometry, cut where it crosses the antimeridian (RFC 7946, 3.1.9)."""
    if plane is None:
        return {"type": "LineString", "coordinates": line.tolist()}
    # The offsets of a single line are its start and its end.
    cut = cut_at_antimeridian(line, np.array([0, len(line)]), decimals=_DECIMALS + DEGREE_DIGITS)
    fragments = [fragment.tolist() for fragment in np.split(cut.points, cut.cuts)]
    if len(fragments) == 1:
        return {"type": "LineString", "coordinates": fragments[0]}
    return {"type": "MultiLineString", "coordinates": fragments}


def _properties(match: Match, number: int, piece: Piece, track: Track) -> dict[str, Any]:
    return {
        "track_id": match.track,
        "piece": number,
        **_times(track, piece.first, piece.last),
        "points": int((match.piece == number).sum()),
        "length": round(piece.length, _DECIMALS),
        "confidence": round(piece.confidence, _DECIMALS),
        "matched": round(match.share, _SHARE_DECIMALS),
        "end": piece.reason,
    }


def _times(track: Track, first: int, last: int) -> dict[str, float]:
    """Return the times of the first and the last point of a slice; none of an untimed track."""
    if not track.timed:
        return {}
    start, end = round_decimals(track.times[[first, last]], TIME_DECIMALS).tolist()
    return {"t_start": start, "t_end": end}


def _road_labels(break_: Break, network: Network) -> list[str]:
    """Return the labels of the roads that a break travels against their direction."""
    # A dict drops repeated labels and keeps the order of travel.
    return list(dict.fromkeys(map(network.label, break_.edges)))


def _street_names(piece: Piece, names: Sequence[str]) -> list[str]:
    """Return the street names of a piece in the order of travel.

    A name that consecutive roads share stands once; roads without a name are passed over.
    """
    travelled = [names[edge] for edge in piece.route.edges.tolist()]
    return [name for name, _ in groupby(filter(None, travelled))]


def _road_ids(piece: Piece, network: Network) -> list[Any]:
    """Return the ids of the roads travelled, or their numbers if they have none.

    An id that consecutive roads share stands once.
    """
    edges = piece.route.edges.tolist()
    ids = edges if network.ids is None else [network.ids[edge] for edge in edges]
    return [road_id for road_id, _ in groupby(ids)]


def _to_output_coordinates(positions: Floats, plane: Plane | None) -> Floats:
    """Return longitude and latitude, or metres, rounded."""
    if plane is None:
        return round_decimals(positions, _DECIMALS)
    lat, lon = to_geographic(positions[:, :2], plane)
    return round_decimals(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)


# CSV.


def _write_csv(
    matching: Matching, tracks: Sequence[Track], network: Network, stream: BinaryIO
) -> None:
    import pyarrow.csv as pc

    # The header takes the columns of the first table; without tracks there is no header.
    needs_header = True
    for match, track in zip(matching.matches, tracks, strict=True):
        table = _point_table(match, track, network)
        if needs_header:
            stream.write((",".join(table.column_names) + "\n").encode())
        pc.write_csv(table, stream, pc.WriteOptions(include_header=False, quoting_style="needed"))
        needs_header = False


def _point_table(match: Match, track: Track, network: Network) -> pa.Table:
    """Return a row for each point; columns about roads are null for points on no road."""
    import pyarrow as pa

    # Points on no road have null in all columns about roads.
    off_road = match.piece < 0
    columns: dict[str, Any] = {"track_id": pa.array([match.track] * len(match), pa.string())}

    # The point, and its position on the road.
    has_no_time = np.full(len(track), not track.timed)
    nothing_missing = np.zeros(len(track), np.bool_)
    columns["t"] = _masked(round_decimals(track.times, TIME_DECIMALS), has_no_time)
    columns |= _coordinate_columns("", track.positions, track.plane, nothing_missing)
    snapped = match.snapped_positions(network)
    columns |= _coordinate_columns("road_", snapped, network.plane, off_road)
    columns["distance"] = _masked(round_decimals(match.distance, _DECIMALS), off_road)

    # The road.
    edges = match.edge.tolist()
    if network.ids is None:
        roads: Any = match.edge
    else:
        roads = [network.ids[edge] if edge >= 0 else "" for edge in edges]
    columns["piece"] = pa.array(match.piece, mask=off_road)
    columns["road"] = pa.array(roads, mask=off_road)
    columns["forward"] = pa.array(match.forward, mask=off_road)
    columns["offset"] = _masked(round_decimals(match.offset, _DECIMALS), off_road)
    columns["along"] = _masked(round_decimals(match.along, _DECIMALS), off_road)
    columns["confidence"] = round_decimals(match.confidence, _DECIMALS)
    if network.names is not None:
        names = [network.names[edge] if edge >= 0 else None for edge in edges]
        columns["name"] = pa.array(names, pa.string())

    # The reason why a point is on no road.
    columns["reason"], columns["against"] = _reasons(match, network)
    return pa.table(columns)


def _reasons(match: Match, network: Network) -> tuple[pa.Array, pa.Array]:
    """Return why points are on no road, and the one-way roads that they travel against.

    Both are null for points on a road.
    """
    import pyarrow as pa

    # The break that each point is in.
    break_index = np.full(len(match), -1)
    for number, break_ in enumerate(match.breaks):
        break_index[break_.after + 1 : break_.before] = number
    break_index[match.piece >= 0] = -1
    index = pa.array(break_index, mask=break_index < 0)

    reasons = pa.array([break_.reason for break_ in match.breaks], pa.string())
    labels = ["; ".join(_road_labels(break_, network)) or None for break_ in match.breaks]
    # A null index gives a null.
    return reasons.take(index), pa.array(labels, pa.string()).take(index)


def _coordinate_columns(
    prefix: str, positions: Floats, plane: Plane | None, missing: Bools
) -> dict[str, Any]:
    """Return a column for each coordinate: x, y, z, x4 ... or lat and lon."""
    # Replace missing positions, which may be NaN, by numbers that can be rounded.
    known = np.where(missing[:, None], 0.0, positions)
    if plane is None:
        dimension = positions.shape[1]
        names = [*"xyz", *(f"x{i}" for i in range(4, dimension + 1))][:dimension]
        return {
            prefix + name: _masked(round_decimals(known[:, i], _DECIMALS), missing)
            for i, name in enumerate(names)
        }

    # Missing positions are converted, too, and masked later: put them on the planes of the others.
    if missing.all():
        known[:, 0] = 0.0
    else:
        rows = np.arange(len(known))
        known[missing, 0] = np.interp(rows[missing], rows[~missing], known[~missing, 0])
    lon, lat = _to_output_coordinates(known, plane).T
    return {prefix + "lat": _masked(lat, missing), prefix + "lon": _masked(lon, missing)}


def _masked(values: Floats, missing: Bools) -> pa.Array:
    """Return an Arrow array in which missing values are null."""
    import pyarrow as pa

    return pa.array(values, mask=missing)
