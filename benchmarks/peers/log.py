"""A log as plain arrays: the samples of all tracks behind one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Seconds between two tracks on the common clock; longer than any time step.
SEPARATION = 1e6

#: Parts of a second in which the times of logs are read.
MILLISECONDS = 1000


@dataclass(frozen=True)
class Log:
    """Samples of all tracks.

    Parameters
    ----------
    names : list of str
        Names of the tracks.
    starts : float64 array, shape (tracks,)
        Time of the first sample of each track.
    firsts : int64 array, shape (tracks + 1,)
        Index of the first sample of each track, and the number of samples.
    clock : float64 array, shape (n,)
        Times of the samples on a common clock, on which the tracks follow one another.
    x, y : float64 array, shape (n,)
        Positions in metres.
    """

    names: list[str]
    starts: Floats
    firsts: Integers
    clock: Floats
    x: Floats
    y: Floats

    @property
    def clock_starts(self) -> Floats:
        """Time of the first sample of each track on the common clock."""
        return self.clock[self.firsts[:-1]]


def read_log(path: str) -> Log:
    """Read the columns ``track_id,t,x,y`` of a CSV file whose tracks follow one another."""
    kinds = {"track_id": pa.string(), "t": pa.float64(), "x": pa.float64(), "y": pa.float64()}
    # Arrays of our own: kernels are compiled once more for arrays that can't be written.
    options = pyarrow.csv.ConvertOptions(column_types=kinds, auto_dict_encode=True)
    table = pyarrow.csv.read_csv(path, convert_options=options)
    ids = table["track_id"].combine_chunks().dictionary_encode()
    t, x, y = (np.array(table[name]) for name in "txy")
    return make_log(ids.dictionary.to_pylist(), ids.indices.to_numpy(), t, x, y)


def make_log(names: list[str], tracks: Integers, t: Floats, x: Floats, y: Floats) -> Log:
    """Make a log of the track, the time and the position of each sample."""
    firsts = np.r_[0, np.flatnonzero(np.diff(tracks)) + 1, len(t)]
    starts, ends = t[firsts[:-1]], t[firsts[1:] - 1]
    shifts = np.r_[0.0, np.cumsum(ends - starts + SEPARATION)[:-1]] - starts
    return Log(names, starts, firsts, t + shifts.repeat(np.diff(firsts)), x, y)


def find_period(log: Log) -> float:
    """Largest time of which all times since the starts are multiples, in whole milliseconds."""
    since_start = log.clock - log.clock_starts.repeat(np.diff(log.firsts))
    ticks = np.round(since_start * MILLISECONDS).astype(np.int64)
    return max(int(np.gcd.reduce(ticks)), 1) / MILLISECONDS


def find_speed(log: Log, kept: Integers, quantile: float = 0.9) -> float:
    """Quantile of the speeds between successive samples of those that are kept."""
    tracks = np.searchsorted(log.firsts, kept, side="right")
    within = np.diff(tracks) == 0
    if not within.any():
        return 1.0
    distances = np.hypot(np.diff(log.x[kept]), np.diff(log.y[kept]))[within]
    return max(float(np.quantile(distances / np.diff(log.clock[kept])[within], quantile)), 1e-6)
