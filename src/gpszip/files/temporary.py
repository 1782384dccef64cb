"""Temporary folders, which go with all that is in them."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpszip.errors import OutputError
from gpszip.files.interrupts import defer_signals

try:
    import fcntl
except ImportError:  # Windows has none: nobody can tell there whether a folder is still in use
    fcntl = None  # type: ignore[assignment]

__all__ = ["OUTPUT_PREFIX", "SCRATCH_PREFIX", "temporary_folder"]

#: Names of temporary folders begin like this: beside an output, and in TMPDIR.
OUTPUT_PREFIX, SCRATCH_PREFIX = ".gpszip-", "gpszip-"

#: Their names end like this.
_SUFFIX = ".part"

#: Seconds after which a folder that no process has locked is taken for one that a killed process left.
_STALE_AFTER = 3600.0


@contextmanager
def temporary_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """Make a folder for temporary files; it goes at the end with all that is in it, and so do those that killed processes left.

    Parameters
    ----------
    parent : Path
        The folder to make it in.
    prefix : str
        What its name begins with.

    Raises
    ------
    OSError
        If it can't be made.
    OutputError
        If it can't be removed. If something else went wrong before, that error bears a note.
    """
    _remove_stale(parent, prefix)
    room = None
    try:
        with defer_signals():
            room = _TemporaryFolder(
                Path(tempfile.mkdtemp(prefix=prefix, suffix=_SUFFIX, dir=parent))
            )
        yield room.path
    except BaseException as error:
        if room is not None and (complaint := room.remove()):
            error.add_note(complaint)
        raise
    if complaint := room.remove():
        raise OutputError(complaint)


class _TemporaryFolder:
    """A temporary folder, locked for as long as it is in use.

    Parameters
    ----------
    path : Path
        The folder, which is there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = _lock_folder(path)
        # if a signal stops its removal, it goes when the interpreter ends
        self._finalizer = weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)

    def remove(self) -> str:
        """Remove the folder; return what is left of it to be removed by somebody else, in words."""
        with defer_signals():
            self._finalizer.detach()
            try:
                shutil.rmtree(self.path)
            except FileNotFoundError:
                return ""  # somebody else has removed it, maybe with the folder that it was in
            except OSError as error:
                return f"{self.path}: this temporary folder can't be removed ({error.strerror}); delete it"
            finally:
                _unlock_folder(self._lock)
        return ""


def _lock_folder(folder: Path) -> int | None:
    """Lock a folder that nobody else has locked and return the handle that holds the lock; None where that can't be."""
    if fcntl is None:
        return None
    handle = None
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        _unlock_folder(handle)
        return None
    return handle


def _unlock_folder(handle: int | None) -> None:
    # nothing was written through it, so that nothing is lost if closing it fails
    if handle is not None:
        with contextlib.suppress(OSError):
            os.close(handle)


def _remove_stale(parent: Path, prefix: str) -> None:
    """Remove the temporary folders of this user that no process has locked and nobody has written to for an hour."""
    with contextlib.suppress(OSError), os.scandir(parent) as entries:
        names = [
            entry.path
            for entry in entries
            if entry.name.startswith(prefix) and entry.name.endswith(_SUFFIX)
        ]
        for folder in map(Path, names):
            if (lock := _lock_folder(folder)) is None:
                continue
            try:
                if _is_stale(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                _unlock_folder(lock)


def _is_stale(folder: Path) -> bool:
    """Whether a folder is this user's and all in it is old."""
    with contextlib.suppress(OSError):
        found = [folder.lstat(), *(path.lstat() for path in folder.iterdir())]
        return (
            found[0].st_uid == os.geteuid()
            and max(one.st_mtime for one in found) < time.time() - _STALE_AFTER
        )
    return False
