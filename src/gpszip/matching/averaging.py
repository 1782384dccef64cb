"""Moving averages over white noise: samples near each other are averaged, rather than skipped.

Skipping samples within two errors of the last one used (Newson and Krumm 2009) keeps the outliers
of an agent that is slow for its noise. Instead, the samples within twice the noise are averaged;
the error of the mean is smaller by the root of their number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "RunningAverage",
    "Sample",
    "choose_window",
    "estimate_noise",
    "find_stride",
    "moving_average",
]

#: Length of a step, in standard deviations of the noise, that the noise hardly makes longer: by a
#: tenth in the mean.
_CLEAR_STEP = 5.0

#: Largest number of samples in a step or in a mean.
_MAX_SAMPLES = 64

#: Least number of steps of a track from which noise and stride are estimated.
_MIN_STEPS = 20

#: Distance, in standard deviations of the noise, within which samples are averaged.
_RADIUS = 2.0

Floats = NDArray[np.float64]

#: Time in seconds, position in metres, and the unit vector in which the agent faces.
Sample: TypeAlias = tuple[float, Floats, Floats]


def estimate_noise(positions: Floats, is_gap: NDArray[np.bool_]) -> float:
    """Estimate the standard deviation of white noise in metres, from second differences.

    Second differences of a smooth path are small. Those of noise with variance s² have variance
    6 s² on each axis; the median of their squares is that of chi squared, by the approximation of
    Wilson and Hilferty.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Metres.
    is_gap : bool array, shape (n - 1,)
        Steps to leave out.

    Examples
    --------
    >>> line = np.arange(900.0)[:, None] * [3.0, 4.0]
    >>> noise = np.random.default_rng(1).normal(0, 2, (900, 2))
    >>> round(estimate_noise(line + noise, np.zeros(899, bool)), 1)
    2.0
    """
    is_known = ~(is_gap[1:] | is_gap[:-1])
    if is_known.sum() < _MIN_STEPS:
        return 0.0
    squares = (np.diff(positions, n=2, axis=0)[is_known] ** 2).sum(axis=1)
    dimension = positions.shape[1]
    median_of_unit_noise = 6 * dimension * (1 - 2 / (9 * dimension)) ** 3
    return math.sqrt(float(np.median(squares)) / median_of_unit_noise)


def find_stride(positions: Floats, is_gap: NDArray[np.bool_], noise: float) -> tuple[int, float]:
    """Find the number of samples whose steps show travel rather than noise.

    Returns that number, a power of two, and the length of such a step in metres.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    noise : float
        What it returned.
    """
    # Double the stride until its steps are long against the noise.
    run = np.append(0, np.cumsum(is_gap))
    stride, length = 1, 0.0
    while True:
        # Steps of this many samples, without gaps.
        same_run = run[stride:] == run[:-stride]
        steps = np.linalg.norm(positions[stride:] - positions[:-stride], axis=1)[same_run]
        if len(steps):
            length = _median_by_length(steps)

        # Long enough, or too few steps left.
        if (
            length >= _CLEAR_STEP * noise
            or 2 * stride > _MAX_SAMPLES
            or len(positions) <= 2 * stride * _MIN_STEPS
        ):
            return stride, length
        stride *= 2


def _median_by_length(steps: Floats) -> float:
    """The length such that half of the distance is travelled in longer steps.

    An agent that stands most of the time counts as far as it moves.
    """
    order = np.sort(steps)
    travelled = np.cumsum(order)
    return float(order[min(np.searchsorted(travelled, 0.5 * travelled[-1]), len(order) - 1)])


def choose_window(positions: Floats, is_gap: NDArray[np.bool_], max_noise: float = math.inf) -> int:
    """Choose the number of samples to average: odd, and 1 where the agent is fast for its noise.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    max_noise : float, default infinite
        Upper bound of the noise, from the distances to the roads. Sparse samples in a small town
        look like noise, but not beside its roads.

    Examples
    --------
    >>> walk = np.arange(900.0)[:, None] * [0.6, 0.8]
    >>> noise = np.random.default_rng(1).normal(0, 1, (900, 2))
    >>> [choose_window(walk + size * noise, np.zeros(899, bool)) for size in (0.5, 2.0, 4.0)]
    [1, 3, 7]
    """
    noise = min(estimate_noise(positions, is_gap), max_noise)
    if noise == 0:
        return 1
    stride, length = find_stride(positions, is_gap, noise)
    window = min(int(_RADIUS * noise * stride / length), _MAX_SAMPLES) if length > 0 else 1
    return max(window - (window % 2 == 0), 1)


def moving_average(positions: Floats, is_gap: NDArray[np.bool_], window: int) -> Floats:
    """Average the samples of a window about each sample.

    Near a gap the window is shorter, and as long before the sample as after it.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    window : int
        Number of samples, odd.

    Examples
    --------
    >>> positions = np.array([[0.0], [3.0], [3.0], [9.0]])
    >>> moving_average(positions, np.zeros(3, bool), 3).ravel().tolist()
    [0.0, 2.0, 5.0, 9.0]
    """
    # A window of one sample has nothing to average.
    n, half = len(positions), window // 2
    if half == 0:
        return positions

    # Samples on each side of a sample, within its run between gaps.
    samples = np.arange(n)
    gaps = np.flatnonzero(is_gap)
    run = np.searchsorted(gaps, samples, side="left")
    first = np.append(0, gaps + 1)[run]
    last = np.append(gaps, n - 1)[run]
    sides = np.minimum(half, np.minimum(samples - first, last - samples))

    # Sums in the order of time, as the live matcher adds them.
    total = np.zeros_like(positions)
    for step in range(-half, half + 1):
        has_step = np.flatnonzero(sides >= abs(step))
        total[has_step] += positions[has_step + step]
    means: Floats = total / (2 * sides + 1)[:, None]
    return means


class RunningAverage:
    """The means of :func:`moving_average`, one sample at a time.

    Each mean is returned as soon as the samples after it are known.

    Parameters
    ----------
    window : int
        Number of samples, odd.

    Examples
    --------
    >>> average, heading = RunningAverage(3), np.zeros(1)
    >>> samples = [(float(t), np.array([x]), heading) for t, x in enumerate([0.0, 3.0, 3.0, 9.0])]
    >>> means = [*map(average.push, samples), average.finish()]
    >>> [[(time, float(position[0])) for time, position, _ in ready] for ready in means]
    [[(0.0, 0.0)], [], [(1.0, 2.0)], [(2.0, 5.0)], [(3.0, 9.0)]]
    """

    def __init__(self, window: int) -> None:
        self._half = window // 2
        self._recent: list[Sample] = []
        # Samples since the last gap that were dropped from ``_recent``, and that were averaged.
        self._dropped = self._averaged = 0

    def push(self, sample: Sample) -> list[Sample]:
        """Take in a sample; return those whose means are known now."""
        # A window of one sample waits for no later ones.
        if not self._half:
            return [sample]
        self._recent.append(sample)

        # Means of all samples that have enough samples after them.
        received, ready = self._dropped + len(self._recent), []
        while self._averaged < received:
            side = min(self._half, self._averaged)
            if self._averaged + side >= received:
                break
            ready.append(self._mean(side))

        # Drop samples that no later mean needs.
        unneeded = max(self._averaged - self._half - self._dropped, 0)
        del self._recent[:unneeded]
        self._dropped += unneeded
        return ready

    def finish(self) -> list[Sample]:
        """Return the remaining means, before a gap or at the end."""
        received = self._dropped + len(self._recent)
        ready = [
            self._mean(min(self._half, self._averaged, received - 1 - self._averaged))
            for _ in range(received - self._averaged)
        ]
        self._recent, self._dropped, self._averaged = [], 0, 0
        return ready

    def state(self) -> dict[str, Any]:
        """Return the samples that later means need as a value of JSON."""
        recent = [[t, position.tolist(), heading.tolist()] for t, position, heading in self._recent]
        return {"recent": recent, "counts": [self._dropped, self._averaged]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on where :meth:`state` was taken."""
        self._recent = [
            (time, np.array(position, np.float64), np.array(heading, np.float64))
            for time, position, heading in state["recent"]
        ]
        self._dropped, self._averaged = state["counts"]

    def _mean(self, side: int) -> Sample:
        """The next sample, averaged with ``side`` samples before and after it."""
        number = self._averaged - self._dropped
        total = np.zeros_like(self._recent[number][1])
        for _, position, _ in self._recent[number - side : number + side + 1]:
            total += position
        self._averaged += 1
        time, _, heading = self._recent[number]
        return time, total / (2 * side + 1), heading
