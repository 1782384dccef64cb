"""Write results: data to a file or standard output, messages to standard error."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.errors import OutputError
from gpszip.files.temporary import OUTPUT_PREFIX, temporary_folder

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = [
    "STDOUT",
    "check_output",
    "make_folder",
    "print_json",
    "print_status",
    "write_archive",
    "write_archive_and_map",
]

#: What -o says for standard output.
STDOUT = "-"


def check_output(target: str, *, force: bool, binary: bool = False, in_place: bool = False) -> None:
    """Refuse an output that can't or must not be written, before any work is done.

    Parameters
    ----------
    target : str
        The output; ``-`` is standard output.
    force : bool
        Replace an existing file.
    binary : bool
        Whether the output is no text.
    in_place : bool
        Whether the output may replace an input of the command: it holds what that held.

    Raises
    ------
    OutputError
        If the file exists and ``force`` is not given, it is an input, its folder can't be written
        to, or binary data would go to a terminal.
    """
    # Standard output.
    if target == STDOUT:
        if binary and sys.stdout.isatty():
            raise OutputError(
                "an archive is no text for a terminal",
                path="standard output",
                remedy="name a file with -o or redirect with > FILE",
            )
        return

    # An existing file, or what is no file.
    path = Path(target)
    if path.is_dir():
        example = path / ("out.gpsz" if binary else "out.csv")
        raise OutputError(
            "is a folder", path=target, remedy=f"name a file in it, such as -o {example}"
        )
    if path.exists() and not path.is_file():
        raise OutputError(
            "is no regular file and can't be replaced",
            path=target,
            remedy="name a file, or - for standard output",
        )
    if path.exists() and not force:
        raise OutputError(
            "exists already",
            path=target,
            remedy="add --force to replace it, or name another file with -o",
        )
    if path.exists() and not in_place and _is_input(path):
        raise OutputError(
            "is an input, which would be lost",
            path=target,
            remedy="name another file with -o",
        )

    # The folder; of a link, that of the file to which it leads.
    _check_folder(Path(os.path.realpath(path)).parent)


def _is_input(path: Path) -> bool:
    """Whether an argument of the command that runs names this file."""
    context = click.get_current_context(silent=True)
    if context is None:
        return False
    arguments = [each.name for each in context.command.params if isinstance(each, click.Argument)]
    values = [context.params.get(name or "") for name in arguments]
    names = [name for value in values for name in (value if isinstance(value, tuple) else (value,))]
    return any(isinstance(name, str) and _is_same_file(name, path) for name in names)


def _is_same_file(name: str, path: Path) -> bool:
    try:
        return path.samefile(name)
    except (OSError, ValueError):  # a URL, a pattern, or a name that no file can have
        return False


def _check_folder(folder: Path) -> None:
    """Refuse a folder in which no file can be written.

    To make a folder in it and remove it again is the one test that holds on all file systems and
    for all users.
    """
    # Say whether the folder is missing or is a file, which have different remedies.
    if not folder.is_dir():
        reason = (
            "is a file, not a folder; name another one with -o"
            if folder.exists()
            else "no such folder; make it first or name another one"
        )
        raise OutputError(reason, path=folder)

    # Try it.
    try:
        with temporary_folder(folder, OUTPUT_PREFIX):
            pass
    except OSError as error:
        raise OutputError(
            f"can't write to this folder ({error.strerror})",
            path=folder,
            remedy="name another one with -o",
        ) from error


def write_archive(target: str, archive: Archive, *, force: bool) -> None:
    """Write an archive to a file or to standard output."""
    from gpszip.container.writer import write
    from gpszip.io.storage.sink import open_sink

    if target != STDOUT:
        archive.save(target, force=force)
        return

    # A pipe takes the archive as it comes; there is no file to be replaced at the end.
    with open_sink(STDOUT) as stream:
        write(archive.contents, stream)


def write_archive_and_map(
    target: str, archive: Archive, map_target: str, updated_map: Archive
) -> None:
    """Write an archive and its updated map.

    Neither appears before both are on disk. Both may replace files.
    """
    from gpszip.container.writer import write
    from gpszip.files.atomic_write import atomic_write_all
    from gpszip.files.os_errors import as_output_error

    # A stream can't wait for a file: what is written to it is gone.
    if STDOUT in (target, map_target):
        write_archive(target, archive, force=True)
        write_archive(map_target, updated_map, force=True)
        return
    names = (target, map_target)
    with atomic_write_all([target, map_target]) as temporary_paths:
        for name, path, written in zip(names, temporary_paths, (archive, updated_map), strict=True):
            with as_output_error(name), path.open("wb") as file:
                write(written.contents, file)


def make_folder(folder: Path, option: str) -> None:
    """Make the folder that is to hold the files of a command, unless it is there.

    Parameters
    ----------
    folder : Path
        The folder.
    option : str
        The option that names it, for the message.

    Raises
    ------
    OutputError
        If it can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"can't be made ({error.strerror})",
            path=folder,
            remedy=f"name another folder with {option}",
        ) from error


def print_status(text: str) -> None:
    """Print a line for a person on standard error; standard output is for data only."""
    # If standard error is closed, the exit code still says how the command ended.
    with contextlib.suppress(OSError):
        click.echo(text, err=True)


def print_json(value: Any, *, err: bool = False) -> None:
    """Print a line of strict JSON, in which NaN and infinite numbers are null.

    It is UTF-8 whatever the locale. Bytes of file names that are not UTF-8 are escaped as lone
    surrogates, as in Python.
    """
    # Bytes, since a text would be encoded once more by the locale, which may not know all letters.
    line = json.dumps(_to_strict_json(value), ensure_ascii=False).encode(
        "utf-8", "backslashreplace"
    )

    # Results that can't be written are an error; remarks on standard error are not.
    with contextlib.suppress(OSError) if err else contextlib.nullcontext():
        click.echo(line, err=err)


def _to_strict_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _to_strict_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_strict_json(item) for item in value]
    # json.dumps writes NaN and Infinity, which are no JSON.
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
