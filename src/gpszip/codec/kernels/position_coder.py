"""Coding of the position of a new node, on the axes of the last step or on those of the grid.

An offset is coded by a mixture. Its distributions are centred where steps like the last ones would
lead, and about 0 with scales that cover all magnitudes.
"""

from __future__ import annotations

import numpy as np

from gpszip.codec.kernels.adaptive import SUBSTEPS, TWO_SIDED, code_mixture
from gpszip.codec.kernels.distributions import (
    LARGE_OFFSET,
    MIXTURE_LIMIT,
    ZERO,
    add_distribution,
    code_large_signed,
)
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.rotation import rotate, rotate_back, sideways_offset
from gpszip.codec.kernels.walk_model import (
    DURATION_SUM,
    HEADING,
    LAST_DURATION,
    LAST_LENGTH,
    LENGTH_SUM,
    MAX_MAGNITUDE,
    NO_TURN,
    STEP_LENGTH,
    TURN,
    WalkModel,
)
from gpszip.codec.kernels.walk_priors import (
    MIX_ACROSS,
    MIX_ACROSS_TIMED,
    MIX_ALONG,
    MIX_ALONG_TIMED,
    MIX_BESIDE,
    MIX_JUMP,
)
from gpszip.kernels.jit import inner_uncounted

__all__ = ["ON_GRID_AXES", "ON_HEADING", "code_position"]

#: Axes on which an offset is coded: those of the grid, or along and across the heading.
ON_GRID_AXES = np.bool_(False)
ON_HEADING = np.bool_(True)

#: A known duration counts as at most this many time steps: products with lengths stay below 2**63.
_MAX_DURATION = np.int64(1) << 25

#: The step to expect is at least this long, in sixteenths of a space step.
_MIN_REACH = np.int64(64)

#: The largest offset along the heading, in space steps, and the largest reach, in sixteenths, with
#: which the offset across it is computed: their squares stay below 2**63.
_MAX_ALONG = np.int64(1) << 26
_MAX_REACH = np.int64(1) << 30

#: Mixtures of jumps: one for each of so many axes.
_JUMP_AXES = 4


@inner_uncounted
def _code_axis(coder: Coder, model: WalkModel, mixture_id: int, value: int, count: int) -> int:
    """Code an offset on one axis with a mixture, given its first ``count`` distributions.

    Others follow about 0, with scales of 1 to 2**17 space steps.
    """
    # Add distributions about 0 with scales of 2**octave space steps.
    mixture = model.mixture
    for octave in (0, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 17):
        count = add_distribution(mixture, count, TWO_SIDED, ZERO, np.int64(SUBSTEPS) << octave)

    # The largest value of the mixture stands for all that don't fit.
    is_large = value >= MIXTURE_LIMIT - 1 or value < -MIXTURE_LIMIT
    coded = code_mixture(
        coder,
        MIXTURE_LIMIT - 1 if is_large else value,
        -MIXTURE_LIMIT,
        MIXTURE_LIMIT,
        mixture,
        count,
        model.mixture_weights[mixture_id],
        model.histograms[mixture_id][:0],
    )
    if coded == MIXTURE_LIMIT - 1:
        return code_large_signed(coder, model, LARGE_OFFSET, value)
    return coded


@inner_uncounted
def _code_along(coder: Coder, model: WalkModel, value: int, reach: int) -> int:
    """Code an offset along the heading, given the mean length of steps."""
    mixture = model.mixture
    count = ZERO
    for shift in range(1, 5):
        count = add_distribution(mixture, count, TWO_SIDED, reach, reach >> shift)
    count = add_distribution(mixture, count, TWO_SIDED, reach >> 1, reach >> 2)
    count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach >> 2)
    count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach)
    count = add_distribution(mixture, count, TWO_SIDED, reach << 1, reach >> 1)
    return _code_axis(coder, model, MIX_ALONG, value, count)


@inner_uncounted
def _code_along_timed(
    coder: Coder, model: WalkModel, value: int, reach: int, mean_reach: int
) -> int:
    """Code an offset along the heading, given how far its duration leads at the known speeds.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the offset.
    value : int
        The offset; ignored by a decoder.
    reach, mean_reach : int
        Lengths at the last speed, and at the mean of the last few, in sixteenths of a space step.
    """
    mixture = model.mixture
    count = ZERO
    for shift in range(1, 7):
        count = add_distribution(mixture, count, TWO_SIDED, reach, reach >> shift)
    for shift in range(1, 6):
        count = add_distribution(mixture, count, TWO_SIDED, mean_reach, mean_reach >> shift)
    count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach >> 2)
    count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach)
    return _code_axis(coder, model, MIX_ALONG_TIMED, value, count)


@inner_uncounted
def _code_across(
    coder: Coder, model: WalkModel, mixture_id: int, value: int, reach: int, along: int
) -> int:
    """Code an offset across the heading, given the length to expect and the offset along."""
    # Expect the node straight ahead, within 1/2 to 1/32 of the length to expect.
    mixture = model.mixture
    count = ZERO
    for shift in range(1, 6):
        count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach >> shift)

    # Left or right such that the step has the length to expect: sqrt(reach**2 - along**2).
    along_size = min(abs(along), _MAX_ALONG) * SUBSTEPS
    reach = min(reach, _MAX_REACH)
    side = np.int64(0)
    if along_size < reach:
        side = np.int64(np.sqrt(np.float64(reach * reach - along_size * along_size)))
    for sign in (-1, 1):
        count = add_distribution(mixture, count, TWO_SIDED, sign * side, reach >> 4)
        count = add_distribution(mixture, count, TWO_SIDED, sign * side, reach >> 2)

    # Such that the walk turns as it did last.
    turn = model.scalars[TURN]
    turned = np.int64(0)
    if turn != NO_TURN:
        turned = sideways_offset(along_size if along >= 0 else -along_size, turn)
    for shift in range(2, 4):
        count = add_distribution(mixture, count, TWO_SIDED, turned, along_size >> shift)
    return _code_axis(coder, model, mixture_id, value, count)


@inner_uncounted
def _reach_at_speed(length: int, duration: int, time_steps: int) -> int:
    """Length of a step of ``time_steps`` at the speed ``length`` / ``duration``."""
    return min(max(length * time_steps // duration, _MIN_REACH), MAX_MAGNITUDE)


@inner_uncounted
def _code_on_heading(
    coder: Coder, model: WalkModel, u: int, node: int, reach: int, duration: int
) -> int:
    """Code the first two coordinates of ``node`` along and across the heading.

    Returns the length to expect, which a known duration changes; see :func:`code_position`.
    """
    # Rotate the step to axes along and across the heading.
    positions, scalars = model.places, model.scalars
    direction = max(scalars[HEADING], np.int64(0))
    along, across = rotate(
        positions[node, 0] - positions[u, 0], positions[node, 1] - positions[u, 1], direction
    )

    # Code along, then across given along. With a known duration, the last speed and the mean
    # speed yield the lengths to expect.
    if duration > 0 and scalars[LAST_DURATION] > 0:
        duration = min(duration, _MAX_DURATION)
        reach = _reach_at_speed(scalars[LAST_LENGTH], scalars[LAST_DURATION], duration)
        mean_reach = _reach_at_speed(scalars[LENGTH_SUM], scalars[DURATION_SUM], duration)
        along = _code_along_timed(coder, model, along, reach, mean_reach)
        across = _code_across(coder, model, MIX_ACROSS_TIMED, across, reach, along)
    else:
        along = _code_along(coder, model, along, reach)
        across = _code_across(coder, model, MIX_ACROSS, across, reach, along)

    # Rotate back to the grid's axes; a decoder gets the position from it.
    x, y = rotate_back(along, across, direction)
    positions[node, 0], positions[node, 1] = positions[u, 0] + x, positions[u, 1] + y
    return reach


@inner_uncounted
def code_position(
    coder: Coder, model: WalkModel, u: int, node: int, on_heading: bool, duration: int
) -> None:
    """Code the position of a new node, relative to that of u.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        ``places[node]`` holds the position; a decoder fills it in.
    u, node : int
        Where the walk is, and the new node.
    on_heading : bool
        ``ON_HEADING`` or ``ON_GRID_AXES``.
    duration : int
        Time steps that the step takes, where they are coded before it; otherwise 0.
    """
    # Code the first two coordinates along and across the heading, if that is asked for.
    positions, mixture = model.places, model.mixture
    dimension = positions.shape[1]
    reach = max(model.scalars[STEP_LENGTH], _MIN_REACH)
    first = 0
    if on_heading and dimension > 1:
        reach = _code_on_heading(coder, model, u, node, reach, duration)
        first = 2

    # The other axes: height, or all of them.
    for axis in range(first, dimension):
        count = ZERO
        if on_heading:
            for shift in range(0, 6):
                count = add_distribution(mixture, count, TWO_SIDED, ZERO, reach >> shift)
        mixture_id = MIX_BESIDE if on_heading else MIX_JUMP + axis % _JUMP_AXES
        offset = positions[node, axis] - positions[u, axis]
        offset = _code_axis(coder, model, mixture_id, offset, count)
        positions[node, axis] = positions[u, axis] + offset
