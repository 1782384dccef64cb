"""Open the archives that commands read, from a file or from standard input."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = [
    "explain_corruption",
    "open_archive_bytes",
    "open_archive_file",
    "open_map_file",
    "read_archive_bytes",
    "read_decoded_archive",
]

#: Bits of an archive's third byte that hold the version of its format.
_VERSION_MASK = 7


def read_archive_bytes(name: str) -> bytes:
    """Read all bytes of an archive; ``-`` is standard input.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    """
    from gpszip.container.reader import read_file
    from gpszip.errors import InputError

    if name != "-":
        return read_file(name)
    try:
        return sys.stdin.buffer.read()
    except OSError as error:
        raise InputError(
            f"can't be read: {error.strerror or error}", path="standard input", remedy="is it open?"
        ) from None


@contextmanager
def open_archive_file(name: str, map_name: str | None = None) -> Iterator[Archive]:
    """Open an archive; ``-`` is standard input.

    Parameters
    ----------
    name : str
        Name of the file.
    map_name : str, optional
        Name of the archive that holds its map, if it has none of its own.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    CorruptArchiveError
        If it is damaged or incomplete, even if that shows only when it is used. The message begins
        with the name.
    MapError
        If ``map_name`` is not its map; without a map, once it is needed.
    """
    data = read_archive_bytes(name)
    # The caller's block runs inside: walks are decoded when they are used, and damage shows then.
    with explain_corruption(name, data):
        yield open_archive_bytes(name, data, map_name)


def read_decoded_archive(name: str, map_name: str | None = None) -> Archive:
    """Read and decode an archive, for commands on several: an error names the one that is corrupt.

    Parameters and errors are those of :func:`open_archive_file`.
    """
    with open_archive_file(name, map_name) as archive:
        if archive.ids and (archive.contents.map is None or archive.map is not None):
            # Properties are decoded when they are used.
            _ = archive.walks, archive.road_map
            if archive.kept_columns is not None:
                archive.sample_times(archive.ids[0])
        return archive


def open_archive_bytes(name: str, data: bytes, map_name: str | None) -> Archive:
    """Open an archive from the bytes of its file, see :func:`open_archive_file`."""
    from gpszip.archive import open_archive

    # A map that isn't named is looked for in the folder of the file; standard input has none.
    archive_of_map = None if map_name is None else open_map_file(map_name)
    return open_archive(data, archive_of_map, beside=None if name == "-" else name)


def open_map_file(name: str) -> Archive:
    """Open an archive whose map other archives use."""
    from gpszip.archive import open_archive

    data = read_archive_bytes(name)
    with explain_corruption(name, data):
        return open_archive(data)


@contextmanager
def explain_corruption(name: str, data: bytes, *, recovering: bool = False) -> Iterator[None]:
    """Add to a CorruptArchiveError which archive is corrupt, and what to do.

    ``recovering`` says that ``gpszip recover`` itself failed, so that it can't be the advice.
    """
    from gpszip.container.layout import MAGIC, VERSION, Form
    from gpszip.errors import CorruptArchiveError

    # Choose the remedy by what the bytes show: no archive, a newer version, or damage.
    try:
        yield
    except CorruptArchiveError as error:
        remedy = "fetch or make it again"
        if not data.startswith(MAGIC):
            remedy = "name a file that gpszip compress has written"
        elif data[2:3] and data[2] & _VERSION_MASK > VERSION:
            remedy = "pip install --upgrade gpszip brings the newest"
        elif not recovering and data[2:3] and data[2] >> 3 & 3 == Form.SECTIONS:
            # An archive in sections has a checksum for each group of walks.
            remedy += ", or save its intact parts with gpszip recover"
        where = "standard input" if name == "-" else name
        raise CorruptArchiveError(error.reason, path=where, remedy=remedy) from error
