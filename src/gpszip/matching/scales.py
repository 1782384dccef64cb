"""The scales of the model from the log itself: match, measure what was matched, and match again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.match_lattice import JUMP, thin
from gpszip.kernels.match_near import nearest_distances
from gpszip.kernels.match_roads import Work
from gpszip.kernels.match_trace import places
from gpszip.matching.chain import Chain, Stretch, follow
from gpszip.matching.index import RoadIndex
from gpszip.matching.rules import Scales

__all__ = ["estimate_scales"]

#: Rounds of matching and measuring; the numbers hardly move after two.
_ROUNDS = 3

#: Samples that the rounds look at: more of them say the same.
_ENOUGH = 50_000

#: Share of its inverse by which an error may be alike from layer to layer, so that sigma stays finite.
_MOST_ALIKE = 0.95

#: No speed of a log is more than so many times the one that one in a hundred exceeds.
_FASTER = 3.0

Floats = NDArray[np.float64]


def estimate_scales(
    index: RoadIndex, work: Work, stretches: Sequence[Stretch], *, sigma: float | None = None, beta: float | None = None
) -> Scales:
    """Find the scales of a log.

    Errors of receiver and map change slowly, so that samples in a row repeat the same error rather than tell a new one. If the error of
    one layer is alike that of the next by a share rho, n of them tell as much as n (1 - rho) / (1 + rho) independent ones; the prices
    of all candidates are lowered by as much, which is a larger sigma. Where samples are far apart nothing is left of this.

    Parameters
    ----------
    index, work : RoadIndex, Work
        The network, and room to search it.
    stretches : sequence of Stretch
        The log.
    sigma, beta : float, optional
        Those that are known.
    """
    some = _some(stretches)
    scales = _fixed(_first(index, some), sigma, beta)
    for _ in range(_ROUNDS):
        chains = [follow(index, work, one, scales, sure=False) for one in some]
        scales = _fixed(_measured(index, some, chains, scales), sigma, beta)
    return scales


def _some(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Enough of a log: the same share of each track, from its middle."""
    share = min(_ENOUGH / max(sum(len(one.times) for one in stretches), 1), 1.0)
    return [_middle(one, share) for one in stretches]


def _middle(stretch: Stretch, share: float) -> Stretch:
    n = len(stretch.times)
    size = max(math.ceil(n * share), min(n, 2))
    first = (n - size) // 2
    last = first + size
    return Stretch(stretch.positions[first:last], stretch.times[first:last], stretch.silent[first : last - 1])


def _fixed(scales: Scales, sigma: float | None, beta: float | None) -> Scales:
    """Put in what the user knows; an error is never above the sigma that it makes."""
    if sigma is not None:
        scales = replace(scales, sigma=sigma, error=min(scales.error, sigma))
    return scales if beta is None else replace(scales, beta=beta)


def _first(index: RoadIndex, stretches: Sequence[Stretch]) -> Scales:
    """A first guess, from the distance to the nearest road."""
    near = np.concatenate([nearest_distances(one.positions, index.roads, index.cells) for one in stretches])
    known = near[np.isfinite(near)]
    error = 2.0 * float(np.median(known)) if len(known) else 1.0
    error = max(error, _least_error(index))
    usual, fastest = _speeds(stretches, error)
    return Scales(error, 2.0 * error, 2.0 * error, usual, fastest)


def _least_error(index: RoadIndex) -> float:
    """Even a log without error has one: some rounding of the map."""
    return 1e-3 * index.cells.size


def _speeds(stretches: Sequence[Stretch], error: float) -> tuple[float, float]:
    """Usual and fastest speed between samples that lie apart."""
    speeds = [np.zeros(0)]
    for one in stretches:
        used = thin(one.positions, one.silent, 2 * error)
        steps = np.sqrt((np.diff(one.positions[used], axis=0) ** 2).sum(axis=1))
        silent = np.concatenate(([0], np.cumsum(one.silent)))[used]
        speeds.append((steps / np.diff(one.times[used]))[np.diff(silent) == 0])
    pooled = np.concatenate(speeds)
    if not len(pooled):
        return 1.0, math.inf
    return float(np.median(pooled)), _FASTER * float(np.quantile(pooled, 0.99))


def _measured(index: RoadIndex, stretches: Sequence[Stretch], chains: Sequence[Chain], before: Scales) -> Scales:
    """Scales of what was matched."""
    residuals = [_residuals(index, chain) for chain in chains]
    squares = np.concatenate([(one**2).sum(axis=1) for one in residuals])
    squares = squares[np.isfinite(squares)]
    if len(squares) < 2:
        return before
    error = max(math.sqrt(squares.mean()), _least_error(index))
    rho = _alike(residuals)
    sigma = error * math.sqrt((1 + rho) / (1 - rho))
    differences = np.concatenate([_differences(chain) for chain in chains])
    square = float((differences**2).mean()) if len(differences) else 0.0
    usual, fastest = _speeds(stretches, error)
    return Scales(error, sigma, math.sqrt(square + error**2), usual, fastest)


def _residuals(index: RoadIndex, chain: Chain) -> Floats:
    """From the place of each layer to its sample, NaN off the roads."""
    on = chain.leg >= 0
    at = places(np.where(on, chain.roads, 0), chain.metres, index.roads, index.graph)
    return np.where(on[:, None], chain.stretch.positions[chain.used] - at, np.nan)


def _alike(residuals: Sequence[Floats]) -> float:
    """Correlation of the errors of layers in a row, from 0 to nearly 1."""
    product = square = 0.0
    for one in residuals:
        a, b = one[:-1], one[1:]
        both = np.isfinite(a[:, 0] + b[:, 0])
        product += float((a[both] * b[both]).sum())
        square += 0.5 * float((a[both] ** 2).sum() + (b[both] ** 2).sum())
    return min(max(product / square, 0.0), _MOST_ALIKE) if square > 0 else 0.0


def _differences(chain: Chain) -> Floats:
    """Way over roads less straight line, of layers that a way joins."""
    steps = np.sqrt((np.diff(chain.stretch.positions[chain.used], axis=0) ** 2).sum(axis=1))
    differences: Floats = (np.diff(chain.along) - steps)[chain.kinds[1:] < JUMP]
    return differences
