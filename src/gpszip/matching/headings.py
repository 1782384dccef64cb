"""Headings of a log: read from its attribute, tested against the roads, their spread estimated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import plane_indices, to_geographic
from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import travel_directions
from gpszip.matching.viterbi import ViterbiPath
from gpszip.model import Plane, Track

__all__ = [
    "HEADING",
    "estimate_heading_spread",
    "heading_vectors",
    "headings_follow_roads",
    "read_headings",
]

#: Attribute of a track that holds its headings.
HEADING = "heading"

#: A heading agrees with a road if the cosine between them is greater: within 45 degrees.
_AGREEMENT = math.cos(math.pi / 4)

#: Least Cohen's kappa of headings that follow the roads. It is low, since where samples are sparse
#: and errors large, many roads are wrong before headings help.
_MIN_KAPPA = 0.2

#: Least kappa in its standard deviations under chance.
_SIGNIFICANCE = 3.0

#: Least kappa of a track's headings, as a share of that of the log.
_MIN_SHARE_OF_LOG = 0.5

#: Least number of time steps that tell whether headings follow.
_MIN_STEPS = 20

#: Share of agreement above which headings tell nothing, as on a straight road, where any heading
#: that fits once fits always.
_STRAIGHT = 0.9

#: Number of headings, and of roads, that are compared with each other to estimate chance.
_CHANCE_SAMPLE = 400

#: Least spread in degrees: roads are not drawn better.
_MIN_SPREAD = 2.0

#: Largest autocorrelation from time step to time step, so that the spread stays finite.
_MAX_AUTOCORRELATION = 0.95

Vectors = NDArray[np.complex128]


def heading_vectors(
    degrees: NDArray[np.float64], positions: NDArray[np.float64], plane: Plane | None
) -> NDArray[np.float64]:
    """Convert headings to unit vectors on the plane.

    Parameters
    ----------
    degrees : float64 array, shape (n,)
        Clockwise from true north, or from the y axis where there is no plane; not finite where a
        heading is not known.
    positions : float64 array, shape (n, d)
        Positions in metres.
    plane : Plane or None
        Where the positions lie on the earth.

    Returns
    -------
    float64 array, shape (n, 2)
        Zero where a heading is not known.

    Examples
    --------
    >>> heading_vectors(np.array([0.0, 90.0, np.nan]), np.zeros((3, 2)), None).round(9).tolist()
    [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]
    """
    is_known = np.isfinite(degrees)
    angle = np.radians(np.where(is_known, degrees, 0.0))
    if plane is not None and is_known.any():
        # Meridian convergence: meridians lean towards the central meridian of the plane.
        lat, lon = to_geographic(positions[:, :2], plane)
        central = np.array(plane.centers)[plane_indices(positions[:, :2], plane), 1] / 1e7
        angle -= np.arctan(np.tan(np.radians(lon - central)) * np.sin(np.radians(lat)))
    return np.where(is_known[:, None], np.stack([np.sin(angle), np.cos(angle)], axis=1), 0.0)


def read_headings(track: Track) -> NDArray[np.float64]:
    """Read the attribute ``heading`` of a track, in degrees, as unit vectors; zero without one."""
    column = track.attributes.get(HEADING)
    if column is None or column.dtype.kind not in "fiu":
        return np.zeros((len(track), 2))
    return heading_vectors(np.asarray(column, dtype=np.float64), track.positions, track.plane)


def headings_follow_roads(
    index: RoadIndex, paths: Sequence[ViterbiPath]
) -> tuple[bool, list[bool]]:
    """Whether headings follow the roads travelled: those of the log, and those of each track.

    Headings that agree with the roads hardly more often than by chance don't follow them: a
    constant column, another unit, or another zero.

    Parameters
    ----------
    index : RoadIndex
        The network.
    paths : sequence of ViterbiPath
        Tracks matched without their headings.
    """
    # The log.
    pairs = [_pair_directions(index, path) for path in paths]
    log_kappa, log_least = _agreement(*map(np.concatenate, zip(*pairs, strict=True)))
    log_follows = log_kappa >= log_least

    # Each track; one that tells nothing goes with the log.
    track_follow = []
    for pair in pairs:
        kappa, least = _agreement(*pair)
        if math.isnan(kappa):
            track_follow.append(log_follows)
        else:
            track_follow.append(kappa >= (_MIN_SHARE_OF_LOG * log_kappa if log_follows else least))
    return log_follows, track_follow


def estimate_heading_spread(index: RoadIndex, paths: Sequence[ViterbiPath]) -> float:
    """Estimate the spread between headings and the roads travelled, in degrees.

    The cost ``log(1 + (1 - cos(a)) / spread ** 2)`` of a small angle a is that of a Cauchy
    distribution with the scale √2 spread. Its scale is the median of absolute values, which
    outliers don't move. With an autocorrelation rho from time step to time step the spread grows by
    sqrt((1 + rho) / (1 - rho)), as sigma does. It is infinite if there are no headings.

    Parameters
    ----------
    index : RoadIndex
        The network.
    paths : sequence of ViterbiPath
        Tracks whose headings follow the roads.
    """
    # Angles in radians from the direction of the road to the heading, at each time step.
    errors = [
        np.angle(heading * road.conj())
        for heading, road in (_pair_directions(index, path) for path in paths)
    ]
    if not sum(map(len, errors)):
        return math.inf

    # Scale of one error.
    median = float(np.degrees(np.median(np.abs(np.concatenate(errors)))))
    spread = max(median / math.sqrt(2), _MIN_SPREAD)

    # Autocorrelation of their sines.
    sines = [np.sin(error) for error in errors]
    products = sum(float((sine[:-1] * sine[1:]).sum()) for sine in sines)
    squares = sum(0.5 * float((sine[:-1] ** 2 + sine[1:] ** 2).sum()) for sine in sines)
    rho = min(max(products / squares, 0.0), _MAX_AUTOCORRELATION) if squares > 0 else 0.0
    return spread * math.sqrt((1 + rho) / (1 - rho))


def _pair_directions(index: RoadIndex, path: ViterbiPath) -> tuple[Vectors, Vectors]:
    """Headings and road directions, as complex numbers, of the time steps that have both."""
    headings = path.observations.headings[path.sample_indices]
    steps = np.flatnonzero((path.leg >= 0) & headings.any(axis=1))
    heading = headings[steps]
    road = travel_directions(path.roads[steps], path.metres[steps], index.roads, index.graph)
    return heading[:, 0] + 1j * heading[:, 1], road[:, 0] + 1j * road[:, 1]


def _agreement(heading: Vectors, road: Vectors) -> tuple[float, float]:
    """Cohen's kappa of headings and roads, and the least kappa that is not chance.

    Kappa is NaN where the time steps tell nothing.
    """
    if len(heading) < _MIN_STEPS:
        return math.nan, _MIN_KAPPA

    # Share that agrees, and share of all pairs of headings and roads that would agree.
    share = float(((heading * road.conj()).real > _AGREEMENT).mean())
    step = math.ceil(len(heading) / _CHANCE_SAMPLE)
    pairs = heading[::step, None] * road[None, ::step].conj()
    chance = float((pairs.real > _AGREEMENT).mean())
    if min(share, chance) > _STRAIGHT:
        return math.nan, _MIN_KAPPA

    deviation = math.sqrt(chance * (1 - chance) / len(heading)) / (1 - chance)
    kappa = (share - chance) / (1 - chance)
    return kappa, max(_MIN_KAPPA, _SIGNIFICANCE * deviation)
