"""How agents move: speeds measured in a log, speeds in bends, and progress through a gap.

In a gap the speed at both ends, the distance, and the time are known; the speed between them is
interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.averaging import estimate_noise, find_stride
from gpszip.model import Track

__all__ = ["MotionStatistics", "bend_speed", "interpolate_progress", "measure_motion"]

#: Lateral acceleration in m/s² that people bear in bends.
_LATERAL_ACCELERATION = 2.0

#: Acceleration in m/s² along the road, unless the log shows another.
_ACCELERATION = 1.5

#: Seconds over which acceleration is measured.
_ACCELERATION_TIME = 3.0

#: Metres by which a bend of a line may be cut: half a road, or what the line leaves out.
_CUT = 4.0

#: Lags in seconds at which the autocorrelation of speeds is measured.
_LAGS = (2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0, 240.0)

#: Steps in which progress through a gap is computed.
_STEPS = 240

#: Share of the top speed above which an agent moves.
_MOVING = 0.1

#: Diagonal, as a share, that is added to a covariance matrix so that it can be inverted.
_RIDGE = 1e-9

#: Speeds in m/s of a log in which nothing moves.
_STANDING_MEAN_SPEED = 1.0
_STANDING_TOP_SPEED = 2.0

Floats = NDArray[np.float64]


class _SpeedSamples(NamedTuple):
    """Speeds of the steps of one track: middle of each in seconds, speed in m/s, and duration."""

    times: Floats
    speeds: Floats
    durations: Floats


@dataclass(frozen=True)
class MotionStatistics:
    """Statistics of how the agents of a log move.

    Parameters
    ----------
    mean_speed : float
        Mean speed in m/s while moving.
    top_speed : float
        Speed in m/s that is exceeded in one hundredth of the time.
    acceleration : float
        Acceleration along the road in m/s².
    autocorrelation : tuple of (float, float)
        Lags in seconds, and the correlation of speeds that far apart; NaN where it is not known.
    """

    mean_speed: float
    top_speed: float
    acceleration: float
    autocorrelation: tuple[tuple[float, float], ...]

    def correlation_time(self, seconds: float) -> float:
        """Time in seconds in which the correlation of speeds falls to 1/e.

        It is that of the exponential function through the correlation at a third of ``seconds``,
        the length of the gap in question.
        """
        # Interpolate the correlation over the logarithm of the lag, within the lags that are known.
        lag = seconds / 3
        known = [
            (known_lag, value) for known_lag, value in self.autocorrelation if not math.isnan(value)
        ]
        if not known:
            return lag
        value = float(
            np.interp(
                np.log(lag),
                np.log([known_lag for known_lag, _ in known]),
                [value for _, value in known],
            )
        )

        # The time T of the exponential function: ``correlation = exp(-lag / T)``.
        near = min(max(lag, known[0][0]), known[-1][0])
        return float(
            np.clip(-near / np.log(np.clip(value, 0.02, 0.98)), 0.05 * seconds, 2 * seconds)
        )


def measure_motion(
    tracks: Sequence[Track], gap: float, error: float = math.inf
) -> MotionStatistics:
    """Measure how agents move, from the steps of a log that are no gaps.

    Parameters
    ----------
    tracks : sequence of Track
        The log, or one agent's tracks.
    gap : float
        Seconds above which a step is a gap.
    error : float, default infinite
        Upper bound of the noise of samples in metres.

    Examples
    --------
    >>> track = Track("a", range(100), [[2.0 * t, 0.0] for t in range(100)])
    >>> measure_motion([track], 30.0).mean_speed
    2.0
    """
    # Pool speeds in metres per second, and their durations. A log that stands gets default speeds.
    samples = [_measure_speeds(track, gap, error) for track in tracks if len(track) > 1]
    speeds = np.concatenate([sample.speeds for sample in samples]) if samples else np.empty(0)
    seconds = np.concatenate([sample.durations for sample in samples]) if samples else np.empty(0)
    if not len(speeds) or speeds.max() <= 0:
        return MotionStatistics(_STANDING_MEAN_SPEED, _STANDING_TOP_SPEED, _ACCELERATION, ())

    # Quantile of speed, weighted by time.
    order = np.argsort(speeds)
    rank = np.searchsorted(np.cumsum(seconds[order]), 0.99 * seconds.sum())
    top_speed = float(speeds[order[min(rank, len(order) - 1)]])

    # Mean while moving.
    is_moving = speeds > _MOVING * top_speed
    mean_speed = float((speeds * seconds)[is_moving].sum() / seconds[is_moving].sum())
    autocorrelation = tuple((lag, _correlation_at(samples, lag)) for lag in _LAGS)
    return MotionStatistics(
        mean_speed, top_speed, _measure_acceleration(samples, mean_speed), autocorrelation
    )


def _measure_speeds(track: Track, gap: float, error: float) -> _SpeedSamples:
    """Measure speeds over steps without a gap that are long enough to show travel, not noise."""
    is_gap = np.diff(track.times) > gap
    noise = min(estimate_noise(track.positions, is_gap), error)
    stride, _ = find_stride(track.positions, is_gap, noise)
    run = np.append(0, np.cumsum(is_gap))
    times, positions = track.times[::stride], track.positions[::stride]
    step = np.diff(times)
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=1) / step
    is_known = np.diff(run[::stride]) == 0
    return _SpeedSamples((times[:-1] + step / 2)[is_known], speed[is_known], step[is_known])


def _measure_acceleration(samples: Sequence[_SpeedSamples], mean_speed: float) -> float:
    """Acceleration that one step in ten exceeds, over three seconds.

    The default where samples are too sparse, or too few of them accelerate.
    """
    accelerations = []
    for times, speeds, durations in samples:
        if len(times) > 10 and np.median(durations) <= _ACCELERATION_TIME:
            later = times + _ACCELERATION_TIME
            inside = later <= times[-1]
            change = np.interp(later[inside], times, speeds) - speeds[inside]
            accelerations.append(np.abs(change) / _ACCELERATION_TIME)
    pooled = np.concatenate(accelerations) if accelerations else np.empty(0)
    pooled = pooled[pooled > 0.02 * mean_speed]
    if len(pooled) <= 20:
        return _ACCELERATION
    return float(np.clip(np.quantile(pooled, 0.9), 0.1 * _ACCELERATION, 2 * _ACCELERATION))


def _correlation_at(samples: Sequence[_SpeedSamples], lag: float) -> float:
    """Correlation of speeds a lag apart, over all tracks about their own means; NaN if unknown."""
    products, squares, pairs = 0.0, 0.0, 0
    for times, speeds, durations in samples:
        # Tracks that are long and dense enough.
        if len(times) < 10 or times[-1] - times[0] < 3 * lag or np.median(durations) > 2 * lag:
            continue

        # Pairs of steps about a lag apart.
        deviation = speeds - speeds.mean()
        later = np.searchsorted(times, times + lag)
        first = np.flatnonzero(later < len(times))
        first = first[np.abs(times[later[first]] - times[first] - lag) <= 0.5 * lag]
        products += float(deviation[first] @ deviation[later[first]])
        squares += float(deviation[first] @ deviation[first])
        pairs += len(first)
    return products / squares if pairs > 20 and squares > 0 else math.nan


def bend_speed(line: Floats, along: Floats, acceleration: float, top_speed: float) -> Floats:
    """Highest speed that the bends of a line allow, with braking before and accelerating after.

    A bend by an angle a that may be cut by c metres is a circle of radius r = c k / (1 - k), with
    k = cos(a / 2); on it v² <= lateral acceleration times r. Between bends, v² changes by at most
    twice the acceleration times the distance.

    Parameters
    ----------
    line : float64 array, shape (P, d)
        Vertices in metres.
    along : float64 array, shape (n,)
        Metres along it at which the speed is wanted, evenly spaced.
    acceleration : float
        Acceleration along the road in m/s².
    top_speed : float
        No speed is higher, in m/s.

    Returns
    -------
    float64 array, shape (n,)
        Speeds in m/s.
    """
    # Angle between the directions an arm's length before and behind.
    vertices = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    arm = float(np.clip(2.0 * top_speed, 1.0, 15.0))
    middle, before, behind = (
        np.stack([np.interp(along + shift, vertices, axis) for axis in line.T], axis=1)
        for shift in (0.0, -arm, arm)
    )
    a, b = middle - before, behind - middle
    lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    cosine = np.divide((a * b).sum(axis=1), lengths, out=np.ones(len(along)), where=lengths > 1e-6)

    # Square of the speed on the circle in the bend.
    half_cosine = np.sqrt(np.clip((1 + cosine) / 2, 1e-6, 1.0))
    radius = _CUT * half_cosine / np.maximum(1 - half_cosine, 1e-9)
    square = np.minimum(_LATERAL_ACCELERATION * radius, top_speed**2)

    # Accelerating from a bend: the running minimum, less a ramp; then braking, in reverse.
    step = along[1] - along[0] if len(along) > 1 else 0.0
    ramp = 2 * acceleration * step * np.arange(len(along))
    square = np.minimum.accumulate(square - ramp) + ramp
    square = (np.minimum.accumulate((square - ramp[::-1])[::-1]))[::-1] + ramp[::-1]
    allowed: Floats = np.sqrt(square)
    return allowed


def interpolate_progress(
    seconds: float, distance: float, before: float, after: float, correlation_time: float
) -> tuple[Floats, Floats]:
    """Interpolate progress over time between two known speeds.

    The speed is a Gaussian process with the covariance exp(-|t - u| / T) of Ornstein and Uhlenbeck,
    given its values at both ends and its integral. The result is its expectation, kept from going
    back: m + c(t) K⁻¹ (y - mean), with the covariances K of the three known values y and c(t) of
    the speed with them.

    Parameters
    ----------
    seconds : float
        Length of the gap.
    distance : float
        What is travelled in it, in any unit.
    before, after : float
        Speeds at its ends, in that unit per second.
    correlation_time : float
        Seconds T in which the correlation of speeds falls to 1/e.

    Returns
    -------
    times, progress : float64 arrays
        From 0 to ``seconds``, and from 0 to ``distance``.

    Examples
    --------
    >>> times, progress = interpolate_progress(60.0, 600.0, 10.0, 10.0, 20.0)
    >>> bool(np.allclose(progress, 10 * times))
    True
    """
    # Weights of the trapezoidal rule.
    times = np.linspace(0.0, seconds, _STEPS + 1)
    weights = np.full(len(times), seconds / _STEPS)
    weights[[0, -1]] /= 2

    # Covariances of the speed with those at both ends, and with its integral.
    to_start = np.exp(-times / correlation_time)
    to_end = np.exp(-times[::-1] / correlation_time)
    to_integral = correlation_time * (2 - to_start - to_end)

    # Solve for the known values.
    covariance = np.array(
        [
            [1.0, to_start[-1], to_integral[0]],
            [to_start[-1], 1.0, to_integral[-1]],
            [to_integral[0], to_integral[-1], float(weights @ to_integral)],
        ]
    )
    mean = distance / seconds
    gains = np.linalg.solve(
        covariance + _RIDGE * np.eye(3) * covariance.diagonal(), [before - mean, after - mean, 0.0]
    )
    speed = mean + gains[0] * to_start + gains[1] * to_end + gains[2] * to_integral

    # Integrate, without going back, and scale to the distance.
    speed = np.maximum(speed, 0.0)
    progress = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * (seconds / _STEPS)))
    if progress[-1] > 0:
        return times, progress * (distance / progress[-1])
    return times, distance * times / seconds
