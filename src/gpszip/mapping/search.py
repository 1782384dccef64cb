"""The connected map of a log: quanta and starts are tried, the smallest archive that keeps the bound wins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import encode
from gpszip.errors import OptionError
from gpszip.mapping.local_search import (
    WORK_BY_EFFORT,
    improve_walks,
    is_worthwhile,
    select_best_outcomes,
)
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome, fit
from gpszip.mapping.time_grid import build_time_grid, count_slots, sparsify
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.model.grid import STEP_SIZES, step_index, step_size
from gpszip.run.executor import Executor, SharedValue, local_executor, share_value

__all__ = ["RMSE_PER_MAX_ERROR", "SLOTS_BY_EFFORT", "learn_map", "suggest_time_step"]

_TrialResult = tuple[QuantisationGrid, Outcome | None]

#: The mean error with which the walks for a maximum begin, as a share of it.
RMSE_PER_MAX_ERROR = 0.4

#: Indices of quanta from one to its double: every eighth is that of 1, 2, 4 ... or 1/2, 1/4 ... seconds.
_OCTAVE = 8

#: Size that stands for a bound not kept.
_NEVER = 1 << 62


@dataclass(frozen=True)
class _Trial:
    """Quanta and start of one search: ``space`` in targets, ``time`` in space quanta at the log's mean speed, leader radius in targets."""

    space: float
    time: float
    leader_radius: float


#: Where the search for quanta starts, and the factors by which it steps.
_FIRST = _Trial(1.2, 2.0, 1.2)
_STEPS = ((1 / 1.5, 1 / 1.5), (1.0, 1 / 1.6), (1.0, 1.6), (1 / 1.4, 1.0), (1.4, 1.0))

#: What is tried around the quanta found: factors on space and time, and leader radii, in this order.
_STARTS = tuple(
    (space, time, leader_radius)
    for space, time in (
        (1.0, 1.0),
        (0.87, 1.0),
        (1.0, 1.2),
        (0.87, 1.2),
        (1.15, 1.0),
        (1.15, 1.2),
        (1.0, 0.83),
        (0.87, 0.83),
    )
    for leader_radius in (1.2, 0.0, 2.0, 0.7)
)

#: Slots that all starts of one log may take together, at each effort, and the most starts.
SLOTS_BY_EFFORT = (0, 30_000, 60_000, 90_000, 120_000, 250_000, 500_000, 1_000_000, 2_000_000)
_MOST_STARTS = (1, 3, 6, 9, 16, 20, 24, 28, 32)

#: Samples of the excerpt on which quanta are chosen, the slots that it may have, and samples that it has in any case.
_SUBSAMPLE, _SUBSAMPLE_SLOTS, _MIN_SUBSAMPLE = 12_000, 40_000, 4000

#: Rounds of a search that only compares quanta, on the whole log or an excerpt, of the only start of a large log, and of each
#: start of a small one.
_ROUGH_ROUNDS, _HASTY_ROUNDS, _ROUNDS, _MANY_ROUNDS = 8, 6, 12, 24
#: Rounds that may follow on a large log.
_EXTRA = 5
#: On large logs: bits beyond a slot's cheapest node above which another isn't looked at, and the excess of the error above which
#: quanta are given up that hardly bring it down.
_BEAM, _HOPELESS = 6.0, 1.2


def learn_map(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    effort: int = 5,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[QuantisationGrid, GridWalks] | None:
    """Learn a connected map and the tracks' walks on it whose error is within a bound.

    Quanta are chosen by a pattern search on an excerpt, then maps are learnt from several starts.

    Parameters
    ----------
    tracks : sequence of Track
        At least one, all of the same dimension and on the same plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse : float, optional
        Root mean square of the synchronised distance over all samples of all tracks, in metres.
    max_error : float, optional
        Largest distance of any sample, in metres. At least one of the two bounds must be given.
    effort : int, default 5
        From 1 (one start) to 9 (up to 32): how many slots all starts together may take.
    executor : Executor, optional
        Where the searches run; their results do not depend on it.
    progress : callable, optional
        Told how many searches are done, and of how many.

    Returns
    -------
    (Frame, LatticeWalks) or None
        The smallest that was found; None if none kept the bound. Of two bounds the looser one may be missed by little where the
        tighter one is a maximum.
    """
    if rmse is None and max_error is None:
        raise OptionError("a map needs a bound on its error: give rmse or max_error")
    if rmse is not None and max_error is not None:
        if rmse < RMSE_PER_MAX_ERROR * max_error:
            # few samples are beyond the maximum: it takes few knots to bring them back
            loose = learn_map(
                tracks, gaps, rmse=rmse, effort=effort, executor=executor, progress=progress
            )
            return None if loose is None else enforce_max_error(tracks, *loose, max_error)
        rmse = None
    search = _Search(
        tuple(tracks),
        tuple(gaps),
        RMSE_PER_MAX_ERROR * max_error if max_error is not None else rmse or 0.0,
        max_error,
    )
    # an excerpt is done with before processes would have started
    with share_value(local_executor(executor), _subsample(search)) as subsample:
        chosen = _choose_steps(subsample)
    trials = _list_trials(chosen, effort, search.count_slots(chosen))
    search = replace(search, work=WORK_BY_EFFORT[effort - 1])
    if len(trials) == 1:  # one search spreads its own work
        alone = replace(
            search,
            rounds=_ROUNDS,
            hasty=True,
            extra_rounds=_EXTRA if max_error is None else 0,
            inner=local_executor(executor),
        )
        found = _collect_outcomes([alone.run(trials[0])], 1, progress)
        return _select_smallest(
            alone.improve_walks(one) for one in _select_finalists(found, effort)
        )
    with share_value(executor, replace(search, rounds=_MANY_ROUNDS)) as whole:
        found = _collect_outcomes(whole.map(_run, trials), len(trials), progress)
        return _select_smallest(whole.map(_polish, _select_finalists(found, effort)))


def _collect_outcomes(
    results: Iterable[_TrialResult], count: int, progress: Callable[[int, int], None] | None
) -> list[tuple[QuantisationGrid, Outcome]]:
    """Return what searches found, telling how far they are."""
    found: list[tuple[QuantisationGrid, Outcome]] = []
    for done, (grid, outcome) in enumerate(results, 1):
        if outcome is not None:
            found.append((grid, outcome))
        if progress is not None:
            progress(done, count)
    return found


def _select_finalists(
    found: list[tuple[QuantisationGrid, Outcome]], effort: int
) -> list[tuple[QuantisationGrid, Outcome]]:
    """Return the outcomes that are to be polished."""
    frames = {id(outcome): grid for grid, outcome in found}
    return [
        (frames[id(outcome)], outcome)
        for outcome in select_best_outcomes((outcome for _, outcome in found), effort)
    ]


def _select_smallest(
    found: Iterable[tuple[QuantisationGrid, Outcome]],
) -> tuple[QuantisationGrid, GridWalks] | None:
    best = min(found, key=lambda one: one[1].cost, default=None)
    return None if best is None else (best[0], best[1].walks)


@dataclass(frozen=True)
class _Search:
    """What all searches of one log have in common."""

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    rmse: float
    max_error: float | None = None
    rounds: int = 0
    rough: bool = False
    hasty: bool = False
    extra_rounds: int = 0
    inner: Executor | None = None
    work: int = 0

    @property
    def samples(self) -> int:
        return sum(len(track) for track in self.tracks)

    @cached_property
    def speed(self) -> float:
        return _mean_speed(self.tracks, self.gaps, self.rmse)

    @cached_property
    def ticking(self) -> bool:
        """Whether all samples are at whole seconds."""
        return all(bool((track.times == np.rint(track.times)).all()) for track in self.tracks)

    def grid(self, trial: _Trial) -> QuantisationGrid:
        grid = _build_grid(self.tracks, self.rmse, self.speed, trial)
        if self.max_error is None or not self.ticking:
            return grid
        # a knot at the very time of a sample comes as near to it as it likes, whatever lies beside
        return replace(
            grid, time=_OCTAVE * min(round(grid.time / _OCTAVE), STEP_SIZES // _OCTAVE - 1)
        )

    def run(self, trial: _Trial) -> _TrialResult:
        grid = self.grid(trial)
        maximum = None if self.max_error is None else 0.999 * self.max_error / step_size(grid.space)
        plan = Plan(
            target=0.9995 * self.rmse / step_size(grid.space), leader_radius=trial.leader_radius, rounds=self.rounds, extra_rounds=self.extra_rounds,
            maximum=maximum, give_up_ratio=_HOPELESS if self.hasty and self.rough else math.inf, beam=_BEAM if self.hasty else math.inf,
            encode_alternate_rounds=self.hasty and self.max_error is None,
        )  # fmt: skip
        slots = build_time_grid(self.tracks, self.gaps, grid, sparse=self.rough)
        outcome = fit(
            slots,
            len(self.tracks),
            plan,
            sparse_grid=None if self.rough else sparsify(slots),
            executor=self.inner,
        )
        if self.rough:
            return grid, outcome
        return (
            (grid, outcome)
            if outcome is None or self.max_error is None
            else self._mended(grid, outcome)
        )

    def _mended(self, grid: QuantisationGrid, outcome: Outcome) -> _TrialResult:
        """What becomes of walks of which a few parts miss the maximum."""
        mended = (
            None
            if self.max_error is None
            else enforce_max_error(self.tracks, grid, outcome.walks, self.max_error)
        )
        if mended is None:
            return grid, None
        return mended[0], replace(outcome, walks=mended[1], size=len(encode(mended[1])), misses=0)

    def improve_walks(
        self, found: tuple[QuantisationGrid, Outcome]
    ) -> tuple[QuantisationGrid, Outcome]:
        """What becomes of an outcome by single changes."""
        grid, outcome = found
        if not is_worthwhile(outcome, self.work):
            return found
        unit = step_size(grid.space)
        maximum = None if self.max_error is None else (1 - 1e-6) * self.max_error / unit
        slots = build_time_grid(self.tracks, self.gaps, grid)
        return grid, improve_walks(
            slots, outcome, target=self.rmse / unit, maximum=maximum, work=self.work
        )

    def count_slots(self, trial: _Trial) -> int:
        return count_slots(self.tracks, self.gaps, self.grid(trial))

    def subsample(self, samples: int) -> _Search:
        """Whole tracks, evenly chosen, or the start of one, of about so many samples in all."""
        if self.samples <= samples:
            return replace(self, rounds=_ROUGH_ROUNDS, rough=True)
        stride = max(1, min(len(self.tracks), self.samples // samples))
        tracks, gaps, left = [], [], samples
        for track, gap in list(zip(self.tracks, self.gaps, strict=True))[::stride]:
            count = min(len(track), left)
            if count > 0:
                weights = None if track.weights is None else track.weights[:count]
                tracks.append(
                    Track(
                        track.id,
                        track.times[:count],
                        track.positions[:count],
                        weights,
                        plane=track.plane,
                    )
                )
                gaps.append(gap[: count - 1])
                left -= count
        return replace(
            self,
            tracks=tuple(tracks),
            gaps=tuple(gaps),
            rounds=_HASTY_ROUNDS,
            rough=True,
            hasty=True,
        )


def _subsample(search: _Search) -> _Search:
    """Return a search of a part of the log that takes little time."""
    subsample = search.subsample(_SUBSAMPLE)
    slots = len(
        build_time_grid(
            subsample.tracks, subsample.gaps, subsample.grid(_FIRST), sparse=True
        ).time_steps
    )
    return (
        search.subsample(max(_SUBSAMPLE * _SUBSAMPLE_SLOTS // slots, _MIN_SUBSAMPLE))
        if slots > _SUBSAMPLE_SLOTS
        else subsample
    )


def _run(search: _Search, trial: _Trial) -> _TrialResult:
    return search.run(trial)


def _polish(
    search: _Search, found: tuple[QuantisationGrid, Outcome]
) -> tuple[QuantisationGrid, Outcome]:
    return search.improve_walks(found)


def _choose_steps(search: SharedValue[_Search]) -> _Trial:
    """Walk downhill on the coded size from the usual quanta."""
    sizes: dict[_Trial, float] = {}

    def measure(trials: list[_Trial]) -> None:
        new = [trial for trial in trials if trial not in sizes]
        for trial, (_, outcome) in zip(new, search.map(_run, new), strict=True):
            sizes[trial] = _NEVER if outcome is None else outcome.cost

    best = _FIRST
    for _ in range(4):
        around = [_Trial(best.space * s, best.time * t, best.leader_radius) for s, t in _STEPS]
        measure([best, *around])
        nearer = min(around, key=sizes.__getitem__)
        if sizes[nearer] >= sizes[best] and sizes[best] < _NEVER:
            break
        best = nearer if sizes[nearer] < _NEVER else around[0]
    return best


def _list_trials(chosen: _Trial, effort: int, slots: int) -> list[_Trial]:
    """Starts around the chosen quanta: the smaller the log, the more of them."""
    count = max(1, min(_MOST_STARTS[effort - 1], SLOTS_BY_EFFORT[effort - 1] // slots))
    return [
        _Trial(chosen.space * space, chosen.time * time, leader_radius)
        for space, time, leader_radius in _STARTS[:count]
    ]


def _build_grid(
    tracks: Sequence[Track], rmse: float, speed: float, trial: _Trial
) -> QuantisationGrid:
    space = step_index(1.04 * trial.space * rmse)
    time = step_index(1.04 * trial.time * step_size(space) / speed)
    first = min(tracks, key=lambda track: float(track.times[0]))
    # whole metres and seconds take fewer bytes in the head than they cost in the first place
    origin = tuple(1000 * math.floor(float(x) + 1e-6) for x in first.positions[0])
    return QuantisationGrid(
        origin, 1000 * math.floor(float(first.times[0]) + 1e-6), space, time, first.plane
    )


def suggest_time_step(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], space: int
) -> float:
    """Time step in seconds with which the search for quanta would begin: about that in which tracks go two space quanta."""
    size = step_size(space)
    return _FIRST.time * size / _mean_speed(tracks, gaps, size)


def _mean_speed(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], scale: float) -> float:
    """Way per second outside gaps, in metres, where only steps of at least ``scale`` count as way, so that noise does not."""
    way = span = 0.0
    for track, gap in zip(tracks, gaps, strict=True):
        span += float(np.diff(track.times)[~gap].sum())
        way += _travelled_distance(track.positions, gap, scale)
    return max(way, 1e-3 * scale) / max(span, 1e-3)


def _travelled_distance(
    positions: NDArray[np.float64], gap: NDArray[np.bool_], scale: float
) -> float:
    """Length of the way in steps of at least ``scale``, by decimating until steps are that long."""
    stride = 1
    while True:
        step = np.sqrt((np.diff(positions[::stride], axis=0) ** 2).sum(axis=1))
        jumps = np.add.reduceat(gap, np.arange(0, len(gap), stride)) > 0 if len(gap) else gap
        step = step[~jumps[: len(step)]]
        moving = step[step > 0.2 * scale]
        if (len(moving) >= 20 and np.median(moving) >= scale) or stride > len(positions) // 20:
            return float(step[step > 0.5 * scale].sum())
        stride *= 2
