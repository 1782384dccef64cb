"""Output that appears whole or not at all, in a file or on standard output."""

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
    """Open a file, ``-`` for standard output, or a stream that is open already, for writing bytes.

    Parameters
    ----------
    sink : str, Path or binary stream
        Where to.

    Raises
    ------
    OutputError
        If it can't be written.
    """
    if isinstance(sink, io.RawIOBase):
        buffered = io.BufferedWriter(sink)  # raw streams may take less than they are given
        yield buffered
        buffered.flush()
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
    """Give a temporary file; once filled without an error it goes to standard output.

    Parameters
    ----------
    suffix : str
        Of the temporary file.

    Raises
    ------
    OutputError
        If standard output can't be written.
    """
    with scratch_folder() as room:
        whole = room / f"out{suffix}"
        yield whole
        with whole.open("rb") as file, _standard_output() as stream:
            shutil.copyfileobj(file, stream)


@contextmanager
def _standard_output() -> Iterator[BinaryIO]:
    """Standard output for bytes; what can't be written to it is said at once, not when the process ends."""
    if sys.stdout is None:
        raise OutputError("standard output: is closed; name a file with -o or leave it open")
    report_output("standard output may be incomplete")
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise  # whoever reads it has had enough, and is told nothing
    except OSError as error:
        if error.filename is not None:
            raise
        raise OutputError(
            f"standard output: can't be written: {explain_os_error(error)}"
        ) from error
