"""Temporary folders that are removed with their content, even after a killed process."""

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
except ImportError:  # on Windows nothing shows whether a folder is still in use
    fcntl = None  # type: ignore[assignment]

__all__ = ["OUTPUT_PREFIX", "SCRATCH_PREFIX", "temporary_folder"]

#: Prefix of temporary folders beside an output file; hidden, as the user's folder is listed.
OUTPUT_PREFIX = ".gpszip-"

#: Prefix of temporary folders in TMPDIR.
SCRATCH_PREFIX = "gpszip-"

#: Suffix of all temporary folders.
_SUFFIX = ".part"

#: Seconds without a write after which an unlocked folder counts as left by a killed process.
_STALE_AFTER = 3600.0


@contextmanager
def temporary_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """Create a temporary folder and remove it when the block ends.

    Stale folders of killed processes in the same parent are removed, too.

    Parameters
    ----------
    parent : Path
        The folder to create it in.
    prefix : str
        First characters of its name.

    Raises
    ------
    OSError
        If it can't be created.
    OutputError
        If it can't be removed. If the block raised an error, that error gets a note instead.
    """
    # Create the folder. If the block raises an error, a failed removal is only a note on it.
    _remove_stale(parent, prefix)
    folder = None
    try:
        # a signal between creation and registration would leave the folder behind
        with defer_signals():
            folder = _TemporaryFolder(
                Path(tempfile.mkdtemp(prefix=prefix, suffix=_SUFFIX, dir=parent))
            )
        yield folder.path
    except BaseException as error:
        if folder is not None and (complaint := folder.remove()):
            error.add_note(complaint)
        raise

    # After a block without error, a failed removal is an error of its own.
    if complaint := folder.remove():
        raise OutputError(complaint)


class _TemporaryFolder:
    """A temporary folder, locked for as long as it is in use.

    Parameters
    ----------
    path : Path
        The folder; it exists.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = _lock_folder(path)
        # If a signal interrupts the removal, the interpreter removes it at exit.
        self._finalizer = weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)

    def remove(self) -> str:
        """Remove the folder; return "" or a message that says what the user must delete."""
        with defer_signals():
            self._finalizer.detach()
            try:
                shutil.rmtree(self.path)
            except FileNotFoundError:
                return ""  # another process removed it, perhaps together with its parent
            except OSError as error:
                return (
                    f"{self.path}: this temporary folder can't be removed ({error.strerror}); "
                    "delete it"
                )
            finally:
                _unlock_folder(self._lock)
        return ""


def _lock_folder(folder: Path) -> int | None:
    """Lock a folder; return the handle of the lock, or None if it is locked or can't be."""
    if fcntl is None:
        return None
    handle = None
    try:
        # Don't follow a link that somebody has put there, nor wait for a lock.
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        _unlock_folder(handle)
        return None
    return handle


def _unlock_folder(handle: int | None) -> None:
    """Close the handle of a lock; errors don't matter, as nothing was written through it."""
    if handle is not None:
        with contextlib.suppress(OSError):
            os.close(handle)


def _remove_stale(parent: Path, prefix: str) -> None:
    """Remove unlocked temporary folders of this user without a write for an hour."""
    with contextlib.suppress(OSError), os.scandir(parent) as entries:
        folders = [
            Path(entry.path)
            for entry in entries
            if entry.name.startswith(prefix) and entry.name.endswith(_SUFFIX)
        ]
        for folder in folders:
            # A folder in use is locked, by its own process or another one that removes it.
            if (lock := _lock_folder(folder)) is None:
                continue
            try:
                if _is_stale(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                _unlock_folder(lock)


def _is_stale(folder: Path) -> bool:
    """Whether a folder belongs to this user and neither it nor its content is recent."""
    with contextlib.suppress(OSError):
        # Writes to a file change the time of the file, but not that of its folder.
        stats = [folder.lstat(), *(path.lstat() for path in folder.iterdir())]
        return (
            stats[0].st_uid == os.geteuid()
            and max(stat.st_mtime for stat in stats) < time.time() - _STALE_AFTER
        )
    return False
