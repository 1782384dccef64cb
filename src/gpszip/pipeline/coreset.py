"""Coresets of logs larger than memory: batches of samples become blocks, which are united as a tree."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.io.large.store import StoredLog
from gpszip.model import Track
from gpszip.pipeline.slices import Slice, batch_slices, slice_tracks
from gpszip.run.executor import Executor, Serial, reduce_tree
from gpszip.sketches.blocks import build_fine_blocks, merge_fine_blocks
from gpszip.sketches.coreset import OVERSAMPLING, Coreset
from gpszip.sketches.kernels.caratheodory import select_block_samples
from gpszip.sketches.partition import (
    LOWER_BOUND_FACTORS,
    blocks_under_cost,
    max_block_cost,
    next_block_cost,
    resolve_block_count,
)

__all__ = ["sketch_log", "thin_log"]

#: Samples of a batch.
_BATCH = 100_000


def sketch_log(
    log: StoredLog,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
    executor: Executor | None = None,
) -> Coreset:
    """Make the coreset of a log of any size in bounded memory.

    Of each batch of samples, at most ``8 * size`` blocks are kept, and of two batches together as many, up to the whole log, whose
    blocks at last become ``size``. As blocks are sketches, that loses nothing but where breaks may fall.
    With ``k`` and ``eps``, the least cost of k parts is bounded by such blocks first; then the samples of each batch are cut
    in blocks that cost as much as ``eps`` allows. Tracks whose blocks don't keep ``eps`` by themselves are cut again, finer.

    Parameters
    ----------
    log : StoredLog
        The log.
    k, eps, size, max_bytes : optional
        As for :func:`gpszip.sketches.partition.build_coreset`.
    executor : Executor, optional
        Where batches are worked on; the result does not depend on it. What batches become is united there, too.

    Returns
    -------
    Coreset

    Raises
    ------
    OptionError
        As :func:`gpszip.sketches.partition.build_coreset` does.
    """
    most = resolve_block_count(len(log.tracks), log.dimension, k, eps, size, max_bytes)
    slices = slice_tracks([track.count for track in log.tracks], _BATCH)
    if most is not None:
        return _united(log, slices, OVERSAMPLING * most, executor).reduced(most)
    assert k is not None
    assert eps is not None
    return _within_eps(log, slices, k, eps, executor)


def _within_eps(
    log: StoredLog, slices: Sequence[Slice], k: int, eps: float, executor: Executor | None
) -> Coreset:
    """Cut tracks into blocks that keep ``eps``, and those whose blocks don't again, finer."""
    costs: dict[int, float | None] = dict(_first_costs(log, slices, k, eps, executor))
    rows = dict[int, NDArray[np.float64]]()
    left, tries = set(costs), 0
    while left:
        tries += 1
        rows |= _cut(log, [one for one in slices if one.track in left], costs, executor)
        asked = {number: costs[number] for number in left}
        for number, cost in asked.items():
            if cost is not None:
                costs[number] = next_block_cost(rows[number], k, eps, cost, tries)
        left = {number for number, cost in asked.items() if costs[number] != cost}
    numbers = sorted(rows)
    owners = np.repeat(numbers, [len(rows[number]) for number in numbers])
    return Coreset(
        tuple(track.id for track in log.tracks),
        owners,
        np.concatenate([rows[number] for number in numbers]),
        log.plane,
    )


def _first_costs(
    log: StoredLog, slices: Sequence[Slice], k: int, eps: float, executor: Executor | None
) -> dict[int, float]:
    """What a block of each track may cost, from a lower bound on the least cost of k parts."""
    own = executor or Serial()
    short = batch_slices(
        [one for one in slices if one.end - one.begin == log.tracks[one.track].count], _BATCH
    )
    costs = dict[int, float]()
    for batch, found in zip(
        short, own.map(partial(_costs, k, eps), _samples(log, short)), strict=True
    ):
        costs |= {one.track: cost for one, cost in zip(batch, found, strict=True)}
    for number in sorted({one.track for one in slices} - set(costs)):
        parts = [one for one in slices if one.track == number]
        costs[number] = max_block_cost(
            _united(log, parts, OVERSAMPLING * math.ceil(LOWER_BOUND_FACTORS[-1] * k), executor),
            k,
            eps,
        )
    return costs


def _cut(
    log: StoredLog,
    slices: Sequence[Slice],
    costs: Mapping[int, float | None],
    executor: Executor | None,
) -> dict[int, NDArray[np.float64]]:
    """Rows of the blocks of each track, none of which costs more than the track's blocks may."""
    batches = batch_slices(slices, _BATCH)
    work = (
        (samples, [costs[one.track] for one in batch])
        for samples, batch in zip(_samples(log, batches), batches, strict=True)
    )
    parts = defaultdict[int, list[NDArray[np.float64]]](list)
    for batch, found in zip(batches, (executor or Serial()).map(_within, work), strict=True):
        for one, blocks in zip(batch, found, strict=True):
            parts[one.track].append(blocks)
    return {number: np.concatenate(some) for number, some in parts.items()}


def thin_log(
    log: StoredLog, coreset: Coreset, *, executor: Executor | None = None
) -> Iterator[Track]:
    """Yield the weighted samples of each track that stand for the blocks of its coreset, as :func:`weighted_samples` does.

    Parameters
    ----------
    log : StoredLog
        The log.
    coreset : Coreset
        Its coreset.
    executor : Executor, optional
        Where batches are worked on.
    """
    own = executor or Serial()
    bounds = np.searchsorted(coreset.owners, np.arange(len(log.tracks) + 1))
    for number, track in enumerate(log.tracks):
        mine = slice(bounds[number], bounds[number + 1])
        cuts = np.concatenate([[0], np.cumsum(coreset.counts[mine])])
        # a block too long for memory is thinned in parts, and what is left of them once more
        fine = np.unique(np.concatenate([cuts, np.arange(0, track.count, _BATCH)]))
        work = (
            (log.read(track, int(some[0]), int(some[-1])), some - some[0]) for some in _runs(fine)
        )
        times, places, weights = (
            np.concatenate(column) for column in zip(*own.map(_few, work), strict=True)
        )
        starts = np.append(np.searchsorted(times, coreset.edges[mine, 0]), len(times))
        kept, heavy = select_block_samples(times, places, weights, starts)
        yield Track(track.id, times[kept], places[kept], heavy, plane=log.plane)


def _runs(cuts: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Consecutive cuts over about a batch of samples."""
    first = 0
    while first < len(cuts) - 1:
        last = max(int(np.searchsorted(cuts, cuts[first] + _BATCH, side="right")) - 1, first + 1)
        yield cuts[first : last + 1]
        first = last


def _few(
    work: tuple[Track, NDArray[np.int64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    track, cuts = work
    kept, weights = select_block_samples(track.times, track.positions, np.ones(len(track)), cuts)
    return track.times[kept], track.positions[kept], weights


def _samples(log: StoredLog, batches: Sequence[Sequence[Slice]]) -> Iterator[list[Track]]:
    for batch in batches:
        yield [log.read(log.tracks[one.track], one.begin, one.end) for one in batch]


def _united(
    log: StoredLog, slices: Sequence[Slice], most: int, executor: Executor | None
) -> Coreset:
    samples = _samples(log, batch_slices(slices, _BATCH))
    whole: Coreset = reduce_tree(
        executor, partial(merge_fine_blocks, most), samples, partial(build_fine_blocks, most)
    )
    return whole


def _costs(k: int, eps: float, tracks: Sequence[Track]) -> list[float]:
    return [max_block_cost(track, k, eps) for track in tracks]


def _within(work: tuple[Sequence[Track], Sequence[float | None]]) -> list[NDArray[np.float64]]:
    return [blocks_under_cost(track, cost) for track, cost in zip(*work, strict=True)]
