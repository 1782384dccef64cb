"""Lines of a map in well-known binary."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from gpszip.io.maps.table import MapTable

__all__ = ["table_wkb"]

#: Type of a LineString in well-known binary.
_LINE_STRING = 2

#: Type of a MultiLineString.
_MULTI_LINE_STRING = 5

#: Added to a type whose points have a z coordinate (ISO).
_WITH_Z = 1000


def table_wkb(table: MapTable) -> NDArray[np.object_]:
    """Return the lines of a map in well-known binary, shape (E,).

    If any line is cut, all are MultiLineStrings, since a layer has one type.
    """
    # Encode all coordinates at once; a fragment is a slice of these bytes.
    coordinates = table.points.astype("<f8").tobytes()
    point_bytes = 8 * table.points.shape[1]
    z_flag = _WITH_Z if table.points.shape[1] == 3 else 0

    # Encode each line from its fragments.
    lines = np.empty(len(table), dtype=object)
    for i, fragments in enumerate(table.fragments):
        # Byte order (1 is little-endian), type, number of points, points.
        encoded = [
            struct.pack("<BII", 1, _LINE_STRING + z_flag, fragment.stop - fragment.start)
            + coordinates[fragment.start * point_bytes : fragment.stop * point_bytes]
            for fragment in fragments
        ]
        if len(table.cuts):
            header = struct.pack("<BII", 1, _MULTI_LINE_STRING + z_flag, len(encoded))
            lines[i] = header + b"".join(encoded)
        else:
            lines[i] = encoded[0]
    return lines
