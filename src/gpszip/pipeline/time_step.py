"""The time step for a whole log, once the map of a subsample is learned.

In a subsample, nodes cost much and walks little; in all of a large log it is the other way round.
The nodes stay where they are. A coarser time grid uses up the error that is left to the walks,
and each of their knots costs less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpszip.codec.kernels.walk_model import POSITION_BITS
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode_with_statistics
from gpszip.errors import BoundError
from gpszip.model import GridWalk, GridWalks, Track
from gpszip.model.grid import STEP_SIZES
from gpszip.model.log import Log
from gpszip.pipeline.encode_batches import BaseMap, encode_batch, read_slice
from gpszip.pipeline.slices import Slice
from gpszip.run.executor import Executor, share_value
from gpszip.walks.quantised import dequantise_walks, node_positions, quantise_walks

__all__ = ["with_best_time_step"]

#: Step sizes by which the time step grows at once; eight of them double it.
_STRIDE = 2

#: Step sizes by which it grows at most: a factor of 2.8.
_MAX_GROWTH = 12

#: One of so many batches is tried.
_ONE_OF = 16

#: Batches that are tried at most.
_MAX_TRIED = 6

#: Logs of fewer batches keep their time step: trying takes longer than it gains.
_MIN_BATCHES = 6


def with_best_time_step(
    log: Log, base: BaseMap, batches: Sequence[Sequence[Slice]], executor: Executor
) -> BaseMap:
    """Return the base map with the time step on which some batches of the log take least.

    Parameters
    ----------
    log : Log
        Shapes get the times of ``base``.
    base : BaseMap
        As it was learned.
    batches : sequence of sequences of Slice
        All samples of the log. A few batches, evenly spread, are encoded on coarser and coarser
        time grids until that doesn't pay any more.
    executor : Executor
        Where they are encoded; the result does not depend on it.
    """
    # Keep the time step of a short log: trying others takes longer than it gains.
    if len(batches) < _MIN_BATCHES:
        return base

    # Some batches, evenly spread.
    count = min(max(len(batches) // _ONE_OF, 1), _MAX_TRIED)
    some = [batches[(2 * number + 1) * len(batches) // (2 * count)] for number in range(count)]
    repeats = len(batches) / count

    # Coarser time grids, while they pay.
    best, least = base, _bytes_of_log(log, base, some, repeats, executor)
    limit = min(_MAX_GROWTH, STEP_SIZES - 1 - base.grid.time)
    for growth in range(_STRIDE, limit + 1, _STRIDE):
        coarser = _with_coarser_times(base, growth)
        size = _bytes_of_log(log, coarser, some, repeats, executor)
        if size >= least:
            break
        best, least = coarser, size
    return best


def _with_coarser_times(base: BaseMap, growth: int) -> BaseMap:
    """The base map with a time step that is so many step sizes larger."""
    grid = replace(base.grid, time=base.grid.time + growth)
    known = base.prior.walks
    names = [str(number) for number in range(len(known.walks))]
    walks = dequantise_walks(known, base.grid, names)

    # The coder's model is primed once, before several batches ask for it.
    nodes = node_positions(known, base.grid)
    prior = Prior(number_by_visit(quantise_walks(nodes, walks, grid)))
    prior.model(0)
    return replace(base, grid=grid, prior=prior)


def _bytes_of_log(
    log: Log,
    base: BaseMap,
    batches: Sequence[Sequence[Slice]],
    repeats: float,
    executor: Executor,
) -> float:
    """Estimate the bytes of ``repeats`` times these batches; infinite if one misses the bound.

    The positions of known nodes count once, however many batches there are.
    """
    # Walks of the batches behind the known ones.
    nodes, walks = [base.prior.walks.nodes], list[GridWalk]()
    with share_value(executor, base) as shared:
        work = ([read_slice(log, each) for each in batch] for batch in batches)
        for encoded in shared.map(_encode_or_none, work):
            if encoded is None:
                return math.inf
            added = sum(map(len, nodes)) + np.arange(len(encoded.nodes))
            number = np.append(np.arange(base.prior.nodes), added).astype(np.int32)
            nodes.append(encoded.nodes)
            walks += [
                GridWalk(number[walk.nodes], walk.time_steps, walk.gaps) for walk in encoded.walks
            ]

    # Bytes of all, of which those of known positions count once.
    together = number_by_visit(GridWalks(np.concatenate(nodes), tuple(walks)))
    data, statistics = encode_with_statistics(together)
    known_share = 1 - sum(map(len, nodes[1:])) / len(together.nodes)
    once = float(statistics[POSITION_BITS, 0]) / 8 * known_share
    return (len(data) - once) * repeats + once


def _encode_or_none(base: BaseMap, tracks: Sequence[Track]) -> GridWalks | None:
    try:
        return encode_batch(base, tracks)
    except BoundError:
        return None
