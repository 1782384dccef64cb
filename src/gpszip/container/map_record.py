"""Which known map an archive's walks lie on."""

from __future__ import annotations

import hashlib

from gpszip.container.contents import MAP_HASH_BYTES, Contents, MapReference
from gpszip.container.grid_record import encode_grid
from gpszip.container.layout import Cursor, encode_varint

__all__ = ["encode_reference", "map_hash", "read_reference"]


def map_hash(contents: Contents) -> bytes:
    """Identify a map by the first bytes of the SHA-256 of an archive's grid and walks.

    Names, kept columns and the form of the file do not matter.
    """
    digest = hashlib.sha256(b"" if contents.grid is None else encode_grid(contents.grid))
    for group in contents.groups:
        # The lengths separate the payloads: the same bytes cut elsewhere are other walks.
        digest.update(
            encode_varint(len(group.payload)) + encode_varint(group.tracks) + group.payload
        )
    return digest.digest()[:MAP_HASH_BYTES]


def encode_reference(reference: MapReference) -> bytes:
    """Hash of the map, then the refinements of its grid."""
    return reference.hash + bytes([reference.refinements])


def read_reference(cursor: Cursor) -> MapReference:
    """Undo :func:`encode_reference`."""
    return MapReference(
        cursor.read_bytes(MAP_HASH_BYTES, "the map's hash"),
        cursor.read_byte("the refinements of its grid"),
    )
