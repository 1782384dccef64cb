"""Walks in the fewest bytes: encoded in each mode that may pay, to keep the smallest result."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.step_coder import KIND_BACK, KIND_KNOWN, KIND_NEW_NODE
from gpszip.codec.kernels.walk_model import (
    SHORTEST_PATHS,
    SORTED_STARTS,
    STEP_KIND_BITS,
    TIME_FIRST,
    WalkModel,
)
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.payload_head import MAX_SORTED_TRACKS
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode_in_modes
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.run.executor import Executor, local_executor

__all__ = ["encode_smallest"]

#: Knots on which shortest paths are tried, so that large logs need not be encoded once in vain.
_SAMPLE_KNOTS = 1 << 12


def encode_smallest(
    walks: GridWalks,
    prior: Prior | None = None,
    executor: Executor | None = None,
    *,
    grid: QuantisationGrid | None = None,
) -> bytes:
    """Encode walks as :func:`gpszip.codec.walks.encode` does, in the modes that take fewest bytes.

    Each mode is tried by itself, then all that pay together. Shortest paths take searches: walks of
    more than 4,096 knots are encoded with them only if they pay for the first 4,096.

    Parameters
    ----------
    walks : GridWalks
        As :func:`gpszip.codec.walks.encode` takes them.
    prior : Prior, optional
        As :func:`gpszip.codec.walks.encode` takes it.
    executor : Executor, optional
        Where modes are tried; the bytes do not depend on it.
    grid : QuantisationGrid, optional
        Epoch and time step, for the ends of pieces; these are not coded without it.

    Returns
    -------
    bytes
        What :func:`gpszip.codec.walks.decode` reads.

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
    # Without modes, which also measures the bits of each step. The mode of shortest paths needs
    # them: a target pays where it saves more than it costs.
    step_bits = _zero_bits(walks)
    plain, model = encode_in_modes(walks, prior, 0, step_bits, grid)

    # Each mode by itself.
    modes = _plausible_modes(walks, model)
    encode_mode = partial(_encode_mode, walks, prior, step_bits, plain, grid)
    encoded = dict(zip(modes, local_executor(executor).map(encode_mode, modes), strict=True))

    # All modes that pay, together.
    paying = [mode for mode, data in encoded.items() if len(data) < len(plain)]
    candidates = [plain, *encoded.values()]
    if len(paying) > 1:
        candidates.append(encode_in_modes(walks, prior, sum(paying), step_bits, grid)[0])

    # Of results as long, the first is taken: fewer modes, whatever the executor.
    return min(candidates, key=len)


def _plausible_modes(walks: GridWalks, model: WalkModel) -> list[int]:
    """Modes that may take fewer bytes, given the model after coding without any."""
    # How many steps there are of each kind; column 0 has their bits. Durations come first at new
    # nodes only, and a path over known edges that saves anything has two steps.
    steps = model.statistics[STEP_KIND_BITS:, 1]
    may_pay = {
        int(SORTED_STARTS): walks.timed and 2 < len(walks.walks) <= MAX_SORTED_TRACKS,
        int(TIME_FIRST): walks.timed and walks.nodes.shape[1] > 1 and steps[KIND_NEW_NODE] > 1,
        int(SHORTEST_PATHS): steps[KIND_BACK] + steps[KIND_KNOWN] > 1,
    }
    return [mode for mode, pays in may_pay.items() if pays]


def _encode_mode(
    walks: GridWalks,
    prior: Prior | None,
    step_bits: NDArray[np.float64],
    plain: bytes,
    grid: QuantisationGrid | None,
    mode: int,
) -> bytes:
    """Walks in one mode; ``plain``, without any, where shortest paths don't pay in the sample."""
    if mode == SHORTEST_PATHS and not _do_shortest_paths_pay(walks, prior):
        return plain
    return encode_in_modes(walks, prior, mode, step_bits, grid)[0]


def _do_shortest_paths_pay(walks: GridWalks, prior: Prior | None) -> bool:
    """Whether shortest paths pay for the first knots of many; True for few."""
    sample = _first_knots(walks, _SAMPLE_KNOTS, 0 if prior is None else prior.nodes)
    # Trying the sample would encode all walks twice.
    if sample is walks:
        return True
    step_bits = _zero_bits(sample)
    plain, _ = encode_in_modes(sample, prior, 0, step_bits)
    return len(encode_in_modes(sample, prior, int(SHORTEST_PATHS), step_bits)[0]) < len(plain)


def _zero_bits(walks: GridWalks) -> NDArray[np.float64]:
    """One number for each knot, to be filled in."""
    return np.zeros(sum(len(walk.nodes) for walk in walks.walks))


def _first_knots(walks: GridWalks, count: int, known: int) -> GridWalks:
    """The first ``count`` knots of all walks; the same object if they have no more."""
    if sum(len(walk.nodes) for walk in walks.walks) <= count:
        return walks
    shortened = []
    for walk in walks.walks:
        kept = min(count, len(walk.nodes))
        shortened.append(GridWalk(walk.nodes[:kept], walk.time_steps[:kept], walk.gaps[: kept - 1]))
        count -= kept
        if count == 0:
            break

    # The encoder expects no node that is never visited, save those of a prior.
    return number_by_visit(GridWalks(walks.nodes, tuple(shortened), walks.timed), known)
