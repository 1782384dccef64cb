"""CISED-S: one pass over the samples, with intersections of cones (Lin et al., VLDB J. 28, 2019).

A line from the sample s that is within a distance r of sample i at that sample's time has a
velocity within ``r / (t_i - t_s)`` of ``u_i = (p_i - p_s) / (t_i - t_s)``: the cone of sample i,
cut by a plane one second after s, is that circle. The line suits all samples whose circles it lies
in. Circles are replaced with inscribed regular polygons of ``SIDES`` sides, all turned alike, so
that an intersection is bounded by one half-plane for each side::

    u . n_k <= h_k = min over i of (u_i . n_k + r cos(pi / SIDES) / (t_i - t_s))
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit

from .log import Floats, Integers, Log

#: Sides of a polygon, as in the paper; it covers 97 % of its circle.
SIDES = 16

#: Outer normals of the sides; the corners lie half a side further.
_ANGLES = 2 * np.pi * np.arange(SIDES) / SIDES
_NORMALS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_CORNERS = np.column_stack([np.cos(_ANGLES + np.pi / SIDES), np.sin(_ANGLES + np.pi / SIDES)])

#: Distance of a side from the center, for corners at distance 1.
_INNER = math.cos(math.pi / SIDES)


def simplify(log: Log, tolerance: float) -> Integers:
    """Keep the ends of all tracks, and what CISED-S keeps between them.

    Cones have half the tolerance as radius. As long as one line suits all samples, the last of them
    is within half the tolerance of it, and the line to that sample within the tolerance of all.
    """
    return _simplify(log, tolerance, narrow=True)


def simplify_with_wide_cones(log: Log, tolerance: float) -> Integers:
    """Keep samples with cones of the whole tolerance.

    A line may then only end at a sample that lies in the cones of all samples before it, and the
    samples behind the last such one are passed twice.
    """
    return _simplify(log, tolerance, narrow=False)


def _simplify(log: Log, tolerance: float, *, narrow: bool) -> Integers:
    return np.flatnonzero(_mark_kept(log.clock, log.x, log.y, log.firsts, tolerance, narrow))


@jit
def _mark_kept(
    t: Floats, x: Floats, y: Floats, firsts: Integers, tolerance: float, narrow: bool
) -> NDArray[np.bool_]:
    """Mark the samples that are kept: each is the last where a line from the one before may end."""
    radius = 0.5 * tolerance if narrow else tolerance
    kept = np.zeros(len(t), np.bool_)
    bounds = np.empty(SIDES)
    polygon, spare = np.empty((2 * SIDES, 2)), np.empty((2 * SIDES, 2))
    for track in range(len(firsts) - 1):
        start, last = firsts[track], firsts[track + 1] - 1
        kept[start] = True
        while start < last:
            # The cone of the next sample.
            end = start + 1
            duration = t[end] - t[start]
            ux, uy = (x[end] - x[start]) / duration, (y[end] - y[start]) / duration
            for k in range(SIDES):
                bounds[k] = ux * _NORMALS[k, 0] + uy * _NORMALS[k, 1] + radius * _INNER / duration
                polygon[k, 0] = ux + _CORNERS[k, 0] * radius / duration
                polygon[k, 1] = uy + _CORNERS[k, 1] * radius / duration
            size = SIDES

            # Intersect it with those of the samples that follow, until nothing is left.
            for i in range(start + 2, last + 1):
                duration = t[i] - t[start]
                ux, uy = (x[i] - x[start]) / duration, (y[i] - y[start]) / duration
                if not narrow and _is_inside(bounds, ux, uy):
                    end = i
                size = _intersect(polygon, spare, size, bounds, ux, uy, radius * _INNER / duration)
                if size == 0:
                    break
                if narrow:
                    end = i
            kept[end] = True
            start = end
    return kept


@inner_uncounted
def _is_inside(bounds: Floats, ux: float, uy: float) -> bool:
    """Tell whether a velocity lies in the intersection."""
    inside = True
    for k in range(SIDES):
        inside &= ux * _NORMALS[k, 0] + uy * _NORMALS[k, 1] <= bounds[k]
    return inside


@inner_uncounted
def _intersect(
    polygon: Floats, spare: Floats, size: int, bounds: Floats, ux: float, uy: float, inner: float
) -> int:
    """Intersect the polygon with another one, and return its number of corners.

    The other polygon has its center at u, and sides at the distance ``inner``. Only sides that are
    closer than those so far cut anything off.
    """
    for k in range(SIDES):
        nx, ny = _NORMALS[k, 0], _NORMALS[k, 1]
        bound = ux * nx + uy * ny + inner
        if bound < bounds[k]:
            bounds[k] = bound
            size = _clip(polygon, spare, size, nx, ny, bound)
    return size


@inner_uncounted
def _clip(polygon: Floats, spare: Floats, size: int, nx: float, ny: float, bound: float) -> int:
    """Keep what of the polygon lies where ``p . n <= bound`` (Sutherland and Hodgman, 1974)."""
    # Corners inside stay; where a side crosses the line, there is a new corner.
    count = 0
    for i in range(size):
        j = i + 1 if i + 1 < size else 0
        here = polygon[i, 0] * nx + polygon[i, 1] * ny - bound
        there = polygon[j, 0] * nx + polygon[j, 1] * ny - bound
        if here <= 0:
            spare[count, 0], spare[count, 1] = polygon[i, 0], polygon[i, 1]
            count += 1
        if (here < 0 < there) or (there < 0 < here):
            share = here / (here - there)
            spare[count, 0] = polygon[i, 0] + share * (polygon[j, 0] - polygon[i, 0])
            spare[count, 1] = polygon[i, 1] + share * (polygon[j, 1] - polygon[i, 1])
            count += 1

    # Copy them back.
    for i in range(count):
        polygon[i, 0], polygon[i, 1] = spare[i, 0], spare[i, 1]
    return count
