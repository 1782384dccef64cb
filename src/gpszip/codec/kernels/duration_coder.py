"""Coding of durations in time steps, from the length of a step and how fast such steps were before.

A duration is coded by a mixture: a histogram of the shortest, distributions that fall
exponentially, and distributions about each guess, by ratio. A guess is a logarithm to base two, in
units of 2**-16.
"""

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
    LARGE_DURATION,
    MIXTURE_LIMIT,
    ZERO,
    add_distribution,
    code_large_signed,
)
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import (
    HAS_PACE,
    LAST_LOG_DURATION,
    LENGTH_CLASSES,
    LOG_PACE,
    MAX_EDGE_SAMPLES,
    MAX_MEAN_SAMPLES,
    MEAN_LOG,
    MEAN_LOG_PACE,
    MEAN_SAMPLES,
    ROW_NEW_NODE,
    WalkModel,
    length_class,
    log_duration,
    node_distance,
    update_mean_log,
)
from gpszip.codec.kernels.walk_priors import MIX_DURATION_FIRST, MIX_MOVE
from gpszip.kernels.jit import inner, inner_uncounted

__all__ = ["code_duration_first", "code_move_duration", "code_pause_duration"]

#: Steepness of the widest distribution about a guess, in halves for an octave, and number of the
#: distributions, each twice as steep as the one before.
_MOVE_STEEPNESS = np.int64(3)
_MOVE_WIDTHS = np.int64(5)
_PAUSE_STEEPNESS = np.int64(1)
_PAUSE_WIDTHS = np.int64(3)
_DURATION_FIRST_WIDTHS = np.int64(5)

#: Distributions that fall exponentially.
_ONE_SIDED_COUNT = 9

#: Durations are at least this many time steps.
_MIN_DURATION = np.int64(1)

#: Weights of a guess's sources: all classes of about the length, the half-edge, its opposite.
_CLASS_WEIGHT = 3
_EDGE_WEIGHT = 4
_OPPOSITE_WEIGHT = 2


@inner_uncounted
def _code_duration(
    coder: Coder,
    model: WalkModel,
    mixture_id: int,
    guesses: NDArray[np.int64],
    guess_count: int,
    steepness: int,
    widths: int,
    duration: int,
) -> int:
    """Code a duration in time steps.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the duration.
    mixture_id : int
        One of the mixtures ``MIX_*``.
    guesses : int64 array
        Logarithms of the durations to expect.
    guess_count : int
        How many of them there are.
    steepness, widths : int
        Steepness of the widest distribution about a guess, and number of the distributions.
    duration : int
        The duration to encode; ignored by a decoder.
    """
    # a histogram, and scales of 1, 2, 4, 8, 16, 64, 256, 1024 and 4096 time steps
    mixture = model.mixture
    count = add_distribution(mixture, ZERO, HISTOGRAM, ZERO, np.int64(SUBSTEPS))
    for i in range(_ONE_SIDED_COUNT):
        octave = i if i < 5 else 2 * i - 4
        count = add_distribution(mixture, count, ONE_SIDED, ZERO, np.int64(SUBSTEPS) << octave)

    # Distributions about each guess.
    for i in range(guess_count):
        for width in range(widths):
            mixture[KINDS, count] = BY_RATIO
            mixture[CENTERS, count] = guesses[i]
            mixture[SCALES, count] = steepness << width
            count += 1

    # The largest value of the mixture stands for all that don't fit.
    coded = code_mixture(
        coder,
        min(duration, MIXTURE_LIMIT - 1),
        _MIN_DURATION,
        MIXTURE_LIMIT,
        mixture,
        count,
        model.mixture_weights[mixture_id],
        model.histograms[mixture_id],
    )
    if coded == MIXTURE_LIMIT - 1:
        rest = duration - coded if duration >= MIXTURE_LIMIT else np.int64(0)
        return coded + code_large_signed(coder, model, LARGE_DURATION, rest)
    return coded


@inner
def code_pause_duration(
    coder: Coder, model: WalkModel, mixture_id: int, row: int, duration: int
) -> int:
    """Code the duration of a stop or gap, and learn it.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the duration.
    mixture_id, row : int
        ``MIX_STAY`` and ``ROW_STAY``, or ``MIX_GAP`` and ``ROW_GAP``.
    duration : int
        The duration to encode; ignored by a decoder.
    """
    # The mean of those before is the only guess.
    guesses = np.empty(1, np.int64)
    guesses[0] = model.duration_means[row, MEAN_LOG]
    duration = _code_duration(
        coder,
        model,
        mixture_id,
        guesses,
        min(model.duration_means[row, MEAN_SAMPLES], 1),
        _PAUSE_STEEPNESS,
        _PAUSE_WIDTHS,
        duration,
    )
    update_mean_log(model, row, MAX_MEAN_SAMPLES, log_duration(duration))
    return duration


@inner
def code_duration_first(coder: Coder, model: WalkModel, duration: int) -> int:
    """Code the duration of a step to a new node before its position, and learn it."""
    # Guesses are the mean of such durations, and the last one.
    guesses = np.empty(2, np.int64)
    guesses[0] = model.duration_means[ROW_NEW_NODE, MEAN_LOG]
    guesses[1] = model.scalars[LAST_LOG_DURATION]
    duration = _code_duration(
        coder,
        model,
        MIX_DURATION_FIRST,
        guesses,
        2 * min(model.duration_means[ROW_NEW_NODE, MEAN_SAMPLES], 1),
        _PAUSE_STEEPNESS,
        _DURATION_FIRST_WIDTHS,
        duration,
    )
    model.scalars[LAST_LOG_DURATION] = log_duration(duration)
    update_mean_log(model, ROW_NEW_NODE, MAX_MEAN_SAMPLES, model.scalars[LAST_LOG_DURATION])
    return duration


@inner
def code_move_duration(
    coder: Coder, model: WalkModel, half_edge: int, u: int, v: int, duration: int
) -> int:
    """Code the duration of a step from u to v on a known half-edge, or on a new edge (-1)."""
    guesses = np.empty(3, np.int64)
    guess_count = _guess(model, half_edge, node_distance(model.places, u, v), guesses)
    return _code_duration(
        coder, model, MIX_MOVE, guesses, guess_count, _MOVE_STEEPNESS, _MOVE_WIDTHS, duration
    )


@inner_uncounted
def _guess(model: WalkModel, half_edge: int, length: int, guesses: NDArray[np.int64]) -> int:
    """Fill in logarithms of the durations to expect for a step of a length; return how many.

    The guesses are a mean W / V over the length and the half-edge, log(length) + the last pace, and
    log(length) + the mean pace. With n the traversals and m the mean logarithms, V sums up 3 for
    the length, 4 n for the half-edge and 2 n for its opposite, and W these times their m.
    """
    # V and W
    weight, total = _sum_near_classes(model, length)
    total = _CLASS_WEIGHT * (total // weight) if weight > 0 else np.int64(0)
    weight = _CLASS_WEIGHT if weight > 0 else 0
    if half_edge >= 0:
        for edge, share in ((half_edge, _EDGE_WEIGHT), (half_edge ^ 1, _OPPOSITE_WEIGHT)):
            samples = share * min(model.traversals[edge], MAX_EDGE_SAMPLES)
            weight += samples
            total += samples * model.mean_log_duration[edge]

    # Without a pace, only the mean is left.
    scalars = model.scalars
    if scalars[HAS_PACE] == 0:
        if weight == 0:
            return 0
        guesses[0] = total // weight
        return 1
    log_length = fixed_log2(max(length, np.int64(1)))
    guesses[0] = total // weight if weight > 0 else log_length + scalars[MEAN_LOG_PACE]
    guesses[1] = log_length + scalars[LOG_PACE]
    guesses[2] = log_length + scalars[MEAN_LOG_PACE]
    return 3


@inner_uncounted
def _sum_near_classes(model: WalkModel, length: int) -> tuple[int, int]:
    """Weight and weighted sum of the mean logarithms of steps about as long.

    The classes two below to two above that of the length weigh 1, 5, 33, 5, 1 for each sample.
    """
    weight, total = np.int64(0), np.int64(0)
    row = length_class(length)
    means = model.duration_means
    for offset, share in ((-2, 1), (-1, 5), (0, 33), (1, 5), (2, 1)):
        if 0 <= row + offset < LENGTH_CLASSES:
            samples = share * means[row + offset, MEAN_SAMPLES]
            weight += samples
            total += samples * means[row + offset, MEAN_LOG]
    return weight, total
