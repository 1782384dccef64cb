"""Files that take the place of others once they are whole and on disk."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gpszip.errors import OutputError
from gpszip.files.interrupts import defer_signals
from gpszip.files.os_errors import as_output_error, copy_notes
from gpszip.files.temporary import OUTPUT_PREFIX, temporary_folder
from gpszip.files.written import report_output

__all__ = ["atomic_write", "atomic_write_all"]


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, force: bool = True) -> Iterator[Path]:
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
    with atomic_write_all([path], force=force) as (whole,):
        yield whole


@contextmanager
def atomic_write_all(
    paths: Sequence[str | os.PathLike[str]], *, force: bool = True
) -> Iterator[list[Path]]:
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
        As of :func:`atomic_write`; it names the files that have taken their places already.
    """
    targets = [_resolve_target(path, force) for path in paths]
    written: list[str] = []
    with _report_written(written), contextlib.ExitStack() as stack:
        rooms = [stack.enter_context(_temporary_folder_beside(target)) for target in targets]
        parts = [room / target.name for room, target in zip(rooms, targets, strict=True)]
        try:
            yield parts
        except OSError as error:
            if len(targets) > 1 or _names_other_file(error, targets[0]):
                raise
            with as_output_error(targets[0]):
                raise

        # all on disk, and only then in place
        for part, target in zip(parts, targets, strict=True):
            with as_output_error(target):
                _sync_file(part, target)
        with defer_signals():
            for part, target in zip(parts, targets, strict=True):
                with as_output_error(target):
                    _publish(part, target, force=force)
                written.append(str(target))
                report_output(f"{target} is written")
            stack.close()


@contextmanager
def _report_written(written: list[str]) -> Iterator[None]:
    """Tell of any error after files were written that they are."""
    try:
        yield
    except OutputError as error:
        if not written:
            raise
        raise copy_notes(OutputError(f"{error}; {', '.join(written)} is written"), error) from error


def _resolve_target(path: str | os.PathLike[str], force: bool) -> Path:
    """The file behind a name, which may be replaced."""
    named = Path(path)
    # unlike pathlib's, the functions of os.path never raise
    if os.path.isdir(named):  # noqa: PTH112
        raise OutputError(f"{named}: is a folder; name a file in it")
    if not force and os.path.lexists(named):
        raise _exists_error(named)
    target = Path(os.path.realpath(named))
    if os.path.lexists(target) and not os.path.isfile(target):  # noqa: PTH113
        raise OutputError(
            f"{named}: is no regular file and can't be replaced; - is standard output"
        )
    return target


def _exists_error(target: Path) -> OutputError:
    return OutputError(f"{target}: exists already; --force overwrites it")


@contextmanager
def _temporary_folder_beside(target: Path) -> Iterator[Path]:
    with contextlib.ExitStack() as stack:
        with as_output_error(target):
            room = stack.enter_context(temporary_folder(target.parent, OUTPUT_PREFIX))
        yield room


def _sync_file(part: Path, target: Path) -> None:
    """Put what was written on disk, with the mode of the file that it replaces."""
    with part.open("rb+") as stream:
        os.fsync(stream.fileno())
    if target.exists():
        part.chmod(target.stat().st_mode & 0o777)


def _sync_folder(folder: Path) -> None:
    # some systems don't open folders; the file itself is on disk by now
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _publish(part: Path, target: Path, *, force: bool) -> None:
    """Let what is on disk take its name."""
    if force or not _try_hardlink(part, target):
        part.replace(target)
    _sync_folder(target.parent)


def _try_hardlink(part: Path, target: Path) -> bool:
    """Give a file a second name: unlike a rename, it never takes the place of a file that another process made meanwhile."""
    try:
        target.hardlink_to(part)
    except OSError:
        if os.path.lexists(target):
            raise _exists_error(target) from None
        return False  # the file system has no links
    return True


def _names_other_file(error: OSError, target: Path) -> bool:
    """Whether an error names a file that is neither the target nor on its way to become it."""
    if not isinstance(error.filename, (str, bytes)):
        return False
    return target.parent not in (one := Path(os.fsdecode(error.filename)), *one.parents)
