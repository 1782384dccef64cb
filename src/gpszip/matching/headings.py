"""Which way an agent faces, as the log tells it, and how far that is to be believed."""

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

#: A heading agrees with a road whose direction differs by less than half a right angle.
_AGREES = math.cos(math.pi / 4)

#: Headings follow the roads if they agree so much oftener than by chance (Cohen's kappa), and by so many of its standard deviations.
#: Where samples are sparse and errors large, many roads are wrong before headings help, so that this is little.
_KAPPA, _SIGNIFICANT = 0.2, 3.0

#: A track's headings follow if they do so at least this much as well as the whole log's; it needs so many layers to tell.
_AS_WELL, _FEW = 0.5, 20

#: Where this share would agree by chance, as on a straight road, a track's own headings tell nothing about themselves.
_STRAIGHT = 0.9

#: So many headings are compared with as many roads to know what chance does.
_SOME = 400

#: The least spread, in degrees: roads are drawn no better.
_LEAST = 2.0

#: The most that errors are alike from layer to layer, so that the spread stays finite.
_MOST_ALIKE = 0.95

Vectors = NDArray[np.complex128]


def heading_vectors(
    degrees: NDArray[np.float64], positions: NDArray[np.float64], plane: Plane | None
) -> NDArray[np.float64]:
    """Headings as vectors on the plane.

    Parameters
    ----------
    degrees : float64 array, shape (n,)
        Clockwise from true north, or from y on a plane of its own; what is not finite is not known.
    positions : float64 array, shape (n, d)
        Where, in metres.
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
    known = np.isfinite(degrees)
    angle = np.radians(np.where(known, degrees, 0.0))
    if plane is not None and known.any():
        lat, lon = to_geographic(positions[:, :2], plane)
        middle = np.array(plane.centers)[plane_indices(positions[:, :2], plane), 1] / 1e7
        # meridians lean towards the plane's middle
        angle -= np.arctan(np.tan(np.radians(lon - middle)) * np.sin(np.radians(lat)))
    return np.where(known[:, None], np.stack([np.sin(angle), np.cos(angle)], axis=1), 0.0)


def read_headings(track: Track) -> NDArray[np.float64]:
    """Headings of a track as vectors, from its attribute ``heading`` in degrees; zero where it has none."""
    column = track.attributes.get(HEADING)
    if column is None or column.dtype.kind not in "fiu":
        return np.zeros((len(track), 2))
    return heading_vectors(np.asarray(column, dtype=np.float64), track.positions, track.plane)


def headings_follow_roads(
    index: RoadIndex, chains: Sequence[ViterbiPath]
) -> tuple[bool, list[bool]]:
    """Whether headings follow the roads travelled: in a log as a whole, and in each track.

    Those that agree with the roads hardly oftener than by chance don't: a constant column, another unit, another zero.

    Parameters
    ----------
    index : RoadIndex
        The network.
    chains : sequence of Chain
        Tracks matched without their headings.
    """
    pairs = [_headed(index, chain) for chain in chains]
    usual, least = _kappa(*map(np.concatenate, zip(*pairs, strict=True)))
    whole = usual >= least
    each = [_kappa(*pair) for pair in pairs]
    return whole, [
        whole if math.isnan(own) else own >= (_AS_WELL * usual if whole else least)
        for own, least in each
    ]


def estimate_heading_spread(index: RoadIndex, chains: Sequence[ViterbiPath]) -> float:
    """How far headings differ from the roads travelled, in degrees.

    From the median, which strays don't move: the price of an error has the shape of Cauchy's distribution. It is larger by as much as
    differences of layers in a row are alike, as sigma is.

    Parameters
    ----------
    index : RoadIndex
        The network.
    chains : sequence of Chain
        Tracks whose headings are to be believed.
    """
    errors = [
        np.angle(heading * road.conj())
        for heading, road in (_headed(index, chain) for chain in chains)
    ]
    if not sum(map(len, errors)):
        return math.inf
    angle = max(float(np.degrees(np.median(np.abs(np.concatenate(errors))))) / math.sqrt(2), _LEAST)
    sines = [np.sin(one) for one in errors]
    products = sum(float((one[:-1] * one[1:]).sum()) for one in sines)
    squares = sum(0.5 * float((one[:-1] ** 2 + one[1:] ** 2).sum()) for one in sines)
    rho = min(max(products / squares, 0.0), _MOST_ALIKE) if squares > 0 else 0.0
    return angle * math.sqrt((1 + rho) / (1 - rho))


def _headed(index: RoadIndex, chain: ViterbiPath) -> tuple[Vectors, Vectors]:
    """Headings, and directions of the roads travelled, of layers that have both, as complex numbers."""
    on = np.flatnonzero(
        (chain.leg >= 0) & chain.observations.headings[chain.sample_indices].any(axis=1)
    )
    heading, road = (
        chain.observations.headings[chain.sample_indices[on]],
        travel_directions(chain.roads[on], chain.metres[on], index.roads, index.graph),
    )
    return heading[:, 0] + 1j * heading[:, 1], road[:, 0] + 1j * road[:, 1]


def _kappa(heading: Vectors, road: Vectors) -> tuple[float, float]:
    """Cohen's kappa of headings and roads, NaN where there is too little to tell; and the least that is no chance."""
    if len(heading) < _FEW:
        return math.nan, _KAPPA
    share = float(((heading * road.conj()).real > _AGREES).mean())
    step = math.ceil(len(heading) / _SOME)
    chance = float(((heading[::step, None] * road[None, ::step].conj()).real > _AGREES).mean())
    if min(share, chance) > _STRAIGHT:
        return math.nan, _KAPPA
    deviation = math.sqrt(chance * (1 - chance) / len(heading)) / (1 - chance)
    return (share - chance) / (1 - chance), max(_KAPPA, _SIGNIFICANT * deviation)
