"""A folder for temporary files as large as logs, and what is said where these find no room."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.files.temporary import SCRATCH_PREFIX, temporary_folder

__all__ = ["disk_errors_as_output_errors", "read_numbers", "scratch_folder", "write_numbers"]

Number = TypeVar("Number", bound=np.generic)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder for temporary files, in the one that ``TMPDIR`` names if it is set; it goes at the end with all that is in it.

    Raises
    ------
    OutputError
        If no folder can be made there, or it can't be removed.
    """
    with contextlib.ExitStack() as stack:
        try:
            # unlike tempfile by itself, don't fill another disk than the one that was named
            parent = Path(os.environ.get("TMPDIR") or tempfile.gettempdir())
            room = stack.enter_context(temporary_folder(parent, SCRATCH_PREFIX))
        except OSError as error:
            place = (
                f"TMPDIR names {os.environ['TMPDIR']}"
                if os.environ.get("TMPDIR")
                else "TMPDIR is not set"
            )
            raise OutputError(
                f"{place}: no temporary files can be made ({error.strerror}); let it name a folder with room"
            ) from None
        yield room


@contextmanager
def disk_errors_as_output_errors() -> Iterator[None]:
    """Say where temporary files find no room.

    Raises
    ------
    OutputError
        In place of any OSError.
    """
    try:
        yield
    except OSError as error:
        folder = os.environ.get("TMPDIR") or tempfile.gettempdir()
        raise OutputError(
            f"{folder}: temporary files can't be written: {error.strerror or 'no room'}{_describe_free_space(folder)}; "
            "let TMPDIR name a folder with more room"
        ) from None


def _describe_free_space(folder: str) -> str:
    """How much room a folder has, in words; nothing where it is gone."""
    with contextlib.suppress(OSError):
        return f", {shutil.disk_usage(folder).free / 2**20:,.0f} MiB are free"
    return ""


def write_numbers(numbers: NDArray[Any], file: BinaryIO) -> None:
    """Append numbers to a file. Unlike NumPy's ``tofile``, it misses no error of the disk, and goes on where it was interrupted.

    Parameters
    ----------
    numbers : array
        Of any shape and kind.
    file : binary file
        Open for writing.
    """
    file.write(np.ascontiguousarray(numbers).data.cast("B"))


def read_numbers(path: Path, kind: type[Number], first: int, count: int) -> NDArray[Number]:
    """Read numbers that :func:`write_numbers` wrote.

    Parameters
    ----------
    path : Path
        The file.
    kind : type
        Of the numbers.
    first, count : int
        Number of the first one in the file, and how many.

    Raises
    ------
    OutputError
        If the file is shorter, or can't be read.
    """
    numbers = np.empty(count, kind)
    with disk_errors_as_output_errors(), path.open("rb") as file:
        file.seek(first * numbers.itemsize)
        found = file.readinto(numbers.data.cast("B")) if count else 0
    if found != numbers.nbytes:
        raise OutputError(
            f"{path}: this temporary file is {numbers.nbytes - found} bytes too short; is the disk full, or failing?"
        )
    return numbers
