"""The fixes of segments as arrays, sorted by agent and time."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.live.fix import Fix, Marks
from gpszip.live.journal import Tail, read_segment

__all__ = ["AgentFixes", "read_fixes"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Coordinates of a fix at most.
_MAX_DIMENSION = 3


@dataclass(frozen=True, eq=False)
class AgentFixes:
    """The fixes of one agent in the order of time, one for each time.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, strictly increasing.
    coordinates : float64 array, shape (n, d)
        Latitude and longitude in degrees, or x, y[, z] in metres.
    breaks : bool array, shape (n,)
        Whether the agent did not travel from the fix before to this one.
    """

    times: Floats
    coordinates: Floats
    breaks: Flags

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: Flags | slice) -> AgentFixes:
        """Return some of the fixes."""
        return AgentFixes(self.times[rows], self.coordinates[rows], self.breaks[rows])

    def runs(self, limit: int) -> list[AgentFixes]:
        """Return the fixes from each break to the next; all in one where there are too many."""
        starts = [start for start in np.flatnonzero(self.breaks).tolist() if start > 0]
        if len(starts) >= limit:
            return [self]
        edges = [0, *starts, len(self)]
        return [self.take(slice(*pair)) for pair in pairwise(edges)]


class _Rows:
    """Fixes of one agent as they are read."""

    def __init__(self) -> None:
        self._times, self._accuracies, self._coordinates = array("d"), array("d"), array("d")
        self._breaks = bytearray()
        self._dimension = _MAX_DIMENSION

    def add(self, fix: Fix) -> None:
        """Add a fix; coordinates that not all fixes have are left out of all."""
        self._dimension = min(self._dimension, len(fix.position))
        self._times.append(fix.time)
        self._accuracies.append(np.inf if fix.accuracy is None else fix.accuracy)
        self._breaks.append(Marks.BREAK in fix.quality)
        self._coordinates.extend((*fix.position, 0.0)[:_MAX_DIMENSION])

    def sorted(self) -> AgentFixes:
        """Return the fixes in order, of those at one time the most accurate, or else the first."""
        times = np.frombuffer(self._times)
        order = np.lexsort([np.arange(len(times)), np.frombuffer(self._accuracies), times])
        coordinates = np.frombuffer(self._coordinates).reshape(-1, _MAX_DIMENSION)[
            :, : self._dimension
        ]
        times = times[order]
        is_first = np.append(True, np.diff(times) > 0)
        breaks = np.frombuffer(self._breaks, np.bool_)[order]
        return AgentFixes(times[is_first], coordinates[order][is_first], breaks[is_first])


def read_fixes(paths: Sequence[Path], tail: Tail) -> tuple[dict[str, AgentFixes], bool]:
    """Read segments.

    Parameters
    ----------
    paths : sequence of Path
        The segments.
    tail : Tail
        Takes how many records are damaged.

    Returns
    -------
    dict of str to AgentFixes
        The fixes by agent, in the order of their names.
    bool
        Whether positions are in degrees.
    """
    rows: dict[str, _Rows] = {}
    geographic = True
    for fix in _read_all(paths, tail):
        if fix.agent not in rows:
            rows[fix.agent] = _Rows()
        rows[fix.agent].add(fix)
        geographic = fix.geographic
    return {agent: rows[agent].sorted() for agent in sorted(rows)}, geographic


def _read_all(paths: Sequence[Path], tail: Tail) -> Iterable[Fix]:
    for path in paths:
        own = Tail()
        yield from read_segment(path, own)
        tail.damaged += own.damaged
