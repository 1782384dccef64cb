"""Walks in the fewest bytes: coded in each mode that may pay, of which the smallest is kept."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.walk_model import (
    SHORTEST_PATHS,
    SORTED_STARTS,
    STEP_KIND_BITS,
    TIME_FIRST,
)
from gpszip.codec.prior import Prior
from gpszip.codec.walks import MAX_SORTED_TRACKS, encode_in_modes, number_by_visit
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.run.executor import Executor, local_executor

__all__ = ["encode_smallest"]

#: Whether aims pay is found out on so many knots, so that large logs don't wait for it.
_SAMPLE = 1 << 12

#: Kinds of steps that modes may spare bits of.
_BACK, _KNOWN, _NEW = 0, 1, 3


def encode_smallest(
    walks: GridWalks,
    prior: Prior | None = None,
    executor: Executor | None = None,
    *,
    grid: QuantisationGrid | None = None,
) -> bytes:
    """Code walks as :func:`gpszip.codec.walks.encode` does, but in the modes that take the fewest bytes.

    Each mode is tried by itself, and those that pay together once more. To aim takes searches: walks with more than 4,096 knots are
    coded with aims only if these pay for the first so many.

    Parameters
    ----------
    walks, past
        As :func:`gpszip.codec.walks.encode` takes them.
    executor : Executor, optional
        Where modes are tried; the bytes do not depend on it.
    grid : Frame, optional
        Epoch and time step, for the ends of pieces; these are not coded without it.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.codec.walks import decode
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1, 0], np.int32), np.array([0, 9, 18]), np.zeros(2, bool))
    >>> data = encode_smallest(GridWalks(np.array([[0, 0], [30, 4]]), (walk,)))
    >>> decode(data, dimension=2, tracks=1).walks[0].time_steps.tolist()
    [0, 9, 18]
    """
    spent = _no_bits(walks)
    plain, model = encode_in_modes(walks, prior, 0, spent, grid)
    steps = model.ledger[STEP_KIND_BITS : STEP_KIND_BITS + 5, 1]
    worth = {
        int(SORTED_STARTS): walks.timed and 2 < len(walks.walks) <= MAX_SORTED_TRACKS,
        int(TIME_FIRST): walks.timed and walks.nodes.shape[1] > 1 and steps[_NEW] > 1,
        int(SHORTEST_PATHS): steps[_BACK] + steps[_KNOWN] > 1,
    }
    modes = [mode for mode, is_worth in worth.items() if is_worth]
    coded = dict(
        zip(
            modes,
            local_executor(executor).map(
                partial(_in_mode, walks, prior, spent, plain, grid), modes
            ),
            strict=True,
        )
    )
    paying = [mode for mode, data in coded.items() if len(data) < len(plain)]
    together = (
        [encode_in_modes(walks, prior, sum(paying), spent, grid)[0]] if len(paying) > 1 else []
    )
    return min([plain, *coded.values(), *together], key=len)


def _in_mode(
    walks: GridWalks,
    prior: Prior | None,
    spent: NDArray[np.float64],
    plain: bytes,
    grid: QuantisationGrid | None,
    mode: int,
) -> bytes:
    """The walks in one mode; as they are without, where aims don't pay."""
    return (
        plain
        if mode == SHORTEST_PATHS and not _aims_pay_at_first(walks, prior)
        else encode_in_modes(walks, prior, mode, spent, grid)[0]
    )


def _aims_pay_at_first(walks: GridWalks, prior: Prior | None) -> bool:
    """Whether aims may pay for few walks, or do for the first knots of many."""
    sample = _first_knots(walks, _SAMPLE, 0 if prior is None else prior.nodes)
    if sample is walks:
        return True
    spent = _no_bits(sample)
    plain, _ = encode_in_modes(sample, prior, 0, spent)
    return len(encode_in_modes(sample, prior, int(SHORTEST_PATHS), spent)[0]) < len(plain)


def _no_bits(walks: GridWalks) -> NDArray[np.float64]:
    return np.zeros(sum(len(walk.nodes) for walk in walks.walks))


def _first_knots(walks: GridWalks, count: int, known: int) -> GridWalks:
    """The first ``count`` knots of all walks; the very same walks if they have no more."""
    if sum(len(walk.nodes) for walk in walks.walks) <= count:
        return walks
    first = []
    for walk in walks.walks:
        kept = min(count, len(walk.nodes))
        first.append(GridWalk(walk.nodes[:kept], walk.time_steps[:kept], walk.gaps[: kept - 1]))
        count -= kept
        if count == 0:
            break
    return number_by_visit(GridWalks(walks.nodes, tuple(first), walks.timed), known)
