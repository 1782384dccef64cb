"""Coresets of tracks in memory: the balanced partition, and how fine it has to be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.kernels.read_only import read_only
from gpszip.kernels.sums import PrefixSums, normalised_moments, track_sums
from gpszip.kernels.sums import best_line_cost as free_cost_in_ticks
from gpszip.model import Track
from gpszip.sketches.coreset import Coreset, eps_of_blocks
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.kernels.balanced import balanced_cuts
from gpszip.sketches.weights import sample_weights

__all__ = [
    "LOWER_BOUND_FACTORS",
    "blocks_under_cost",
    "build_coreset",
    "max_block_cost",
    "max_blocks_in",
    "max_file_size",
    "next_block_cost",
    "resolve_block_count",
]

#: Numbers of blocks, as multiples of k, whose balanced partitions give lower bounds on OPT_k.
LOWER_BOUND_FACTORS = (2.0, 3.0, 4.0, 6.0)

#: Most steps of the search for the largest cost of a block; each halves the logarithm.
_BISECTION_STEPS = 48

#: Tries to make blocks fine enough for eps; after that, blocks have two samples.
_MAX_TRIES = 10

#: Largest ratio of the block costs of two successive tries.
_MAX_COST_RATIO = 0.97

#: Smallest ratio of the block costs of two successive tries.
_MIN_COST_RATIO = 1 / 16

#: Bytes of a saved coreset beside tracks and blocks, at most.
_FILE_BYTES = 8192

#: Bytes of a track's name in a saved coreset, on average at most.
_NAME_BYTES = 64

#: Bytes of a number in a saved coreset, at most.
_NUMBER_BYTES = 9

#: Cuts of the partition of each track.
_Cuts = list[NDArray[np.int64]]


def build_coreset(
    tracks: Sequence[Track] | Track,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
) -> Coreset:
    """Build the coreset of tracks in memory by a balanced partition, in O(n log n).

    Blocks are as long as possible with a free cost, against their own best lines, of at most
    sigma, which is the same for all blocks.

    With ``k`` and ``eps``, sigma is ``eps^2 LB / (4 (1 + eps) (k - 1))``. LB is a lower bound on
    the cost of every k-segment. Of N blocks at most k - 1 have a break inside, so that the sum of
    all free costs but the k - 1 largest is a lower bound; the best of N = 2 k, 3 k, 4 k and 6 k
    balanced blocks is taken. Then the estimate of the cost of any k-segment is within a relative
    error of ``eps`` (see :class:`~gpszip.sketches.coreset.Coreset`).

    There are O(k / eps^2) blocks if the least cost of k segments falls no faster than 1 / k.
    Blocks are made finer until ``eps(k)`` of the coreset itself, computed from the blocks alone,
    is at most ``eps`` for each track. A track that k segments may fit exactly gets blocks of two
    samples.

    Parameters
    ----------
    tracks : Track or sequence of Track
        Tracks on the same planes, with different ids. Weights count.
    k : int, optional
        Number of segments of each track; requires ``eps``.
    eps : float, optional
        Relative error of the cost of any k-segment, between 0 and 1; requires ``k``.
    size : int, optional
        Largest number of blocks, instead of ``k`` and ``eps``.
    max_bytes : int, optional
        Largest size of the saved file, instead of ``k`` and ``eps``.

    Returns
    -------
    Coreset

    Raises
    ------
    InputError
        If there is no track.
    OptionError
        If not exactly one of k with eps, size and max_bytes is given, if one is out of range, or
        if the tracks have different planes or the same id.

    Examples
    --------
    >>> track = Track("bends", range(300), [[abs(t % 100 - 50)] for t in range(300)])
    >>> len(build_coreset(track, size=10)), build_coreset(track, size=10).samples
    (6, 300)
    """
    # Turn a limit on bytes or blocks into a number of blocks; k and eps give none.
    tracks = (tracks,) if isinstance(tracks, Track) else tuple(tracks)
    _check_tracks(tracks)
    max_blocks = resolve_block_count(len(tracks), tracks[0].dimension, k, eps, size, max_bytes)

    # Blocks of each track: fine enough for eps, or as many as allowed.
    if max_blocks is None:
        assert k is not None
        assert eps is not None
        rows = [_rows_within_eps(track, k, eps) for track in tracks]
    else:
        cuts = _search_partition([track_sums(track) for track in tracks], max_blocks)
        rows = [
            _block_rows(track, track_cuts) for track, track_cuts in zip(tracks, cuts, strict=True)
        ]

    # Concatenate the blocks of all tracks, each with the number of its track.
    names = tuple(track.id for track in tracks)
    owners = np.repeat(np.arange(len(tracks)), [len(track_rows) for track_rows in rows])
    return Coreset(names, owners, np.concatenate(rows), tracks[0].plane)


def max_file_size(blocks: int, tracks: int, dimension: int) -> int:
    """Return the largest size of a saved coreset in bytes."""
    return _FILE_BYTES + _NAME_BYTES * tracks + _block_bytes(dimension) * blocks


def max_blocks_in(max_bytes: float, tracks: int, dimension: int) -> int:
    """Return the number of blocks that a saved coreset of a given size has space for.

    Raises
    ------
    OptionError
        If there is no space for one block of each track.
    """
    space = max_bytes - max_file_size(0, tracks, dimension)
    max_blocks = int(space // _block_bytes(dimension))
    if max_blocks < tracks:
        raise OptionError(
            f"{max_bytes:.0f} bytes are too few for a coreset of this log; "
            f"allow {max_file_size(tracks, tracks, dimension):,}"
        )
    return max_blocks


def _block_bytes(dimension: int) -> int:
    """Return the largest size of a block in a saved coreset: its row and its track."""
    # The fixed columns, three groups of d, and one number for the track.
    return _NUMBER_BYTES * (kernel.FIXED_COLUMNS + 3 * dimension + 1)


def resolve_block_count(
    tracks: int,
    dimension: int,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
) -> int | None:
    """Return the largest number of blocks of a coreset; None if k and eps determine it.

    Parameters
    ----------
    tracks : int
        Number of tracks.
    dimension : int
        Number of coordinates d.
    k, eps, size, max_bytes
        As for :func:`build_coreset`.

    Raises
    ------
    OptionError
        If not exactly one of k with eps, size and max_bytes is given, or one is out of range.
    """
    # Exactly one way of giving the size.
    given = (k is not None) + (size is not None) + (max_bytes is not None)
    if (k is None) != (eps is None) or given != 1:
        raise OptionError(
            "how large is the coreset to be? give size, or max_bytes, or k and eps together"
        )

    # k and eps
    if k is not None and eps is not None:
        if k < 1:
            raise OptionError(f"k is {k}; a track has at least 1 segment")
        if not 0 < eps < 1:
            raise OptionError(f"eps is {eps:g}; it lies between 0 and 1")
        return None

    # Size, or max_bytes.
    max_blocks = size if size is not None else max_blocks_in(max_bytes or 0, tracks, dimension)
    if max_blocks < tracks:
        raise OptionError(f"size is {max_blocks}; {tracks} tracks need as many blocks at least")
    return max_blocks


def max_block_cost(source: Track | Coreset, k: int, eps: float) -> float:
    """Return sigma: the largest cost of a block with which any k-segment is within ``eps``.

    Parameters
    ----------
    source : Track or Coreset
        A track, or a coreset of it with at least 6 k blocks.
    k : int
        Number of segments.
    eps : float
        Relative error.

    Returns
    -------
    float
        Square metres.
    """
    # A single line breaks nowhere, so blocks may be of any cost; k - 1 would divide by zero.
    if k == 1:
        return math.inf
    if isinstance(source, Coreset):
        return _sigma(lambda size: source.reduced(size).rows, k, eps)
    sums = [track_sums(source)]
    return _sigma(lambda size: _block_rows(source, _search_partition(sums, size)[0]), k, eps)


def _sigma(balanced_rows: Callable[[int], NDArray[np.float64]], k: int, eps: float) -> float:
    """Return sigma for a function that returns a balanced partition of a given size."""
    lower_bound = 0.0
    for factor in LOWER_BOUND_FACTORS:
        rows = read_only(balanced_rows(math.ceil(factor * k)))
        costs = np.array([kernel.free_cost(row) for row in rows])
        unbroken = np.sort(costs)[: max(len(costs) - k + 1, 0)]
        lower_bound = max(lower_bound, math.fsum(unbroken))
    return _cost_share(eps) * lower_bound / (k - 1)


def blocks_under_cost(track: Track, cost: float | None) -> NDArray[np.float64]:
    """Return the rows of the longest blocks of a track whose free costs are at most ``cost``.

    Parameters
    ----------
    track : Track
        The samples.
    cost : float or None
        Square metres; None for blocks of two samples, which always lie on their own line.
    """
    if cost is None:
        return _block_rows(track, np.append(np.arange(0, len(track), 2), len(track)))
    return _block_rows(track, _balanced_cuts(track_sums(track), cost))


def next_block_cost(
    rows: NDArray[np.float64], k: int, eps: float, cost: float, tries: int
) -> float | None:
    """Return the largest cost of a block for the next try, after blocks of a first one.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks of an entire track, none of which costs more than ``cost``.
    k : int
        Number of segments.
    eps : float
        Relative error.
    cost : float
        Square metres.
    tries : int
        Number of tries so far, this one included.

    Returns
    -------
    float or None
        ``cost`` itself if the blocks keep ``eps``; less if they don't; None for blocks of two
        samples.
    """
    reached = eps_of_blocks(rows, k)
    if reached <= eps:
        return cost

    # Blocks of two samples cost nothing, and end the search in any case.
    if cost <= 0 or tries >= _MAX_TRIES:
        return None

    # The cost that an error allows is nearly in proportion to _cost_share, as OPT_k stays the same.
    ratio = _cost_share(eps) / _cost_share(reached) if math.isfinite(reached) else 0.0
    return cost * min(max(ratio, _MIN_COST_RATIO), _MAX_COST_RATIO)


def _cost_share(eps: float) -> float:
    """Return eps^2 / (4 (1 + eps)): the share of OPT_k that k - 1 blocks may cost."""
    return eps * eps / (4 * (1 + eps))


def _rows_within_eps(track: Track, k: int, eps: float) -> NDArray[np.float64]:
    """Return the blocks of a track, as long as :func:`eps_of_blocks` allows."""
    cost = max_block_cost(track, k, eps)
    for tries in range(1, _MAX_TRIES + 1):
        rows = blocks_under_cost(track, cost)
        next_cost = next_block_cost(rows, k, eps, cost, tries)
        if next_cost == cost:
            return rows
        if next_cost is None:
            break
        cost = next_cost
    return blocks_under_cost(track, None)


def _check_tracks(tracks: Sequence[Track]) -> None:
    """Raise an error if tracks can't share a coreset."""
    if not tracks:
        raise InputError("no tracks: there is nothing to make a coreset of")
    if len({track.id for track in tracks}) < len(tracks):
        raise OptionError("two tracks have the same id; give each its own")
    for track in tracks:
        if track.dimension != tracks[0].dimension or track.plane != tracks[0].plane:
            raise OptionError(
                f"tracks {tracks[0].id!r} and {track.id!r} lie on different planes; "
                "make a coreset of each"
            )


def _block_rows(track: Track, cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the rows of the blocks between cuts."""
    return kernel.block_rows(track.times, track.positions, sample_weights(track), cuts)


def _balanced_cuts(sums: PrefixSums, limit: float) -> NDArray[np.int64]:
    """Return the cuts of the balanced partition for a limit in square metres."""
    return balanced_cuts(sums, limit / sums.position_tick**2, len(sums.t))


def _search_partition(sums: Sequence[PrefixSums], size: int) -> _Cuts:
    """Return the finest balanced partition of all tracks with at most ``size`` blocks in total."""
    # a limit at which each track is one block
    row = np.empty(2 * sums[0].p.shape[1] + 4)
    high = 0.0
    for track in sums:
        normalised_moments(track, 0, len(track.t), row)
        high = max(high, 1.01 * free_cost_in_ticks(row) * track.position_tick**2)
    return _bisect(lambda limit: _partition_within(sums, limit, size), high)


def _partition_within(sums: Sequence[PrefixSums], limit: float, size: int) -> _Cuts | None:
    """Return the balanced partitions for a limit, or None if they have more than ``size`` blocks.

    Each track has one block in any case; further ones are taken from a common stock.
    """
    cuts, stock = [], size - len(sums)
    for track in sums:
        track_cuts = balanced_cuts(track, limit / track.position_tick**2, stock + 1)
        stock -= len(track_cuts) - 2
        if stock < 0:
            return None
        cuts.append(track_cuts)
    return cuts


def _bisect(partition_within: Callable[[float], _Cuts | None], high: float) -> _Cuts:
    """Return the partition for the lowest limit at which there is one.

    Parameters
    ----------
    partition_within : callable
        Returns the partition for a limit, or None if it has too many blocks.
    high : float
        A limit at which there is a partition.
    """
    # Perhaps all blocks are lines.
    exact = partition_within(0.0)
    if exact is not None or high <= 0:
        return exact if exact is not None else []

    # Bisect the logarithm of the limit.
    best, low = partition_within(high), high * 1e-18
    for _ in range(_BISECTION_STEPS):
        middle = math.sqrt(low * high)
        cuts = partition_within(middle)
        if cuts is None:
            low = middle
        else:
            best, high = cuts, middle
        if high < 1.0005 * low:
            break
    assert best is not None
    return best
