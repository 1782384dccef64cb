"""Walks of further tracks on a map that is there already: its nodes stay, and what lies off it gets nodes of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode
from gpszip.mapping.local_search import WORK_BY_EFFORT, improve_walks, select_best_outcomes
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome, fit
from gpszip.mapping.search import RMSE_PER_MAX_ERROR, SLOTS_BY_EFFORT
from gpszip.mapping.time_grid import build_time_grid, count_slots, sparsify
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.model.grid import MAX_REFINEMENTS, step_size
from gpszip.run.executor import Executor, local_executor, share_value

__all__ = ["learn_on", "needed_refinements"]

#: Quanta are halved while they are coarser than these shares of the RMSE allowed; the best lie about 1.2.
_COARSEST = 2.4

#: Starts in the order in which they are tried: the radius, in targets, within which first knots take a known node or each other, and the
#: knots of a window.
_STARTS = tuple(
    (leader_radius, window) for window in (24, 12, 40) for leader_radius in (1.2, 2.0, 0.0, 0.7)
)

#: The most starts at each effort.
_MOST_STARTS = (1, 3, 4, 4, 8, 8, 12, 12, 12)

#: Rounds of the only start of a large log, and of each of several.
_ROUNDS, _MANY_ROUNDS = 12, 18


@dataclass(frozen=True, eq=False)
class _Search:
    """What all starts of one log have in common."""

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    grid: QuantisationGrid
    known: Prior
    target: float
    maximum: float | None
    rounds: int
    inner: Executor | None = None
    work: int = 0

    def run(self, start: tuple[float, int]) -> Outcome | None:
        """Learn from one start."""
        unit = step_size(self.grid.space)
        limit = None if self.maximum is None else 0.999 * self.maximum / unit
        plan = Plan(
            target=0.9995 * self.target / unit,
            leader_radius=start[0],
            window=start[1],
            rounds=self.rounds,
            maximum=limit,
        )
        slots = build_time_grid(self.tracks, self.gaps, self.grid)
        return fit(
            slots,
            len(self.tracks),
            plan,
            sparse_grid=sparsify(slots),
            known=self.known,
            executor=self.inner,
        )

    def improve_walks(self, outcome: Outcome) -> Outcome | None:
        """What becomes of an outcome by mending and single changes; None if it can't be mended."""
        unit, maximum = step_size(self.grid.space), None
        if self.maximum is not None:
            maximum = (1 - 1e-6) * self.maximum / unit
            if outcome.misses:
                mended = enforce_max_error(
                    self.tracks, self.grid, outcome.walks, self.maximum, known=self.known.nodes
                )
                if mended is None:
                    return None
                outcome = replace(
                    outcome, walks=mended[1], size=len(encode(mended[1], self.known)), misses=0
                )
        slots = build_time_grid(self.tracks, self.gaps, self.grid)
        return improve_walks(
            slots,
            outcome,
            target=self.target / unit,
            maximum=maximum,
            known=self.known,
            work=self.work,
        )


def _run(search: _Search, start: tuple[float, int]) -> Outcome | None:
    return search.run(start)


def _polish(search: _Search, outcome: Outcome) -> Outcome | None:
    return search.improve_walks(outcome)


def needed_refinements(grid: QuantisationGrid, rmse: float | None, max_error: float | None) -> int:
    """How often a map's quanta are to be halved for a bound on the error."""
    bound = rmse if rmse is not None else RMSE_PER_MAX_ERROR * (max_error or 0.0)
    times = 0
    while (
        times < min(MAX_REFINEMENTS, grid.space // 8, grid.time // 8)
        and step_size(grid.space - 8 * times) > _COARSEST * bound
    ):
        times += 1
    return times


def learn_on(
    known: Prior,
    grid: QuantisationGrid,
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    effort: int = 5,
    share: float = 1.0,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> GridWalks | None:
    """Lay tracks as walks on a known map, within a bound on their error.

    Parameters
    ----------
    known : Past
        The map's walks: its nodes and ways, and how often and how fast they are travelled.
    grid : Frame
        The lattice of the map.
    tracks : sequence of Track
        At least one, on the map's plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse, max_error : float, optional
        Root mean square of the synchronised distance over all samples, and the largest one, in metres; at least one must be given.
    effort : int, default 5
        From 1 to 9: how many starts are tried.
    share : float, default 1
        Share that these tracks have in the work of this effort, where they are only a part of a log.
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
    if rmse is not None and max_error is not None and rmse < RMSE_PER_MAX_ERROR * max_error:
        # few samples are beyond the maximum: it takes few knots to bring them back
        laid = learn_on(
            known,
            grid,
            tracks,
            gaps,
            rmse=rmse,
            effort=effort,
            share=share,
            executor=executor,
            progress=progress,
        )
        mended = (
            None
            if laid is None
            else enforce_max_error(tracks, grid, laid, max_error, known=known.nodes)
        )
        return None if mended is None else mended[1]
    target = RMSE_PER_MAX_ERROR * max_error if max_error is not None else rmse or 0.0
    search = _Search(tuple(tracks), tuple(gaps), grid, known, target, max_error, _ROUNDS)
    slots = count_slots(tracks, gaps, grid)
    starts = _STARTS[
        : max(1, min(_MOST_STARTS[effort - 1], int(share * SLOTS_BY_EFFORT[effort - 1]) // slots))
    ]
    if len(starts) > 1:
        search = replace(search, rounds=_MANY_ROUNDS)
    search = replace(search, work=int(share * WORK_BY_EFFORT[effort - 1]))
    if len(starts) == 1:  # one start spreads its own work
        search, executor = replace(search, inner=local_executor(executor)), None
    found: list[Outcome] = []
    with share_value(executor, search) as shared:
        for done, outcome in enumerate(shared.map(_run, starts), 1):
            if outcome is not None:
                found.append(outcome)
            if progress is not None:
                progress(done, len(starts))
        polished = [
            outcome
            for outcome in shared.map(_polish, select_best_outcomes(found, effort))
            if outcome is not None
        ]
    return min(polished, key=lambda outcome: outcome.size).walks if polished else None
