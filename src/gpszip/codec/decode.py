"""Walks from bytes, by the decoder that is faster: plain for small payloads, compiled for others.

Loading the compiled decoder takes a second, and compiling it for the first time a minute. Nothing
of it is imported until a payload needs it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from gpszip.codec.plain.decode import decode_plain
from gpszip.codec.plain.work import TooMuchWorkError, WorkLimit
from gpszip.model import GridWalks, QuantisationGrid

if TYPE_CHECKING:
    from gpszip.codec.prior import Prior

__all__ = ["decode_walks"]

#: The compiled decoder.
_COMPILED = "gpszip.codec.walks"

#: Payloads of at most so many bytes are decoded plainly. A kilobyte takes 0.13 s, and loading the
#: compiled decoder 0.9 s.
_MAX_PLAIN_BYTES = 1 << 14

#: Work of the plain decoder in one process, in distributions that it evaluates: 3 s. A payload of
#: 6 kB takes 1.3 million. A process that decodes more loads the compiled decoder.
_PLAIN_WORK = WorkLimit(5_000_000)


def decode_walks(
    data: bytes,
    dimension: int,
    tracks: int,
    prior: Prior | None = None,
    grid: QuantisationGrid | None = None,
) -> GridWalks:
    """Decode what :func:`gpszip.codec.walks.encode` wrote; parameters and errors are its decoder's.

    Examples
    --------
    >>> walks = decode_walks(bytes.fromhex("05efbdc0"), 2, 1)
    >>> walks.nodes.tolist(), walks.walks[0].time_steps.tolist()
    ([[3, -4]], [7])
    """
    # A prior trains the compiled model only.
    if prior is None and len(data) <= _MAX_PLAIN_BYTES and _COMPILED not in sys.modules:
        try:
            return decode_plain(data, dimension, tracks, grid, _PLAIN_WORK)
        # Nothing was returned yet: the compiled decoder begins with the same bytes again.
        except TooMuchWorkError:
            pass

    from gpszip.codec.walks import decode

    return decode(data, dimension, tracks, prior, grid)
