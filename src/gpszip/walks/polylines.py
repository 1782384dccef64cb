"""Distances of two polylines: Hausdorff, Fréchet and discrete Fréchet distance.

The Hausdorff distance is that of the two sets of points. The Fréchet distance also respects the
order in which they are passed (Alt and Godau 1995), and the discrete one looks at vertices alone
(Eiter and Mannila 1994).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.kernels.read_only import read_only
from gpszip.walks.kernels.polylines import (
    discrete_frechet_square,
    frechet_within,
    nearest_squares,
)

__all__ = ["MAX_PAIRS", "PolylineDistances", "polyline_distances", "thin_polyline"]

#: Pairs of segments up to which distances are exact: such as 8,000 vertices each. All distances
#: of 3,000 vertices each take .04 s of CPU time.
MAX_PAIRS = 1 << 26

#: Metres to which distances are computed.
_TOLERANCE = 1e-4

#: Distances of points from segments, and from boxes around them, that one direction of the
#: Hausdorff distance takes: about 10 s of CPU time. Walks and their logs need a thousandth.
_MAX_COMPUTED = 1 << 31

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PolylineDistances:
    """Distances of two polylines in metres.

    Parameters
    ----------
    hausdorff, frechet, discrete_frechet : float
        The distances.
    within, discrete_within : float
        Metres by which the first two, and the last, may be off: the tolerance of the computation,
        and what thinning of long polylines moved, or an early end left open.
    """

    hausdorff: float
    frechet: float
    discrete_frechet: float
    within: float
    discrete_within: float


class ThinnedPolyline(NamedTuple):
    """A polyline with fewer vertices.

    Parameters
    ----------
    vertices : float64 array, shape (k, d)
        Every n-th vertex, and the last one.
    moved, discrete_moved : float
        At least the Fréchet and the discrete Fréchet distance from what it was, in metres.
    """

    vertices: Floats
    moved: float
    discrete_moved: float


def polyline_distances(p: ArrayLike, q: ArrayLike) -> PolylineDistances:
    """Hausdorff, Fréchet and discrete Fréchet distance of two polylines.

    Up to :data:`MAX_PAIRS` pairs of segments, distances are exact to 0.1 mm. Longer polylines are
    thinned to every n-th vertex first; ``within`` says how far the result may be off then. It also
    does where more than 10,000 points are equally far from the other polyline, so that the search
    for the farthest one ends early.

    The Fréchet distance is found by bisection between its lower bound, the Hausdorff distance and
    those of both ends, and its upper bound, the discrete one.

    Parameters
    ----------
    p, q : array_like, shape (n, d) and (m, d)
        Vertices in metres.

    Examples
    --------
    >>> there = [[0.0, 0.0], [10.0, 0.0]]
    >>> found = polyline_distances(there, [[0.0, 3.0], [10.0, 3.0]])
    >>> round(found.frechet, 3), round(polyline_distances(there, there[::-1]).frechet, 3)
    (3.0, 10.0)
    """
    # Thin what is too long.
    first, second = _thin_both(_with_a_segment(p), _with_a_segment(q))
    a, b = read_only(first.vertices), read_only(second.vertices)

    # The Hausdorff and the discrete distance, which bound the Fréchet distance.
    (there, off_there), (back, off_back) = _directed_hausdorff(a, b), _directed_hausdorff(b, a)
    hausdorff = max(there, back)
    discrete = math.sqrt(discrete_frechet_square(a, b, np.empty(len(b))))
    low = max(hausdorff, *(float(np.linalg.norm(a[end] - b[end])) for end in (0, -1)))
    frechet = _frechet(a, b, low, max(low, discrete))
    return PolylineDistances(
        hausdorff,
        frechet,
        discrete,
        max(_TOLERANCE, off_there, off_back) + first.moved + second.moved,
        first.discrete_moved + second.discrete_moved,
    )


def thin_polyline(vertices: Floats, step: int) -> ThinnedPolyline:
    """Keep every ``step``-th vertex and the last one.

    Vertex k of a block whose first and last vertices are u and v is matched to the point
    u + s_k (v - u), where s_k is the largest parameter so far of the vertices' projections. Both
    ways are passed forwards, and a distance along matched segments is largest at a vertex.

    Parameters
    ----------
    vertices : float64 array, shape (n, d)
        Metres.
    step : int
        At least 1.

    Examples
    --------
    >>> line = np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [3.0, 0.0]])
    >>> thinned = thin_polyline(line, 2)
    >>> thinned.vertices.tolist(), thinned.moved
    ([[0.0, 0.0], [2.0, 0.0], [3.0, 0.0]], 0.5)
    """
    # Blocks of vertices, the last one filled up with the last vertex.
    count = len(vertices)
    if step == 1 or count <= 2:
        return ThinnedPolyline(vertices, 0.0, 0.0)
    blocks = -(-(count - 1) // step)
    rows = np.minimum(np.arange(blocks)[:, None] * step + np.arange(step + 1), count - 1)
    of_blocks = vertices[rows]
    start, end = of_blocks[:, :1], of_blocks[:, -1:]

    # Parameters that never go back.
    chord = end - start
    length = np.maximum((chord**2).sum(axis=2), np.finfo(float).tiny)
    along = np.clip(((of_blocks - start) * chord).sum(axis=2) / length, 0.0, 1.0)
    along = np.maximum.accumulate(along, axis=1)

    # The largest distance of matched points, and of vertices from the first of their block.
    matched = start + along[:, :, None] * chord
    moved = np.sqrt(((of_blocks - matched) ** 2).sum(axis=2)).max()
    discrete = np.sqrt(((of_blocks[:, :-1] - start) ** 2).sum(axis=2)).max()
    kept = np.unique(np.append(np.arange(0, count, step), count - 1))
    return ThinnedPolyline(vertices[kept], float(moved), float(discrete))


def _with_a_segment(vertices: ArrayLike) -> Floats:
    """Vertices, of which a single one is repeated, as kernels expect them."""
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    return np.repeat(points, 2, axis=0) if len(points) == 1 else points


def _thin_both(p: Floats, q: Floats) -> tuple[ThinnedPolyline, ThinnedPolyline]:
    """Thin the longer one to the length of the shorter one, then both alike, as far as needed."""
    n, m = len(p), len(q)
    if n * m <= MAX_PAIRS:
        return ThinnedPolyline(p, 0.0, 0.0), ThinnedPolyline(q, 0.0, 0.0)
    share = MAX_PAIRS // min(n, m)
    limit = max(share, math.isqrt(MAX_PAIRS))
    step_p, step_q = (max(1, -(-count // limit)) for count in (n, m))
    return thin_polyline(p, step_p), thin_polyline(q, step_q)


def _frechet(p: Floats, q: Floats, low: float, high: float) -> float:
    """Smallest radius that is reached, to the tolerance; ``high`` is reached for sure."""
    workspace = np.empty(len(q) - 1)
    # Mostly the lower bound is the distance itself.
    if frechet_within(p, q, low + _TOLERANCE / 2, workspace):
        return low
    while high - low > _TOLERANCE:
        middle = (low + high) / 2
        # Of coordinates beyond 10^12 m, numbers lie farther apart than the tolerance.
        if not low < middle < high:
            break
        if frechet_within(p, q, middle, workspace):
            high = middle
        else:
            low = middle
    return high


class _Points(NamedTuple):
    """Points, and what of the other polyline is nearest to them.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Metres.
    distances : float64 array, shape (n,)
        Metres from the nearest segment.
    nearest : int64 array, shape (n,)
        Number of that segment.
    """

    positions: Floats
    distances: Floats
    nearest: NDArray[np.int64]

    def at(self, rows: slice | NDArray[np.generic]) -> _Points:
        """Some of the points."""
        return _Points(self.positions[rows], self.distances[rows], self.nearest[rows])

    def and_also(self, others: _Points) -> _Points:
        """These points and others."""
        return _Points(
            np.concatenate([self.positions, others.positions]),
            np.concatenate([self.distances, others.distances]),
            np.concatenate([self.nearest, others.nearest]),
        )


class _Boxed(NamedTuple):
    """A polyline, and boxes around blocks of its segments.

    Parameters
    ----------
    vertices : float64 array, shape (n, d)
        Metres.
    size : int
        Segments of a block.
    low, high : float64 arrays, shape (b, d)
        Corners of the box around each block.
    """

    vertices: Floats
    size: int
    low: Floats
    high: Floats


def _with_boxes(q: Floats) -> _Boxed:
    """A polyline with as many boxes as segments in each."""
    size = math.isqrt(len(q))
    first = np.arange(0, len(q) - 1, size)
    ends = (q[:-1], q[1:])
    return _Boxed(
        np.ascontiguousarray(q),
        size,
        np.minimum(*(np.minimum.reduceat(end, first) for end in ends)),
        np.maximum(*(np.maximum.reduceat(end, first) for end in ends)),
    )


def _directed_hausdorff(p: Floats, q: Floats) -> tuple[float, float]:
    """Largest distance of a point of the polyline p from q, and by how much it may be off.

    The distance from one segment of q is convex along a part of a segment of p. So on the part,
    the distance from q is at most the larger of those of its two ends from one and the same
    segment, for which that nearest to either end is taken. Parts on which this is no more than the
    largest distance so far are left out, others are cut in two.
    """
    # All vertices, then parts of segments.
    boxed = _with_boxes(q)
    vertices, computed = _find_nearest(p, boxed)
    best = float(vertices.distances.max())
    begin, end = vertices.at(slice(None, -1)), vertices.at(slice(1, None))
    while True:
        # Which parts may hold a larger distance?
        bound = np.minimum(
            np.maximum(begin.distances, _distances_from(end.positions, q, begin.nearest)),
            np.maximum(end.distances, _distances_from(begin.positions, q, end.nearest)),
        )
        is_open = bound > best + _TOLERANCE / 2
        if not is_open.any() or computed > _MAX_COMPUTED:
            return best, max(float(bound.max()) - best, 0.0)

        # Cut them in two.
        begin, end = begin.at(is_open), end.at(is_open)
        middle, more = _find_nearest((begin.positions + end.positions) / 2, boxed)
        computed += more
        best = max(best, float(middle.distances.max()))
        begin, end = begin.and_also(middle), middle.and_also(end)


def _find_nearest(points: Floats, q: _Boxed) -> tuple[_Points, int]:
    """Find the segment of a polyline that is nearest to each point.

    Returns
    -------
    _Points
        The points, their distances and segments.
    int
        Number of distances that were computed.
    """
    squares, nearest = np.empty(len(points)), np.empty(len(points), np.int64)
    computed = nearest_squares(read_only(np.ascontiguousarray(points)), *q, squares, nearest)
    return _Points(points, np.sqrt(squares), nearest), computed


def _distances_from(points: Floats, q: Floats, segments: NDArray[np.int64]) -> Floats:
    """Distance of each point from a segment of its own."""
    start = q[segments]
    chord = q[segments + 1] - start
    length = np.maximum((chord**2).sum(axis=1), np.finfo(float).tiny)
    along = np.clip(((points - start) * chord).sum(axis=1) / length, 0.0, 1.0)
    distances: Floats = np.sqrt(((start + along[:, None] * chord - points) ** 2).sum(axis=1))
    return distances
