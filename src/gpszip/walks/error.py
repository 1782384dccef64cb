"""How far walks lie from the tracks that they stand for, each sample at its own time.

On a geographic plane a metre here is a metre of the plane. A transverse Mercator plane stretches what lies beside its
central meridian, by 0.2 % at 400 km, and shrinks nothing, so that an error on the ground is never above the one told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model.track import Track
from gpszip.model.walk import Walk
from gpszip.walks.kernels.along import interpolate_positions
from gpszip.walks.shapes import shape_error

__all__ = ["TIME_SLACK", "ErrorSummary", "measure_errors", "positions_at", "synchronised_errors"]

#: Instants up to this many seconds outside of a piece belong to it.
TIME_SLACK = 1e-3


@dataclass(frozen=True)
class ErrorSummary:
    """How well walks stand for tracks.

    Parameters
    ----------
    rmse, max_error : float
        Root mean square and largest synchronised distance in metres, over the covered samples.
    points, uncovered : int
        All samples, and those for which the walks claim no position.
    """

    rmse: float
    max_error: float
    points: int
    uncovered: int


def positions_at(
    walk: Walk, nodes: NDArray[np.float64], when: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Positions of a walk at given instants.

    Parameters
    ----------
    walk : Walk
        With times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.
    when : float64 array, shape (n,)
        Seconds in the log's own zero, in any order.

    Returns
    -------
    float64 array, shape (n, d)
        Metres; NaN where no travel is claimed: before, after and in gaps. Up to 1 ms outside, the nearest end counts.

    Raises
    ------
    OptionError
        If the walk has no times.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 10.0]), np.array([False]))
    >>> positions_at(walk, np.array([[0.0, 0.0], [5.0, 0.0]]), np.array([4.0, 11.0])).tolist()
    [[2.0, 0.0], [nan, nan]]
    """
    if walk.times is None:
        raise OptionError(
            f"track {walk.id!r} has no times: the archive was written without them, so positions at a time can't be had"
        )
    out = np.empty((len(when), nodes.shape[1]))
    interpolate_positions(
        walk.times, nodes[walk.nodes], walk.gaps, np.array(when, np.float64), TIME_SLACK, out
    )
    if walk.spans is not None:
        out[~_is_covered(walk.spans, when)] = np.nan
    return out


def _is_covered(spans: NDArray[np.float64], when: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each instant lies between the start and the end of a piece, within the slack."""
    if len(spans) == 1:
        return np.asarray((when >= spans[0, 0] - TIME_SLACK) & (when <= spans[0, 1] + TIME_SLACK))
    piece = np.clip(np.searchsorted(spans[:, 0], when + TIME_SLACK, side="right") - 1, 0, None)
    return np.asarray(
        (when >= spans[piece, 0] - TIME_SLACK) & (when <= spans[piece, 1] + TIME_SLACK)
    )


def synchronised_errors(
    track: Track, walk: Walk, nodes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance in metres between each sample and the walk at the sample's time, shape (n,); NaN where the walk claims nothing.

    Parameters
    ----------
    track : Track
        The samples.
    walk : Walk
        With times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 2.0]), np.array([False]))
    >>> synchronised_errors(Track("a", [0, 1], [[0, 0], [1, 3]]), walk, np.array([[0.0, 0.0], [2.0, 0.0]])).tolist()
    [0.0, 3.0]
    """
    away = positions_at(walk, nodes, track.times) - track.positions
    distances: NDArray[np.float64] = np.sqrt(np.einsum("ij,ij->i", away, away))
    return distances


def measure_errors(
    tracks: Sequence[Track], walks: Sequence[Walk], nodes: NDArray[np.float64]
) -> ErrorSummary:
    """Measure walks against their tracks at every sample, all samples alike.

    Tracks without times are compared at equal shares of the way, at all places of it; their mean counts as often as they have points.

    Parameters
    ----------
    tracks : sequence of Track
        The samples.
    walks : sequence of Walk
        One for each track, in the same order, with times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.
    """
    squares, worst, uncovered = 0.0, 0.0, 0
    for track, walk in zip(tracks, walks, strict=True):
        if not track.timed:
            mean, most = shape_error(track.positions, nodes[walk.nodes])
            squares, worst = squares + len(track) * mean, max(worst, most)
            continue
        errors = synchronised_errors(track, walk, nodes)
        covered = errors[~np.isnan(errors)]
        squares += float(covered @ covered)
        worst = max(worst, float(covered.max(initial=0.0)))
        uncovered += len(errors) - len(covered)
    points = sum(map(len, tracks))
    return ErrorSummary(math.sqrt(squares / max(points - uncovered, 1)), worst, points, uncovered)
