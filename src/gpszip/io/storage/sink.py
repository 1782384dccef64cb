"""Output that appears completely or not at all, in a file or on standard output."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gpszip.errors import OutputError
from gpszip.files.atomic_write import atomic_write
from gpszip.files.os_errors import explain_os_error
from gpszip.files.written import report_output
from gpszip.io.storage.temporary import scratch_folder

__all__ = ["atomic_write", "open_sink", "to_stdout"]


@contextmanager
def open_sink(sink: str | Path | BinaryIO) -> Iterator[BinaryIO]:
    """Open a file or standard output for writing bytes.

    Parameters
    ----------
    sink : str, Path or binary stream
        Name of a file, ``-`` for standard output, or a stream that is already open.

    Raises
    ------
    OutputError
        If it can't be written.
    """
    # Raw streams may write less than they are given.
    if isinstance(sink, io.RawIOBase):
        buffered = io.BufferedWriter(sink)
        yield buffered
        buffered.flush()
        # Detach the buffer: closing it would close the caller's stream.
        buffered.detach()
    elif not isinstance(sink, (str, Path)):
        yield sink
    elif str(sink) == "-":
        with _standard_output() as stream:
            yield stream
    else:
        with atomic_write(sink) as path, path.open("wb") as file:
            yield file


@contextmanager
def to_stdout(suffix: str) -> Iterator[Path]:
    """Create a temporary file, and copy it to standard output if it was written without an error.

    Parameters
    ----------
    suffix : str
        Suffix of the temporary file.

    Raises
    ------
    OutputError
        If standard output can't be written.
    """
    with scratch_folder() as folder:
        path = folder / f"out{suffix}"
        yield path
        with path.open("rb") as file, _standard_output() as stream:
            shutil.copyfileobj(file, stream)


@contextmanager
def _standard_output() -> Iterator[BinaryIO]:
    """Standard output for bytes, flushed at the end, so that errors don't wait for the exit."""
    if sys.stdout is None:
        raise OutputError(
            "is closed", path="standard output", remedy="name a file with -o or leave it open"
        )
    # If the run fails, its message says that part of the output is out already.
    report_output("standard output may be incomplete")
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise  # the reader has closed the pipe, which is no error
    except OSError as error:
        # An error with the name of a file is about that file, not about standard output.
        if error.filename is not None:
            raise
        raise OutputError(
            f"can't be written: {explain_os_error(error)}", path="standard output"
        ) from error
