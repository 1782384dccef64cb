"""A folder for temporary files as large as logs, and what is said where these find no room."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpszip.errors import OutputError
from gpszip.files import SCRATCH_PREFIX, temporary_folder

__all__ = ["scratch", "writing"]


@contextmanager
def scratch() -> Iterator[Path]:
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
            place = f"TMPDIR names {os.environ['TMPDIR']}" if os.environ.get("TMPDIR") else "TMPDIR is not set"
            raise OutputError(f"{place}: no temporary files can be made ({error.strerror}); let it name a folder with room") from None
        yield room


@contextmanager
def writing() -> Iterator[None]:
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
            f"{folder}: temporary files can't be written: {error.strerror or 'no room'}{_free(folder)}; "
            "let TMPDIR name a folder with more room"
        ) from None


def _free(folder: str) -> str:
    """How much room a folder has, in words; nothing where it is gone."""
    with contextlib.suppress(OSError):
        return f", {shutil.disk_usage(folder).free / 2**20:,.0f} MiB are free"
    return ""
