"""Walks on a lattice to bytes and back: what an archive keeps of its tracks."""

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
from gpszip.codec.knots import concatenate_knots
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

#: Starts of at most so many tracks are sorted: which one is meant is found by counting.
MAX_SORTED_TRACKS = 4096

_TIMED, _GAPPED = 1, 2
#: An archive holds at most this many knots for each byte, so that forged counts can't ask for memory.
_KNOTS_PER_BYTE = 512
_KNOTS_AT_LEAST = 4096
#: Places and times are below this many quanta.
_FARTHEST = 1 << 45


def number_by_visit(walks: GridWalks, known: int = 0) -> GridWalks:
    """Number the nodes in the order in which the walks first visit them; drop those that none visits.

    The first ``known`` nodes stay what they are, visited or not.

    Examples
    --------
    >>> import numpy as np
    >>> walk = GridWalk(np.array([2, 0], np.int32), np.array([0, 1]), np.array([False]))
    >>> numbered = number_by_visit(GridWalks(np.array([[5, 5], [6, 6], [7, 7]]), (walk,)))
    >>> numbered.nodes.tolist(), numbered.walks[0].nodes.tolist()
    ([[7, 7], [5, 5]], [0, 1])
    """
    visited = (
        np.concatenate([walk.nodes for walk in walks.walks])
        if walks.walks
        else np.zeros(0, np.int32)
    )
    used, first = np.unique(visited[visited >= known], return_index=True)
    order = np.append(np.arange(known), used[np.argsort(first)])
    number = np.full(len(walks.nodes), -1, np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    renumbered = tuple(
        GridWalk(number[walk.nodes], walk.time_steps, walk.gaps) for walk in walks.walks
    )
    return replace(walks, nodes=walks.nodes[order], walks=renumbered)


def encode(walks: GridWalks, prior: Prior | None = None) -> bytes:
    """Code walks with an adaptive model into bytes.

    Parameters
    ----------
    walks : LatticeWalks
        Each walk has at least one knot; nodes are numbered in the order of their first visit.
    prior : Past, optional
        Walks that the reader has, too; their nodes come first in ``walks.nodes``, visited or not.

    Returns
    -------
    bytes
        A varint of the number of knots times 4 plus flags (1: times, 2: gaps), then the range coder's bytes.

    Raises
    ------
    BoundError
        If a place or time is 2**45 quanta or more from the origin, which no reader takes.

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
    """Code walks as :func:`encode` does, and return what the bits were spent on, by ``walk_model.ACCOUNTS``: bits, and how often."""
    data, model = encode_in_modes(walks, prior, 0, np.zeros(0))
    return data, model.ledger


def encode_in_modes(
    walks: GridWalks,
    prior: Prior | None,
    modes: int,
    spent: NDArray[np.float64],
    grid: QuantisationGrid | None = None,
) -> tuple[bytes, WalkModel]:
    """Code walks with some of the modes ``SORTED``, ``PACED`` and ``AIMS`` on.

    Parameters
    ----------
    walks, past
        As :func:`encode` takes them; ``SORTED`` takes times and at most ``MOST_SORTED`` tracks.
    modes : int
        A sum of modes.
    spent : float64 array, shape (K,) or (0,)
        Bits of the ways to all knots: filled in without ``AIMS``, asked for with it.
    grid : Frame, optional
        Epoch and time step, for the ends of pieces; these are not coded without it.

    Returns
    -------
    bytes, WalkModel
        What :func:`decode` reads, and the model as it is then.
    """
    nodes, cells, gaps, begins = concatenate_knots(walks)
    if max(_extent(walks.nodes), _extent(cells)) >= _FARTHEST:
        raise BoundError(
            "places or times lie too far apart for so fine a lattice; allow a larger error"
        )
    dimension = walks.nodes.shape[1]
    capacity = 64 + 16 * len(nodes) + 16 * walks.nodes.size
    while True:
        model = with_modes(
            _model(len(nodes), dimension, prior), modes, np.sort(cells[begins == 1]), spent
        )
        model.places[: len(walks.nodes)] = walks.nodes
        coder = new_encoder(capacity)
        code_walks(
            coder,
            model,
            nodes,
            cells,
            gaps,
            begins,
            len(walks.walks),
            walks.timed,
            bool(gaps.any()),
        )
        if grid is not None and walks.timed:
            code_tail(coder, walks, grid)
        payload = finish(coder)
        if payload is not None:
            break
        capacity *= 4
    least = -(-(len(nodes) - _KNOTS_AT_LEAST) // _KNOTS_PER_BYTE)
    flags = _TIMED * walks.timed + _GAPPED * bool(gaps.any())
    head = _mode_head(modes) + _varint(4 * len(nodes) + flags)
    return head + payload + bytes(max(least - len(payload), 0)), model


def decode(
    data: bytes,
    dimension: int,
    tracks: int,
    prior: Prior | None = None,
    grid: QuantisationGrid | None = None,
) -> GridWalks:
    """Read what :func:`encode` wrote.

    Parameters
    ----------
    data : bytes
        Untrusted bytes; memory stays below about 130 kB for each of them, plus 1 MB and what the past takes.
    dimension, tracks : int
        Number of coordinates and of tracks.
    prior : Past, optional
        The walks after which these were written; its nodes come first in those returned.
    grid : Frame, optional
        Epoch and time step of walks that were written with the ends of their pieces.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no walks of so many tracks.
    """
    modes, data = _read_modes(data) if tracks else (0, data)
    count, start = _read_varint(data)
    knots = count >> 2
    payload = data[start:]
    if (
        knots > _KNOTS_AT_LEAST + _KNOTS_PER_BYTE * len(payload)
        or knots < tracks
        or (tracks == 0) != (knots == 0)
    ):
        raise CorruptArchiveError(
            f"{knots} knots of {tracks} tracks can't lie in {len(payload)} bytes of walks"
        )
    timed, gapped = bool(count & _TIMED), bool(count & _GAPPED)
    if modes & SORTED_STARTS and not (timed and tracks <= MAX_SORTED_TRACKS):
        raise CorruptArchiveError("starts of tracks can't be sorted here")
    model = with_modes(
        _model(knots, dimension, prior), modes, np.zeros(tracks, np.int64), np.zeros(0)
    )
    nodes, cells = np.zeros(knots, np.int64), np.zeros(knots, np.int64)
    gaps, begins = np.zeros(knots, np.int8), np.zeros(knots, np.int8)
    coder = new_decoder(payload)
    found = int(code_walks(coder, model, nodes, cells, gaps, begins, tracks, timed, gapped))
    if found < 0:
        raise CorruptArchiveError("the walks end before all tracks are read")
    if timed and (np.diff(cells)[begins[1:] == 0] <= 0).any():
        raise CorruptArchiveError("times of the walks go back")
    bounds = np.append(np.flatnonzero(begins), knots)
    walks = tuple(
        GridWalk(nodes[a:b].astype(np.int32), cells[a:b].copy(), gaps[a + 1 : b] == 1)
        for a, b in pairwise(bounds.tolist())
    )
    whole = GridWalks(model.places[:found].copy(), walks, timed)
    return code_tail(coder, whole, grid) if grid is not None and timed else whole


def _mode_head(modes: int) -> bytes:
    """What comes ahead of the count where modes are on: the modes, or a zero and the modes. A count there is 4 at least."""
    return b"" if modes == 0 else bytes([modes]) if modes < 4 else bytes([0, modes])


def _read_modes(data: bytes) -> tuple[int, bytes]:
    """Modes, and the data behind them."""
    if not data or data[0] >= 4:
        return 0, data
    modes, rest = (data[0], data[1:]) if data[0] else (data[1] if len(data) > 1 else 0, data[2:])
    if (
        _mode_head(modes) != data[: len(data) - len(rest)]
        or modes > SORTED_STARTS | TIME_FIRST | SHORTEST_PATHS
    ):
        raise CorruptArchiveError("the walks are coded in a way that this version doesn't know")
    return modes, rest


def _model(knots: int, dimension: int, prior: Prior | None) -> WalkModel:
    return new_model(knots, dimension) if prior is None else prior.model(knots)


def _extent(values: NDArray[np.int64]) -> int:
    return int(np.abs(values).max()) if values.size else 0


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 128:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: bytes) -> tuple[int, int]:
    value = 0
    for i, byte in enumerate(data[:9]):
        value |= (byte & 127) << (7 * i)
        if byte < 128:
            return value, i + 1
    raise CorruptArchiveError("the walks have no count")
