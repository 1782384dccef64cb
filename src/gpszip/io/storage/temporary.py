"""Temporary files as large as logs, in the folder that TMPDIR names, and errors of a full disk."""

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
    """Create a folder for temporary files, in the folder that ``TMPDIR`` names if it is set.

    The folder and its content are removed at the end.

    Raises
    ------
    OutputError
        If the folder can't be created or removed.
    """
    with contextlib.ExitStack() as stack:
        # Unlike tempfile, don't fall back to another disk than the given one.
        given = os.environ.get("TMPDIR")
        try:
            parent = Path(given or tempfile.gettempdir())
            folder = stack.enter_context(temporary_folder(parent, SCRATCH_PREFIX))
        except OSError as error:
            setting = f"TMPDIR names {given}" if given else "TMPDIR is not set"
            raise OutputError(
                f"no temporary files can be made ({error.strerror})",
                location=setting,
                remedy="let it name a folder with free space",
            ) from None
        yield folder


@contextmanager
def disk_errors_as_output_errors() -> Iterator[None]:
    """Re-raise OSError as OutputError naming the folder of temporary files and its free space.

    Raises
    ------
    OutputError
        In place of any OSError.
    """
    try:
        yield
    except OSError as error:
        folder = os.environ.get("TMPDIR") or tempfile.gettempdir()
        reason = error.strerror or "no space"
        raise OutputError(
            f"temporary files can't be written: {reason}{_describe_free_space(folder)}",
            path=folder,
            remedy="let TMPDIR name a folder with more space",
        ) from None


def _describe_free_space(folder: str) -> str:
    """Free space of a folder for messages; empty if the folder doesn't exist."""
    with contextlib.suppress(OSError):
        return f", {shutil.disk_usage(folder).free / 2**20:,.0f} MiB are free"
    return ""


def write_numbers(numbers: NDArray[Any], file: BinaryIO) -> None:
    """Append numbers to a file.

    Unlike NumPy's ``tofile``, this reports all disk errors and continues after interrupts.

    Parameters
    ----------
    numbers : array
        Numbers of any shape and type.
    file : binary file
        Open for writing.
    """
    # The file takes the numbers as bytes, which only a contiguous array has in one piece. The
    # memory of an empty array can't always be viewed as bytes.
    if numbers.size:
        file.write(np.ascontiguousarray(numbers).data.cast("B"))


def read_numbers(path: Path, kind: type[Number], first: int, count: int) -> NDArray[Number]:
    """Read numbers that :func:`write_numbers` wrote.

    Parameters
    ----------
    path : Path
        The file.
    kind : type
        Type of the numbers.
    first, count : int
        Index of the first number in the file, and number of numbers.

    Raises
    ------
    OutputError
        If the file is too short or can't be read.
    """
    numbers = np.empty(count, kind)
    with disk_errors_as_output_errors(), path.open("rb") as file:
        file.seek(first * numbers.itemsize)
        # The memory of an empty array can't always be viewed as bytes.
        read = file.readinto(numbers.data.cast("B")) if count else 0
    if read != numbers.nbytes:
        raise OutputError(
            f"this temporary file is {numbers.nbytes - read} bytes too short",
            path=path,
            remedy="is the disk full, or failing?",
        )
    return numbers
