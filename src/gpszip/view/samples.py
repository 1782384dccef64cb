"""The samples of a log beside the walks of an archive: errors, and fewer samples for a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.walks.error import synchronised_errors

if TYPE_CHECKING:
    from gpszip.model import Track, Walk

__all__ = ["Samples", "collect_samples", "thin_samples"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of all tracks of a log, one track after the other, with their errors.

    Parameters
    ----------
    ids : tuple of str
        Names of the tracks.
    timed : tuple of bool
        Whether each track has times.
    walks : int64 array, shape (tracks,)
        Number of each track's walk; -1 where the archive has none.
    offsets : int64 array, shape (tracks + 1,)
        Track i has the samples from ``offsets[i]`` to ``offsets[i + 1]``.
    positions : float64 array, shape (n, d)
        Metres.
    times : float64 array, shape (n,)
        Seconds; metres along a track without times.
    errors : float64 array, shape (n,)
        Synchronised distance to the walk in metres; NaN where the walk claims no position.
    total : int
        Samples of the log, of which these may be a part.
    """

    ids: tuple[str, ...]
    timed: tuple[bool, ...]
    walks: NDArray[np.int64]
    offsets: NDArray[np.int64]
    positions: Floats
    times: Floats
    errors: Floats
    total: int

    @property
    def rmse(self) -> float | None:
        """Root mean square error in metres; None where no sample has an error."""
        known = self.errors[~np.isnan(self.errors)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else None

    @property
    def max_error(self) -> float | None:
        """Largest error in metres; None where no sample has one."""
        known = self.errors[~np.isnan(self.errors)]
        return float(known.max()) if len(known) else None


def collect_samples(tracks: Sequence[Track], walks: Sequence[Walk], nodes: Floats) -> Samples:
    """Put the samples of tracks one after the other, and measure their errors.

    Parameters
    ----------
    tracks : sequence of Track
        The log, on the plane of the walks. A track belongs to the walk of its name.
    walks : sequence of Walk
        The walks of an archive.
    nodes : float64 array, shape (V, d)
        Positions of the nodes in metres.

    Returns
    -------
    Samples
        Tracks without times, and tracks that the archive doesn't have, have no errors.
    """
    numbers = {walk.id: number for number, walk in enumerate(walks)}
    belongs = np.array([numbers.get(track.id, -1) for track in tracks], np.int64)

    # Errors of each track.
    errors = [
        _errors(track, walks[number] if number >= 0 else None, nodes)
        for track, number in zip(tracks, belongs.tolist(), strict=True)
    ]
    offsets = np.concatenate([[0], np.cumsum([len(track) for track in tracks])]).astype(np.int64)
    return Samples(
        ids=tuple(track.id for track in tracks),
        timed=tuple(track.timed for track in tracks),
        walks=belongs,
        offsets=offsets,
        positions=np.concatenate([track.positions for track in tracks]),
        times=np.concatenate([track.times for track in tracks]),
        errors=np.concatenate(errors),
        total=int(offsets[-1]),
    )


def _errors(track: Track, walk: Walk | None, nodes: Floats) -> Floats:
    """Errors of a track's samples, NaN where there are none."""
    if walk is None or walk.times is None or not track.timed:
        return np.full(len(track), np.nan)
    return synchronised_errors(track, walk, nodes)


def thin_samples(samples: Samples, max_samples: int) -> Samples:
    """Keep at most about ``max_samples`` samples: of each run of k, the one with the largest error.

    So the largest errors of a log are in the page whatever it leaves out. Runs don't reach from one
    track into the next; a track keeps one sample at least.

    Parameters
    ----------
    samples : Samples
        All samples.
    max_samples : int
        About how many are kept; at most one more for each track.
    """
    length = -(-len(samples.times) // max_samples)
    if length <= 1:
        return samples

    # Number the runs over all tracks.
    counts = np.diff(samples.offsets)
    runs = -(-counts // length)
    first_run = np.concatenate([[0], np.cumsum(runs)])
    within = np.arange(len(samples.times)) - np.repeat(samples.offsets[:-1], counts)
    run = np.repeat(first_run[:-1], counts) + within // length

    # The first of each run, once runs are sorted by error. A sample without an error comes last.
    errors = np.where(np.isnan(samples.errors), -1.0, samples.errors)
    order = np.lexsort((-errors, run))
    is_first = np.diff(run[order], prepend=-1) > 0
    kept = np.sort(order[is_first])
    return Samples(
        ids=samples.ids,
        timed=samples.timed,
        walks=samples.walks,
        offsets=first_run.astype(np.int64),
        positions=samples.positions[kept],
        times=samples.times[kept],
        errors=samples.errors[kept],
        total=samples.total,
    )
