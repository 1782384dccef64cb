"""Coresets of logs on disk: batches of samples become blocks, which are merged as a tree.

Blocks are sketches, so that merging them loses nothing but where breaks may fall.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.kernels.read_only import read_only
from gpszip.model import Track
from gpszip.model.log import Log
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
from gpszip.sketches.weights import sample_weights

__all__ = ["sketch_log", "thin_log"]

#: Samples of a batch: 2.4 MB of times and two coordinates.
_BATCH = 100_000


def sketch_log(
    log: Log,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
    executor: Executor | None = None,
) -> Coreset:
    """Build the coreset of a log in bounded memory.

    With a size, at most ``8 * size`` blocks are kept of each batch, of two batches together, and
    so on up to the whole log; those become ``size`` blocks at last.

    With ``k`` and ``eps``, such blocks give a lower bound on the least cost of k segments first.
    Then the samples of each batch are cut into blocks that cost as much as ``eps`` allows. Tracks
    whose blocks don't hold ``eps`` are cut again, finer.

    Parameters
    ----------
    log : Log
        With times.
    k, eps, size, max_bytes : optional
        As for :func:`gpszip.sketches.partition.build_coreset`.
    executor : Executor, optional
        Where batches are read and merged; the result does not depend on it.

    Returns
    -------
    Coreset

    Raises
    ------
    OptionError
        As :func:`gpszip.sketches.partition.build_coreset` does; also if a track has no times.
    """
    untimed = next((track for track in log.tracks if not track.timed), None)
    if untimed is not None:
        raise OptionError(f"track {untimed.id!r} has no times, which a coreset needs")
    count = resolve_block_count(len(log.tracks), log.dimension, k, eps, size, max_bytes)
    slices = slice_tracks([len(track) for track in log.tracks], _BATCH)
    if count is not None:
        return _merge_blocks(log, slices, OVERSAMPLING * count, executor).reduced(count)
    assert k is not None
    assert eps is not None
    return _within_eps(log, slices, k, eps, executor)


def thin_log(log: Log, coreset: Coreset, *, executor: Executor | None = None) -> Iterator[Track]:
    """Yield weighted samples of each track that stand for the blocks of its coreset.

    They are those of :func:`gpszip.sketches.samples.weighted_samples`.

    Parameters
    ----------
    log : Log
        The log.
    coreset : Coreset
        Its coreset.
    executor : Executor, optional
        Where batches are thinned.
    """
    # Find the blocks of each track, and the numbers of the samples between which they lie.
    workers = executor or Serial()
    bounds = np.searchsorted(coreset.owners, np.arange(len(log.tracks) + 1))
    for number, track in enumerate(log.tracks):
        rows = slice(bounds[number], bounds[number + 1])
        cuts = np.concatenate([[0], np.cumsum(coreset.counts[rows])])

        # a block too long for memory is thinned in fragments, and these once more together
        finer = np.unique(np.concatenate([cuts, np.arange(0, len(track), _BATCH)]))
        work = (
            (log.read(track, int(run[0]), int(run[-1])), run - run[0]) for run in _cut_runs(finer)
        )
        selected = zip(*workers.map(_select_samples, work), strict=True)
        times, positions, weights = (read_only(np.concatenate(column)) for column in selected)
        starts = np.append(np.searchsorted(times, coreset.edges[rows, 0]), len(times))
        kept, kept_weights = select_block_samples(times, positions, weights, starts)
        yield Track(track.id, times[kept], positions[kept], kept_weights, plane=log.plane)


def _within_eps(
    log: Log, slices: Sequence[Slice], k: int, eps: float, executor: Executor | None
) -> Coreset:
    """Cut tracks into blocks that hold ``eps``; those whose blocks don't, again and finer."""
    # Cut every track into blocks of at most its cost, then again those that don't hold ``eps``.
    costs: dict[int, float | None] = dict(_initial_costs(log, slices, k, eps, executor))
    rows: dict[int, NDArray[np.float64]] = {}
    remaining, tries = set(costs), 0
    while remaining:
        tries += 1
        rows |= _cut_blocks(log, [s for s in slices if s.track in remaining], costs, executor)

        # The cost that blocks may have next; the same where they hold eps.
        before = {number: costs[number] for number in remaining}
        for number, cost in before.items():
            if cost is not None:
                costs[number] = next_block_cost(rows[number], k, eps, cost, tries)
        remaining = {number for number, cost in before.items() if costs[number] != cost}

    # Put the blocks of all tracks in the order of the log.
    numbers = sorted(rows)
    owners = np.repeat(numbers, [len(rows[number]) for number in numbers])
    names = tuple(track.id for track in log.tracks)
    return Coreset(names, owners, np.concatenate([rows[i] for i in numbers]), log.plane)


def _initial_costs(
    log: Log, slices: Sequence[Slice], k: int, eps: float, executor: Executor | None
) -> dict[int, float]:
    """What a block of each track may cost, from a lower bound on the least cost of k segments."""
    # Tracks that fit a batch, several at once.
    whole_tracks = [s for s in slices if s.end - s.begin == len(log.tracks[s.track])]
    batches = batch_slices(whole_tracks, _BATCH)
    work = _read_batches(log, batches)
    costs: dict[int, float] = {}
    for batch, found in zip(
        batches, (executor or Serial()).map(partial(_max_costs, k, eps), work), strict=True
    ):
        costs |= {s.track: cost for s, cost in zip(batch, found, strict=True)}

    # Longer ones from their blocks.
    finest = OVERSAMPLING * math.ceil(LOWER_BOUND_FACTORS[-1] * k)
    for number in sorted({s.track for s in slices} - set(costs)):
        blocks = _merge_blocks(log, [s for s in slices if s.track == number], finest, executor)
        costs[number] = max_block_cost(blocks, k, eps)
    return costs


def _cut_blocks(
    log: Log,
    slices: Sequence[Slice],
    costs: Mapping[int, float | None],
    executor: Executor | None,
) -> dict[int, NDArray[np.float64]]:
    """Rows of the blocks of each track, none of which costs more than the track's blocks may."""
    batches = batch_slices(slices, _BATCH)
    work = (
        (tracks, [costs[s.track] for s in batch])
        for tracks, batch in zip(_read_batches(log, batches), batches, strict=True)
    )
    fragments = defaultdict[int, list[NDArray[np.float64]]](list)
    for batch, found in zip(batches, (executor or Serial()).map(_cut_batch, work), strict=True):
        for s, blocks in zip(batch, found, strict=True):
            fragments[s.track].append(blocks)
    return {number: np.concatenate(blocks) for number, blocks in fragments.items()}


def _cut_runs(cuts: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Consecutive cuts over about a batch of samples each."""
    first = 0
    while first < len(cuts) - 1:
        last = int(np.searchsorted(cuts, cuts[first] + _BATCH, side="right")) - 1
        last = max(last, first + 1)
        yield cuts[first : last + 1]
        first = last


def _select_samples(
    work: tuple[Track, NDArray[np.int64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Times, positions and weights of a few samples of each block."""
    track, cuts = work
    kept, weights = select_block_samples(track.times, track.positions, sample_weights(track), cuts)
    return track.times[kept], track.positions[kept], weights


def _read_batches(log: Log, batches: Sequence[Sequence[Slice]]) -> Iterator[list[Track]]:
    for batch in batches:
        yield [log.read(log.tracks[s.track], s.begin, s.end) for s in batch]


def _merge_blocks(
    log: Log, slices: Sequence[Slice], limit: int, executor: Executor | None
) -> Coreset:
    """Merge the blocks of all batches, at most ``limit`` at a time."""
    batches = _read_batches(log, batch_slices(slices, _BATCH))
    merged: Coreset = reduce_tree(
        executor, partial(merge_fine_blocks, limit), batches, partial(build_fine_blocks, limit)
    )
    return merged


def _max_costs(k: int, eps: float, tracks: Sequence[Track]) -> list[float]:
    return [max_block_cost(track, k, eps) for track in tracks]


def _cut_batch(
    work: tuple[Sequence[Track], Sequence[float | None]],
) -> list[NDArray[np.float64]]:
    return [blocks_under_cost(track, cost) for track, cost in zip(*work, strict=True)]
