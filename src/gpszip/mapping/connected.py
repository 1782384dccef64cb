"""The connected map of a log: quanta and starts are tried, the smallest archive that keeps the bound wins."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.rounds import Outcome, Plan, fit
from gpszip.mapping.slots import Slots, lay_slots
from gpszip.model import Executor, Frame, LatticeWalks, Track
from gpszip.model.frame import quantum, quantum_index

__all__ = ["learn"]


@dataclass(frozen=True)
class _Trial:
    """Quanta and start of one search: ``space`` in targets, ``time`` in space quanta at the log's mean speed, leader radius in targets."""

    space: float
    time: float
    leader: float


#: What is tried at each effort, in this order.
_TRIALS = (
    _Trial(1.2, 2.0, 1.2),
    _Trial(0.8, 1.0, 1.2),
    _Trial(1.2, 3.0, 0.0),
    _Trial(1.2, 2.0, 2.0),
    _Trial(1.0, 2.0, 0.8),
    _Trial(1.2, 3.0, 1.6),
    _Trial(1.6, 2.0, 1.2),
    _Trial(1.4, 2.5, 0.8),
    _Trial(1.0, 1.4, 1.6),
    _Trial(1.2, 2.0, 0.0),
    _Trial(0.8, 1.4, 0.8),
    _Trial(1.6, 3.0, 2.0),
)


def learn(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    *,
    rmse: float,
    effort: int = 5,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Frame, LatticeWalks] | None:
    """Learn a connected map and the tracks' walks on it at a root mean square error of at most ``rmse`` metres.

    Parameters
    ----------
    tracks : sequence of Track
        At least one, all of the same dimension and on the same plane.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    rmse : float
        Root mean square of the synchronised distance over all samples of all tracks, in metres.
    effort : int, default 5
        From 1 (one search) to 9 (twelve searches).
    executor : Executor, optional
        Where the searches run; their results do not depend on it.
    progress : callable, optional
        Told how many searches are done, and of how many.

    Returns
    -------
    (Frame, LatticeWalks) or None
        The smallest that was found; None if none kept the bound.
    """
    speed = _typical_speed(tracks, gaps, rmse)
    trials = _TRIALS[: _count_trials(effort)]
    run = map if executor is None else executor.map

    def search(trial: _Trial) -> tuple[Frame, Outcome | None]:
        frame = _frame(tracks, rmse, speed, trial)
        slots = lay_slots(tracks, gaps, frame)
        return frame, fit(slots, len(tracks), Plan(target=0.9995 * rmse / quantum(frame.space), leader=trial.leader))

    best: tuple[Frame, Outcome] | None = None
    found: Iterable[tuple[Frame, Outcome | None]] = run(search, trials)
    for done, (frame, outcome) in enumerate(found, 1):
        if outcome is not None and (best is None or outcome.size < best[1].size):
            best = frame, outcome
        if progress is not None:
            progress(done, len(trials))
    return None if best is None else (best[0], best[1].walks)


def _count_trials(effort: int) -> int:
    return (1, 1, 2, 2, 3, 4, 6, 8, 12)[effort - 1]


def _frame(tracks: Sequence[Track], rmse: float, speed: float, trial: _Trial) -> Frame:
    space = quantum_index(1.04 * trial.space * rmse)
    time = quantum_index(1.04 * trial.time * quantum(space) / speed)
    first = min(tracks, key=lambda track: float(track.times[0]))
    origin = tuple(int(round(1000 * float(x))) for x in first.positions[0])
    return Frame(origin, int(np.floor(1000 * float(first.times[0]) + 1e-6)), space, time, first.plane)


def _typical_speed(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], scale: float) -> float:
    """Way per second outside gaps, in metres, where only steps of at least ``scale`` count as way, so that noise does not."""
    way = span = 0.0
    for track, gap in zip(tracks, gaps, strict=True):
        span += float(np.diff(track.times)[~gap].sum())
        way += _way(track.positions, gap, scale)
    return max(way, 1e-3 * scale) / max(span, 1e-3)


def _way(positions: NDArray[np.float64], gap: NDArray[np.bool_], scale: float) -> float:
    """Length of the way in steps of at least ``scale``, by decimating until steps are that long."""
    stride = 1
    while True:
        step = np.sqrt((np.diff(positions[::stride], axis=0) ** 2).sum(axis=1))
        jumps = np.add.reduceat(gap, np.arange(0, len(gap), stride)) > 0 if len(gap) else gap
        step = step[~jumps[: len(step)]]
        moving = step[step > 0.2 * scale]
        if len(moving) < 20 or np.median(moving) >= scale or stride > len(positions) // 20:
            return float(step[step > 0.5 * scale].sum())
        stride *= 2
