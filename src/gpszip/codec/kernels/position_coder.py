"""Coding of places: where a new node lies, in the frame of the last step or of the axes."""

from __future__ import annotations

import numpy as np

from gpszip.codec.kernels.adaptive import SUBSTEPS, TWO_SIDED, code_mixture
from gpszip.codec.kernels.distributions import (
    FAR_OFFSET,
    MIXTURE_LIMIT,
    ZERO,
    add_distribution,
    code_large_signed,
)
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.rotation import rotate, rotate_back, sideways_offset
from gpszip.codec.kernels.walk_model import (
    HEADING,
    LAST_CELLS,
    LAST_FAR,
    MAX_MAGNITUDE,
    NO_TURN,
    STEP_LENGTH,
    SUM_CELLS,
    SUM_FAR,
    TURN,
    WalkModel,
)
from gpszip.kernels.jit import jit

__all__ = ["ON_AXES", "ON_HEADING", "code_position"]

#: Mixtures of coordinates: along the heading, across it, on further axes, and of jumps on each axis.
_P_ALONG, _P_ACROSS, _P_BESIDE, _P_JUMP = np.arange(5, 9)
_P_ALONG_PACED, _P_ACROSS_PACED = np.array([12, 13])

#: A step is taken for one of at most so many cells when it is told how far speeds lead: products stay below 2**63.
_LONGEST = np.int64(1) << 25

#: Frames of a new place.
ON_AXES, ON_HEADING = np.array([False, True])


@jit
def _code_axis(coder: Coder, model: WalkModel, mixture: int, value: int, count: int) -> int:
    """Code a coordinate, of which the first ``count`` distributions are told already."""
    sheet = model.sheet
    for octave in (0, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 17):
        count = add_distribution(sheet, count, TWO_SIDED, ZERO, np.int64(SUBSTEPS) << octave)
    outside = value >= MIXTURE_LIMIT - 1 or value < -MIXTURE_LIMIT
    near = MIXTURE_LIMIT - 1 if outside else value
    coded = code_mixture(
        coder,
        near,
        -MIXTURE_LIMIT,
        MIXTURE_LIMIT,
        sheet,
        count,
        model.weights[mixture],
        model.histograms[mixture][:0],
    )
    if coded == MIXTURE_LIMIT - 1:
        return code_large_signed(coder, model, FAR_OFFSET, value)
    return coded


@jit
def _code_along(coder: Coder, model: WalkModel, value: int, reach: int) -> int:
    sheet = model.sheet
    count = ZERO
    for shift in range(1, 5):
        count = add_distribution(sheet, count, TWO_SIDED, reach, reach >> shift)
    count = add_distribution(sheet, count, TWO_SIDED, reach >> 1, reach >> 2)
    count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach >> 2)
    count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach)
    count = add_distribution(sheet, count, TWO_SIDED, reach << 1, reach >> 1)
    return _code_axis(coder, model, _P_ALONG, value, count)


@jit
def _code_along_paced(coder: Coder, model: WalkModel, value: int, reach: int, usual: int) -> int:
    """The same where the duration tells how far the step goes at the last speed (``reach``) and at that of the last few."""
    sheet = model.sheet
    count = ZERO
    for shift in range(1, 7):
        count = add_distribution(sheet, count, TWO_SIDED, reach, reach >> shift)
    for shift in range(1, 6):
        count = add_distribution(sheet, count, TWO_SIDED, usual, usual >> shift)
    count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach >> 2)
    count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach)
    return _code_axis(coder, model, _P_ALONG_PACED, value, count)


@jit
def _code_across(
    coder: Coder, model: WalkModel, mixture: int, value: int, reach: int, along: int
) -> int:
    sheet = model.sheet
    count = ZERO
    for shift in range(1, 6):
        count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach >> shift)
    forth = min(abs(along), np.int64(1) << 26) * SUBSTEPS
    reach = min(reach, np.int64(1) << 30)
    side = (
        np.int64(np.sqrt(np.float64(reach * reach - forth * forth)))
        if forth < reach
        else np.int64(0)
    )
    for sign in (-1, 1):
        count = add_distribution(sheet, count, TWO_SIDED, sign * side, reach >> 4)
        count = add_distribution(sheet, count, TWO_SIDED, sign * side, reach >> 2)
    turn = model.scalars[TURN]
    aside = (
        sideways_offset(forth if along >= 0 else -forth, turn) if turn != NO_TURN else np.int64(0)
    )
    for shift in range(2, 4):
        count = add_distribution(sheet, count, TWO_SIDED, aside, forth >> shift)
    return _code_axis(coder, model, mixture, value, count)


@jit
def code_position(
    coder: Coder, model: WalkModel, u: int, node: int, grid: bool, cells: int
) -> None:
    """Code the place of ``node`` relative to u, in the frame of the last step (``ON_HEADING``) or of the axes (``ON_AXES``).

    Where it is told already in how many cells the step went, speeds say how far; otherwise ``cells`` is 0.
    """
    places = model.places
    dimension = places.shape[1]
    sheet = model.sheet
    scalars = model.scalars
    first = 0
    reach = max(scalars[STEP_LENGTH], np.int64(64))
    if grid and dimension > 1:
        turn = max(model.scalars[HEADING], np.int64(0))
        x, y = rotate(places[node, 0] - places[u, 0], places[node, 1] - places[u, 1], turn)
        if cells > 0 and scalars[LAST_CELLS] > 0:
            cells = min(cells, _LONGEST)
            reach = min(
                max(scalars[LAST_FAR] * cells // scalars[LAST_CELLS], np.int64(64)), MAX_MAGNITUDE
            )
            usual = min(
                max(scalars[SUM_FAR] * cells // scalars[SUM_CELLS], np.int64(64)), MAX_MAGNITUDE
            )
            x = _code_along_paced(coder, model, x, reach, usual)
            y = _code_across(coder, model, _P_ACROSS_PACED, y, reach, x)
        else:
            x = _code_along(coder, model, x, reach)
            y = _code_across(coder, model, _P_ACROSS, y, reach, x)
        x, y = rotate_back(x, y, turn)
        places[node, 0], places[node, 1] = places[u, 0] + x, places[u, 1] + y
        first = 2
    for axis in range(first, dimension):
        count = ZERO
        if grid:
            for shift in range(0, 6):
                count = add_distribution(sheet, count, TWO_SIDED, ZERO, reach >> shift)
        offset = places[node, axis] - places[u, axis]
        places[node, axis] = places[u, axis] + _code_axis(
            coder, model, _P_BESIDE if grid else _P_JUMP + axis % 4, offset, count
        )
