"""Building a coreset of whole tracks: the balanced partition, and how fine it must be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.kernels.sums import PrefixSums, normalised_moments
from gpszip.kernels.sums import best_line_cost as free_ticks
from gpszip.model import Track
from gpszip.sketches.coreset import Coreset, eps_of_blocks
from gpszip.sketches.kernels import blocks as kernel
from gpszip.sketches.kernels.balanced import balanced_cuts
from gpszip.sketches.prefix import track_sums

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

#: Partitions into so many times k blocks give lower bounds on the least cost of k parts.
LOWER_BOUND_FACTORS = (2.0, 3.0, 4.0, 6.0)

#: Halvings of the logarithm of the largest cost of a block.
_BISECTION_STEPS = 48

#: Times that blocks are made finer until they keep eps by themselves; then come blocks of two samples.
_MAX_TRIES = 10

#: A block's largest cost becomes at most and at least so many times what it was, at one try.
_MAX_COST_RATIO, _MIN_COST_RATIO = 0.97, 1 / 16

#: Bytes of a saved coreset's frame, of each track's name and of each number.
_FILE_BYTES, _NAME_BYTES, _NUMBER_BYTES = 8192, 64, 9

_Cuts = list[NDArray[np.int64]]


def build_coreset(
    tracks: Sequence[Track] | Track,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
) -> Coreset:
    """Build the coreset of tracks that are whole: a balanced partition in O(n log n), each block an exact sketch.

    Blocks are as long as their cost against their own best line is at most sigma, the same for all of them.

    With ``k`` and ``eps``, sigma is ``eps^2 LB / (4 (1 + eps) (k - 1))``. LB is a lower bound on the cost of every
    k-segment: of N blocks at most k - 1 have a break inside, so the sum of all but the k - 1 largest free costs is below
    it; the best of N = 2 k, 3 k, 4 k and 6 k balanced blocks is taken. Then the estimate of the cost of any k-segment is
    within ``eps`` of it (see :class:`~gpszip.sketches.coreset.Coreset`). There are O(k / eps^2) blocks for a log whose
    cost falls no faster than with the number of parts. Blocks are made finer until ``eps(k)`` of the coreset itself, which
    knows the blocks only, is at most ``eps`` for each track. A track that k parts may fit exactly has blocks of two samples.

    Parameters
    ----------
    tracks : Track or sequence of Track
        On one plane, with different ids; weights count.
    k : int, optional
        Parts of the k-segments that are to be priced, of each track; with ``eps``.
    eps : float, optional
        Relative error of the price, between 0 and 1.
    size : int, optional
        Largest number of blocks, instead.
    max_bytes : int, optional
        Largest size of the saved file, instead.

    Returns
    -------
    Coreset

    Raises
    ------
    InputError
        If there is no track.
    OptionError
        If not exactly one of k with eps, size and max_bytes is given, one is out of range, or tracks don't go together.

    Examples
    --------
    >>> track = Track("bends", range(300), [[abs(t % 100 - 50)] for t in range(300)])
    >>> len(build_coreset(track, size=10)), build_coreset(track, size=10).samples
    (6, 300)
    """
    whole = (tracks,) if isinstance(tracks, Track) else tuple(tracks)
    _check(whole)
    most = resolve_block_count(len(whole), whole[0].dimension, k, eps, size, max_bytes)
    if most is None:
        assert k is not None
        assert eps is not None
        rows = [_rows_within_eps(track, k, eps) for track in whole]
    else:
        rows = [
            _block_rows(track, own)
            for track, own in zip(
                whole, _search_partition([track_sums(track) for track in whole], most), strict=True
            )
        ]
    owners = np.repeat(np.arange(len(whole)), [len(own) for own in rows])
    return Coreset(tuple(track.id for track in whole), owners, np.concatenate(rows), whole[0].plane)


def max_file_size(blocks: int, tracks: int, dimension: int) -> int:
    """Bytes that the file of a coreset takes at most."""
    return (
        _FILE_BYTES
        + _NAME_BYTES * tracks
        + _NUMBER_BYTES * (kernel.FIXED_COLUMNS + 3 * dimension + 1) * blocks
    )


def max_blocks_in(max_bytes: float, tracks: int, dimension: int) -> int:
    """Number of blocks whose file is within so many bytes.

    Raises
    ------
    OptionError
        If not even one block for each track is.
    """
    most = int(
        (max_bytes - max_file_size(0, tracks, dimension))
        // (_NUMBER_BYTES * (kernel.FIXED_COLUMNS + 3 * dimension + 1))
    )
    if most < tracks:
        raise OptionError(
            f"{max_bytes:.0f} bytes are too few for a coreset of this log; allow {max_file_size(tracks, tracks, dimension):,}"
        )
    return most


def resolve_block_count(
    tracks: int,
    dimension: int,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
) -> int | None:
    """Largest number of blocks of a coreset of so many tracks; None where k and eps tell it.

    Raises
    ------
    OptionError
        If not exactly one of k with eps, size and max_bytes is given, or one is out of range.
    """
    if (k is None) != (eps is None) or (k is not None) + (size is not None) + (
        max_bytes is not None
    ) != 1:
        raise OptionError(
            "how large is the coreset to be? give size, or max_bytes, or k and eps together"
        )
    if k is not None and eps is not None:
        if k < 1:
            raise OptionError(f"k is {k}; a track has at least 1 part")
        if not 0 < eps < 1:
            raise OptionError(f"eps is {eps:g}; it lies between 0 and 1")
        return None
    most = size if size is not None else max_blocks_in(max_bytes or 0, tracks, dimension)
    if most < tracks:
        raise OptionError(f"size is {most}; {tracks} tracks need as many blocks at least")
    return most


def max_block_cost(of: Track | Coreset, k: int, eps: float) -> float:
    """How much each block of a track may cost, in square metres, so that any k-segment is priced within ``eps``: sigma.

    Parameters
    ----------
    of : Track or Coreset
        A track, or some blocks of it, 6 k or more.
    k, eps : int, float
        Parts, and relative error.
    """
    if k == 1:
        return math.inf
    if isinstance(of, Coreset):
        return _sigma(lambda size: of.reduced(size).rows, k, eps)
    sums = [track_sums(of)]
    return _sigma(lambda size: _block_rows(of, _search_partition(sums, size)[0]), k, eps)


def _sigma(balanced: Callable[[int], NDArray[np.float64]], k: int, eps: float) -> float:
    least = 0.0
    for several in LOWER_BOUND_FACTORS:
        costs = np.array([kernel.free_cost(row) for row in balanced(math.ceil(several * k))])
        least = max(least, math.fsum(np.sort(costs)[: max(len(costs) - k + 1, 0)]))
    return _cost_share(eps) * least / (k - 1)


def blocks_under_cost(track: Track, cost: float | None) -> NDArray[np.float64]:
    """Rows of the longest blocks of a track whose free costs are at most so many square metres.

    Parameters
    ----------
    track : Track
        Samples.
    cost : float or None
        The most that a block may cost; None for blocks of two samples, which lie on their line whatever they are.
    """
    if cost is None:
        return _block_rows(track, np.append(np.arange(0, len(track), 2), len(track)))
    return _block_rows(track, _balanced_cuts(track_sums(track), cost))


def next_block_cost(
    rows: NDArray[np.float64], k: int, eps: float, cost: float, tries: int
) -> float | None:
    """What blocks may cost at the next try, after these.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks of a whole track, none of which costs more than ``cost``.
    k, eps : int, float
        Parts, and relative error.
    cost : float
        In square metres.
    tries : int
        How often blocks have been made, these included.

    Returns
    -------
    float or None
        ``cost`` itself where the blocks keep ``eps``; less where they don't; None where they are to have two samples.
    """
    found = eps_of_blocks(rows, k)
    if found <= eps:
        return cost
    if cost <= 0 or tries >= _MAX_TRIES:
        return None
    # the error that a cost allows is nearly in proportion to it, as far as the least cost of k parts stays
    wanted = _cost_share(eps) / _cost_share(found) if math.isfinite(found) else 0.0
    return cost * min(max(wanted, _MIN_COST_RATIO), _MAX_COST_RATIO)


def _cost_share(eps: float) -> float:
    return eps * eps / (4 * (1 + eps))


def _rows_within_eps(track: Track, k: int, eps: float) -> NDArray[np.float64]:
    """Rows of the blocks of a track that keep ``eps`` by themselves."""
    cost = max_block_cost(track, k, eps)
    for tries in range(1, _MAX_TRIES + 1):
        rows = blocks_under_cost(track, cost)
        finer = next_block_cost(rows, k, eps, cost, tries)
        if finer == cost:
            return rows
        if finer is None:
            break
        cost = finer
    return blocks_under_cost(track, None)


def _check(tracks: Sequence[Track]) -> None:
    if not tracks:
        raise InputError("no tracks: there is nothing to make a coreset of")
    if len({track.id for track in tracks}) < len(tracks):
        raise OptionError("two tracks have the same id; give each its own")
    for track in tracks:
        if track.dimension != tracks[0].dimension or track.plane != tracks[0].plane:
            raise OptionError(
                f"tracks {tracks[0].id!r} and {track.id!r} lie on different planes; make a coreset of each"
            )


def _block_rows(track: Track, cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    weights = np.ones(len(track)) if track.weights is None else track.weights
    return kernel.block_rows(track.times, track.positions, weights, cuts)


def _balanced_cuts(sums: PrefixSums, limit: float) -> NDArray[np.int64]:
    """Cuts of the balanced partition for a limit in square metres."""
    return balanced_cuts(sums, limit / sums.position_tick**2, len(sums.t))


def _search_partition(sums: Sequence[PrefixSums], size: int) -> _Cuts:
    """The finest balanced partition of all tracks with at most ``size`` blocks in all."""
    row = np.empty(2 * sums[0].p.shape[1] + 4)
    high = 0.0
    for one in sums:
        normalised_moments(one, 0, len(one.t), row)
        high = max(high, 1.01 * free_ticks(row) * one.position_tick**2)
    return _bisect(lambda limit: _partition_within(sums, limit, size), high)


def _partition_within(sums: Sequence[PrefixSums], limit: float, size: int) -> _Cuts | None:
    cuts, left = [], size - len(sums)
    for one in sums:
        own = balanced_cuts(one, limit / one.position_tick**2, left + 1)
        left -= len(own) - 2
        if left < 0:
            return None
        cuts.append(own)
    return cuts


def _bisect(attempt: Callable[[float], _Cuts | None], high: float) -> _Cuts:
    exact = attempt(0.0)
    if exact is not None or high <= 0:
        return exact if exact is not None else []
    best, low = attempt(high), high * 1e-18
    for _ in range(_BISECTION_STEPS):
        middle = math.sqrt(low * high)
        found = attempt(middle)
        if found is None:
            low = middle
        else:
            best, high = found, middle
        if high < 1.0005 * low:
            break
    assert best is not None
    return best
