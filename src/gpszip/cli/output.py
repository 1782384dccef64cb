"""Where results go: a file or standard output for data, standard error for words."""

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
    "print_json",
    "print_status",
    "write_archive",
    "write_archive_and_map",
]

STDOUT = "-"


def check_output(target: str, *, force: bool, binary: bool = False) -> None:
    """Refuse, before any work is done, an output that can't or must not be written.

    Raises
    ------
    OutputError
        If the file exists and ``force`` is not given, its folder can't be written to, or binary data would go to a terminal.
    """
    if target == STDOUT:
        if binary and sys.stdout.isatty():
            raise OutputError(
                "standard output: an archive is no text for a terminal; name a file with -o or redirect with > FILE"
            )
        return
    path = Path(target)
    if path.is_dir():
        raise OutputError(
            f"{target}: is a folder; name a file in it, such as -o {path / ('out.gpsz' if binary else 'out.csv')}"
        )
    if path.exists() and not path.is_file():
        raise OutputError(
            f"{target}: is no regular file and can't be replaced; name a file, or - for standard output"
        )
    if path.exists() and not force:
        raise OutputError(
            f"{target}: exists already; add --force to replace it, or name another file with -o"
        )
    _check_folder(Path(os.path.realpath(path)).parent)


def _check_folder(folder: Path) -> None:
    """Create a folder in it and remove that again: the only test that all file systems and users answer truly."""
    if not folder.is_dir():
        reason = (
            "is a file, not a folder; name another one with -o"
            if folder.exists()
            else "no such folder; make it first or name another one"
        )
        raise OutputError(f"{folder}: {reason}")
    try:
        with temporary_folder(folder, OUTPUT_PREFIX):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: can't write to this folder ({error.strerror}); name another one with -o"
        ) from error


def write_archive(target: str, archive: Archive, *, force: bool) -> None:
    """Save an archive to a file or put it on standard output."""
    from gpszip.container.writer import write
    from gpszip.io.storage.sink import open_sink

    if target != STDOUT:
        archive.save(target, force=force)
        return
    with open_sink(STDOUT) as stream:
        write(archive.contents, stream)


def write_archive_and_map(
    target: str, archive: Archive, map_target: str, updated_map: Archive
) -> None:
    """Write an archive and a renewed map so that neither takes its place before both are on disk; both may replace files."""
    from gpszip.container.writer import write
    from gpszip.files.atomic_write import atomic_write_all
    from gpszip.files.os_errors import as_output_error

    if STDOUT in (target, map_target):
        write_archive(target, archive, force=True)
        write_archive(map_target, updated_map, force=True)
        return
    with atomic_write_all([target, map_target]) as parts:
        for name, part, one in zip(
            (target, map_target), parts, (archive, updated_map), strict=True
        ):
            with as_output_error(name), part.open("wb") as file:
                write(one.contents, file)


def print_status(text: str) -> None:
    """One line for the person, who reads standard error; standard output carries data only."""
    # where nobody listens, the exit code still tells
    with contextlib.suppress(OSError):
        click.echo(text, err=True)


def print_json(value: Any, *, err: bool = False) -> None:
    """One line of strict JSON: numbers that it has no word for become null.

    It is UTF-8 whatever the locale. Bytes of file names that are no UTF-8 are escaped as lone surrogates, as in Python.
    """
    line = json.dumps(_to_strict_json(value), ensure_ascii=False).encode(
        "utf-8", "backslashreplace"
    )
    with contextlib.suppress(OSError) if err else contextlib.nullcontext():
        click.echo(line, err=err)


def _to_strict_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _to_strict_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_strict_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
