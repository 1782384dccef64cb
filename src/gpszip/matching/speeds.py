"""How fast an agent goes where nobody saw it: between two speeds that are known, over roads and round bends, in a given time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.averaging import estimate_noise, find_stride
from gpszip.model import Track

__all__ = ["MotionStatistics", "bend_speed", "interpolate_progress", "measure_motion"]

#: Acceleration across the way, in m/s², that people bear in bends, and along the way unless the log says otherwise.
_SIDEWAYS, _ALONG = 2.0, 1.5

#: Bends of lines are cut by so many metres: half a road, or what a line leaves out.
_WIDTH = 4.0

#: Lags in seconds over which a log's speeds are compared.
_LAGS = (2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0, 240.0)

#: Speeds are followed through a gap in so many steps.
_STEPS = 240

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MotionStatistics:
    """What a log tells about how its agents go.

    Parameters
    ----------
    mean_speed : float
        Mean speed in m/s while moving.
    top_speed : float
        Speed in m/s that one step in a hundred exceeds.
    acceleration : float
        Acceleration along the way in m/s².
    autocorrelation : tuple of (float, float)
        Lags in seconds, and the correlation of speeds so far apart.
    """

    mean_speed: float
    top_speed: float
    acceleration: float
    autocorrelation: tuple[tuple[float, float], ...]

    def correlation_time(self, seconds: float) -> float:
        """Time in seconds after which a speed is forgotten, as it matters for a gap of some seconds: of its third."""
        lag = seconds / 3
        known = [(at, value) for at, value in self.autocorrelation if value == value]  # noqa: PLR0124 (NaN is nothing)
        if not known:
            return lag
        value = float(
            np.interp(np.log(lag), np.log([at for at, _ in known]), [value for _, value in known])
        )
        near = min(max(lag, known[0][0]), known[-1][0])
        return float(
            np.clip(-near / np.log(np.clip(value, 0.02, 0.98)), 0.05 * seconds, 2 * seconds)
        )


def measure_motion(
    tracks: Sequence[Track], gap: float, error: float = math.inf
) -> MotionStatistics:
    """Learn from the steps of a log that are no gaps.

    Parameters
    ----------
    tracks : sequence of Track
        The log, or one agent's tracks.
    gap : float
        Seconds above which a step is a gap.
    error : float, default infinite
        Metres that samples err at most: what looks like larger noise is travel.

    Examples
    --------
    >>> track = Track("a", range(100), [[2.0 * t, 0.0] for t in range(100)])
    >>> measure_motion([track], 30.0).mean_speed
    2.0
    """
    steps = [_speeds(track, gap, error) for track in tracks if len(track) > 1]
    speeds = np.concatenate([speed for _, speed, _ in steps]) if steps else np.empty(0)
    seconds = np.concatenate([step for _, _, step in steps]) if steps else np.empty(0)
    if not len(speeds) or speeds.max() <= 0:
        return MotionStatistics(1.0, 2.0, _ALONG, ())
    order = np.argsort(speeds)
    top_speed = float(
        speeds[
            order[
                min(
                    np.searchsorted(np.cumsum(seconds[order]), 0.99 * seconds.sum()), len(order) - 1
                )
            ]
        ]
    )
    moving = speeds > 0.1 * top_speed
    mean_speed = float((speeds * seconds)[moving].sum() / seconds[moving].sum())
    likeness = tuple((lag, _likeness(steps, lag)) for lag in _LAGS)
    return MotionStatistics(mean_speed, top_speed, _push(steps, mean_speed), likeness)


def _speeds(track: Track, gap: float, error: float) -> tuple[Floats, Floats, Floats]:
    """Middle, speed and length in seconds of steps without a gap: of so many samples that they tell of travel, not of noise."""
    is_gap = np.diff(track.times) > gap
    every, _ = find_stride(
        track.positions, is_gap, min(estimate_noise(track.positions, is_gap), error)
    )
    gaps = np.append(0, np.cumsum(is_gap))
    times, positions = track.times[::every], track.positions[::every]
    step = np.diff(times)
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=1) / step
    known = np.diff(gaps[::every]) == 0
    return (times[:-1] + step / 2)[known], speed[known], step[known]


def _push(steps: Sequence[tuple[Floats, Floats, Floats]], mean_speed: float) -> float:
    """Acceleration that one step in ten exceeds, over some three seconds, where sampling shows it."""
    found = []
    for at, speed, step in steps:
        if len(at) > 10 and np.median(step) <= 3:
            later = at + 3.0
            reach = later <= at[-1]
            found.append(np.abs(np.interp(later[reach], at, speed) - speed[reach]) / 3.0)
    pooled = np.concatenate(found) if found else np.empty(0)
    pooled = pooled[pooled > 0.02 * mean_speed]
    return (
        float(np.clip(np.quantile(pooled, 0.9), 0.1 * _ALONG, 2 * _ALONG))
        if len(pooled) > 20
        else _ALONG
    )


def _likeness(steps: Sequence[tuple[Floats, Floats, Floats]], lag: float) -> float:
    """Correlation of speeds so far apart, over all tracks about their own means."""
    both, one, pairs = 0.0, 0.0, 0
    for at, speed, step in steps:
        if len(at) < 10 or at[-1] - at[0] < 3 * lag or np.median(step) > 2 * lag:
            continue
        own = speed - speed.mean()
        later = np.searchsorted(at, at + lag)
        first = np.flatnonzero(later < len(at))
        first = first[np.abs(at[later[first]] - at[first] - lag) <= 0.5 * lag]
        both, one, pairs = (
            both + float(own[first] @ own[later[first]]),
            one + float(own[first] @ own[first]),
            pairs + len(first),
        )
    return both / one if pairs > 20 and one > 0 else float("nan")


def bend_speed(line: Floats, at: Floats, acceleration: float, top_speed: float) -> Floats:
    """Speed in m/s that bends allow at places along a line, braking and accelerating included.

    Parameters
    ----------
    line : float64 array, shape (P, d)
        Vertices in metres.
    at : float64 array, shape (n,)
        Metres along it, evenly spaced.
    acceleration : float
        Acceleration along the way.
    top_speed : float
        No speed is higher.
    """
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    arm = float(np.clip(2.0 * top_speed, 1.0, 15.0))
    middle, before, after = (
        np.stack([np.interp(at + shift, along, axis) for axis in line.T], axis=1)
        for shift in (0.0, -arm, arm)
    )
    a, b = middle - before, after - middle
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    cosine = np.divide((a * b).sum(axis=1), size, out=np.ones(len(at)), where=size > 1e-6)
    half = np.sqrt(np.clip((1 + cosine) / 2, 1e-6, 1.0))  # the cosine of half the angle
    radius = _WIDTH * half / np.maximum(1 - half, 1e-9)
    square = np.minimum(_SIDEWAYS * radius, top_speed**2)
    step = at[1] - at[0] if len(at) > 1 else 0.0
    ramp = 2 * acceleration * step * np.arange(len(at))
    square = np.minimum.accumulate(square - ramp) + ramp
    square = (np.minimum.accumulate((square - ramp[::-1])[::-1]))[::-1] + ramp[::-1]
    allowed: Floats = np.sqrt(square)
    return allowed


def interpolate_progress(
    seconds: float, whole: float, before: float, after: float, memory: float
) -> tuple[Floats, Floats]:
    """Progress over time between two paces that are known.

    The pace is a Gaussian process whose likeness fades with the memory (Ornstein and Uhlenbeck's), given its values at both ends and
    how much is travelled in all; this is its expectation, kept from going back.

    Parameters
    ----------
    seconds : float
        Length of the gap.
    whole : float
        What is travelled in it.
    before, after : float
        Pace at its ends, in the same unit a second.
    correlation_time : float
        Seconds in which the likeness of paces falls to a third.

    Returns
    -------
    times, progress : float64 arrays
        From 0 to ``seconds``, and from 0 to ``whole``.

    Examples
    --------
    >>> times, progress = interpolate_progress(60.0, 600.0, 10.0, 10.0, 20.0)
    >>> bool(np.allclose(progress, 10 * times))
    True
    """
    times = np.linspace(0.0, seconds, _STEPS + 1)
    weights = np.full(len(times), seconds / _STEPS)
    weights[[0, -1]] /= 2
    near, far = np.exp(-times / memory), np.exp(-times[::-1] / memory)
    inside = memory * (2 - near - far)
    known = np.array(
        [
            [1.0, near[-1], inside[0]],
            [near[-1], 1.0, inside[-1]],
            [inside[0], inside[-1], float(weights @ inside)],
        ]
    )
    mean = whole / seconds
    gains = np.linalg.solve(
        known + 1e-9 * np.eye(3) * known.diagonal(), [before - mean, after - mean, 0.0]
    )
    pace = np.maximum(mean + gains[0] * near + gains[1] * far + gains[2] * inside, 0.0)
    progress = np.append(0.0, np.cumsum((pace[1:] + pace[:-1]) / 2 * (seconds / _STEPS)))
    return times, progress * (whole / progress[-1]) if progress[-1] > 0 else whole * times / seconds
