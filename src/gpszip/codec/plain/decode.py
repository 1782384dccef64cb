"""Walks from a small payload, in plain Python."""

from __future__ import annotations

from gpszip.codec.ends import code_tail
from gpszip.codec.knots import check_times, split_knots
from gpszip.codec.payload_head import read_head
from gpszip.codec.plain.model import PlainModel
from gpszip.codec.plain.range_decoder import RangeDecoder
from gpszip.codec.plain.tail import PlainTailCoder
from gpszip.codec.plain.walk_decoder import read_knots
from gpszip.codec.plain.work import WorkLimit
from gpszip.model import GridWalks, QuantisationGrid

__all__ = ["decode_plain"]


def decode_plain(
    data: bytes,
    dimension: int,
    tracks: int,
    grid: QuantisationGrid | None,
    work: WorkLimit,
) -> GridWalks:
    """Decode what :func:`gpszip.codec.walks.encode` wrote without a prior.

    Parameters
    ----------
    data : bytes
        Untrusted bytes.
    dimension, tracks : int
        Number of coordinates and of tracks.
    grid : QuantisationGrid or None
        Epoch and time step of walks that were written with the ends of their pieces.
    work : WorkLimit
        What may be done.

    Returns
    -------
    GridWalks
        The same as :func:`gpszip.codec.walks.decode` gives.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no walks of so many tracks.
    TooMuchWorkError
        If they take more work than that.

    Examples
    --------
    >>> walks = decode_plain(bytes.fromhex("05efbdc0"), 2, 1, None, WorkLimit(1000))
    >>> walks.nodes.tolist(), walks.walks[0].time_steps.tolist()
    ([[3, -4]], [7])
    """
    # The head and the knots.
    head, payload = read_head(data, tracks)
    decoder = RangeDecoder(payload)
    model = PlainModel(decoder, dimension, head.timed, head.modes, work)
    knots = read_knots(model, head.knots, tracks, head.gapped)
    if head.timed:
        check_times(knots)

    # The tail.
    walks = GridWalks(model.map.places.copy(), split_knots(knots), head.timed)
    if grid is None or not head.timed:
        return walks
    return code_tail(PlainTailCoder(decoder, work), walks, grid)
