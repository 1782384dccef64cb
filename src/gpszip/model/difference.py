"""How two archives or logs differ: what :func:`gpszip.diff` returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Difference", "Distances", "FarPlace", "TrackDifference"]


@dataclass(frozen=True)
class Distances:
    """Synchronised distances in metres: of the two positions at one time.

    Parameters
    ----------
    mean, rmse, percentile_95, maximum : float
        Mean, root mean square, the distance that 95 % do not exceed, and the largest one. NaN where
        nothing could be compared.
    compared : int
        Number of times that were compared.
    """

    mean: float
    rmse: float
    percentile_95: float
    maximum: float
    compared: int


@dataclass(frozen=True)
class TrackDifference:
    """How two tracks of one id differ.

    Parameters
    ----------
    id : str
        Name of the track.
    compared_at : {"samples", "times", "knots", None}
        Where distances were taken: at the samples of the log against an archive, at the times of
        both logs, or over all time between two archives, whose positions are linear between knots.
        None where a track has no times.
    distances : Distances
        Synchronised distances.
    at : float or None
        Time of the largest one, in seconds.
    hausdorff, frechet, discrete_frechet : float
        Distances of the two lines in metres. Gaps are bridged by straight lines.
    within, discrete_within : float
        Metres by which the first two, and the last, may be off: 0.1 mm, or what thinning of very
        long lines moved.
    lengths : (float, float)
        Metres travelled by the first and the second, without gaps.
    durations : (float, float)
        Seconds of travel of the first and the second, without gaps.
    unmatched : (int, int)
        Samples of the first and of the second, if it is a log, at which the other has no position.
    alone : (tuple of (float, float), tuple of (float, float))
        Time ranges in seconds in which only the first, and only the second, has travel.
    """

    id: str
    compared_at: str | None
    distances: Distances
    at: float | None
    hausdorff: float
    frechet: float
    discrete_frechet: float
    within: float
    discrete_within: float
    lengths: tuple[float, float]
    durations: tuple[float, float]
    unmatched: tuple[int, int]
    alone: tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]


@dataclass(frozen=True)
class FarPlace:
    """A place where two tracks are far apart.

    Parameters
    ----------
    id : str
        Name of the track.
    time : float
        Seconds.
    distance : float
        Metres.
    first, second : tuple of float
        Both positions: latitude and longitude, or x, y[, z].
    """

    id: str
    time: float
    distance: float
    first: tuple[float, ...]
    second: tuple[float, ...]


@dataclass(frozen=True)
class Difference:
    """How two archives or logs differ.

    Parameters
    ----------
    tracks : sequence of TrackDifference
        Tracks that both have, in the order of the first.
    total : Distances
        Of all these tracks together.
    missing : (tuple of str, tuple of str)
        Tracks that the first, and that the second lacks.
    worst : sequence of FarPlace
        Places where the distance is largest before and after, the largest first.
    geographic : bool
        Whether positions are latitudes and longitudes.
    """

    tracks: Sequence[TrackDifference]
    total: Distances
    missing: tuple[tuple[str, ...], tuple[str, ...]]
    worst: Sequence[FarPlace]
    geographic: bool
