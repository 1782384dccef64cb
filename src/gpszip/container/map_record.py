"""Which map an archive's walks lie on, where it is kept elsewhere."""

from __future__ import annotations

import hashlib

from gpszip.container.contents import MAP_HASH_BYTES, Contents, MapReference
from gpszip.container.grid_record import encode_grid
from gpszip.container.layout import Cursor, encode_varint

__all__ = ["encode_reference", "map_hash", "read_reference"]


def map_hash(contents: Contents) -> bytes:
    """Name of a map: the first bytes of the SHA-256 of the archive's frame and walks.

    Neither names nor kept columns nor the form of the file matter.
    """
    whole = hashlib.sha256(b"" if contents.grid is None else encode_grid(contents.grid))
    for group in contents.groups:
        whole.update(
            encode_varint(len(group.payload)) + encode_varint(group.tracks) + group.payload
        )
    return whole.digest()[:MAP_HASH_BYTES]


def encode_reference(reference: MapReference) -> bytes:
    """Hash of the map, then how often its quanta are halved."""
    return reference.hash + bytes([reference.refinements])


def read_reference(cursor: Cursor) -> MapReference:
    """Undo :func:`encode_reference`."""
    return MapReference(
        cursor.read_bytes(MAP_HASH_BYTES, "the map's hash"),
        cursor.read_byte("the halvings of its quanta"),
    )
