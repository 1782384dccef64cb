"""Walks of further tracks on a known map: its nodes stay, and new nodes come where it has none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode
from gpszip.mapping.local_search import WORK_BY_EFFORT, improve_walks, select_best_outcomes
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import (
    LOCAL_MAX_ERROR_AIM,
    MAX_ERROR_AIM,
    RMSE_AIM,
    Plan,
    is_dense,
)
from gpszip.mapping.rounds import Outcome, fit
from gpszip.mapping.search import RMSE_PER_MAX_ERROR
from gpszip.mapping.time_grid import build_time_grid, count_slots, sparsify
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.model.grid import MAX_REFINEMENTS, step_size
from gpszip.run.executor import Executor, local_executor, share_value

__all__ = ["learn_on", "needed_refinements"]

#: A grid is refined while its space step is larger than this many RMSE allowed; the best steps are
#: about 1.2.
_MAX_STEP_PER_RMSE = 2.4

#: Step indices of an octave, by which a refinement lowers them.
_OCTAVE = 8


class _Start(NamedTuple):
    """Start of a search.

    ``leader_radius`` is the radius in targets within which the first knots take a known node or
    share one, ``window`` the number of knots of a window.
    """

    leader_radius: float
    window: int


#: Starts in the order in which they are tried.
_STARTS = tuple(
    _Start(leader_radius, window)
    for window in (24, 12, 40)
    for leader_radius in (1.2, 2.0, 0.0, 0.7)
)

#: Slots that all starts of one log may take together, at efforts 1 to 9.
_SLOTS_BY_EFFORT = (0, 4_000, 8_000, 14_000, 25_000, 60_000, 150_000, 500_000, 2_000_000)

#: Largest number of starts, at efforts 1 to 9.
_MAX_STARTS = (1, 3, 4, 4, 8, 8, 12, 12, 12)

#: Effort at which walks of few rounds do on a dense log.
_FASTEST_EFFORT = 1

#: Rounds of the only start of a large log.
_SINGLE_START_ROUNDS = 12
#: Rounds of each of several starts.
_ROUNDS = 18


@dataclass(frozen=True, eq=False)
class _Search:
    """What all starts of one log share.

    Parameters
    ----------
    tracks, gaps : tuples
        The log.
    grid : QuantisationGrid
        The grid of the map.
    prior : Prior
        The map's walks.
    target : float
        Root mean square error to reach, in metres.
    max_error : float, optional
        Largest distance of a sample, in metres.
    rounds : int
        Rounds of each search.
    work : int
        Knots that a local search may encode.
    is_fastest : bool
        Walks of few rounds do on a dense log.
    inner : Executor, optional
        Spreads the work of one search.
    """

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    grid: QuantisationGrid
    prior: Prior
    target: float
    max_error: float | None
    rounds: int
    work: int
    is_fastest: bool
    inner: Executor | None = None

    def run(self, start: _Start) -> Outcome | None:
        """Learn walks from one start."""
        # Aim a little below the bounds, since rounding adds error; plans count in grid steps.
        unit = step_size(self.grid.space)
        plan = Plan(
            target=RMSE_AIM * self.target / unit,
            leader_radius=start.leader_radius,
            window=start.window,
            rounds=self.rounds,
            maximum=None if self.max_error is None else MAX_ERROR_AIM * self.max_error / unit,
        )
        time_grid = build_time_grid(self.tracks, self.gaps, self.grid)
        if self.is_fastest and is_dense(len(time_grid.times), len(time_grid.time_steps)):
            plan = plan.hurried()
        return fit(
            time_grid,
            len(self.tracks),
            plan,
            sparse_grid=sparsify(time_grid),
            prior=self.prior,
            executor=self.inner,
        )

    def improve_walks(self, outcome: Outcome) -> Outcome | None:
        """Bring an outcome within the maximum, and improve it by local search.

        None if the maximum can't be kept.
        """
        # Bring segments that miss the maximum within it.
        unit, maximum = step_size(self.grid.space), None
        if self.max_error is not None:
            maximum = LOCAL_MAX_ERROR_AIM * self.max_error / unit
            if outcome.misses:
                changed = enforce_max_error(
                    self.tracks, self.grid, outcome.walks, self.max_error, known=self.prior.nodes
                )
                if changed is None:
                    return None
                _, walks = changed
                outcome = replace(
                    outcome, walks=walks, size=len(encode(walks, self.prior)), misses=0
                )

        # Search locally at the exact target, since the search measures the rounded walks.
        return improve_walks(
            build_time_grid(self.tracks, self.gaps, self.grid),
            outcome,
            target=self.target / unit,
            maximum=maximum,
            prior=self.prior,
            work=self.work,
        )


def _run(search: _Search, start: _Start) -> Outcome | None:
    return search.run(start)


def _improve_walks(search: _Search, outcome: Outcome) -> Outcome | None:
    return search.improve_walks(outcome)


def needed_refinements(grid: QuantisationGrid, rmse: float | None, max_error: float | None) -> int:
    """How often a map's step sizes are to be halved for a bound on the error.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid of the map.
    rmse, max_error : float, optional
        Bounds in metres.

    Returns
    -------
    int
        At most :data:`gpszip.model.grid.MAX_REFINEMENTS`.
    """
    bound = rmse if rmse is not None else RMSE_PER_MAX_ERROR * (max_error or 0.0)
    refinements = 0
    while (
        refinements < min(MAX_REFINEMENTS, grid.space // _OCTAVE, grid.time // _OCTAVE)
        and step_size(grid.space - _OCTAVE * refinements) > _MAX_STEP_PER_RMSE * bound
    ):
        refinements += 1
    return refinements


def learn_on(
    prior: Prior,
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
    """Learn walks of tracks on a known map, within a bound on their error.

    Parameters
    ----------
    prior : Prior
        The map's walks: its nodes and edges, and how often and how fast they are travelled.
    grid : QuantisationGrid
        The grid of the map.
    tracks : sequence of Track
        At least one, on the map's plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse, max_error : float, optional
        Root mean square of the synchronised distance over all samples, and the largest one, in
        metres; at least one must be given.
    effort : int, default 5
        From 1 to 9: how many starts are tried.
    share : float, default 1
        Share of these tracks in the work of this effort, where they are a fraction of a log.
    executor : Executor, optional
        Runs the starts; the result does not depend on it.
    progress : callable, optional
        Called with the number of starts done, and the number of all.

    Returns
    -------
    GridWalks or None
        The map's nodes, then the new ones in the order of their first visit, and one walk for each
        track. None if no start kept the bound.
    """
    # Of two bounds, aim at the tighter one.
    if rmse is not None and max_error is not None and rmse < RMSE_PER_MAX_ERROR * max_error:
        # Few samples are beyond the maximum: it takes few knots to bring them back.
        loose = learn_on(
            prior,
            grid,
            tracks,
            gaps,
            rmse=rmse,
            effort=effort,
            share=share,
            executor=executor,
            progress=progress,
        )
        if loose is None:
            return None
        changed = enforce_max_error(tracks, grid, loose, max_error, known=prior.nodes)
        return None if changed is None else changed[1]

    # The fewer slots the tracks have, the more starts.
    slots = count_slots(tracks, gaps, grid)
    starts = _STARTS[
        : max(1, min(_MAX_STARTS[effort - 1], int(share * _SLOTS_BY_EFFORT[effort - 1]) // slots))
    ]
    search = _Search(
        tuple(tracks),
        tuple(gaps),
        grid,
        prior,
        RMSE_PER_MAX_ERROR * max_error if max_error is not None else rmse or 0.0,
        max_error,
        rounds=_ROUNDS if len(starts) > 1 else _SINGLE_START_ROUNDS,
        work=int(share * WORK_BY_EFFORT[effort - 1]),
        is_fastest=effort == _FASTEST_EFFORT,
    )

    # One start spreads its own work over the executor.
    if len(starts) == 1:
        search, executor = replace(search, inner=local_executor(executor)), None

    # Share the search with the executor's workers once for both passes.
    outcomes: list[Outcome] = []
    with share_value(executor, search) as shared:
        # Learn walks from each start.
        for done, outcome in enumerate(shared.map(_run, starts), 1):
            if outcome is not None:
                outcomes.append(outcome)
            if progress is not None:
                progress(done, len(starts))

        # Improve the best ones.
        improved = [
            outcome
            for outcome in shared.map(_improve_walks, select_best_outcomes(outcomes, effort))
            if outcome is not None
        ]
    return min(improved, key=lambda outcome: outcome.size).walks if improved else None
