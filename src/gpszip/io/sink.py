"""Output that appears whole or not at all."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gpszip.errors import OutputError

__all__ = ["pouring", "replacing", "writing"]


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary file in the same folder, with the same suffix; once filled without an error it takes the name.

    Parameters
    ----------
    path : str or Path
        The file to write; replaced if it exists.

    Raises
    ------
    OutputError
        If it can't be written, or something else than a file has its name.
    """
    # a link stays one, and what it points to is replaced
    target = Path(os.path.realpath(path))
    if os.path.lexists(target) and not target.is_file():
        raise OutputError(f"{path}: is no regular file and can't be replaced; - is standard output")
    try:
        with tempfile.TemporaryDirectory(prefix=".gpszip-", dir=target.parent) as room:
            whole = Path(room) / target.name
            yield whole
            with whole.open("rb") as file:
                os.fsync(file.fileno())
            whole.replace(target)
    except OSError as error:
        raise OutputError(f"{target}: can't be written: {error.strerror or error}") from error


@contextmanager
def writing(sink: str | Path | BinaryIO) -> Iterator[BinaryIO]:
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
    if not isinstance(sink, (str, Path)):
        yield sink
    elif str(sink) == "-":
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    else:
        with replacing(sink) as path, path.open("wb") as file:
            yield file


@contextmanager
def pouring(suffix: str) -> Iterator[Path]:
    """Give a temporary file; once filled without an error it goes to standard output.

    Parameters
    ----------
    suffix : str
        Of the temporary file.
    """
    with tempfile.TemporaryDirectory(prefix="gpszip-") as room:
        whole = Path(room) / f"out{suffix}"
        yield whole
        with whole.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()
