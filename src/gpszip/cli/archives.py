"""Archives that commands take: from a file or from standard input."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = ["archive_bytes", "naming", "opened"]

#: Bits of an archive's third byte that tell the version of its format.
_VERSION_BITS = 7


def archive_bytes(name: str) -> bytes:
    """All bytes of the archive with this name; ``-`` is standard input.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    """
    from gpszip.container.reader import read_file

    return sys.stdin.buffer.read() if name == "-" else read_file(name)


@contextmanager
def opened(name: str) -> Iterator[Archive]:
    """Open the archive with this name; ``-`` is standard input.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    CorruptArchiveError
        If it is no whole archive, also when that shows only in its use; the message begins with the name.
    """
    from gpszip.archive import open_archive

    data = archive_bytes(name)
    with naming(name, data):
        yield open_archive(data)


@contextmanager
def naming(name: str, data: bytes) -> Iterator[None]:
    """Say in the message of a CorruptArchiveError which archive is corrupt, and what to do."""
    from gpszip.container.layout import MAGIC, SMALL_LIMIT, VERSION
    from gpszip.errors import CorruptArchiveError

    try:
        yield
    except CorruptArchiveError as error:
        cure = "fetch or make it again"
        if not data.startswith(MAGIC):
            cure = "name a file that gpszip compress has written"
        elif data[2:3] and data[2] & _VERSION_BITS > VERSION:
            cure = "pip install --upgrade gpszip brings the newest"
        elif len(data) >= SMALL_LIMIT:
            cure += ", or save what is whole with gpszip recover"
        raise CorruptArchiveError(f"{'standard input' if name == '-' else name}: {error}; {cure}") from error
