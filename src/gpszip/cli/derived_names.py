"""Names of outputs where a command gives none: beside the input, with another ending."""

from __future__ import annotations

import os
from collections.abc import Sequence

__all__ = ["derive_output"]

#: Endings of packed files, which stand behind that of the format.
_PACKED = (".gz", ".zip")

#: Letters of a pattern, which stands for many files.
_PATTERN = "*?["


def derive_output(inputs: Sequence[str], ending: str) -> str | None:
    """Name of an output that is made of one file or folder.

    Parameters
    ----------
    inputs : sequence of str
        What the command reads.
    ending : str
        What stands in place of the input's suffix.

    Returns
    -------
    str or None
        A name in the folder of the input; None for standard input, URLs, patterns and several
        inputs, for which no name is obvious.

    Examples
    --------
    >>> derive_output(["rides/walk.gpx"], ".gpsz"), derive_output(["rides/"], ".gpsz")
    ('rides/walk.gpsz', 'rides.gpsz')
    >>> derive_output(["walk.csv.gz"], ".gpsz"), derive_output(["a.gpx", "b.gpx"], ".gpsz")
    ('walk.gpsz', None)
    """
    # One file or folder.
    if len(inputs) != 1:
        return None
    name = inputs[0].rstrip("/" + os.sep)
    if name in ("", "-", ".", "..") or "://" in name or any(letter in name for letter in _PATTERN):
        return None

    # Without its suffix, and that of what it is packed with.
    stem, suffix = os.path.splitext(name)  # noqa: PTH122  # keeps ./ and .. as they were given
    if suffix.lower() in _PACKED:
        stem, _ = os.path.splitext(stem)  # noqa: PTH122
    return stem + ending
