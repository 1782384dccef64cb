"""From a file or bytes to an archive, with the map that it may need."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO, TypeAlias

from gpszip.archive.archive import Archive
from gpszip.container.catalog import open_contents, path_opener, stream_opener
from gpszip.container.contents import Contents, MapReference
from gpszip.container.reader import from_bytes
from gpszip.errors import CorruptArchiveError, InputError, MapError

__all__ = ["ArchiveSource", "open_archive"]

#: Files of a folder that are looked at, at most, to find a map.
_MAX_FILES = 1000

#: Where an archive may come from: a path, a binary file that can seek, or bytes.
ArchiveSource: TypeAlias = str | os.PathLike[str] | bytes | BinaryIO


def open_archive(
    source: ArchiveSource,
    map: Archive | ArchiveSource | None = None,
    *,
    beside: str | os.PathLike[str] | None = None,
) -> Archive:
    """Open an archive from a file or from its bytes.

    Of a file beyond a megabyte only the index and the names are read, and then the groups that are
    asked for. Such a file must stay as it is as long as the archive is in use.

    Parameters
    ----------
    source : path, bytes or binary file
        A ``.gpsz`` file, or its bytes. A binary file needs ``seek`` and ``read``.
    map : Archive, path, bytes or binary file, optional
        The known map, for an archive whose walks lie on one. If it isn't given, it is looked for in
        the archive's folder.
    beside : path, optional
        The file from which bytes came, in whose folder a map is looked for.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    MapError
        If another map is given than the one that the walks were written on.
    CorruptArchiveError
        If it is not a complete archive. Bytes that pass all checksums and still are no walks are
        found when they are decoded; so is damage to the groups of a large file.
    """
    contents = _read_contents(source)
    if contents.map is None:
        return Archive(contents)
    if map is not None:
        known_map = map if isinstance(map, Archive) else open_archive(map)
        return Archive(contents, _check_map(known_map, contents.map))

    # Without a map given, look beside the file.
    path = source if isinstance(source, str | os.PathLike) else beside
    return Archive(contents, None if path is None else _find_map_beside(Path(path), contents.map))


def _read_contents(source: ArchiveSource) -> Contents:
    # Bytes are in memory already, so that all of them are checked at once.
    if isinstance(source, bytes):
        return from_bytes(source)
    if isinstance(source, str | os.PathLike):
        try:
            return open_contents(path_opener(source))
        except CorruptArchiveError as error:
            raise error.with_path(source) from error
    return open_contents(stream_opener(source))


def _check_map(map: Archive, wanted: MapReference) -> Archive:
    if map.contents.map is not None:
        raise MapError(
            "the map given lies on another map itself",
            remedy="give an archive that holds its own map",
        )
    if map.hash != wanted.hash:
        raise MapError(
            f"the archive lies on the map {wanted.hash.hex()}, "
            f"and another one, {map.hash.hex()}, was given"
        )
    return map


def _find_map_beside(path: Path, wanted: MapReference) -> Archive | None:
    """Find the map in the archive's folder, if it is there."""
    for other in sorted(path.parent.glob("*.gpsz"))[:_MAX_FILES]:
        # Other files there may be anything, and their hash needs all of their groups.
        try:
            archive = Archive(_read_contents(other))
            if archive.contents.map is None and archive.hash == wanted.hash:
                return archive
        except (InputError, CorruptArchiveError):
            continue
    return None
