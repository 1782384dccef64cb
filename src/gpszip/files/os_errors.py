"""Errors of the operating system, with a remedy in plain words."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

from gpszip.errors import OutputError

__all__ = ["as_output_error", "copy_notes", "explain_os_error"]

#: Remedy by error number. Numbers without an entry are reported without a remedy.
_REMEDIES = {
    errno.ENOSPC: "free some space or name a file on another disk",
    errno.EDQUOT: "free some space or name a file on another disk",
    errno.EFBIG: "name a file on a disk that takes larger ones",
    errno.EROFS: "name a file on another disk",
    errno.EACCES: "check the owner and the mode of file and folder",
    errno.EPERM: "check the owner, the mode and the attributes of file and folder",
    errno.EIO: "check the disk or the connection to it, or name a file on another one",
    errno.ENOENT: "its folder is gone or was never there; create it first",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EBADF: "it is closed; name a file with -o or leave it open",
}


def explain_os_error(error: OSError) -> str:
    """Return the system's message with a remedy, in one line.

    Parameters
    ----------
    error : OSError
        From any call.

    Examples
    --------
    >>> explain_os_error(OSError(errno.ENOSPC, "No space left on device"))
    'No space left on device; free some space or name a file on another disk'
    """
    # Arrow's errors have several lines and no number
    text = error.strerror or (str(error).splitlines() or [type(error).__name__])[0]
    remedy = _REMEDIES.get(error.errno or 0)
    return f"{text}; {remedy}" if remedy else text


@contextmanager
def as_output_error(target: str | os.PathLike[str]) -> Iterator[None]:
    """Re-raise OSError as OutputError that names the target.

    Parameters
    ----------
    target : path
        The file that can't be written.

    Raises
    ------
    OutputError
        In place of any OSError, with its notes.
    """
    try:
        yield
    except OSError as error:
        raise copy_notes(
            OutputError(f"can't be written: {explain_os_error(error)}", path=target), error
        ) from error


def copy_notes(error: OutputError, before: BaseException) -> OutputError:
    """Copy the notes of an earlier error, such as on temporary folders that remain."""
    for note in getattr(before, "__notes__", ()):
        error.add_note(note)
    return error
