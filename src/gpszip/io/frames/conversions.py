"""Make frames of other packages; these are imported only here, when they are asked for."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import MissingExtraError, OptionError
from gpszip.geo.crs import METRES
from gpszip.io.frames.track_tables import Piece, build_table
from gpszip.io.logs.track_rows import densified_rows, metre_decimals, track_rows
from gpszip.io.maps.graph import edge_frame, node_frame, to_graph
from gpszip.io.maps.table import learned_table
from gpszip.io.maps.write import write_map
from gpszip.model import CleanMap, RoadMap, Track
from gpszip.model.error_bound import writing_error
from gpszip.model.timestamps import Times

__all__ = [
    "archive_to_arrow",
    "import_package",
    "map_to_geopandas",
    "map_to_networkx",
    "save_map",
    "to_geopandas",
    "to_movingpandas",
    "to_pandas",
    "to_polars",
    "tracks_to_arrow",
]

#: Coordinate system of a log in degrees.
_DEGREES = "EPSG:4326"

#: Column that names the trajectories of movingpandas.
_TRAJECTORY_ID = "traj_id"

#: Rows that a trajectory of movingpandas needs.
_MIN_TRAJECTORY_ROWS = 2


def import_package(name: str, extra: str | None = None) -> Any:
    """Import an optional package.

    Parameters
    ----------
    name : str
        Its name.
    extra : str, optional
        The extra that brings it; of the same name by default.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    # movingpandas warns of packages that only some of its classes need.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return import_module(name)
    except ImportError as error:
        raise MissingExtraError(extra or name, f"making a frame of {name}") from error


# Arrow


def tracks_to_arrow(tracks: Track | Sequence[Track]) -> Any:
    """All samples of tracks as an Arrow table, see :meth:`gpszip.Track.to_arrow`."""
    listed = [tracks] if isinstance(tracks, Track) else list(tracks)
    pieces = [
        Piece(
            track=each.id,
            number=None,
            times=each.times if each.timed else None,
            coordinates=each.coordinates,
            geographic=each.plane is not None,
            attributes=each.attributes,
        )
        for each in listed
    ]
    return build_table(pieces)


def archive_to_arrow(
    archive: Any,
    *,
    every: float | None,
    at: Times | None,
    samples: bool,
    track: str | None,
) -> Any:
    """Tracks of an archive as an Arrow table, see :meth:`gpszip.Archive.to_arrow`."""
    # Which tracks, at which times.
    if (every is not None) + (at is not None) + samples > 1:
        raise OptionError("several of every, at and samples were given", remedy="give one")
    if samples:
        return tracks_to_arrow(archive.samples(track))
    is_knots = every is None and at is None
    tracks = archive.decompress(track) if is_knots else archive.sample(every, at=at, track=track)

    # Between knots, a reader of degrees takes a track as straight in degrees.
    error = writing_error(archive.error_bound, geographic=archive.grid.plane is not None)
    decimals = metre_decimals(error)
    rows = [
        densified_rows(each, decimals, error) if is_knots else track_rows(each, decimals)
        for each in tracks
    ]

    # The name of a piece ends with its number.
    owners = {each.id: track for each in tracks} if track is not None else archive.pieces
    pieces = [
        Piece(
            track=owners[each.id],
            number=0 if owners[each.id] == each.id else int(each.id.rpartition("/")[2]),
            times=each.times,
            coordinates=each.coordinates,
            geographic=each.geographic,
        )
        for each in rows
    ]
    return build_table(pieces, dimension=archive.grid.dimension, plane=archive.grid.plane)


# Packages


def to_pandas(table: Any) -> Any:
    """Return a table as a DataFrame of pandas."""
    import_package("pandas")
    return table.to_pandas()


def to_polars(table: Any) -> Any:
    """Return a table as a DataFrame of polars."""
    return import_package("polars").from_arrow(table)


def to_geopandas(table: Any) -> Any:
    """Return a table as a GeoDataFrame of points."""
    geopandas = import_package("geopandas")

    # Coordinates become geometries; all other columns stay.
    geographic = "lat" in table.column_names
    axes = ["lon", "lat"] if geographic else [n for n in "xyz" if n in table.column_names]
    positions = [table.column(axis).to_numpy() for axis in axes]
    if len(positions) == 1:
        positions.append(np.zeros(len(table)))
    points = geopandas.points_from_xy(*positions)
    frame = table.drop_columns(axes).to_pandas()
    return geopandas.GeoDataFrame(frame, geometry=points, crs=_DEGREES if geographic else METRES)


def to_movingpandas(table: Any) -> Any:
    """Return a table as a TrajectoryCollection: a trajectory for each piece."""
    movingpandas = import_package("movingpandas")

    # Rows with times, named by their pieces. A track without gaps keeps its id.
    table = table.filter(table.column("t").is_valid())
    frame = to_geopandas(table)
    names = _trajectory_names(table)
    counts = names.value_counts() if len(names) else {}
    if not any(item["counts"].as_py() >= _MIN_TRAJECTORY_ROWS for item in counts):
        raise OptionError("no track has times and two positions, as a trajectory needs")
    frame[_TRAJECTORY_ID] = names.to_pandas()

    # movingpandas drops time zones with a warning.
    times = table.column("t")
    if not pa.types.is_timestamp(times.type):
        micros = np.round(times.to_numpy() * 1e6).astype(np.int64)
        times = pa.chunked_array([pa.array(micros, pa.timestamp("us"))])
    frame["t"] = times.cast(pa.timestamp("us")).to_numpy()

    # It uses arguments of pandas that pandas warns of.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return movingpandas.TrajectoryCollection(frame, _TRAJECTORY_ID, t="t", min_length=0)


def _trajectory_names(table: Any) -> Any:
    """Names of the pieces: ``id``, or ``id/0``, ``id/1`` and so on for a track of several."""
    ids = table.column("track_id").to_pylist()
    if "piece" not in table.column_names:
        return pa.array(ids, pa.string())
    pieces = table.column("piece").to_pylist()
    has_several = {name for name, piece in zip(ids, pieces, strict=True) if piece}
    return pa.array(
        [f"{n}/{i}" if n in has_several else n for n, i in zip(ids, pieces, strict=True)],
        pa.string(),
    )


# Maps


def map_to_networkx(learned: RoadMap | CleanMap) -> Any:
    """Return a map as a graph, see :meth:`gpszip.RoadMap.to_networkx`."""
    return to_graph(
        learned_table(learned),
        import_package("networkx"),
        import_package("shapely", extra="networkx"),
    )


def map_to_geopandas(learned: RoadMap | CleanMap) -> tuple[Any, Any]:
    """Return nodes and edges of a map, see :meth:`gpszip.RoadMap.to_geopandas`."""
    geopandas, table = import_package("geopandas"), learned_table(learned)
    return node_frame(table, geopandas), edge_frame(table, geopandas)


def save_map(learned: RoadMap | CleanMap, path: str, *, force: bool) -> None:
    """Write a map to a file, see :meth:`gpszip.RoadMap.save`."""
    write_map(learned, path, force=force)
