"""Logs as named arrays of equal length, as in files of NumPy and HDF5.

An array of one dimension is a column, as is each field of a structured array. An array of two or
three columns named ``pos`` becomes ``pos_x``, ``pos_y`` and ``pos_z``; one of more becomes
``pos_0``, ``pos_1`` and so on. The roles of columns are then found as for CSV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.tables.given_columns import find_requested_roles, rename_columns
from gpszip.io.tables.roles import Roles
from gpszip.io.tables.table import build_raw_log

__all__ = ["Column", "columns_of", "open_arrays", "read_arrays"]

#: Columns of an array of two dimensions, at most: more are images.
_MAX_COLUMNS = 64

#: Columns of an array that may be a position in space.
_MAX_AXES = 3

#: Names of arrays whose columns are x, y and z, without more.
_POSITIONS = frozenset(
    {"xy", "xyz", "positions", "points", "coordinates", "coords", "trajectory", "path", "poses"}
)

#: Kinds of numbers and texts that are read; booleans, complex numbers and objects are not.
_READABLE_KINDS = "iufMSU"

#: The last letter of Unicode, the numbers that are no letters, and what stands for these.
_LAST_LETTER = 0x10FFFF
_SURROGATES = (0xD800, 0xDFFF)
_REPLACEMENT = 0xFFFD

#: Rows that are read at a time.
_BATCH_ROWS = 1 << 18

#: Letters of a reason that messages show.
_MAX_REASON_LETTERS = 120


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Parameters
    ----------
    name : str
        Its name.
    rows : int
        Its length.
    load : callable
        Returns the values of some rows: the array of a slice.
    """

    name: str
    rows: int
    load: Callable[[slice], NDArray[Any]]


def columns_of(
    name: str, shape: Sequence[int], dtype: np.dtype[Any], load: Callable[[slice], NDArray[Any]]
) -> list[Column]:
    """Return the columns of an array; none if it is of a kind that is not read.

    Parameters
    ----------
    name : str
        Name of the array.
    shape : sequence of int
        Its shape.
    dtype : numpy.dtype
        Type of its values.
    load : callable
        Returns the rows of a slice.

    Examples
    --------
    >>> values = np.zeros((5, 2))
    >>> [column.name for column in columns_of("pos", (5, 2), values.dtype, values.__getitem__)]
    ['pos_x', 'pos_y']
    """
    # Fields of a structured array.
    if dtype.names and len(shape) == 1:
        return [
            column
            for field in dtype.names
            for column in columns_of(
                field if not name else f"{name}.{field}",
                (*shape, *dtype[field].shape),
                dtype[field].base,
                partial(_field, load, field),
            )
        ]
    if dtype.kind not in _READABLE_KINDS or len(shape) not in (1, 2):
        return []
    if len(shape) == 1:
        return [Column(name, shape[0], load)]

    # Columns of an array.
    if shape[1] > _MAX_COLUMNS:
        return []
    leaf = name.rsplit("/", 1)[-1].lower()
    ends = list("xyz"[: shape[1]]) if 1 < shape[1] <= _MAX_AXES else list(map(str, range(shape[1])))
    before = "" if leaf in _POSITIONS and shape[1] <= _MAX_AXES else f"{name}_"
    return [
        Column(f"{before}{end}", shape[0], partial(_axis, load, i)) for i, end in enumerate(ends)
    ]


def _field(load: Callable[[slice], NDArray[Any]], name: str, rows: slice) -> NDArray[Any]:
    values: NDArray[Any] = load(rows)[name]
    return values


def _axis(load: Callable[[slice], NDArray[Any]], number: int, rows: slice) -> NDArray[Any]:
    return load(rows)[:, number]


def _find_roles(columns: Sequence[Column], request: Request, where: str) -> Roles:
    """Find out which column holds what, as for CSV.

    Raises
    ------
    InputError
        If time or position can't be found, or columns in use differ in length.
    """
    roles = find_requested_roles(tuple(column.name for column in columns), request, where)

    # Columns in use have to be of one length.
    lengths = {columns[i].rows: columns[i].name for i in reversed(roles.used)}
    if len(lengths) > 1:
        shown = ", ".join(f"{name!r} {rows:,}" for rows, name in list(lengths.items())[:3])
        raise InputError(
            f"arrays of different lengths: {shown}",
            path=where,
            remedy="name arrays of one length: --columns t=NAME,x=NAME,y=NAME",
        )
    if not next(iter(lengths), 0):
        raise InputError("arrays without values", path=where, remedy="name a file that holds a log")
    return roles


def _renamed(columns: Sequence[Column], request: Request, where: str) -> list[Column]:
    """Return columns with the names that the user gives in their order, if any."""
    names = rename_columns([column.name for column in columns], request, where)
    return [replace(column, name=name) for column, name in zip(columns, names, strict=True)]


def read_arrays(columns: Sequence[Column], request: Request, where: str) -> RawLog:
    """Read columns as one log.

    Parameters
    ----------
    columns : sequence of Column
        All columns of a file.
    request : Request
        Columns for roles by name or in order, unit of time, attributes.
    where : str
        Name of the file.

    Raises
    ------
    InputError
        If roles can't be found, or columns differ in length.

    Examples
    --------
    >>> arrays = {"t": np.arange(2.0), "xy": np.array([[1.0, 2], [3, 4]])}
    >>> columns = [
    ...     column
    ...     for name, values in arrays.items()
    ...     for column in columns_of(name, values.shape, values.dtype, values.__getitem__)
    ... ]
    >>> read_arrays(columns, Request(), "a.npz").coordinates.tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    columns = _renamed(columns, request, where)
    roles = _find_roles(columns, request, where)
    reader = _ArrayReader(where, columns, roles)
    table = pa.concat_tables([batch.table for batch in reader.read()])
    return build_raw_log(table.columns, reader.column_names, roles, request, where)


def open_arrays(columns: Sequence[Column], request: Request, where: str) -> LogBatches:
    """Open columns to be read in batches; see :func:`read_arrays`."""
    columns = _renamed(columns, request, where)
    roles = _find_roles(columns, request, where)
    reader = _ArrayReader(where, columns, roles)
    return LogBatches(
        interpret_batches(reader, request),
        CoordinateKind(roles.geographic, len(roles.axes)),
        lambda: columns[roles.axes[0]].rows,
    )


@dataclass(frozen=True)
class _ArrayReader:
    """Reads slices of columns, see :class:`gpszip.io.logs.table_batches.TableReader`."""

    name: str
    columns: Sequence[Column]
    roles: Roles
    first_row_number: int = 1

    @property
    def column_names(self) -> tuple[str, ...]:
        return tuple(column.name for column in self.columns)

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows."""
        used = [self.columns[i] for i in self.roles.used]
        for start in range(0, used[0].rows, _BATCH_ROWS):
            rows = slice(start, min(start + _BATCH_ROWS, used[0].rows))
            arrays = [pa.chunked_array([_to_arrow(column, rows, self.name)]) for column in used]
            names = [str(i) for i in range(len(used))]
            yield TableBatch(pa.Table.from_arrays(arrays, names))

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows as tables, with the types that the file has."""
        return (batch.table for batch in self.read())

    def uses_decimal_comma(self) -> None:
        """Leave decimal marks of texts to be found in the first rows."""

    def explain_error(self, error: Exception) -> str:
        return f"damaged: {str(error).splitlines()[0][:_MAX_REASON_LETTERS]}"


def _to_arrow(column: Column, rows: slice, where: str) -> Any:
    """Return rows of a column as an array of Arrow."""
    values = column.load(rows)
    if len(values) != rows.stop - rows.start:
        raise InputError(f"array {column.name!r} is shorter than it says", path=where)

    # Bring types that Arrow doesn't have to those that it has.
    if values.dtype.kind == "S":
        return pa.array([bytes(value).decode("utf-8", "replace") for value in values.tolist()])
    if values.dtype.kind == "U":
        values = _valid_text(values)
    if values.dtype.kind in "UO":
        return pa.array(values.astype(object), pa.string())
    if values.dtype.kind == "M":
        return pa.array(values.astype("M8[us]"))
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        with np.errstate(all="ignore"):  # a damaged file holds any numbers
            values = values.astype(np.float64)
    return pa.array(np.ascontiguousarray(values, values.dtype.newbyteorder("=")))


def _valid_text(values: NDArray[Any]) -> NDArray[Any]:
    """Replace letters that are none in Unicode, which a damaged file may have."""
    if not values.dtype.itemsize:
        return np.full(len(values), "", object)
    values = np.array(values, values.dtype.newbyteorder("="))
    codes = values.view(np.uint32)
    codes[(codes > _LAST_LETTER) | ((codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1]))] = (
        _REPLACEMENT
    )
    return values
