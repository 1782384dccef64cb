"""The scales of the model from the log itself: match, measure what was matched, and match again."""

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

__all__ = ["estimate_robust_scales", "estimate_scales", "guess_error"]

#: Rounds of matching and measuring on a few samples, before one on many: as many as it takes until the error is the same but for so
#: much, which are two or three, but where who stands beside the roads for hours makes the first guess far too large.
_ROUNDS, _SAME = 8, 0.2

#: Samples that the rounds look at, and that the last one does; of each track at least the third number.
_SOME, _MANY, _FEW = 10_000, 100_000, 30

#: A share of a track is looked at in at most so many parts, so that one long walk off the roads is not all that is seen.
_PARTS = 10

#: A first guess of how much longer than the straight line a way is. Rather too much: if ways that wind seem too dear, layers are
#: matched to far roads instead, which looks like a large error, and this never mends.
_WINDING = 0.25

#: A first guess of the error is so many times the distance that a quarter of the samples have at most, or that half of them have, whichever
#: is more: 1.3 errors where all are on roads. Where only 55 in a hundred are it is 3.4: nine in ten of these are nearer than the median.
_GUESS = np.array([4.0, 2.0])

#: An error so many times the first guess, which is rather too much, is none of the log.
_UNSOUND = 1.5

#: Layers so many errors away tell whether a track keeps its distance beside a road: who crosses it by 30 degrees has come as far again.
_BESIDE = 5.0

#: What the whole log tells counts for a track as much as so many layers of its own.
_PRIOR = 300.0

#: The most that errors are alike from layer to layer, so that sigma stays finite.
_MOST_ALIKE = 0.95

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Shown:
    """What the layers of a matched track show.

    Parameters
    ----------
    errors : float64 array, shape (k, d)
        From the place of each layer to its sample, NaN off the roads.
    differences : float64 array, shape (k - 1,)
        Way over roads less straight line between layers in a row, NaN where no way joins them.
    lag : int
        Layers so many places on are some five errors away.
    """

    errors: Floats
    differences: Floats
    lag: int

    @property
    def strays(self) -> Floats:
        """How far each layer is from its road, or from being as far beside it as the layers before or after it are.

        A map that is wrong shifts whole streets, and who follows them keeps his distance; who crosses a field does not.
        """
        length = np.sqrt((self.errors**2).sum(axis=1))
        change = np.sqrt(((self.errors[self.lag :] - self.errors[: -self.lag]) ** 2).sum(axis=1))
        strays: Floats = length.copy()
        strays[self.lag :] = np.fmin(
            strays[self.lag :], np.where(np.isnan(strays[self.lag :]), np.nan, change)
        )
        strays[: -self.lag] = np.fmin(
            strays[: -self.lag], np.where(np.isnan(strays[: -self.lag]), np.nan, change)
        )
        return strays


@dataclass(frozen=True)
class _Sums:
    """What layers of matched tracks add up to, each as far as it is on its road.

    Parameters
    ----------
    squares, layers : float
        Squared distance to the roads, and number of layers on them.
    products, both : float
        Product of the errors of layers in a row, and their mean square.
    differences, ways : float
        Squared difference between ways and straight lines, and number of ways.
    """

    squares: float = 0.0
    layers: float = 0.0
    products: float = 0.0
    both: float = 0.0
    differences: float = 0.0
    ways: float = 0.0

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(
            *(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True))
        )

    def shrunk(self, layers: float) -> _Sums:
        """The same as so few layers would tell; no more than there are."""
        share = min(layers / self.layers, 1.0) if self.layers else 0.0
        return _Sums(*(share * value for value in vars(self).values()))


def estimate_scales(
    index: RoadIndex,
    work: Workspace,
    stretches: Sequence[Observations],
    *,
    sigma: float | None = None,
    beta: float | None = None,
    heading: float | None = None,
) -> tuple[Scales, list[Scales]]:
    """Find the scales of a log as a whole and of each track.

    Errors of receiver and map change slowly, so that samples in a row repeat the same error rather than tell a new one. If the error of
    one layer is alike that of the next by a share rho, n of them tell as much as n (1 - rho) / (1 + rho) independent ones; the prices
    of all candidates are lowered by as much, which is a larger sigma. Where samples are far apart nothing is left of this.

    A part of the log may be off all roads, and still be matched where roads are near: layers count as far as they are on their roads.

    Parameters
    ----------
    index, work : RoadIndex, Work
        The network, and room to search it.
    stretches : sequence of Stretch
        The log.
    sigma, beta, heading : float, optional
        Those that are known.
    """
    some = _some(stretches, _SOME)
    least = _least_error(index)
    scales = _fixed(_first(index, some), sigma, beta)
    for _ in range(_ROUNDS):
        shown = [
            _shown(
                index, find_viterbi_path(index, work, one, scales, with_confidence=False), scales
            )
            for one in some
        ]
        total = _total(shown, _usual(shown, scales))
        if not total.ways:
            scales = replace(scales, heading=heading or math.inf)
            return scales, [scales] * len(stretches)
        before, scales = scales, _fixed(_of(total, _speeds(some, scales.error), least), sigma, beta)
        if abs(math.log(scales.error / before.error)) < _SAME:
            break
    many = _some(stretches, _MANY)
    chains = [find_viterbi_path(index, work, one, scales, with_confidence=False) for one in many]
    shown = [_shown(index, chain, scales) for chain in chains]
    usual = _usual(shown, scales)
    sums = [_summed(one, fit_mixture(one.strays, usual, _PRIOR)) for one in shown]
    facing, facings = (
        _facing(index, work, chains, scales)
        if heading is None
        else (heading, [heading] * len(many))
    )
    total = _total(shown, usual)
    whole = _fixed(_of(total, _speeds(many, scales.error), least), sigma, beta)
    prior, speeds = total.shrunk(_PRIOR), (whole.median_speed, whole.max_speed)
    own = (
        _of(one + prior, _blend(_speeds([track], whole.error), speeds, one.ways), least) for one, track in zip(sums, many, strict=True)
    )  # fmt: skip
    each = [
        replace(_fixed(one, sigma, beta), heading=turned)
        for one, turned in zip(own, facings, strict=True)
    ]
    return replace(whole, heading=facing), each


def estimate_robust_scales(
    index: RoadIndex,
    opened: RoadIndex | None,
    work: Workspace,
    stretches: Sequence[Observations],
    *,
    sigma: float | None = None,
    beta: float | None = None,
    heading: float | None = None,
) -> tuple[Scales, list[Scales]]:
    """Find the scales of a log as :func:`estimate_scales` does, also where it travels against one-way roads.

    Samples that travel against a road look as if their errors were as long as the road. What is far more than the distance to
    the nearest road tells is measured again with all roads open both ways.

    Parameters
    ----------
    index : RoadIndex
        The network.
    opened : RoadIndex or None
        The same with all roads open both ways; None where they are.
    work, stretches, sigma, beta, heading
        As for :func:`estimate_scales`.
    """
    known = {"sigma": sigma, "beta": beta, "heading": heading}
    whole, each = estimate_scales(index, work, stretches, **known)
    if opened is None:
        return whole, each
    unsound = [
        one.error > _UNSOUND * guess_error(index, [stretch])
        for one, stretch in zip(each, stretches, strict=True)
    ]
    if not any(unsound):
        return whole, each
    whole_again, again = estimate_scales(opened, work, stretches, **known)
    if whole.error > _UNSOUND * guess_error(index, stretches):
        whole = whole_again
    return whole, [new if bad else old for old, new, bad in zip(each, again, unsound, strict=True)]


def _facing(
    index: RoadIndex, work: Workspace, chains: Sequence[ViterbiPath], scales: Scales
) -> tuple[float, list[float]]:
    """Spread of headings, of a log as a whole and of each track: measured, matched with, and measured again."""
    whole, each = headings_follow_roads(index, chains)
    if not any(each):
        return math.inf, [math.inf] * len(chains)
    followed = [chain for chain, agrees in zip(chains, each, strict=True) if agrees]
    headed = replace(scales, heading=estimate_heading_spread(index, followed))
    found = estimate_heading_spread(
        index,
        [
            find_viterbi_path(index, work, chain.observations, headed, with_confidence=False)
            for chain in followed
        ],
    )
    return found if whole else math.inf, [found if agrees else math.inf for agrees in each]


def _some(stretches: Sequence[Observations], samples: int) -> list[Observations]:
    """So many samples of a log: the same share of each track."""
    share = min(samples / max(sum(len(one.times) for one in stretches), 1), 1.0)
    return [_parts(one, share) for one in stretches]


def _parts(stretch: Observations, share: float) -> Observations:
    """A share of a track, from all over it; nothing is told of what lies between two parts."""
    n = len(stretch.times)
    size = min(max(math.ceil(n * share), _FEW), n)
    count = min(max(size // _FEW, 1), _PARTS) if size < n else 1
    starts = np.round(np.linspace(0, n - size, 2 * count + 1)[1::2]).astype(
        np.int64
    )  # of what is left out before each part
    number = np.arange(size)
    kept = number + starts[number * count // size]
    is_gap = stretch.is_gap[kept[:-1]] | (np.diff(kept) > 1)
    return Observations(
        stretch.positions[kept], stretch.times[kept], is_gap, stretch.headings[kept]
    )


def _fixed(scales: Scales, sigma: float | None, beta: float | None) -> Scales:
    """Put in what the user knows; an error is never above the sigma that it makes."""
    if sigma is not None:
        scales = replace(scales, sigma=sigma, error=min(scales.error, sigma))
    return scales if beta is None else replace(scales, beta=beta)


def _first(index: RoadIndex, stretches: Sequence[Observations]) -> Scales:
    """A first guess."""
    error = guess_error(index, stretches)
    return Scales(
        error,
        2.0 * error,
        2.0 * error + _WINDING * _step(stretches, error),
        *_speeds(stretches, error),
    )


def guess_error(index: RoadIndex, stretches: Sequence[Observations]) -> float:
    """A first guess of the error, from the distance to the nearest road of some samples."""
    near = np.concatenate(
        [
            nearest_distances(one.positions, index.roads, index.road_grid)
            for one in _some(stretches, _SOME)
        ]
    )
    known = near[np.isfinite(near)]
    return (
        max(*(_GUESS * np.quantile(known, [0.25, 0.5])).tolist(), _least_error(index))
        if len(known)
        else _least_error(index)
    )


def _step(stretches: Sequence[Observations], error: float) -> float:
    """Median distance between samples that lie apart, 0 where none do."""
    steps = [np.zeros(0)]
    for one in stretches:
        used = select_samples(one.positions, one.is_gap, 2 * error)
        steps.append(np.sqrt((np.diff(one.positions[used], axis=0) ** 2).sum(axis=1)))
    pooled = np.concatenate(steps)
    return float(np.median(pooled)) if len(pooled) else 0.0


def _least_error(index: RoadIndex) -> float:
    """Even a log without error has one: some rounding of the map."""
    return 1e-3 * index.road_grid.size


def _speeds(stretches: Sequence[Observations], error: float) -> tuple[float, float]:
    """Usual and fastest speed between samples that lie apart; 0 and infinite where there are none."""
    speeds, calm = [np.zeros(0)], [np.zeros(0)]
    for one in stretches:
        used = select_samples(one.positions, one.is_gap, 2 * error)
        steps = np.sqrt((np.diff(one.positions[used], axis=0) ** 2).sum(axis=1))
        is_gap = np.concatenate(([0], np.cumsum(one.is_gap)))[used]
        own = (steps / np.diff(one.times[used]))[np.diff(is_gap) == 0]
        speeds.append(own)
        # the lesser of two in a row, so that in a short log a leap or two don't become the fastest that it knows
        calm.append(np.minimum(own[:-1], own[1:]) if len(own) > 1 else own)
    pooled = np.concatenate(speeds)
    if not len(pooled):
        return 0.0, math.inf
    return float(np.median(pooled)), MAX_SPEED_FACTOR * float(
        np.quantile(np.concatenate(calm), 0.95)
    )


def _blend(
    own: tuple[float, float], whole: tuple[float, float], ways: float
) -> tuple[float, float]:
    """Speeds of a track, as far as it has enough of them."""
    share = ways / (ways + _PRIOR)
    usual, fastest = (
        share * a + (1 - share) * b if share else b for a, b in zip(own, whole, strict=True)
    )
    return usual, max(fastest, own[1]) if math.isfinite(own[1]) else fastest


def _of(sums: _Sums, speeds: tuple[float, float], least: float) -> Scales:
    """Scales of what was matched.

    beta is a root mean square, since differences have a longer tail than the exponential distribution of their price; and
    the places between which a way leads are themselves uncertain by the error.
    """
    error = max(math.sqrt(sums.squares / sums.layers), least)
    rho = min(max(sums.products / sums.both, 0.0), _MOST_ALIKE) if sums.both > 0 else 0.0
    square = sums.differences / sums.ways if sums.ways else 0.0
    return Scales(
        error, error * math.sqrt((1 + rho) / (1 - rho)), math.sqrt(square + error**2), *speeds
    )


def _differences(chain: ViterbiPath) -> Floats:
    """Way over roads less straight line between layers in a row, NaN where no way joins them."""
    steps = np.sqrt(
        (np.diff(chain.observations.positions[chain.sample_indices], axis=0) ** 2).sum(axis=1)
    )
    return np.where(chain.transitions[1:] < JUMP, np.diff(chain.along) - steps, np.nan)


def _usual(shown: Sequence[_Shown], scales: Scales) -> DistanceMixture:
    """Distances of all layers, on roads and off them."""
    return fit_mixture(
        np.concatenate([one.strays for one in shown]),
        DistanceMixture(0.5, scales.error, search_radius(scales)),
    )


def _total(shown: Sequence[_Shown], usual: DistanceMixture) -> _Sums:
    return sum((_summed(one, usual) for one in shown), _Sums())


def _summed(shown: _Shown, usual: DistanceMixture) -> _Sums:
    """What is on roads, added up: who crosses a field within reach of a road tells nothing of errors, nor of ways."""
    on = usual.on_roads(shown.strays)
    errors = np.nan_to_num(shown.errors)
    squares = (errors**2).sum(axis=1)
    both = on[:-1] * on[1:]
    products = both @ (errors[:-1] * errors[1:]).sum(axis=1)
    joined = np.where(np.isfinite(shown.differences), both, 0.0)
    differences = joined @ np.nan_to_num(shown.differences) ** 2
    return _Sums(
        *map(
            float,
            (
                on @ squares,
                on.sum(),
                products,
                0.5 * both @ (squares[:-1] + squares[1:]),
                differences,
                joined.sum(),
            ),
        )
    )


def _shown(index: RoadIndex, chain: ViterbiPath, scales: Scales) -> _Shown:
    steps = np.sqrt(
        (np.diff(chain.observations.positions[chain.sample_indices], axis=0) ** 2).sum(axis=1)
    )
    step = float(np.median(steps)) if steps.any() else 0.0
    return _Shown(
        _errors(index, chain),
        _differences(chain),
        max(math.ceil(_BESIDE * scales.error / step), 1) if step else 1,
    )


def _errors(index: RoadIndex, chain: ViterbiPath) -> Floats:
    """From the place of each layer to its sample, NaN off the roads."""
    on = chain.leg >= 0
    at = road_positions(np.where(on, chain.roads, 0), chain.metres, index.roads, index.graph)
    return np.where(on[:, None], chain.observations.positions[chain.sample_indices] - at, np.nan)
