"""Simplify, round the knots, and code them: the smallest file over a few splits of the error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from . import bottom_up, cised, td_tr
from .curves import Curve, Steps, errors, knot_clock, make_curve, round_times
from .files import encode_file
from .log import SEPARATION, Integers, Log, find_period, find_speed

#: Coders of the knots; the smaller file counts.
CODERS = ("pco", "arithmetic")


#: A function of a log, the samples kept, the grid and the samples pinned.
Fit = Callable[[Log, Integers, Steps, Integers], Curve]


@dataclass(frozen=True)
class Simplifier:
    """A way to choose knots.

    Parameters
    ----------
    simplify : callable
        Samples that are kept of a log, within a tolerance in metres.
    fit : callable
        The curve of the samples that are kept, on a grid, which goes through those that are pinned.
    tolerances : tuple of float
        Tolerances to try, in bounds, the best one mostly first. Rounding needs a tolerance below
        the bound; least squares turn one above the bound into an error below it.
    """

    simplify: Callable[[Log, float], Integers]
    fit: Fit
    tolerances: tuple[float, ...]


@dataclass(frozen=True)
class Search:
    """What is tried.

    Parameters
    ----------
    positions : tuple of float
        Steps of positions, in bounds; rounding moves a position by up to 0.71 steps.
    times : tuple of float
        Steps of times; in bounds, at the speed of the log. The first is tried with all positions,
        and the others with the best of them.
    tolerances : int
        Number of tolerances.
    """

    positions: tuple[float, ...]
    times: tuple[float, ...]
    tolerances: int


def fit_samples(log: Log, kept: Integers, steps: Steps, _pinned: Integers) -> Curve:
    """The curve through the samples that are kept, rounded to the grid."""
    return make_curve(log, kept, steps)


def fit_least_squares(log: Log, kept: Integers, steps: Steps, pinned: Integers) -> Curve:
    """The curve whose vertices are those of least squares, rounded to the grid."""
    ticks, kept, firsts = round_times(log, kept, steps.time)
    clock = log.clock_starts.repeat(np.diff(firsts)) + ticks * steps.time
    vertices = bottom_up.fit_vertices(log, kept, clock, np.isin(kept, pinned))
    x, y = (np.round(axis / steps.position).astype(np.int64) for axis in vertices)
    return Curve(firsts, ticks, x, y, steps)


SIMPLIFIERS = {
    "td-tr": Simplifier(td_tr.simplify, fit_samples, (0.9, 0.8, 1.0)),
    "cised-s": Simplifier(cised.simplify, fit_samples, (1.1, 0.9, 1.3)),
    "cised-wide": Simplifier(cised.simplify_with_wide_cones, fit_samples, (0.9, 0.8, 1.0)),
    "bottom-up": Simplifier(bottom_up.simplify, fit_least_squares, (1.2, 0.9, 1.5)),
}

#: One split of the error, and a few of them.
SEARCHES = {
    "quick": Search((0.7,), (0.5,), 1),
    "thorough": Search((0.2, 0.4, 0.6, 0.8), (0.5, 0.25, 1.0, 2.0), 3),
}

#: Rounds in which knots are added where the bound is exceeded.
ROUNDS = 20

#: All steps are divided by this until some file holds the bound, and how often.
REFINEMENT = 4.0
REFINEMENTS = 8


def compress(log: Log, bound: float, name: str, level: str) -> tuple[bytes, dict[str, int]]:
    """The smallest file within the bound that the search finds, and the size by each coder."""
    # What the search needs to know.
    simplifier, search = SIMPLIFIERS[name], SEARCHES[level]
    speed, period = find_speed(log, td_tr.simplify(log, bound)), find_period(log)
    kept = {
        tolerance: simplifier.simplify(log, tolerance * bound)
        for tolerance in simplifier.tolerances[: search.tolerances]
    }

    # Finer grids until a file holds the bound.
    scale = bound
    for _ in range(REFINEMENTS):
        files = min(
            try_steps(log, bound, simplifier.fit, kept, search, (scale, speed, period)),
            key=smallest,
            default=None,
        )
        if files is not None:
            return min(files.values(), key=len), {coder: len(f) for coder, f in files.items()}
        scale /= REFINEMENT
    raise ValueError(f"{name} does not hold {bound} m on any grid")


def try_steps(
    log: Log,
    bound: float,
    fit: Fit,
    kept: dict[float, Integers],
    search: Search,
    scales: tuple[float, float, float],
) -> Iterator[dict[str, bytes]]:
    """The files of all steps of the search that hold the bound, by coder."""
    best = search.positions[0], np.inf
    grids = [(position, search.times[0]) for position in search.positions]
    while grids:
        # All tolerances on one grid.
        position, time = grids.pop(0)
        steps = choose_steps(*scales, position, time)
        for samples in kept.values():
            curve = add_knots(log, bound, fit, samples, steps)
            if curve is not None:
                files = {coder: encode_file(log, curve, coder) for coder in CODERS}
                best = min(best, (position, smallest(files)), key=lambda entry: entry[1])
                yield files

        # After all steps of positions, the other steps of times at the best of them.
        if not grids and time == search.times[0]:
            grids = [(best[0], time) for time in search.times[1:]]


def smallest(files: dict[str, bytes]) -> int:
    return min(map(len, files.values()))


def choose_steps(scale: float, speed: float, period: float, position: float, time: float) -> Steps:
    """Steps of a grid; that of times is a multiple of the log's period, which loses nothing."""
    longest = min(time * scale / speed, SEPARATION / 2)
    return Steps(max(1, int(longest / period)) * period, position * scale)


def add_knots(
    log: Log,
    bound: float,
    fit: Fit,
    kept: Integers,
    steps: Steps,
) -> Curve | None:
    """The curve with knots added at the farthest samples until it holds the bound; or None.

    That takes fewer knots than a smaller tolerance of the whole log.
    """
    pinned = np.zeros(0, np.int64)
    for _ in range(ROUNDS):
        # Samples that are too far.
        curve = fit(log, kept, steps, pinned)
        distances = errors(log, curve)
        far = np.flatnonzero(distances > bound)
        if len(far) == 0:
            return curve

        # The farthest of each segment: sorted by distance, it is the last that is noted.
        far = far[np.argsort(distances[far], kind="stable")]
        segments = np.searchsorted(knot_clock(log, curve), log.clock[far])
        farthest = np.array(list(dict(zip(segments.tolist(), far.tolist(), strict=True)).values()))

        # Pin these; those that are pinned already need a finer grid.
        more = np.union1d(pinned, farthest)
        if len(more) == len(pinned):
            return None
        kept, pinned = np.union1d(kept, more), more
    return None
