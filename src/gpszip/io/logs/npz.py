"""Logs in files of NumPy: arrays by name (.npz), or a single one (.npy). Objects are never read."""

from __future__ import annotations

import ast
import io
import operator
from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.arrays import Column, columns_of, read_arrays
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.sniff.binary import NUMPY_MAGIC
from gpszip.io.storage.source import Source
from gpszip.io.storage.zip_files import find_members

__all__ = ["read_npz"]

#: Bytes of an array's signature and version.
_VERSION_BYTES = 8

#: Bytes of a header, at most: one of a few fields has a few hundred.
_MAX_HEADER_BYTES = 10_000

#: Letters of a reason that messages show.
_MAX_REASON_LETTERS = 120


def read_npz(source: Source, request: Request) -> RawLog:
    """Read a log from arrays of equal length.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns for roles, unit of time, attributes. The columns of a single array without names
        are named in their order: ``--columns t,x,y``.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the file is damaged, or there is no array for time or position.

    Examples
    --------
    >>> file = io.BytesIO()
    >>> np.savez(file, t=np.arange(2.0), pos=np.array([[1.0, 2], [3, 4]]))
    >>> read_npz(Source("a.npz", data=file.getvalue()), Request()).coordinates.tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    columns: list[Column] = []
    for name, array in _arrays(source):
        columns += columns_of(name, array.shape, array.dtype, array.__getitem__)
    if not columns:
        raise InputError(
            "no array of numbers with one or two dimensions",
            path=source.name,
            remedy="save arrays of equal length: numpy.savez(file, t=t, x=x, y=y)",
        )
    return read_arrays(columns, request, source.name)


def _arrays(source: Source) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of a file with their names."""
    data = source.read()
    if data.startswith(NUMPY_MAGIC):
        yield "", _array(data, "", source.name)
        return

    # The reader of archives bounds what a member may expand to.
    for member in find_members(io.BytesIO(data), source.name):
        if isinstance(member, InputError):
            raise member
        name = member.name.rsplit("/", 1)[-1]
        if name.endswith(".npy"):
            name = name.removesuffix(".npy")
            yield name, _array(b"".join(member.chunks()), name, source.name)


def _array(data: bytes, name: str, where: str) -> NDArray[Any]:
    """Read one array, whose header has to agree with its size."""

    def error(reason: str) -> InputError:
        return InputError(
            f"an array that can't be read: {reason[:_MAX_REASON_LETTERS]}",
            path=where,
            location=f"array {name!r}" if name else None,
            remedy="save it again with numpy.savez",
        )

    # Nothing but the header is Python's, and that is a literal.
    stream = io.BytesIO(data)
    try:
        shape, is_fortran, dtype = _header(stream)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError, LookupError) as fault:
        raise error(f"its header says {str(fault).partition(chr(10))[0]}") from None

    # An array of a wrong size would take any amount of memory.
    if dtype.hasobject:
        raise error("it holds objects of Python, which are never read")
    if dtype.itemsize * prod(shape) != len(data) - stream.tell() or not dtype.itemsize:
        raise error("its size is not what its header says")

    # Lengths may be negative, or more than NumPy counts beside a length of 0.
    values = np.frombuffer(data, dtype, offset=stream.tell())
    try:
        return values.reshape(shape, order="F" if is_fortran else "C")
    except (ValueError, OverflowError):
        raise error("its header says a shape that no array has") from None


def _header(stream: io.BytesIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the shape, the order and the type of an array.

    NumPy's own reader raises whatever its tokenizer raises, and accepts what Python 2 wrote.
    """
    major = stream.read(_VERSION_BYTES)[len(NUMPY_MAGIC) : len(NUMPY_MAGIC) + 1]
    size = int.from_bytes(stream.read(2 if major == b"\x01" else 4), "little")
    text = stream.read(min(size, _MAX_HEADER_BYTES)).decode("utf-8", "replace")
    members = ast.literal_eval(text.strip())
    shape = tuple(operator.index(length) for length in members["shape"])
    dtype = np.lib.format.descr_to_dtype(members["descr"])
    return shape, bool(members["fortran_order"]), dtype
