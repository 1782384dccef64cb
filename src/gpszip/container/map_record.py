"""Which map an archive's walks lie on, where it is kept elsewhere."""

from __future__ import annotations

import hashlib

from gpszip.container.contents import MAP_HASH_BYTES, Contents, MapReference
from gpszip.container.frame_record import frame_bytes
from gpszip.container.layout import Cursor, varint

__all__ = ["map_hash", "read_reference", "reference_bytes"]


def map_hash(contents: Contents) -> bytes:
    """Name of a map: the first bytes of the SHA-256 of the archive's frame and walks.

    Neither names nor kept columns nor the form of the file matter.
    """
    whole = hashlib.sha256(b"" if contents.frame is None else frame_bytes(contents.frame))
    for group in contents.groups:
        whole.update(varint(len(group.payload)) + varint(group.tracks) + group.payload)
    return whole.digest()[:MAP_HASH_BYTES]


def reference_bytes(reference: MapReference) -> bytes:
    """Hash of the map, then how often its quanta are halved."""
    return reference.hash + bytes([reference.halvings])


def read_reference(cursor: Cursor) -> MapReference:
    """Undo :func:`reference_bytes`."""
    return MapReference(cursor.take(MAP_HASH_BYTES, "the map's hash"), cursor.byte("the halvings of its quanta"))
