"""Walks on a grid to bytes and back: what an archive stores of its tracks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.ends import code_tail
from gpszip.codec.kernels.range_coder import finish, new_decoder, new_encoder
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, new_model, with_modes
from gpszip.codec.knots import Knots, check_times, concatenate_knots, split_knots
from gpszip.codec.payload_head import (
    FREE_KNOTS,
    KNOTS_PER_BYTE,
    PayloadHead,
    encode_head,
    read_head,
)
from gpszip.codec.prior import Prior
from gpszip.codec.tail_coder import CompiledTailCoder
from gpszip.errors import BoundError, CorruptArchiveError
from gpszip.model import GridWalks, QuantisationGrid

__all__ = [
    "decode",
    "encode",
    "encode_in_modes",
    "encode_with_statistics",
]

#: Coordinates (in space steps) and times (in time steps) have absolute values below this.
_MAX_SIZE = 1 << 45


def encode(walks: GridWalks, prior: Prior | None = None) -> bytes:
    """Encode walks with an adaptive model.

    Parameters
    ----------
    walks : GridWalks
        Each walk has at least one knot; nodes are numbered in the order of their first visit.
    prior : Prior, optional
        Walks that the decoder has, too; their nodes come first in ``walks.nodes``, visited or not.

    Returns
    -------
    bytes
        A varint of the number of knots times 4 plus flags (1: times, 2: gaps), then the bytes of
        the range coder.

    Raises
    ------
    BoundError
        If a coordinate or time is 2**45 steps or more from the origin, which no decoder takes.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1, 0], np.int32), np.array([0, 9, 18]), np.zeros(2, bool))
    >>> data = encode(GridWalks(np.array([[0, 0], [30, 4]]), (walk,)))
    >>> decode(data, dimension=2, tracks=1).walks[0].time_steps.tolist()
    [0, 9, 18]
    """
    return encode_with_statistics(walks, prior)[0]


def encode_with_statistics(
    walks: GridWalks, prior: Prior | None = None
) -> tuple[bytes, NDArray[np.float64]]:
    """Encode walks as :func:`encode` does, and return what the bits were spent on.

    Returns
    -------
    bytes
        What :func:`decode` reads.
    float64 array, shape (13, 2)
        Bits, and how often they were spent, by the rows of ``WalkModel.statistics``.
    """
    data, model = encode_in_modes(walks, prior, 0, np.zeros(0))
    return data, model.statistics


def encode_in_modes(
    walks: GridWalks,
    prior: Prior | None,
    modes: int,
    step_bits: NDArray[np.float64],
    grid: QuantisationGrid | None = None,
) -> tuple[bytes, WalkModel]:
    """Encode walks in some of the modes ``SORTED_STARTS``, ``TIME_FIRST`` and ``SHORTEST_PATHS``.

    Parameters
    ----------
    walks : GridWalks
        As :func:`encode` takes them; ``SORTED_STARTS`` takes times and at most
        ``MAX_SORTED_TRACKS`` tracks.
    prior : Prior or None
        As :func:`encode` takes it.
    modes : int
        A sum of modes.
    step_bits : float64 array, shape (K,) or (0,)
        Bits of the step to each of the K knots: filled in without ``SHORTEST_PATHS``, needed with
        it.
    grid : QuantisationGrid, optional
        Epoch and time step, for the ends of pieces; these are not coded without it.

    Returns
    -------
    bytes
        What :func:`decode` reads.
    WalkModel
        The model after the walks.
    """
    # Refuse coordinates and times beyond the largest that the format holds.
    knots = concatenate_knots(walks)
    if max(_largest(walks.nodes), _largest(knots.time_steps)) >= _MAX_SIZE:
        raise BoundError(
            "positions or times lie too far apart for so fine a grid; allow a larger error"
        )

    # Encode, in a longer buffer where the bytes did not fit.
    capacity = 64 + 16 * len(knots.nodes) + 16 * walks.nodes.size
    payload, model = _encode_knots(walks, knots, prior, modes, step_bits, grid, capacity)
    while payload is None:
        capacity *= 4
        payload, model = _encode_knots(walks, knots, prior, modes, step_bits, grid, capacity)

    # The head, and zeros up to the bytes that so many knots must have.
    head = PayloadHead(modes, len(knots.nodes), walks.timed, bool(knots.gaps.any()))
    # Well predicted walks may take less than a byte for 512 knots, which a reader would refuse. Two
    # minus signs round the quotient up. A decoder reads zeros past the end in any case.
    min_bytes = -(-(len(knots.nodes) - FREE_KNOTS) // KNOTS_PER_BYTE)
    return encode_head(head) + payload + bytes(max(min_bytes - len(payload), 0)), model


def _encode_knots(
    walks: GridWalks,
    knots: Knots,
    prior: Prior | None,
    modes: int,
    step_bits: NDArray[np.float64],
    grid: QuantisationGrid | None,
    capacity: int,
) -> tuple[bytes | None, WalkModel]:
    """Bytes of the range coder, None if there are more than ``capacity``, and the model."""
    # In the mode of sorted starts these precede the knots; other modes ignore them.
    starts = np.sort(knots.time_steps[knots.begins == 1])
    model = _new_model(len(knots.nodes), walks.nodes.shape[1], prior)
    model = with_modes(model, modes, starts, step_bits)
    # The coder takes the position of a new node from here, when the walk first visits it.
    model.places[: len(walks.nodes)] = walks.nodes
    coder = new_encoder(capacity)
    code_walks(coder, model, *knots, len(walks.walks), walks.timed, bool(knots.gaps.any()))
    if grid is not None and walks.timed:
        code_tail(CompiledTailCoder(coder), walks, grid)
    return finish(coder), model


def decode(
    data: bytes,
    dimension: int,
    tracks: int,
    prior: Prior | None = None,
    grid: QuantisationGrid | None = None,
) -> GridWalks:
    """Decode what :func:`encode` wrote.

    Parameters
    ----------
    data : bytes
        Untrusted bytes; memory stays below about 130 kB for each of them, plus 1 MB and what the
        prior takes.
    dimension, tracks : int
        Number of coordinates and of tracks.
    prior : Prior, optional
        The walks after which these were written; its nodes come first in those returned.
    grid : QuantisationGrid, optional
        Epoch and time step of walks that were written with the ends of their pieces.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no walks of so many tracks.
    """
    # The head, and arrays for the knots.
    head, payload = read_head(data, tracks)
    model = _new_model(head.knots, dimension, prior)
    model = with_modes(model, head.modes, np.zeros(tracks, np.int64), np.zeros(0))
    knots = Knots(
        np.zeros(head.knots, np.int64),
        np.zeros(head.knots, np.int64),
        np.zeros(head.knots, np.int8),
        np.zeros(head.knots, np.int8),
    )

    # The knots.
    coder = new_decoder(payload)
    nodes = int(code_walks(coder, model, *knots, tracks, head.timed, head.gapped))
    if nodes < 0:
        raise CorruptArchiveError("the walks end before all tracks are read")
    if head.timed:
        check_times(knots)

    # The tail.
    # The copy lets go of the model, whose capacity is a node for each knot.
    walks = GridWalks(model.places[:nodes].copy(), split_knots(knots), head.timed)
    if grid is None or not head.timed:
        return walks
    return code_tail(CompiledTailCoder(coder), walks, grid)


def _new_model(knots: int, dimension: int, prior: Prior | None) -> WalkModel:
    """The model before the first of ``knots`` knots, trained on a prior if there is one."""
    return new_model(knots, dimension) if prior is None else prior.model(knots)


def _largest(values: NDArray[np.int64]) -> int:
    """Largest absolute value; 0 if there is none."""
    return int(np.abs(values).max()) if values.size else 0
