"""Read roads from vector formats with GDAL: GeoPackage, FlatGeobuf, Shapefile."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.networks.features import RoadFeatures, find_columns, road_lines
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.wkb import parse_wkb_lines

__all__ = ["read_vector_lines"]

#: Features that are read at a time.
_BATCH_FEATURES = 65_536

#: Letters of an error message of GDAL that are shown.
_MAX_REASON_LETTERS = 160


def read_vector_lines(path: str | bytes, name: str, *, metric: bool | None = None) -> RoadLines:
    """Read the lines of a vector file, with the columns that say direction, speed and class.

    Parameters
    ----------
    path : str or bytes
        The file, another name that GDAL reads, or the bytes of a file.
    name : str
        Name of the file in messages.
    metric : bool, optional
        Whether the log is in x and y; None if no log is given.

    Returns
    -------
    RoadLines
        In degrees for a log in degrees, whatever the coordinate system of the file.

    Raises
    ------
    InputError
        If it can't be read, holds no lines, or is in degrees and the log is not.
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    """
    # GDAL comes with an extra.
    try:
        import pyogrio
    except ImportError as error:
        raise MissingExtraError("gis", f"reading {name}") from error

    # The error says what matters of a damaged file.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        features, crs = _read_features(pyogrio, path, name)
    return road_lines(features, crs, name, metric=metric)


def _read_features(pyogrio: Any, path: str | bytes, name: str) -> tuple[RoadFeatures, str | None]:
    """Return all features, and the coordinate system of the file."""
    from pyogrio.errors import FeatureError, GeometryError

    # Read the features in batches, to bound memory, with only the columns that have a role.
    gdal_errors = (FeatureError, GeometryError, RuntimeError, ValueError, OSError)
    try:
        layer = _choose_layer(pyogrio.list_layers(path).tolist())
        with pyogrio.open_arrow(
            path, layer=layer, use_pyarrow=True, batch_size=_BATCH_FEATURES
        ) as (meta, reader):
            column_by_role = find_columns(meta["fields"].tolist())
            features = RoadFeatures()
            for batch in reader:
                geometry = meta["geometry_name"] or "wkb_geometry"
                columns = {role: batch.column(name) for role, name in column_by_role.items()}
                for values in columns.values():
                    values.validate(full=True)  # GDAL passes on texts that aren't UTF-8
                features.add(parse_wkb_lines(batch.column(geometry)), batch.num_rows, columns)
    except (*gdal_errors, pa.ArrowException) as error:
        reason = " ".join(str(error).split())[:_MAX_REASON_LETTERS]
        raise InputError(f"can't be read as lines: {reason}", path=name) from error
    return features, meta["crs"]


def _choose_layer(layers: Sequence[Sequence[str | None]]) -> str | None:
    """Return the first layer of lines, else the first that may hold lines, else the first."""
    named = [(str(name), str(kind)) for name, kind in layers]
    # Kinds are such as "MultiLineString Z", or "Unknown" for a layer of mixed geometries.
    for word in ("Line", "Unknown", ""):
        for name, kind in named:
            if word in kind:
                return name
    return None
