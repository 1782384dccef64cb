"""Find the columns of frames of each package."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.frames.arrays import to_arrow
from gpszip.io.frames.columns import ColumnReader, FrameColumns, lazy_columns, stream_columns
from gpszip.io.frames.geometry_columns import GeometryColumn
from gpszip.io.frames.recognise import class_names
from gpszip.io.frames.stream import frame_errors

__all__ = ["open_columns"]

#: Name of the column with the id of each trajectory of movingpandas.
_TRAJECTORY_ID = "track_id"

#: Name of an index of times that has none.
_INDEX_OF_TIMES = "t"


def open_columns(frame: Any, where: str) -> FrameColumns:
    """Find the columns of a frame; their cells are converted when they are read.

    Parameters
    ----------
    frame : frame
        See :func:`gpszip.io.frames.recognise.is_frame`.
    where : str
        Its name in messages.

    Returns
    -------
    FrameColumns

    Raises
    ------
    InputError
        If it is no table, or two columns have one name.

    Examples
    --------
    >>> columns = open_columns({"t": [0, 1], "note": ["a", 1]}, "dict")
    >>> columns.names, next(columns.read([0])).to_pydict()
    (('t', 'note'), {'t': [0, 1]})
    """
    with frame_errors(where):
        columns = _open(frame, where)

    # Of two columns of one name, nobody knows which is meant.
    if not columns.names:
        raise InputError("holds no column", path=where)
    repeated = [name for name in columns.names if columns.names.count(name) > 1]
    if repeated:
        raise InputError(
            f"{len(repeated)} columns are named {repeated[0]!r}", path=where, remedy="rename them"
        )
    return columns


def _open(frame: Any, where: str) -> FrameColumns:
    # The class decides first: a DataFrame has a stream, too, but the time may be in its index.
    classes = class_names(frame)
    for known, open_ in _OPENERS.items():
        if known in classes:
            return open_(frame, where)
    if isinstance(frame, Mapping):
        rows = max((len(cells) for cells in frame.values() if hasattr(cells, "__len__")), default=0)
        return lazy_columns(_readers(frame, where), where, rows)
    return stream_columns(frame, where)


def _readers(values: Mapping[Any, Any], where: str) -> dict[str, ColumnReader]:
    """Readers of arrays by name."""
    return {str(name): partial(to_arrow, cells, str(name), where) for name, cells in values.items()}


def _open_structured(array: Any, where: str) -> FrameColumns:
    """Columns of a structured NumPy array: its fields."""
    if array.ndim != 1:
        raise InputError(f"has {array.ndim} axes, not 1", path=where, remedy="array.ravel()")
    readers = _readers({name: array[name] for name in array.dtype.names}, where)
    return lazy_columns(readers, where, len(array))


# pandas


def _open_pandas(frame: Any, where: str) -> FrameColumns:
    """Columns of a DataFrame, and its index, which often holds the times."""
    # Names need not be texts in pandas.
    names = [str(name) for name in frame.columns]
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"{names.count(repeated)} columns are named {repeated!r}",
            path=where,
            remedy="rename them",
        )
    readers = _readers({name: frame.iloc[:, i] for i, name in enumerate(names)}, where)
    readers = {**_index_readers(frame.index, set(names), where), **readers}

    # A GeoDataFrame says which column holds the geometries.
    active = getattr(frame, "active_geometry_name", None)
    if active is None:
        return lazy_columns(readers, where, len(frame))
    is_point = (frame.geometry.geom_type == "Point") | frame.geometry.isna()
    encoding, convert = ("point", _to_points) if is_point.all() else ("wkb", _to_wkb)
    readers[str(active)] = partial(convert, frame.geometry, str(active), where)
    crs = None if frame.crs is None else frame.crs.to_wkt()
    geometry = GeometryColumn(list(readers).index(str(active)), encoding, crs)
    return lazy_columns(readers, where, len(frame), geometry)


def _index_readers(index: Any, taken: set[str], where: str) -> dict[str, ColumnReader]:
    """Readers of the levels of an index; one that only numbers the rows is no column."""
    values = {}
    for i in range(index.nlevels):
        level = index.get_level_values(i)
        is_time = level.dtype.kind == "M" or getattr(level.dtype, "tz", None) is not None
        name = level.name if level.name is not None or not is_time else _INDEX_OF_TIMES
        # A column of the same name is the one that users see.
        if name is not None and str(name) not in taken:
            values[name] = level.to_series()
    return _readers(values, where)


def _to_points(geometries: Any, name: str, where: str) -> Any:
    """Points of geopandas as lists of x, y and z; NaN where there is none."""
    # A tenth of the time that well-known binary takes.
    with frame_errors(where, name):
        axes = [geometries.x, geometries.y]
        if geometries.has_z.any():
            axes.append(geometries.z)
        values = np.column_stack(axes)
        flat = pa.array(values.reshape(-1))
        return pa.chunked_array([pa.FixedSizeListArray.from_arrays(flat, len(axes))])


def _to_wkb(geometries: Any, name: str, where: str) -> Any:
    """Geometries of geopandas in well-known binary, null where there is none."""
    with frame_errors(where, name):
        binary = geometries.to_wkb().tolist()
        return pa.chunked_array([pa.array(binary, pa.large_binary(), from_pandas=True)])


def _open_trajectories(trajectories: Sequence[Any], where: str) -> FrameColumns:
    """Columns of all points of trajectories of movingpandas, with their ids."""
    if not trajectories:
        raise InputError("holds no trajectory", path=where)

    # pandas is there, as movingpandas is. Each frame has the times as its index.
    from pandas import concat

    frames = [each.df.assign(**{_TRAJECTORY_ID: str(each.id)}) for each in trajectories]
    return _open_pandas(frames[0] if len(frames) == 1 else concat(frames), where)


# xarray


def _open_dataset(dataset: Any, where: str) -> FrameColumns:
    """Variables of a Dataset along its only dimension; a single value holds for all rows."""
    # Find the dimension.
    variables = {str(name): dataset[name] for name in (*dataset.coords, *dataset.data_vars)}
    dimensions = sorted({str(v.dims[0]) for v in variables.values() if len(v.dims) == 1})
    if len(dimensions) != 1:
        found = f"variables along {', '.join(dimensions)}" if dimensions else "no variable of rows"
        raise InputError(
            f"holds {found}, where a table has one dimension",
            path=where,
            remedy="take the variables along one: dataset[['lat', 'lon']], or dataset.isel(...)",
        )

    # Read variables when they are asked for: they may lie in a file.
    rows = dataset.sizes[dimensions[0]]
    readers = {
        name: partial(_read_variable, variable, rows, name, where)
        for name, variable in variables.items()
    }
    return lazy_columns(readers, where, rows)


def _read_variable(variable: Any, rows: int, name: str, where: str) -> Any:
    """Read a variable of a Dataset as an Arrow column."""
    # Times that xarray hasn't decoded don't count from 1970.
    location = f"variable {name!r}"
    units = str(variable.attrs.get("units", ""))
    if " since " in units:
        raise InputError(
            f"holds {units}", path=where, location=location, remedy="xarray.decode_cf(dataset)"
        )
    if len(variable.dims) > 1:
        raise InputError(
            f"has the dimensions {', '.join(map(str, variable.dims))}",
            path=where,
            location=location,
            remedy="take one of them: dataset.isel(...)",
        )
    # An index keeps the time zone, which an array would lose.
    with frame_errors(where, name):
        if variable.dims:
            return to_arrow(variable.to_index(), name, where)
        return to_arrow(np.broadcast_to(variable.values, (rows,)), name, where)


def _refuse_column(_column: Any, where: str) -> FrameColumns:
    raise InputError(
        "is one column, not a table",
        path=where,
        remedy="give the table that has its times and positions",
    )


#: How frames of a class are opened. A subclass, such as GeoDataFrame, is opened as its base.
_OPENERS: dict[tuple[str, str], Callable[[Any, str], FrameColumns]] = {
    ("movingpandas", "Trajectory"): lambda frame, where: _open_trajectories([frame], where),
    ("movingpandas", "TrajectoryCollection"): (
        lambda frame, where: _open_trajectories(frame.trajectories, where)
    ),
    ("pandas", "DataFrame"): _open_pandas,
    ("pandas", "Series"): _refuse_column,
    ("polars", "Series"): _refuse_column,
    ("pyarrow", "ChunkedArray"): _refuse_column,
    ("polars", "LazyFrame"): lambda frame, where: stream_columns(frame.collect(), where),
    ("xarray", "Dataset"): _open_dataset,
    ("numpy", "ndarray"): _open_structured,
}
