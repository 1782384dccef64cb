"""How coarse the times of knots may be for a whole log, once the map of an excerpt stands.

On an excerpt, nodes cost much and walks little; in all of a large log it is the other way round. The nodes stay where they were
learnt. Of the error that is left to walks on them, a coarser lattice of times makes use, which costs each of their knots less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpszip.codec.kernels.walk_model import POSITION_BITS
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode_with_statistics, number_by_visit
from gpszip.errors import BoundError
from gpszip.model import GridWalk, GridWalks, Track
from gpszip.model.grid import STEP_SIZES
from gpszip.pipeline.encode_batches import Ground, Samples, lay_batch, read_stretch
from gpszip.pipeline.slices import Stretch
from gpszip.run.executor import Executor, share_value
from gpszip.walks.quantised import dequantise_walks, node_positions, quantise_walks

__all__ = ["coarsened"]

#: Steps of quanta by which times get coarser at once (eight of them double it), and the most of them.
_STEP, _MOST = 2, 12

#: One of so many batches is tried, but no more than so many in all; logs of fewer batches aren't worth it.
_ONE_OF, _TRIED, _FEWEST = 16, 6, 6


def coarsened(
    log: Samples, ground: Ground, batches: Sequence[Sequence[Stretch]], executor: Executor
) -> Ground:
    """Return the ground with the lattice of times on which some batches of the log take least.

    Parameters
    ----------
    log : Samples
        The log.
    ground : Ground
        As it was learnt.
    batches : sequence of sequences of Stretch
        All of the log; a few, evenly spread, are laid on each lattice until it doesn't pay any more.
    executor : Executor
        Where they are laid; the result does not depend on it.
    """
    if len(batches) < _FEWEST:
        return ground
    count = min(max(len(batches) // _ONE_OF, 1), _TRIED)
    some = [batches[(2 * number + 1) * len(batches) // (2 * count)] for number in range(count)]
    best, least = ground, _cost(log, ground, some, len(batches) / count, executor)
    for steps in range(_STEP, min(_MOST, STEP_SIZES - 1 - ground.grid.time) + 1, _STEP):
        other = _on_coarser_times(ground, steps)
        cost = _cost(log, other, some, len(batches) / count, executor)
        if cost >= least:
            break
        best, least = other, cost
    return best


def _on_coarser_times(ground: Ground, steps: int) -> Ground:
    grid, known = replace(ground.grid, time=ground.grid.time + steps), ground.known.walks
    walks = dequantise_walks(
        known, ground.grid, [str(number) for number in range(len(known.walks))]
    )
    prior = Prior(number_by_visit(quantise_walks(node_positions(known, ground.grid), walks, grid)))
    prior.model(0)  # learnt once, before several batches ask for it
    return replace(ground, grid=grid, known=prior)


def _cost(
    log: Samples,
    ground: Ground,
    batches: Sequence[Sequence[Stretch]],
    times: float,
    executor: Executor,
) -> float:
    """Bytes of so many times these batches, for which known places are said but once; infinite if one can't hold the bound."""
    nodes, walks = [ground.known.walks.nodes], list[GridWalk]()
    with share_value(executor, ground) as shared:
        for found in shared.map(
            _tried, ([read_stretch(log, stretch) for stretch in own] for own in batches)
        ):
            if found is None:
                return math.inf
            own = sum(map(len, nodes)) + np.arange(len(found.nodes))
            number = np.append(np.arange(ground.known.nodes), own).astype(np.int32)
            nodes.append(found.nodes)
            walks += [
                GridWalk(number[walk.nodes], walk.time_steps, walk.gaps) for walk in found.walks
            ]
    whole = number_by_visit(GridWalks(np.concatenate(nodes), tuple(walks)))
    data, ledger = encode_with_statistics(whole)
    once = float(ledger[POSITION_BITS, 0]) / 8 * (1 - sum(map(len, nodes[1:])) / len(whole.nodes))
    return (len(data) - once) * times + once


def _tried(ground: Ground, tracks: Sequence[Track]) -> GridWalks | None:
    try:
        return lay_batch(ground, tracks)
    except BoundError:
        return None
