"""Streams of Arrow batches, by which packages pass tables to each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError

__all__ = ["frame_errors", "open_stream", "stream_batches"]

#: Letters of an error message of another package that are shown.
_MAX_REASON_LETTERS = 160


def open_stream(frame: Any, where: str) -> Any:
    """Open a frame as a stream of batches.

    Parameters
    ----------
    frame : object with ``__arrow_c_stream__``
        The frame.
    where : str
        Its name in messages.

    Returns
    -------
    pyarrow.RecordBatchReader

    Raises
    ------
    InputError
        If it is a single column, or its package refuses.

    Examples
    --------
    >>> open_stream(pa.table({"t": [0, 1]}), "Table").schema.names
    ['t']
    """
    with frame_errors(where):
        return pa.RecordBatchReader.from_stream(frame)


def stream_batches(reader: Any, where: str) -> Iterator[Any]:
    """Yield the batches of a stream, with errors of its package as InputError."""
    while True:
        with frame_errors(where):
            batch = next(reader, None)
            # A batch that came from a damaged file could crash the process.
            if batch is not None:
                batch.validate(full=True)
        if batch is None:
            return
        yield batch


@contextmanager
def frame_errors(where: str, column: str | None = None) -> Iterator[None]:
    """Re-raise whatever another package raises about a frame as InputError.

    Parameters
    ----------
    where : str
        Name of the frame.
    column : str, optional
        Name of the column that is read.
    """
    # A frame may compute its rows only now, so that any error of its package can come up.
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:_MAX_REASON_LETTERS] or type(error).__name__
        location = None if column is None else f"column {column!r}"
        raise InputError(f"can't be read: {reason}", path=where, location=location) from error
