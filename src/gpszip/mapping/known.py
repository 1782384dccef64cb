"""Walks of further tracks on a map that is there already: its nodes stay, and what lies off it gets nodes of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.coding.past import Past
from gpszip.mapping.connected import THIN
from gpszip.mapping.maximum import mend
from gpszip.mapping.rounds import Outcome, Plan, fit
from gpszip.mapping.slots import lay_slots
from gpszip.model import Executor, Frame, LatticeWalks, Track
from gpszip.model.executor import local, sharing
from gpszip.model.frame import MOST_HALVINGS, quantum

__all__ = ["halvings", "learn_on"]

#: Quanta are halved while they are coarser than these shares of the RMSE allowed; the best lie about 1.2.
_COARSEST = 2.4

#: The mean error with which the walks for a maximum begin, as a share of it.
_RMSE_OF_MAXIMUM = 0.4

#: Radii, in targets, within which first knots take a known node or each other, in the order in which they are tried.
_LEADERS = (1.2, 2.0, 0.0, 0.7)

#: Slots that all starts may take together at each effort, and their most.
_BUDGET = (0, 30_000, 60_000, 90_000, 120_000, 250_000, 500_000, 1_000_000, 2_000_000)
_ROUNDS, _MANY_ROUNDS = 12, 18


@dataclass(frozen=True, eq=False)
class _Search:
    """What all starts of one log have in common."""

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    frame: Frame
    known: Past
    target: float
    maximum: float | None
    rounds: int
    inner: Executor | None = None

    def run(self, leader: float) -> Outcome | None:
        """Learn from one start."""
        unit = quantum(self.frame.space)
        limit = None if self.maximum is None else 0.999 * self.maximum / unit
        plan = Plan(target=0.9995 * self.target / unit, leader=leader, rounds=self.rounds, maximum=limit)
        slots, thin = (lay_slots(self.tracks, self.gaps, self.frame, sparse=sparse) for sparse in (False, True))
        sparse = thin if len(thin.cells) < THIN * len(slots.cells) else None
        return fit(slots, len(self.tracks), plan, thin=sparse, known=self.known, executor=self.inner)


def _run(search: _Search, leader: float) -> Outcome | None:
    return search.run(leader)


def halvings(frame: Frame, rmse: float | None, max_error: float | None) -> int:
    """How often a map's quanta are to be halved for a bound on the error."""
    bound = rmse if rmse is not None else _RMSE_OF_MAXIMUM * (max_error or 0.0)
    times = 0
    while times < min(MOST_HALVINGS, frame.space // 8, frame.time // 8) and quantum(frame.space - 8 * times) > _COARSEST * bound:
        times += 1
    return times


def learn_on(
    known: Past,
    frame: Frame,
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    effort: int = 5,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> LatticeWalks | None:
    """Lay tracks as walks on a known map, within a bound on their error.

    Parameters
    ----------
    known : Past
        The map's walks: its nodes and ways, and how often and how fast they are travelled.
    frame : Frame
        The lattice of the map.
    tracks : sequence of Track
        At least one, on the map's plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse, max_error : float, optional
        Root mean square of the synchronised distance over all samples, or the largest one, in metres; one must be given.
    effort : int, default 5
        From 1 to 9: how many starts are tried.
    executor : Executor, optional
        Where the starts are tried; the result does not depend on it.
    progress : callable, optional
        Told how many starts are done, and of how many.

    Returns
    -------
    LatticeWalks or None
        The map's nodes, then the new ones in the order of their first visit, and one walk for each track. None if no start
        kept the bound.
    """
    target = _RMSE_OF_MAXIMUM * max_error if max_error is not None else rmse or 0.0
    search = _Search(tuple(tracks), tuple(gaps), frame, known, target, max_error, _ROUNDS)
    slots = len(lay_slots(tracks, gaps, frame).cells)
    starts = _LEADERS[: max(1, min(len(_LEADERS), _BUDGET[effort - 1] // slots))]
    if len(starts) > 1:
        search = replace(search, rounds=_MANY_ROUNDS)
    best: Outcome | None = None
    if len(starts) == 1:  # one start spreads its own work
        search, executor = replace(search, inner=local(executor)), None
    with sharing(executor, search) as shared:
        for done, outcome in enumerate(shared.map(_run, starts), 1):
            if outcome is not None and (best is None or outcome.cost < best.cost):
                best = outcome
            if progress is not None:
                progress(done, len(starts))
    if best is None or max_error is None or not best.misses:
        return None if best is None else best.walks
    return _mended(search, best, max_error)


def _mended(search: _Search, outcome: Outcome, max_error: float) -> LatticeWalks | None:
    """What becomes of walks of which a few parts miss the maximum, on the very same lattice."""
    found = mend(search.tracks, search.frame, outcome.walks, max_error, known=search.known.nodes)
    return None if found is None else found[1]
