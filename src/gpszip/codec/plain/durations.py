"""Durations in time steps; see :mod:`gpszip.codec.kernels.duration_coder`.

Guesses are logarithms to base two, in units of 2**-16.
"""

from __future__ import annotations

from collections.abc import Sequence

from gpszip.codec.kernels.walk_priors import MIX_DURATION_FIRST, MIX_MOVE
from gpszip.codec.plain.distributions import Durations
from gpszip.codec.plain.log2 import fixed_log2
from gpszip.codec.plain.model import LARGE_DURATION, MAX_MAGNITUDE, MIXTURE_LIMIT, PlainModel
from gpszip.codec.plain.walk_map import HalfEdge
from gpszip.errors import CorruptArchiveError

__all__ = [
    "ROW_GAP",
    "ROW_STAY",
    "learn_duration",
    "read_duration_first",
    "read_move_duration",
    "read_pause_duration",
]

#: Steepness of the distributions about a guess, in halves for an octave.
_MOVE_STEEPNESS = (3, 6, 12, 24, 48)
_PAUSE_STEEPNESS = (1, 2, 4)
_FIRST_STEEPNESS = (1, 2, 4, 8, 16)

#: Durations are at least this many time steps.
_MIN_DURATION = 1

#: Classes of lengths, and what else has a mean duration: keys of ``PlainModel.means``.
_LENGTH_CLASSES = 48
ROW_STAY = 48
ROW_GAP = 49
_ROW_NEW_NODE = 50  # where durations come first

#: Weights of the classes from two below to two above that of a length.
_CLASS_SHARES = ((-2, 1), (-1, 5), (0, 33), (1, 5), (2, 1))

#: Weights of a guess's sources: all classes of about the length, the half-edge, its opposite.
_CLASS_WEIGHT = 3
_EDGE_WEIGHT = 4
_OPPOSITE_WEIGHT = 2

#: Samples that a mean has at most: of a class of lengths, of a half-edge, of stops and gaps.
_MAX_CLASS_SAMPLES = 20
_MAX_EDGE_SAMPLES = 12
_MAX_PAUSE_SAMPLES = 20

#: Lengths below this, in sixteenths of a space step, are in the first class.
_FIRST_CLASS = 16

#: Largest length and duration that count for a speed.
_MAX_SPEED_LENGTH = 1 << 34
_MAX_SPEED_DURATION = 1 << 25


def read_pause_duration(model: PlainModel, mixture_id: int, row: int) -> int:
    """Read the duration of a stop or gap, and learn it."""
    # Without a sample, there is no guess.
    mean, samples = model.means.get(row, (0, 0))
    duration = _read_duration(model, mixture_id, [mean] if samples else [], _PAUSE_STEEPNESS)
    _update_mean(model, row, _MAX_PAUSE_SAMPLES, _log_duration(duration))
    return duration


def read_duration_first(model: PlainModel) -> int:
    """Read the duration of a step to a new node before its position, and learn it."""
    mean, samples = model.means.get(_ROW_NEW_NODE, (0, 0))
    guesses = [mean, model.last_log_duration] if samples else []
    duration = _read_duration(model, int(MIX_DURATION_FIRST), guesses, _FIRST_STEEPNESS)
    model.last_log_duration = _log_duration(duration)
    _update_mean(model, _ROW_NEW_NODE, _MAX_PAUSE_SAMPLES, model.last_log_duration)
    return duration


def read_move_duration(model: PlainModel, u: int, v: int, edge: HalfEdge | None) -> int:
    """Read the duration of a step from u to v on a known half-edge, or on a new edge."""
    length = model.map.length(u, v) if edge is None else edge.length
    return _read_duration(model, int(MIX_MOVE), _guess(model, length, edge), _MOVE_STEEPNESS)


def learn_duration(model: PlainModel, edge: HalfEdge, duration: int) -> None:
    """Learn the duration of a step on a half-edge, and the pace."""
    # Means of its length and of the half-edge, which has the step counted already.
    log = _log_duration(duration)
    _update_mean(model, _length_class(edge.length), _MAX_CLASS_SAMPLES, log)
    edge.mean_log += (log - edge.mean_log) // min(edge.traversals, _MAX_EDGE_SAMPLES)
    if edge.length == 0:
        return

    # The pace, and its mean.
    pace = log - fixed_log2(edge.length)
    if model.log_pace is None:
        model.mean_log_pace = pace
    else:
        model.mean_log_pace += 5 * (pace - model.mean_log_pace) // 32
    model.log_pace = pace

    # The speed, and fading sums.
    model.speed = min(edge.length, _MAX_SPEED_LENGTH), min(duration, _MAX_SPEED_DURATION)
    lengths, durations = model.speed_sums
    model.speed_sums = (
        lengths + model.speed[0] - (lengths >> 3),
        durations + model.speed[1] - (durations >> 3),
    )


def _read_duration(
    model: PlainModel, mixture_id: int, guesses: Sequence[int], steepness: Sequence[int]
) -> int:
    """Read a duration with distributions about each guess.

    Raises
    ------
    CorruptArchiveError
        If it is not positive. The compiled decoder finds that once all knots are read.
    """
    mixture = model.mixture(mixture_id)
    pairs = [(guess, steep) for guess in guesses for steep in steepness]
    durations = Durations(mixture.histogram, pairs, _MIN_DURATION)
    duration = model.read_mixture(mixture, _MIN_DURATION, MIXTURE_LIMIT, durations)

    # The largest value stands for all that don't fit.
    if duration == MIXTURE_LIMIT - 1:
        duration += model.read_signed(LARGE_DURATION)
        if duration < _MIN_DURATION:
            raise CorruptArchiveError("times of the walks go back")
    return duration


def _guess(model: PlainModel, length: int, edge: HalfEdge | None) -> list[int]:
    """Logarithms of the durations to expect: none, a mean, or that and two by the pace.

    See :func:`gpszip.codec.kernels.duration_coder._guess`.
    """
    # a mean over the length, the half-edge and its opposite
    weight, total = _sum_near_classes(model, length)
    if weight:
        # All classes together weigh 3, however many samples they have.
        weight, total = _CLASS_WEIGHT, _CLASS_WEIGHT * (total // weight)
    if edge is not None:
        for half, share in ((edge, _EDGE_WEIGHT), (edge.opposite, _OPPOSITE_WEIGHT)):
            samples = share * min(half.traversals, _MAX_EDGE_SAMPLES)
            weight += samples
            total += samples * half.mean_log

    # Without a pace, only the mean is left.
    mean = total // weight if weight else None
    if model.log_pace is None:
        return [] if mean is None else [mean]
    log_length = fixed_log2(max(length, 1))
    at_mean_pace = log_length + model.mean_log_pace
    return [at_mean_pace if mean is None else mean, log_length + model.log_pace, at_mean_pace]


def _sum_near_classes(model: PlainModel, length: int) -> tuple[int, int]:
    """Weight and weighted sum of the mean logarithms of steps about as long."""
    weight = total = 0
    row = _length_class(length)
    for offset, share in _CLASS_SHARES:
        if 0 <= row + offset < _LENGTH_CLASSES:
            mean, samples = model.means.get(row + offset, (0, 0))
            weight += share * samples
            total += share * samples * mean
    return weight, total


def _length_class(length: int) -> int:
    """Class of a length: two for each octave."""
    # Half an octave is 2**15 units of the logarithm, and 4 << 16 is that of 16.
    if length < _FIRST_CLASS:
        return 0
    return min(1 + ((fixed_log2(length) - (4 << 16)) >> 15), _LENGTH_CLASSES - 1)


def _log_duration(duration: int) -> int:
    """Logarithm of a duration, which counts as at least 1 and at most 2**36."""
    return fixed_log2(min(max(duration, 1), MAX_MAGNITUDE))


def _update_mean(model: PlainModel, row: int, max_samples: int, log: int) -> None:
    """Learn one more logarithm of a duration."""
    mean, samples = model.means.get(row, (0, 0))
    # The mean of up to so many samples; after that, old ones fade, since the divisor stays. The
    # division rounds down also below zero, as the format has it.
    samples = min(samples + 1, max_samples)
    model.means[row] = mean + (log - mean) // samples, samples
