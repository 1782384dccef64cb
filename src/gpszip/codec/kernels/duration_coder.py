"""Coding of durations: how many cells a part takes, given how far it goes and how fast the way was gone before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import (
    BY_RATIO,
    CENTERS,
    HISTOGRAM,
    KINDS,
    ONE_SIDED,
    SCALES,
    SUBSTEPS,
    code_mixture,
)
from gpszip.codec.kernels.distributions import (
    FAR_SPAN,
    MIXTURE_LIMIT,
    ZERO,
    add_distribution,
    code_large_signed,
)
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import (
    LAST_NEW,
    LENGTH_CLASSES,
    MAX_MAGNITUDE,
    PACE,
    PACE_SLOW,
    TIMED,
    U_NEW,
    WalkModel,
    length_class,
    node_distance,
    update_mean_log,
)
from gpszip.kernels.jit import jit

__all__ = [
    "T_GAP",
    "T_MOVE",
    "T_STAY",
    "code_duration_first",
    "code_move_duration",
    "code_pause_duration",
]

#: Mixtures of durations: of parts that move, of stops and of gaps.
T_MOVE, T_STAY, T_GAP, _T_AHEAD = np.arange(4)

#: How steep the widest distribution about a guess is, and how many there are, each twice as steep as the one before.
_MOVE_STEEP, _MOVE_WIDTHS, _REST_STEEP, _REST_WIDTHS, _AHEAD_WIDTHS = np.array([3, 5, 1, 3, 5])

#: Spans are at least this long.
_LEAST = np.int64(1)

#: A mean of stops or gaps is that of about so many.
_RESTS = np.int64(20)


@jit
def _code_span(
    coder: Coder,
    model: WalkModel,
    mixture: int,
    guesses: NDArray[np.int64],
    known: int,
    steep: int,
    widths: int,
    cells: int,
) -> int:
    """Code a duration in cells; ``guesses`` holds ``known`` logarithms of the cells to expect."""
    sheet = model.sheet
    count = add_distribution(sheet, ZERO, HISTOGRAM, ZERO, np.int64(SUBSTEPS))
    for i in range(9):
        count = add_distribution(
            sheet, count, ONE_SIDED, ZERO, np.int64(SUBSTEPS) << (i if i < 5 else 2 * i - 4)
        )
    for i in range(known):
        for width in range(widths):
            sheet[KINDS, count], sheet[CENTERS, count], sheet[SCALES, count] = (
                BY_RATIO,
                guesses[i],
                steep << width,
            )
            count += 1
    far = cells >= MIXTURE_LIMIT
    cells_near = min(cells, MIXTURE_LIMIT - 1)
    coded = code_mixture(
        coder,
        cells_near,
        _LEAST,
        MIXTURE_LIMIT,
        sheet,
        count,
        model.weights[mixture],
        model.histograms[mixture],
    )
    if coded == MIXTURE_LIMIT - 1:
        return coded + code_large_signed(
            coder, model, FAR_SPAN, cells - coded if far else np.int64(0)
        )
    return coded


@jit
def code_pause_duration(coder: Coder, model: WalkModel, mixture: int, row: int, cells: int) -> int:
    """Code the duration of a stop or gap, by those before; ``row`` is where ``usual`` keeps them."""
    guesses = np.empty(1, np.int64)
    guesses[0] = model.usual[row, 0]
    cells = _code_span(
        coder,
        model,
        mixture,
        guesses,
        min(model.usual[row, 1], 1),
        _REST_STEEP,
        _REST_WIDTHS,
        cells,
    )
    update_mean_log(model, row, _RESTS, fixed_log2(min(max(cells, np.int64(1)), MAX_MAGNITUDE)))
    return cells


@jit
def code_duration_first(coder: Coder, model: WalkModel, cells: int) -> int:
    """Code the duration of a step to a new node before its place is told, by those before."""
    guesses = np.empty(2, np.int64)
    guesses[0], guesses[1] = model.usual[U_NEW, 0], model.scalars[LAST_NEW]
    cells = _code_span(
        coder,
        model,
        _T_AHEAD,
        guesses,
        2 * min(model.usual[U_NEW, 1], 1),
        _REST_STEEP,
        _AHEAD_WIDTHS,
        cells,
    )
    model.scalars[LAST_NEW] = fixed_log2(min(max(cells, np.int64(1)), MAX_MAGNITUDE))
    update_mean_log(model, U_NEW, _RESTS, model.scalars[LAST_NEW])
    return cells


@jit
def code_move_duration(
    coder: Coder, model: WalkModel, half: int, u: int, v: int, cells: int
) -> int:
    """Code the duration of a step from u to v, on a known half-edge or a new way (-1)."""
    guesses = np.empty(3, np.int64)
    known = _guess(model, half, node_distance(model.places, u, v), guesses)
    return _code_span(coder, model, T_MOVE, guesses, known, _MOVE_STEEP, _MOVE_WIDTHS, cells)


@jit
def _guess(model: WalkModel, half: int, far: int, guesses: NDArray[np.int64]) -> int:
    """Logarithms of the cells to expect: as usual on this way and at this length, at the last pace, at the usual pace."""
    weight, total = _of_class(model, far)
    total = 3 * (total // weight) if weight > 0 else np.int64(0)
    weight = 3 if weight > 0 else 0
    if half >= 0:
        for way, share in ((half, 4), (half ^ 1, 2)):
            times = share * min(model.count[way], np.int64(12))
            weight += times
            total += times * model.usual_span[way]
    scalars = model.scalars
    length_log = fixed_log2(max(far, np.int64(1)))
    if scalars[TIMED] == 0:
        if weight == 0:
            return 0
        guesses[0] = total // weight
        return 1
    guesses[0] = total // weight if weight > 0 else length_log + scalars[PACE_SLOW]
    guesses[1] = length_log + scalars[PACE]
    guesses[2] = length_log + scalars[PACE_SLOW]
    return 3


@jit
def _of_class(model: WalkModel, far: int) -> tuple[int, int]:
    """Weight and weighted sum of the mean logarithms of steps about as long."""
    weight, total = np.int64(0), np.int64(0)
    row = length_class(far)
    for near, share in ((-2, 1), (-1, 5), (0, 33), (1, 5), (2, 1)):
        if 0 <= row + near < LENGTH_CLASSES:
            times = share * model.usual[row + near, 1]
            weight += times
            total += times * model.usual[row + near, 0]
    return weight, total
