"""Output files that appear at once: complete and on disk, or not at all."""

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
    """Yield a temporary path; when the block ends without an error, move the file to ``path``.

    The temporary file has the name of the target and lies in a temporary folder beside it.

    Parameters
    ----------
    path : path
        The file to write. If it is a symbolic link, the link stays and its target is replaced.
    force : bool, default True
        Whether to replace an existing file. The new file takes over its mode.

    Raises
    ------
    OutputError
        If the file exists and ``force`` is false, if it can't be written, or if the path is a
        folder or another kind of special file.
    """
    with atomic_write_all([path], force=force) as (temporary,):
        yield temporary


@contextmanager
def atomic_write_all(
    paths: Sequence[str | os.PathLike[str]], *, force: bool = True
) -> Iterator[list[Path]]:
    """Write several files; move none of them to its target before all are on disk.

    Parameters
    ----------
    paths : sequence of path
        The files, in the order in which they are moved to their targets.
    force : bool, default True
        Whether to replace existing files.

    Raises
    ------
    OutputError
        As :func:`atomic_write`. The message names the files that were already moved.
    """
    # Check all targets before any file is written.
    targets = [_resolve_target(path, force) for path in paths]
    written: list[str] = []
    with _report_written(written), contextlib.ExitStack() as stack:
        # Each temporary file has the same file system and the same name as its target.
        folders = [stack.enter_context(_temporary_folder_beside(target)) for target in targets]
        temporaries = [
            folder / target.name for folder, target in zip(folders, targets, strict=True)
        ]

        # Let the caller fill them.
        try:
            yield temporaries
        except OSError as error:
            # Of several files, the error can't be attributed to one.
            if len(targets) > 1 or _names_other_file(error, targets[0]):
                raise
            with as_output_error(targets[0]):
                raise

        # First flush all of them to disk.
        for temporary, target in zip(temporaries, targets, strict=True):
            with as_output_error(target):
                _sync_file(temporary, target)

        # Then move them to their targets; Ctrl-C waits until all are moved.
        with defer_signals():
            for temporary, target in zip(temporaries, targets, strict=True):
                with as_output_error(target):
                    _publish(temporary, target, force=force)
                written.append(str(target))
                report_output(f"{target} is written")
            stack.close()


@contextmanager
def _report_written(written: list[str]) -> Iterator[None]:
    """Add the files that are already written to the message of an OutputError."""
    try:
        yield
    except OutputError as error:
        if not written:
            raise
        reason = f"{error.detail}; {', '.join(written)} is written"
        raise copy_notes(OutputError(reason, path=error.path), error) from error


def _resolve_target(path: str | os.PathLike[str], force: bool) -> Path:
    """Follow symbolic links; raise OutputError if the target may not be replaced."""
    named = Path(path)

    # Unlike pathlib's, the functions of os.path never raise.
    if os.path.isdir(named):  # noqa: PTH112
        raise OutputError("is a folder", path=named, remedy="name a file in it")
    if not force and os.path.lexists(named):
        raise _exists_error(named)

    # Devices and pipes can't be replaced by a file.
    target = Path(os.path.realpath(named))
    if os.path.lexists(target) and not os.path.isfile(target):  # noqa: PTH113
        raise OutputError(
            "is no regular file and can't be replaced", path=named, remedy="- is standard output"
        )
    return target


def _exists_error(target: Path) -> OutputError:
    return OutputError(
        "exists already", path=target, remedy="replace it with --force, in Python force=True"
    )


@contextmanager
def _temporary_folder_beside(target: Path) -> Iterator[Path]:
    """Make a temporary folder beside the target: a move within a file system is atomic."""
    with contextlib.ExitStack() as stack:
        with as_output_error(target):
            folder = stack.enter_context(temporary_folder(target.parent, OUTPUT_PREFIX))
        yield folder


def _sync_file(temporary: Path, target: Path) -> None:
    """Flush a file to disk and give it the mode of the file that it replaces."""
    with temporary.open("rb+") as stream:
        os.fsync(stream.fileno())
    if target.exists():
        # Take over the permissions alone, not the bits that let others run it as its owner.
        temporary.chmod(target.stat().st_mode & 0o777)


def _sync_folder(folder: Path) -> None:
    """Flush a folder's list of names to disk, where the system can."""
    # Some systems don't open folders; the file itself is on disk by now.
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _publish(temporary: Path, target: Path, *, force: bool) -> None:
    """Give a finished file the name of its target."""
    if force or not _try_hardlink(temporary, target):
        temporary.replace(target)
    # Without this, a power failure may still lose the new name.
    _sync_folder(target.parent)


def _try_hardlink(temporary: Path, target: Path) -> bool:
    """Link a file to its target name; return False if the file system has no hard links.

    Unlike a rename, a link never replaces a file that another process created meanwhile.
    """
    try:
        target.hardlink_to(temporary)
    except OSError:
        if os.path.lexists(target):
            raise _exists_error(target) from None
        return False
    return True


def _names_other_file(error: OSError, target: Path) -> bool:
    """Whether an error names a file outside the target's folder."""
    # Errors of an open file have no name, or the number of its descriptor.
    if not isinstance(error.filename, (str, bytes)):
        return False
    named = Path(os.fsdecode(error.filename))
    return target.parent not in (named, *named.parents)
