"""The lines of the clean map of an archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive

__all__ = ["archive_lines"]


def archive_lines(archive: Archive) -> list[NDArray[np.float64]]:
    """Return the vertices of each edge of the clean map, in metres."""
    clean = archive.clean_map()
    return [clean[edge] for edge in range(len(clean))]
