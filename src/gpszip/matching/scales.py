"""The scales of the model, estimated from the log: match, measure what was matched, match again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.headings import estimate_heading_spread, headings_follow_roads
from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import road_positions
from gpszip.matching.kernels.candidates import JUMP
from gpszip.matching.kernels.road_grid import nearest_distances
from gpszip.matching.kernels.roads import Workspace
from gpszip.matching.kernels.trellis import select_samples
from gpszip.matching.on_roads import DistanceMixture, fit_mixture
from gpszip.matching.parameters import MAX_SPEED_FACTOR, search_radius
from gpszip.matching.viterbi import Observations, ViterbiPath, find_viterbi_path
from gpszip.model.match import Scales

__all__ = ["MAX_SAMPLES", "estimate_robust_scales", "estimate_scales", "guess_error"]

#: Most rounds of matching and measuring on a few samples, before one on many. Two or three are
#: enough, but where an agent stands beside the roads for hours the first guess is far too large.
_MAX_ROUNDS = 8

#: Change of the error, as a logarithm, below which the rounds end.
_CONVERGED = 0.2

#: Samples that each round looks at.
_ROUND_SAMPLES = 10_000

#: Samples that the last round looks at, unless others are asked for.
MAX_SAMPLES = 100_000

#: Least samples of each track that a round looks at.
_MIN_TRACK_SAMPLES = 30

#: Most slices of a track that a round looks at: more than one, so that a long walk off the roads
#: is not all that it sees.
_MAX_SLICES = 10

#: First guess of how much longer than the straight line a path is, as a share. It is rather too
#: large: if winding paths cost too much, time steps are matched to far roads instead, which looks
#: like a large error, and the rounds don't recover.
_WINDING = 0.25

#: Quantiles of the distance to the nearest road from which the error is guessed.
_GUESS_QUANTILES = (0.25, 0.5)

#: Factor of each quantile; the larger product is the guess. It is 1.3 errors where all samples are
#: on roads, and 3.4 where 55 in a hundred are, since nine in ten of these are nearer than the
#: median.
_GUESS_FACTORS = np.array([4.0, 2.0])

#: Error, as a multiple of the first guess (which is rather too large), above which it is not
#: believed.
_MAX_TO_GUESS = 1.5

#: Distance, in errors, between time steps that tell whether a track keeps its distance beside a
#: road. A track that crosses the road by 30 degrees is as much farther.
_BESIDE = 5.0

#: Time steps as which the log counts for the scales of a track.
_PRIOR = 300.0

#: Time steps below which a track has the scales of the log: they would hardly move those, which
#: count as _PRIOR time steps.
_MIN_STEPS = 10

#: Largest autocorrelation of errors from time step to time step, so that sigma stays finite.
_MAX_AUTOCORRELATION = 0.95

#: Least error, in cells of the grid of roads: the rounding of the map.
_MIN_ERROR = 1e-3

#: First share of time steps on roads, from which the mixture of distances is fitted.
_FIRST_SHARE = 0.5

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Residuals:
    """What the time steps of a matched track leave unexplained.

    Parameters
    ----------
    errors : float64 array, shape (k, d)
        From the position of each time step on its road to its sample, NaN off the roads.
    detours : float64 array, shape (k - 1,)
        Path over roads less straight line between a time step and the next, NaN without a path.
    lag : int
        Number of time steps that are about five errors apart.
    """

    errors: Floats
    detours: Floats
    lag: int

    @property
    def strays(self) -> Floats:
        """Distance of each time step from its road, or from keeping its distance beside the road.

        A map that is wrong shifts whole streets; a track on such a street keeps its distance, a
        track that crosses a field does not. So the least of three distances counts: to the road,
        and to the errors of the time steps ``lag`` before and after.
        """
        length = np.sqrt((self.errors**2).sum(axis=1))
        change = np.sqrt(((self.errors[self.lag :] - self.errors[: -self.lag]) ** 2).sum(axis=1))
        strays: Floats = length.copy()
        for side in (slice(self.lag, None), slice(None, -self.lag)):
            known_change = np.where(np.isnan(strays[side]), np.nan, change)
            strays[side] = np.fmin(strays[side], known_change)
        return strays


@dataclass(frozen=True)
class _Sums:
    """Sums over the time steps of matched tracks, weighted by the probability of being on roads.

    Parameters
    ----------
    squares, steps : float
        Squared distance to the roads, and number of time steps on them.
    products, pairs : float
        Product of the errors of a time step and the next, and their mean square.
    detours, paths : float
        Squared difference between paths and straight lines, and number of paths.
    """

    squares: float = 0.0
    steps: float = 0.0
    products: float = 0.0
    pairs: float = 0.0
    detours: float = 0.0
    paths: float = 0.0

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(
            *(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True))
        )

    def shrunk(self, steps: float) -> _Sums:
        """Scale the sums to a number of time steps, unless they have fewer."""
        share = min(steps / self.steps, 1.0) if self.steps else 0.0
        return _Sums(*(share * value for value in vars(self).values()))


def estimate_scales(
    index: RoadIndex,
    work: Workspace,
    observations: Sequence[Observations],
    *,
    sigma: float | None = None,
    beta: float | None = None,
    heading: float | None = None,
    reach: float = math.inf,
    samples: int = MAX_SAMPLES,
) -> tuple[Scales, list[Scales]]:
    """Estimate the scales of a log and of each of its tracks.

    Errors of receiver and map change slowly, so that successive samples repeat the same error. With
    an autocorrelation rho from time step to time step, n time steps tell as much as
    n (1 - rho) / (1 + rho) independent ones. The emission costs of all candidates are lowered by as
    much, which is a larger sigma. Where samples are far apart nothing is left of this.

    Part of the log may be off all roads, and still be matched where roads are near: time steps
    count by the probability that they are on their roads.

    Parameters
    ----------
    index, work : RoadIndex, Workspace
        The network, and arrays for its searches.
    observations : sequence of Observations
        The log.
    sigma, beta, heading : float, optional
        Scales that are known.
    reach : float, default infinite
        Metres from all roads beyond which a sample is on none.
    samples : int
        Samples that the last round looks at.

    Returns
    -------
    Scales, list of Scales
        Those of the log, and those of each track.
    """
    # Rounds on a few samples, until the error converges.
    sample = _take_sample(observations, _ROUND_SAMPLES)
    min_error = _min_error(index)
    scales = _with_known(_guess_scales(index, sample), sigma, beta, reach)
    for _ in range(_MAX_ROUNDS):
        _, residuals = _match_and_measure(index, work, sample, scales)
        total = _sum_all(residuals, _fit_log_mixture(residuals, scales))
        if not total.paths:
            scales = replace(scales, heading=heading or math.inf)
            return scales, [scales] * len(observations)
        last_error = scales.error
        speeds = _measure_speeds(sample, last_error)
        scales = _with_known(_scales_from(total, speeds, min_error), sigma, beta, reach)
        if abs(math.log(scales.error / last_error)) < _CONVERGED:
            break

    # One round on many samples.
    sample = _take_sample(observations, samples)
    paths, residuals = _match_and_measure(index, work, sample, scales)
    mixture = _fit_log_mixture(residuals, scales)
    total = _sum_all(residuals, mixture)
    if heading is None:
        log_heading, track_headings = _estimate_headings(index, work, paths, scales)
    else:
        log_heading, track_headings = heading, [heading] * len(sample)

    # Scales of the log.
    speeds = _measure_speeds(sample, scales.error)
    log_scales = _with_known(_scales_from(total, speeds, min_error), sigma, beta, reach)

    # Scales of each track, with those of the log as prior.
    prior, log_speeds = total.shrunk(_PRIOR), (log_scales.median_speed, log_scales.max_speed)
    track_scales = []
    for observed, residual, track_heading in zip(sample, residuals, track_headings, strict=True):
        if len(residual.errors) < _MIN_STEPS and len(sample) > 1:
            speed = max(log_scales.max_speed, _fastest_step(observed))
            own = replace(log_scales, max_speed=speed, heading=track_heading)
            track_scales.append(own)
            continue
        sums = _sum_on_roads(residual, fit_mixture(residual.strays, mixture, _PRIOR))
        track_speeds = _measure_speeds([observed], log_scales.error)
        speeds = _blend_speeds(track_speeds, log_speeds, sums.paths)
        scales_of_track = _with_known(
            _scales_from(sums + prior, speeds, min_error), sigma, beta, reach
        )
        track_scales.append(replace(scales_of_track, heading=track_heading))
    return replace(log_scales, heading=log_heading), track_scales


def estimate_robust_scales(
    index: RoadIndex,
    opened: RoadIndex | None,
    work: Workspace,
    observations: Sequence[Observations],
    *,
    sigma: float | None = None,
    beta: float | None = None,
    heading: float | None = None,
    reach: float = math.inf,
    samples: int = MAX_SAMPLES,
) -> tuple[Scales, list[Scales]]:
    """Estimate scales as :func:`estimate_scales` does, also where a log travels against roads.

    Samples that travel against a one-way road look as if their errors were as long as the road. An
    error far above what the distance to the nearest road tells is estimated again with all roads
    open in both directions.

    Parameters
    ----------
    index : RoadIndex
        The network.
    opened : RoadIndex or None
        The same with all roads open in both directions; None where they are.
    work, observations, sigma, beta, heading, reach, samples
        As for :func:`estimate_scales`.
    """

    def estimate(roads: RoadIndex) -> tuple[Scales, list[Scales]]:
        return estimate_scales(
            roads,
            work,
            observations,
            sigma=sigma,
            beta=beta,
            heading=heading,
            reach=reach,
            samples=samples,
        )

    # Without closed directions the first estimate stands.
    log_scales, track_scales = estimate(index)
    if opened is None:
        return log_scales, track_scales

    # Tracks with too large an error.
    is_too_large = [
        scales.error > _MAX_TO_GUESS * guess_error(index, [observed])
        for scales, observed in zip(track_scales, observations, strict=True)
    ]
    if not any(is_too_large):
        return log_scales, track_scales

    # The same with all roads open.
    log_again, tracks_again = estimate(opened)
    if log_scales.error > _MAX_TO_GUESS * guess_error(index, observations):
        log_scales = log_again
    return log_scales, [
        again if bad else scales
        for scales, again, bad in zip(track_scales, tracks_again, is_too_large, strict=True)
    ]


def guess_error(index: RoadIndex, observations: Sequence[Observations]) -> float:
    """Guess the error from the distance to the nearest road of some samples."""
    distances = np.concatenate(
        [
            nearest_distances(observed.positions, index.roads, index.road_grid)
            for observed in _take_sample(observations, _ROUND_SAMPLES)
        ]
    )
    known = distances[np.isfinite(distances)]
    if not len(known):
        return _min_error(index)
    guesses = _GUESS_FACTORS * np.quantile(known, _GUESS_QUANTILES)
    return max(float(guesses.max()), _min_error(index))


def _match_and_measure(
    index: RoadIndex, work: Workspace, sample: Sequence[Observations], scales: Scales
) -> tuple[list[ViterbiPath], list[_Residuals]]:
    """Match the sample of a log, and measure the residuals of each track."""
    paths = [
        find_viterbi_path(index, work, observed, scales, with_confidence=False)
        for observed in sample
    ]
    return paths, [_measure_residuals(index, path, scales) for path in paths]


def _estimate_headings(
    index: RoadIndex, work: Workspace, paths: Sequence[ViterbiPath], scales: Scales
) -> tuple[float, list[float]]:
    """Estimate the spread of headings, of the log and of each track; infinite if not followed.

    The spread is measured, used for matching, and measured again.
    """
    log_follows, track_follow = headings_follow_roads(index, paths)
    if not any(track_follow):
        return math.inf, [math.inf] * len(paths)
    followed = [path for path, follows in zip(paths, track_follow, strict=True) if follows]
    with_heading = replace(scales, heading=estimate_heading_spread(index, followed))
    rematched = [
        find_viterbi_path(index, work, path.observations, with_heading, with_confidence=False)
        for path in followed
    ]
    spread = estimate_heading_spread(index, rematched)
    return (
        spread if log_follows else math.inf,
        [spread if follows else math.inf for follows in track_follow],
    )


def _take_sample(observations: Sequence[Observations], samples: int) -> list[Observations]:
    """Take about a number of samples of a log: the same share of each track."""
    share = min(samples / max(sum(len(observed.times) for observed in observations), 1), 1.0)
    return [_take_slices(observed, share) for observed in observations]


def _take_slices(observations: Observations, share: float) -> Observations:
    """Take a share of a track, in slices from all over it; a gap separates them."""
    # Number of slices, and of samples in all of them.
    n = len(observations.times)
    size = min(max(math.ceil(n * share), _MIN_TRACK_SAMPLES), n)
    count = min(max(size // _MIN_TRACK_SAMPLES, 1), _MAX_SLICES) if size < n else 1

    # Samples left out before each slice.
    left_out = np.round(np.linspace(0, n - size, 2 * count + 1)[1::2]).astype(np.int64)
    number = np.arange(size)
    kept = number + left_out[number * count // size]
    is_gap = observations.is_gap[kept[:-1]] | (np.diff(kept) > 1)
    return Observations(
        observations.positions[kept], observations.times[kept], is_gap, observations.headings[kept]
    )


def _with_known(scales: Scales, sigma: float | None, beta: float | None, reach: float) -> Scales:
    """Replace what is known; an error is never above the sigma that it makes."""
    scales = replace(scales, reach=reach)
    if sigma is not None:
        scales = replace(scales, sigma=sigma, error=min(scales.error, sigma))
    return scales if beta is None else replace(scales, beta=beta)


def _guess_scales(index: RoadIndex, observations: Sequence[Observations]) -> Scales:
    """Guess the scales before anything is matched."""
    error = guess_error(index, observations)
    beta = 2.0 * error + _WINDING * _median_step(observations, error)
    return Scales(error, 2.0 * error, beta, *_measure_speeds(observations, error))


def _median_step(observations: Sequence[Observations], error: float) -> float:
    """Median distance between samples that lie two errors apart, 0 where none do."""
    steps = [np.zeros(0)]
    for observed in observations:
        samples = select_samples(observed.positions, observed.is_gap, 2 * error)
        steps.append(_step_lengths(observed, samples))
    pooled = np.concatenate(steps)
    return float(np.median(pooled)) if len(pooled) else 0.0


def _step_lengths(observations: Observations, samples: NDArray[np.int64]) -> Floats:
    """Straight lines between samples."""
    steps = np.diff(observations.positions[samples], axis=0)
    lengths: Floats = np.sqrt((steps**2).sum(axis=1))
    return lengths


def _min_error(index: RoadIndex) -> float:
    """The least error in metres: even a log without errors is matched to a rounded map."""
    return _MIN_ERROR * index.road_grid.cell_size


def _measure_speeds(observations: Sequence[Observations], error: float) -> tuple[float, float]:
    """Median and highest speed between samples that lie two errors apart.

    0 and infinite where there are none.
    """
    speeds, calm_speeds = [np.zeros(0)], [np.zeros(0)]
    for observed in observations:
        samples = select_samples(observed.positions, observed.is_gap, 2 * error)
        lengths = _step_lengths(observed, samples)
        run = np.concatenate(([0], np.cumsum(observed.is_gap)))[samples]
        speed = (lengths / np.diff(observed.times[samples]))[np.diff(run) == 0]
        speeds.append(speed)
        # Of each two successive steps the slower, so that an outlier or two in a short log don't
        # become its highest speed.
        calm_speeds.append(np.minimum(speed[:-1], speed[1:]) if len(speed) > 1 else speed)
    pooled = np.concatenate(speeds)
    if not len(pooled):
        return 0.0, math.inf
    brisk = float(np.quantile(np.concatenate(calm_speeds), 0.95))
    return float(np.median(pooled)), MAX_SPEED_FACTOR * brisk


def _fastest_step(observed: Observations) -> float:
    """Highest speed of a short track: of each two successive steps, the slower counts."""
    steps = np.linalg.norm(np.diff(observed.positions, axis=0), axis=1)
    speeds = (steps / np.diff(observed.times))[~observed.is_gap]
    calm = np.minimum(speeds[:-1], speeds[1:]) if len(speeds) > 1 else speeds
    return MAX_SPEED_FACTOR * float(calm.max(initial=0.0))


def _blend_speeds(
    track: tuple[float, float], log: tuple[float, float], paths: float
) -> tuple[float, float]:
    """Median and highest speed of a track with those of the log as prior.

    The highest speed is never below the track's own.
    """
    share = paths / (paths + _PRIOR)
    median_speed, max_speed = (
        share * a + (1 - share) * b if share else b for a, b in zip(track, log, strict=True)
    )
    return median_speed, max(max_speed, track[1]) if math.isfinite(track[1]) else max_speed


def _scales_from(sums: _Sums, speeds: tuple[float, float], min_error: float) -> Scales:
    """Compute scales from sums.

    beta is a root mean square, since detours have a longer tail than the exponential distribution
    that their cost implies; the error is added, since the ends of a path are uncertain by it.
    """
    error = max(math.sqrt(sums.squares / sums.steps), min_error)
    rho = min(max(sums.products / sums.pairs, 0.0), _MAX_AUTOCORRELATION) if sums.pairs > 0 else 0.0
    square = sums.detours / sums.paths if sums.paths else 0.0
    sigma = error * math.sqrt((1 + rho) / (1 - rho))
    return Scales(error, sigma, math.sqrt(square + error**2), *speeds)


def _fit_log_mixture(residuals: Sequence[_Residuals], scales: Scales) -> DistanceMixture:
    """Fit the mixture of distances of all time steps, on roads and off them."""
    start = DistanceMixture(_FIRST_SHARE, scales.error, search_radius(scales))
    return fit_mixture(np.concatenate([residual.strays for residual in residuals]), start)


def _sum_all(residuals: Sequence[_Residuals], mixture: DistanceMixture) -> _Sums:
    return sum((_sum_on_roads(residual, mixture) for residual in residuals), _Sums())


def _sum_on_roads(residuals: _Residuals, mixture: DistanceMixture) -> _Sums:
    """Sum over the time steps on roads; a track across a field tells nothing of errors or paths."""
    # Errors, weighted by the probability of being on the road.
    weight = mixture.on_roads(residuals.strays)
    errors = np.nan_to_num(residuals.errors)
    squares = (errors**2).sum(axis=1)

    # Pairs of successive time steps.
    pair_weight = weight[:-1] * weight[1:]
    products = pair_weight @ (errors[:-1] * errors[1:]).sum(axis=1)
    mean_squares = 0.5 * pair_weight @ (squares[:-1] + squares[1:])

    # Paths.
    path_weight = np.where(np.isfinite(residuals.detours), pair_weight, 0.0)
    detours = path_weight @ np.nan_to_num(residuals.detours) ** 2
    return _Sums(
        squares=float(weight @ squares),
        steps=float(weight.sum()),
        products=float(products),
        pairs=float(mean_squares),
        detours=float(detours),
        paths=float(path_weight.sum()),
    )


def _measure_residuals(index: RoadIndex, path: ViterbiPath, scales: Scales) -> _Residuals:
    """Measure errors and detours of a matched track."""
    # From the position on the road to the sample.
    observed, samples = path.observations, path.sample_indices
    is_on_road = path.leg >= 0
    on_road = road_positions(
        np.where(is_on_road, path.roads, 0), path.metres, index.roads, index.graph
    )
    errors = np.where(is_on_road[:, None], observed.positions[samples] - on_road, np.nan)

    # Path less straight line.
    lengths = _step_lengths(observed, samples)
    detours = np.where(path.transitions[1:] < JUMP, np.diff(path.along) - lengths, np.nan)

    step = float(np.median(lengths)) if lengths.any() else 0.0
    lag = max(math.ceil(_BESIDE * scales.error / step), 1) if step else 1
    return _Residuals(errors, detours, lag)
