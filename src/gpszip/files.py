"""Files that are there whole or not at all, temporary folders, and what is wrong with a disk in plain words."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import FrameType

from gpszip.errors import OutputError

try:
    import fcntl
except ImportError:  # Windows has none: nobody can tell there whether a folder is still in use
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "OUTPUT_PREFIX",
    "SCRATCH_PREFIX",
    "cause",
    "naming",
    "note",
    "noting",
    "replacing",
    "replacing_together",
    "temporary_folder",
    "uninterrupted",
]

#: Names of temporary folders begin like this: beside an output, and in TMPDIR.
OUTPUT_PREFIX, SCRATCH_PREFIX = ".gpszip-", "gpszip-"

#: Their names end like this.
_SUFFIX = ".part"

#: Seconds after which a folder that no process has locked is taken for one that a killed process left.
_STALE = 3600.0

#: Signals that are put off while a file takes its place.
_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_written: ContextVar[list[str] | None] = ContextVar("written", default=None)

#: What to do about a system's error.
_REMEDIES = {
    errno.ENOSPC: "free some room or name a file on another disk",
    errno.EDQUOT: "free some room or name a file on another disk",
    errno.EFBIG: "name a file on a disk that takes larger ones",
    errno.EROFS: "name a file on another disk",
    errno.EACCES: "check the owner and the mode of file and folder",
    errno.EPERM: "check the owner, the mode and the attributes of file and folder",
    errno.EIO: "check the disk or the connection to it, or name a file on another one",
    errno.ENOENT: "its folder is gone or was never there; create it first",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EBADF: "it is closed; name a file with -o or leave it open",
}


def cause(error: OSError) -> str:
    """Say what the system complains of, and what to do about it.

    Parameters
    ----------
    error : OSError
        Of any call.

    Examples
    --------
    >>> cause(OSError(errno.ENOSPC, "No space left on device"))
    'No space left on device; free some room or name a file on another disk'
    """
    # Arrow's errors have several lines and no number
    text = error.strerror or (str(error).splitlines() or [type(error).__name__])[0]
    remedy = _REMEDIES.get(error.errno or 0)
    return f"{text}; {remedy}" if remedy else text


@contextmanager
def replacing(path: str | os.PathLike[str], *, force: bool = True) -> Iterator[Path]:
    """Give a temporary file in the same folder, with the same name; once filled without an error it takes the place of the file.

    Parameters
    ----------
    path : path
        The file to write. A link stays one: what it points to is replaced.
    force : bool, default True
        Whether a file of that name is replaced. It hands on its mode.

    Raises
    ------
    OutputError
        If it exists and ``force`` is not given, can't be written, or something else than a file has its name.
    """
    with replacing_together([path], force=force) as (whole,):
        yield whole


@contextmanager
def replacing_together(paths: Sequence[str | os.PathLike[str]], *, force: bool = True) -> Iterator[list[Path]]:
    """Do the same for several files, none of which takes its place before all are on disk.

    Parameters
    ----------
    paths : sequence of path
        The files, in the order in which they take their places.
    force : bool, default True
        Whether files of that name are replaced.

    Raises
    ------
    OutputError
        As of :func:`replacing`; it names the files that have taken their places already.
    """
    targets = [_target(path, force) for path in paths]
    written: list[Path] = []
    try:
        with contextlib.ExitStack() as stack:
            rooms = [stack.enter_context(_room_beside(target)) for target in targets]
            parts = [room / target.name for room, target in zip(rooms, targets, strict=True)]
            yield parts
            for part, target in zip(parts, targets, strict=True):
                with naming(target):
                    _to_disk(part, target)
            with uninterrupted():
                for part, target in zip(parts, targets, strict=True):
                    with naming(target):
                        _publish(part, target, force=force)
                        written.append(target)
                        note(f"{target} is written")
                stack.close()
    except OutputError as error:
        if written:
            names = ", ".join(map(str, written))
            raise _with_notes(OutputError(f"{error}; {names}: is written"), error) from error
        raise
    except OSError as error:
        if len(targets) > 1 or _is_of_another_file(error, targets[0]):
            raise
        raise _failed(targets[0], error) from error


@contextmanager
def _room_beside(target: Path) -> Iterator[Path]:
    with contextlib.ExitStack() as stack:
        with naming(target):
            room = stack.enter_context(temporary_folder(target.parent, OUTPUT_PREFIX))
        yield room


@contextmanager
def naming(target: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file that can't be written.

    Parameters
    ----------
    target : path
        The file.

    Raises
    ------
    OutputError
        In place of any OSError.
    """
    try:
        yield
    except FileExistsError:
        raise _exists(Path(target)) from None
    except OSError as error:
        raise _failed(target, error) from error


def _failed(target: str | os.PathLike[str], error: OSError) -> OutputError:
    return _with_notes(OutputError(f"{os.fspath(target)}: can't be written: {cause(error)}"), error)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off what Ctrl-C and signals to end do until the block is through. In other threads than the main one, they do nothing anyway."""
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        found = {number: signal.getsignal(number) for number in _SIGNALS}
        handlers = {number: handler for number, handler in found.items() if callable(handler)}
    came: list[tuple[int, FrameType | None]] = []
    try:
        for number in handlers:
            signal.signal(number, lambda *signalled: came.append(signalled))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number, frame in came[:1]:
        handlers[signal.Signals(number)](number, frame)


@contextmanager
def noting() -> Iterator[list[str]]:
    """Give a list that takes what is written, in words, for as long as the block lasts."""
    written: list[str] = []
    before = _written.set(written)
    try:
        yield written
    finally:
        _written.reset(before)


def note(what: str) -> None:
    """Tell whoever listens, see :func:`noting`, what is written."""
    listener = _written.get()
    if listener is not None:
        listener.append(what)


def _target(path: str | os.PathLike[str], force: bool) -> Path:
    """The file behind a name, which may be replaced."""
    named = Path(path)
    # unlike pathlib's, the functions of os.path never raise
    if os.path.isdir(named):  # noqa: PTH112
        raise OutputError(f"{named}: is a folder; name a file in it")
    if not force and os.path.lexists(named):
        raise _exists(named)
    target = Path(os.path.realpath(named))
    if os.path.lexists(target) and not os.path.isfile(target):  # noqa: PTH113
        raise OutputError(f"{named}: is no regular file and can't be replaced; - is standard output")
    return target


def _exists(target: Path) -> OutputError:
    return OutputError(f"{target}: exists already; --force overwrites it")


def _to_disk(part: Path, target: Path) -> None:
    """Put what was written on disk, with the mode of the file that it replaces."""
    with part.open("rb+") as stream:
        os.fsync(stream.fileno())
    if target.exists():
        part.chmod(target.stat().st_mode & 0o777)


def _folder_to_disk(folder: Path) -> None:
    # some systems don't open folders; the file itself is on disk by now
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _publish(part: Path, target: Path, *, force: bool) -> None:
    """Let what is on disk take its name."""
    if force or not _linked(part, target):
        part.replace(target)
    _folder_to_disk(target.parent)


def _linked(part: Path, target: Path) -> bool:
    """Give a file a second name: unlike a rename, it never takes the place of a file that another process made meanwhile."""
    try:
        target.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        return False  # the file system has no links
    return True


def _is_of_another_file(error: OSError, target: Path) -> bool:
    """Whether an error names a file that is neither the target nor on its way to become it."""
    if not isinstance(error.filename, (str, bytes)):
        return False
    return target.parent not in (one := Path(os.fsdecode(error.filename)), *one.parents)


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
        with uninterrupted():
            room = _Room(Path(tempfile.mkdtemp(prefix=prefix, suffix=_SUFFIX, dir=parent)))
        yield room.path
    except BaseException as error:
        if room is not None and (complaint := room.remove()):
            error.add_note(complaint)
        raise
    if complaint := room.remove():
        raise OutputError(complaint)


class _Room:
    """A temporary folder, locked for as long as it is in use.

    Parameters
    ----------
    path : Path
        The folder, which is there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = _locked(path)
        # if a signal stops its removal, it goes when the interpreter ends
        self._at_last = weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)

    def remove(self) -> str:
        """Remove the folder; return what is left of it to be removed by somebody else, in words."""
        with uninterrupted():
            self._at_last.detach()
            try:
                shutil.rmtree(self.path)
            except FileNotFoundError:
                return ""  # somebody else has removed it, maybe with the folder that it was in
            except OSError as error:
                return f"{self.path}: this temporary folder can't be removed ({error.strerror}); delete it"
            finally:
                _unlocked(self._lock)
        return ""


def _locked(folder: Path) -> int | None:
    """Lock a folder that nobody else has locked and return the handle that holds the lock; None where that can't be."""
    if fcntl is None:
        return None
    handle = None
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        _unlocked(handle)
        return None
    return handle


def _unlocked(handle: int | None) -> None:
    # nothing was written through it, so that nothing is lost if closing it fails
    if handle is not None:
        with contextlib.suppress(OSError):
            os.close(handle)


def _remove_stale(parent: Path, prefix: str) -> None:
    """Remove the temporary folders of this user that no process has locked and nobody has written to for an hour."""
    with contextlib.suppress(OSError), os.scandir(parent) as entries:
        names = [entry.path for entry in entries if entry.name.startswith(prefix) and entry.name.endswith(_SUFFIX)]
        for folder in map(Path, names):
            if (lock := _locked(folder)) is None:
                continue
            try:
                if _is_stale(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                _unlocked(lock)


def _is_stale(folder: Path) -> bool:
    """Whether a folder is this user's and all in it is old."""
    with contextlib.suppress(OSError):
        found = [folder.lstat(), *(path.lstat() for path in folder.iterdir())]
        return found[0].st_uid == os.geteuid() and max(one.st_mtime for one in found) < time.time() - _STALE
    return False


def _with_notes(error: OutputError, before: BaseException) -> OutputError:
    for note in getattr(before, "__notes__", ()):
        error.add_note(note)
    return error
