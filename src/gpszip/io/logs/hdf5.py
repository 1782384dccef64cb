"""Logs in HDF5: datasets of equal length, in one group or in several.

Reading needs h5py, which the extra ``hdf5`` brings. Links to other files are not followed.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.logs.arrays import Column, columns_of, open_arrays, read_arrays
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.expansion import CHECKED_BYTES, MAX_EXPANSION
from gpszip.io.storage.source import Source
from gpszip.io.tables.roles import find_roles

__all__ = ["read_hdf5", "read_hdf5_batches"]

#: Datasets of a file, at most.
_MAX_DATASETS = 10_000

#: Attributes that netCDF gives to packed numbers.
_PACKED = ("scale_factor", "add_offset")

#: Units of times that count from a date, as netCDF writes them, in seconds.
_SINCE = re.compile(
    r"(microsecond|millisecond|second|sec|minute|min|hour|day|s|h|d)s? since "
    r"(\d{4}-\d{1,2}-\d{1,2})(?:[T ](\d{1,2}:\d{1,2}(?::\d{1,2})?)(?:\.0*)?)?"
    r"(?: ?(?:UTC|Z|\+?00:?00|0:00))?",
    re.IGNORECASE,
)
_SECONDS = {
    "microsecond": 1e-6,
    "millisecond": 1e-3,
    "m": 60.0,
    "s": 1.0,
    "h": 3600.0,
    "d": 86_400.0,
}

#: Calendars whose dates are those of this package.
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")

#: Groups that messages name.
_MAX_SHOWN_GROUPS = 5

#: Letters of a reason that messages show.
_MAX_REASON_LETTERS = 120


def read_hdf5(source: Source, request: Request) -> RawLog:
    """Read a log from datasets of equal length.

    Without ``columns``, time and position are found by their names as for CSV, in the one group
    that has them. With ``columns``, datasets are named by their paths: ``t=gps/time``.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns for roles, unit of time, attributes.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the file is damaged, or no group or several groups have time and position.
    MissingExtraError
        If h5py isn't installed.
    """
    with _errors_of_h5py(source.name):
        return read_arrays(_columns(source, request), _without_paths(request), source.name)


def read_hdf5_batches(source: Source, request: Request) -> LogBatches:
    """Open datasets to be read in batches; see :func:`read_hdf5`."""
    with _errors_of_h5py(source.name):
        opened = open_arrays(_columns(source, request), _without_paths(request), source.name)

    def batches() -> Iterator[RawLog]:
        with _errors_of_h5py(source.name):
            yield from opened.batches

    return replace(opened, batches=batches())


@contextmanager
def _errors_of_h5py(where: str) -> Iterator[None]:
    """Turn errors that a damaged file leads to into one that names the file."""
    # h5py raises whatever the HDF5 library reports as one of these.
    try:
        yield
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        reason = str(error).strip("'\"").splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"damaged HDF5 file: {reason[:_MAX_REASON_LETTERS]}",
            path=where,
            remedy="fetch or write it again",
        ) from None


def _columns(source: Source, request: Request) -> list[Column]:
    """Return the columns among which roles are found, named for that."""
    # A user names datasets by their paths, or in order.
    columns = _all_columns(source)
    if request.columns is not None:
        return columns

    # Find the group that has time and position.
    groups: dict[str, list[Column]] = {}
    for column in columns:
        group, _, leaf = column.name.rpartition("/")
        groups.setdefault(group, []).append(replace(column, name=leaf))
    complete = [group for group, members in groups.items() if _is_complete(members, request)]

    # One has to be the log.
    if len(complete) > 1:
        shown = ", ".join(repr(group) for group in complete[:_MAX_SHOWN_GROUPS])
        first = complete[0]
        raise InputError(
            f"{len(complete)} groups have time and position: {shown}",
            path=source.name,
            remedy=f"name the datasets of one: --columns t={first}/NAME,lat={first}/NAME,...",
        )
    return groups[complete[0]] if complete else columns


def _is_complete(members: Sequence[Column], request: Request) -> bool:
    names = [member.name for member in members]
    try:
        find_roles(names, None, (), "", times=request.times)
    except InputError:
        return False
    return True


def _without_paths(request: Request) -> Request:
    """Return the request with paths as columns have them: without a slash at the start."""
    if not isinstance(request.columns, Mapping):
        return request
    columns = {role: path.lstrip("/") for role, path in request.columns.items()}
    return replace(request, columns=columns, keep=tuple(name.lstrip("/") for name in request.keep))


def _all_columns(source: Source) -> list[Column]:
    """Return the columns of all datasets of a file, named by their paths."""
    # Other formats are read without it.
    try:
        import h5py
    except ImportError:
        raise MissingExtraError("hdf5", "reading HDF5") from None

    # A file is read in place, a stream or a gzip file in memory.
    in_place = source.path is not None and not source.is_gzip
    file = h5py.File(str(source.path) if in_place else io.BytesIO(source.read()), "r")
    columns: list[Column] = []
    found = 0

    # Links of files to others are not visited.
    def visit(name: str, item: Any) -> None:
        nonlocal found
        if isinstance(item, h5py.Dataset):
            found += 1
            columns.extend(_columns_of_dataset(name, item, source.name))
        if found > _MAX_DATASETS:
            raise InputError(f"more than {_MAX_DATASETS:,} datasets", path=source.name)

    file.visititems(visit)
    if not columns:
        raise InputError(
            "no dataset of numbers with one or two dimensions",
            path=source.name,
            remedy="name a file that holds a log",
        )
    return columns


def _columns_of_dataset(name: str, dataset: Any, where: str) -> list[Column]:
    # Data of other files would have to be fetched from wherever the file says.
    if dataset.shape is None or dataset.is_virtual or dataset.external:
        return []
    # Values of variable length are in a heap, whose damage the HDF5 library may follow for ever.
    if dataset.dtype.hasobject:
        return []
    # A dataset may say that it is of any size and store nothing of it.
    stored = max(dataset.id.get_storage_size(), CHECKED_BYTES // MAX_EXPANSION)
    if dataset.size * dataset.dtype.itemsize > MAX_EXPANSION * stored:
        return []
    # Bring packed numbers to those that they stand for.
    scale, offset = (_attribute(dataset, key) for key in _PACKED)
    filler = _attribute(dataset, "_FillValue")
    is_number = dataset.dtype.kind in "iuf"

    def load(rows: slice) -> NDArray[Any]:
        values: NDArray[Any] = dataset[rows]
        since = _since(dataset, where) if is_number else None
        if not is_number or (scale, offset, filler, since) == (None,) * 4:
            return values
        factor, origin = since or (1.0, 0.0)
        with np.errstate(all="ignore"):  # a damaged file holds any numbers
            numbers = values.astype(np.float64)
            numbers[values == filler] = np.nan
            numbers = numbers * (1.0 if scale is None else scale) + (offset or 0.0)
            unpacked: NDArray[Any] = numbers * factor + origin
        return unpacked

    return columns_of(name, dataset.shape, dataset.dtype, load)


def _attribute(dataset: Any, name: str) -> float | None:
    value = np.asarray(dataset.attrs.get(name, np.array([])))
    return float(value.flat[0]) if value.size == 1 and value.dtype.kind in "iuf" else None


def _since(dataset: Any, where: str) -> tuple[float, float] | None:
    """Return the unit of times that count from a date in seconds, and the date since 1970.

    Raises
    ------
    InputError
        If the date or the calendar can't be read: other times would be wrong.
    """
    # Other datasets have other units, or none.
    units = _text(dataset, "units")
    if " since " not in units:
        return None
    match = _SINCE.fullmatch(units.strip())
    calendar = _text(dataset, "calendar") or _CALENDARS[0]
    problem = InputError(
        f"dataset {dataset.name!r} has times in {units[:_MAX_REASON_LETTERS]!r}",
        path=where,
        remedy="write seconds since 1970-01-01 00:00:00, UTC",
    )
    if match is None or calendar.lower() not in _CALENDARS:
        raise problem

    # Digits may be missing: 2020-1-1 0:0.
    date = "-".join(f"{int(part):02}" for part in match[2].split("-"))
    clock = ":".join(f"{int(part):02}" for part in (match[3] or "00:00").split(":"))
    try:
        origin = float(np.datetime64(f"{date}T{clock}", "s").astype(np.int64))
    except ValueError:
        raise problem from None
    unit = match[1].lower()
    return _SECONDS.get(unit, _SECONDS[unit[0]]), origin


def _text(dataset: Any, name: str) -> str:
    value = dataset.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
