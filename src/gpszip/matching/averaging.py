"""White noise: samples so near each other that they tell of one place are averaged, rather than skipped.

Whoever skips samples within two errors of the last one used (Newson and Krumm 2009) keeps, of an agent that is slow for its noise, the
outliers. As many samples as are travelled within twice the noise make a mean instead, whose error is smaller by the root of their number.
"""

from __future__ import annotations

import math
from typing import TypeAlias

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

#: A step so many times as long as a sample's noise is hardly longer for it: by a tenth, in the mean.
_CLEAR = 5.0

#: No step and no mean takes more samples, and a track has so many steps at least.
_LONGEST, _ENOUGH = 64, 20

#: A mean is taken of samples that lie within so many times their noise.
_WITHIN = 2.0

Floats = NDArray[np.float64]

#: Time in seconds, position in metres, and where the agent faces.
Sample: TypeAlias = tuple[float, Floats, Floats]


def estimate_noise(positions: Floats, is_gap: NDArray[np.bool_]) -> float:
    """Standard deviation in metres of what changes from sample to sample without rhyme, from second differences.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Metres.
    is_gap : bool array, shape (n - 1,)
        Steps that tell nothing.

    Examples
    --------
    >>> places = np.arange(900.0)[:, None] * [3.0, 4.0]
    >>> round(estimate_noise(places + np.random.default_rng(1).normal(0, 2, (900, 2)), np.zeros(899, bool)), 1)
    2.0
    """
    known = ~(is_gap[1:] | is_gap[:-1])
    if known.sum() < _ENOUGH:
        return 0.0
    squares = (np.diff(positions, n=2, axis=0)[known] ** 2).sum(axis=1)
    dimension = positions.shape[1]
    return math.sqrt(
        float(np.median(squares)) / (6 * dimension * (1 - 2 / (9 * dimension)) ** 3)
    )  # median of chi squared


def find_stride(positions: Floats, is_gap: NDArray[np.bool_], noise: float) -> tuple[int, float]:
    """So many samples make a step that tells of travel, not of noise; and metres of such a step.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    noise : float
        Its answer.
    """
    runs = np.append(0, np.cumsum(is_gap))
    every, length = 1, 0.0
    while True:
        steps = np.linalg.norm(positions[every:] - positions[:-every], axis=1)[
            runs[every:] == runs[:-every]
        ]
        if len(steps):
            length = _usual(steps)
        if (
            length >= _CLEAR * noise
            or 2 * every > _LONGEST
            or len(positions) <= 2 * every * _ENOUGH
        ):
            return every, length
        every *= 2


def _usual(steps: Floats) -> float:
    """Half of the way is travelled in longer steps: who stands most of the time counts as far as he moves."""
    order = np.sort(steps)
    way = np.cumsum(order)
    return float(order[min(np.searchsorted(way, 0.5 * way[-1]), len(order) - 1)])


def choose_window(positions: Floats, is_gap: NDArray[np.bool_], most: float = math.inf) -> int:
    """Odd number of samples to be averaged, 1 where the agent travels far for its noise.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    most : float, default infinite
        The error that the roads tell: sparse samples of a small town look like noise, too, but not beside its roads.

    Examples
    --------
    >>> walk, noise = np.arange(900.0)[:, None] * [0.6, 0.8], np.random.default_rng(1).normal(0, 1, (900, 2))
    >>> [choose_window(walk + size * noise, np.zeros(899, bool)) for size in (0.5, 2.0, 4.0)]
    [1, 3, 7]
    """
    noise = min(estimate_noise(positions, is_gap), most)
    if noise == 0:
        return 1
    every, length = find_stride(positions, is_gap, noise)
    near = min(int(_WITHIN * noise * every / length), _LONGEST) if length > 0 else 1
    return max(near - (near % 2 == 0), 1)


def moving_average(positions: Floats, is_gap: NDArray[np.bool_], size: int) -> Floats:
    """Means of as many samples about each, fewer where a silence is near, as many before it as after it.

    Parameters
    ----------
    positions, is_gap : arrays
        See :func:`estimate_noise`.
    size : int
        Number of samples, odd.

    Examples
    --------
    >>> moving_average(np.array([[0.0], [3.0], [3.0], [9.0]]), np.zeros(3, bool), 3).ravel().tolist()
    [0.0, 2.0, 5.0, 9.0]
    """
    n, half = len(positions), size // 2
    if half == 0:
        return positions
    at = np.arange(n)
    breaks = np.flatnonzero(is_gap)
    first = np.append(0, breaks + 1)[np.searchsorted(breaks, at, side="left")]
    last = np.append(breaks, n - 1)[np.searchsorted(breaks, at, side="left")]
    reach = np.minimum(half, np.minimum(at - first, last - at))
    total = np.zeros_like(positions)
    for step in range(-half, half + 1):  # in the order of time, as the live matcher adds them
        here = np.flatnonzero(reach >= abs(step))
        total[here] += positions[here + step]
    means: Floats = total / (2 * reach + 1)[:, None]
    return means


class RunningAverage:
    """The means of :func:`moving_average`, one sample at a time: each as soon as the samples after it are known.

    Parameters
    ----------
    size : int
        Number of samples, odd.

    Examples
    --------
    >>> means, nowhere = RunningAverage(3), np.zeros(1)
    >>> told = [means.push((float(t), np.array([x]), nowhere)) for t, x in enumerate([0.0, 3.0, 3.0, 9.0])]
    >>> [[(time, float(place[0])) for time, place, _ in some] for some in (*told, means.finish())]
    [[(0.0, 0.0)], [], [(1.0, 2.0)], [(2.0, 5.0)], [(3.0, 9.0)]]
    """

    def __init__(self, size: int) -> None:
        self._half = size // 2
        self._recent: list[Sample] = []
        self._begin = self._told = (
            0  # samples since the last silence that were forgotten, and that were told
        )

    def push(self, sample: Sample) -> list[Sample]:
        """Take in a sample; return those whose means are known now."""
        if not self._half:
            return [sample]
        self._recent.append(sample)
        known, ready = self._begin + len(self._recent), []
        while self._told < known and self._told + min(self._half, self._told) < known:
            ready.append(self._mean(min(self._half, self._told)))
        forget = max(self._told - self._half - self._begin, 0)
        del self._recent[:forget]
        self._begin += forget
        return ready

    def finish(self) -> list[Sample]:
        """Return the rest, before a silence or at the end."""
        known = self._begin + len(self._recent)
        ready = [
            self._mean(min(self._half, self._told, known - 1 - self._told))
            for _ in range(known - self._told)
        ]
        self._recent, self._begin, self._told = [], 0, 0
        return ready

    def _mean(self, reach: int) -> Sample:
        """The next sample, at the mean of those before and after it."""
        at = self._told - self._begin
        total = np.zeros_like(self._recent[at][1])
        for _, place, _ in self._recent[at - reach : at + reach + 1]:
            total += place
        self._told += 1
        time, _, facing = self._recent[at]
        return time, total / (2 * reach + 1), facing
