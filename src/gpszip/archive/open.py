"""From a file or bytes to an archive, with the map that it may need."""

from __future__ import annotations

import os
from pathlib import Path

from gpszip.archive.archive import Archive
from gpszip.container.contents import MapReference
from gpszip.container.reader import from_bytes, load
from gpszip.errors import CorruptArchiveError, InputError, MapError

__all__ = ["open_archive"]

#: At most so many files of a folder are looked at to find a map.
_MAX_FILES = 1000


def open_archive(
    source: str | os.PathLike[str] | bytes,
    map: Archive | str | os.PathLike[str] | bytes | None = None,
    *,
    beside: str | os.PathLike[str] | None = None,
) -> Archive:
    """Open an archive from a file or from its bytes.

    Parameters
    ----------
    source : path or bytes
        A ``.gpsz`` file or all that is in it.
    map : Archive, path or bytes, optional
        The map, for an archive whose walks lie on one that is kept elsewhere. It is looked for in the archive's folder if it
        isn't given.
    beside : path, optional
        The file from which bytes came, in whose folder a map is looked for.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    MapError
        If another map is given than the one that the walks were written on.
    CorruptArchiveError
        If it is no whole archive. Bytes that pass all checksums and still are no walks are found when they are decoded.
    """
    contents = from_bytes(source) if isinstance(source, bytes) else load(Path(source))
    if contents.map is None:
        return Archive(contents)
    if map is None:
        place = beside if isinstance(source, bytes) else source
        return Archive(
            contents, None if place is None else _find_map_beside(Path(place), contents.map)
        )
    return Archive(
        contents, _check_map(map if isinstance(map, Archive) else open_archive(map), contents.map)
    )


def _check_map(found: Archive, wanted: MapReference) -> Archive:
    if found.contents.map is not None:
        raise MapError(
            "the map given lies on another map itself; give one that holds its own walks"
        )
    if found.hash != wanted.hash:
        raise MapError(
            f"the archive lies on the map {wanted.hash.hex()}, and another one, {found.hash.hex()}, was given"
        )
    return found


def _find_map_beside(path: Path, wanted: MapReference) -> Archive | None:
    """The map that lies in the archive's folder, if it does."""
    for other in sorted(path.parent.glob("*.gpsz"))[:_MAX_FILES]:
        try:
            found = Archive(load(other))
        except (InputError, CorruptArchiveError):
            continue
        if found.contents.map is None and found.hash == wanted.hash:
            return found
    return None
