"""Walks on a grid to bytes and back: what an archive stores of its tracks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.ends import code_tail
from gpszip.codec.kernels.range_coder import finish, new_decoder, new_encoder
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import (
    SHORTEST_PATHS,
    SORTED_STARTS,
    TIME_FIRST,
    WalkModel,
    new_model,
    with_modes,
)
from gpszip.codec.knots import Knots, concatenate_knots
from gpszip.codec.prior import Prior
from gpszip.errors import BoundError, CorruptArchiveError
from gpszip.model import GridWalk, GridWalks, QuantisationGrid

__all__ = [
    "MAX_SORTED_TRACKS",
    "decode",
    "encode",
    "encode_in_modes",
    "encode_with_statistics",
    "number_by_visit",
]

#: Starts of at most this many tracks are sorted: taking one counts those passed over.
MAX_SORTED_TRACKS = 4096

#: Flags in the first number, below the number of knots: there are times, there are gaps.
_TIMED = 1
_GAPPED = 2
_FLAG_BITS = 2

#: The first number is at least this, since there is a knot: a first byte below it names modes.
_FIRST_VARINT = 4

#: A number takes at most this many bytes.
_VARINT_BYTES = 9

#: A payload holds at most this many knots for each byte, and some more, so that forged counts
#: cannot ask for memory.
_KNOTS_PER_BYTE = 512
_FREE_KNOTS = 4096

#: Coordinates (in space steps) and times (in time steps) have absolute values below this.
_MAX_SIZE = 1 << 45


def number_by_visit(walks: GridWalks, known: int = 0) -> GridWalks:
    """Number the nodes in the order in which the walks first visit them; drop those not visited.

    Parameters
    ----------
    walks : GridWalks
        Numbered in any way.
    known : int, default 0
        The first ``known`` nodes keep their numbers, visited or not.

    Examples
    --------
    >>> import numpy as np
    >>> walk = GridWalk(np.array([2, 0], np.int32), np.array([0, 1]), np.array([False]))
    >>> numbered = number_by_visit(GridWalks(np.array([[5, 5], [6, 6], [7, 7]]), (walk,)))
    >>> numbered.nodes.tolist(), numbered.walks[0].nodes.tolist()
    ([[7, 7], [5, 5]], [0, 1])
    """
    # order the nodes by first visit
    visits = np.zeros(0, np.int32)
    if walks.walks:
        visits = np.concatenate([walk.nodes for walk in walks.walks])
    visited, first = np.unique(visits[visits >= known], return_index=True)
    order = np.append(np.arange(known), visited[np.argsort(first)])

    # renumber the walks
    numbers = np.full(len(walks.nodes), -1, np.int32)
    numbers[order] = np.arange(len(order), dtype=np.int32)
    renumbered = tuple(
        GridWalk(numbers[walk.nodes], walk.time_steps, walk.gaps) for walk in walks.walks
    )
    return replace(walks, nodes=walks.nodes[order], walks=renumbered)


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

    # encode, in a longer buffer where the bytes did not fit
    capacity = 64 + 16 * len(knots.nodes) + 16 * walks.nodes.size
    payload, model = _encode_knots(walks, knots, prior, modes, step_bits, grid, capacity)
    while payload is None:
        capacity *= 4
        payload, model = _encode_knots(walks, knots, prior, modes, step_bits, grid, capacity)

    # the head, and zeros up to the bytes that so many knots must have
    flags = _TIMED * walks.timed + _GAPPED * bool(knots.gaps.any())
    head = _mode_bytes(modes) + _encode_varint((len(knots.nodes) << _FLAG_BITS) + flags)
    min_bytes = -(-(len(knots.nodes) - _FREE_KNOTS) // _KNOTS_PER_BYTE)
    return head + payload + bytes(max(min_bytes - len(payload), 0)), model


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
    starts = np.sort(knots.time_steps[knots.begins == 1])
    model = _new_model(len(knots.nodes), walks.nodes.shape[1], prior)
    model = with_modes(model, modes, starts, step_bits)
    model.places[: len(walks.nodes)] = walks.nodes
    coder = new_encoder(capacity)
    code_walks(coder, model, *knots, len(walks.walks), walks.timed, bool(knots.gaps.any()))
    if grid is not None and walks.timed:
        code_tail(coder, walks, grid)
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
    # the head: modes, flags and the number of knots, which must be plausible
    modes, data = _read_modes(data) if tracks else (0, data)
    number, size = _read_varint(data)
    payload = data[size:]
    count = number >> _FLAG_BITS
    timed, gapped = bool(number & _TIMED), bool(number & _GAPPED)
    if (
        count > _FREE_KNOTS + _KNOTS_PER_BYTE * len(payload)
        or count < tracks
        or (tracks == 0) != (count == 0)
    ):
        raise CorruptArchiveError(
            f"{count} knots of {tracks} tracks can't lie in {len(payload)} bytes of walks"
        )
    if modes & SORTED_STARTS and not (timed and tracks <= MAX_SORTED_TRACKS):
        raise CorruptArchiveError("starts of tracks can't be sorted here")

    # the knots
    model = _new_model(count, dimension, prior)
    model = with_modes(model, modes, np.zeros(tracks, np.int64), np.zeros(0))
    knots = Knots(
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count, np.int8),
        np.zeros(count, np.int8),
    )
    coder = new_decoder(payload)
    nodes = int(code_walks(coder, model, *knots, tracks, timed, gapped))
    if nodes < 0:
        raise CorruptArchiveError("the walks end before all tracks are read")
    if timed and (np.diff(knots.time_steps)[knots.begins[1:] == 0] <= 0).any():
        raise CorruptArchiveError("times of the walks go back")

    # the tail
    walks = GridWalks(model.places[:nodes].copy(), _split_knots(knots), timed)
    return code_tail(coder, walks, grid) if grid is not None and timed else walks


def _split_knots(knots: Knots) -> tuple[GridWalk, ...]:
    """Undo :func:`concatenate_knots`."""
    bounds = np.append(np.flatnonzero(knots.begins), len(knots.nodes))
    return tuple(
        GridWalk(
            knots.nodes[first:end].astype(np.int32),
            knots.time_steps[first:end].copy(),
            knots.gaps[first + 1 : end] == 1,
        )
        for first, end in pairwise(bounds.tolist())
    )


def _mode_bytes(modes: int) -> bytes:
    """Bytes before the first number where modes are on: the modes, with a zero ahead from 4 on."""
    if modes == 0:
        return b""
    return bytes([modes]) if modes < _FIRST_VARINT else bytes([0, modes])


def _read_modes(data: bytes) -> tuple[int, bytes]:
    """Undo :func:`_mode_bytes`; return the modes, and the bytes after them."""
    if not data or data[0] >= _FIRST_VARINT:
        return 0, data

    # one byte, or a zero and one more; no writer makes the longer form of the shorter
    if data[0]:
        modes, rest = data[0], data[1:]
    else:
        modes, rest = data[1] if len(data) > 1 else 0, data[2:]
    if (
        _mode_bytes(modes) != data[: len(data) - len(rest)]
        or modes > SORTED_STARTS | TIME_FIRST | SHORTEST_PATHS
    ):
        raise CorruptArchiveError("the walks are coded in a way that this version doesn't know")
    return modes, rest


def _new_model(knots: int, dimension: int, prior: Prior | None) -> WalkModel:
    """The model before the first of ``knots`` knots, trained on a prior if there is one."""
    return new_model(knots, dimension) if prior is None else prior.model(knots)


def _largest(values: NDArray[np.int64]) -> int:
    """Largest absolute value; 0 if there is none."""
    return int(np.abs(values).max()) if values.size else 0


def _encode_varint(value: int) -> bytes:
    """Seven bits in each byte, the lowest first; all bytes but the last have the eighth bit set."""
    out = bytearray()
    while value >= 128:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: bytes) -> tuple[int, int]:
    """Undo :func:`_encode_varint`; return the number, and how many bytes it takes."""
    value = 0
    for i, byte in enumerate(data[:_VARINT_BYTES]):
        value |= (byte & 127) << (7 * i)
        if byte < 128:
            return value, i + 1
    raise CorruptArchiveError("the walks have no count")
