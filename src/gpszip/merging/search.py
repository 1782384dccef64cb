"""One map from the curves of several archives: grids are tried, and walks refined as a tree.

The tree is that of the thesis, section 2.4. Curves are compared with the result at every knot of
either, so that a merge reports exactly how far it moved them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import encode
from gpszip.mapping.budgets import ErrorBudgets
from gpszip.mapping.initial_map import list_segments, sample_errors, walks_of
from gpszip.mapping.local_search import improve_walks
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import MAX_ERROR_AIM, RMSE_AIM, Plan
from gpszip.mapping.rounds import Outcome, fit
from gpszip.mapping.time_grid import TimeGrid
from gpszip.merging.deviation import Curve, measure_deviation, split_at_gaps, union_of_knot_times
from gpszip.merging.refine import AllowedDeviation, refine, snap_to_time_grid
from gpszip.merging.tree import (
    ArchiveCurves,
    Branch,
    build_leaf,
    build_leaves,
    concatenate_branches,
)
from gpszip.model import GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import STEP_SIZES, step_size
from gpszip.model.merge_report import Deviation
from gpszip.run.executor import Executor, SharedValue, reduce_tree, share_value
from gpszip.walks.error import TIME_SLACK, positions_at
from gpszip.walks.quantised import dequantise_walks, node_positions

__all__ = ["ArchiveCurves", "DeviationLimit", "MergedMap", "merge_archives"]

#: Grids to try around each archive's own: shifts of the indices of space and time, eight to an
#: octave.
_NEAR_SHIFTS = ((0, 0), (0, -4), (-4, 0), (0, -8), (4, 0))
#: Finer grids, tried one after the other where no other keeps the limit.
_FINER_SHIFTS = (
    (-8, -8),
    (-8, -16),
    (-16, -16),
    (-16, -24),
    (-24, -32),
    (-32, -48),
    (-48, -64),
)

#: Slots that all searches may take together.
_MAX_TOTAL_SLOTS = 80_000
#: Largest number of grids that are searched.
_MAX_GRIDS = 4
#: Largest number of archives whose grids are tried.
_MAX_ARCHIVE_GRIDS = 4

#: Bits for each knot that an error as large as allowed counts for when grids are ranked.
_ERROR_BITS = 2.0

#: Rounds of a search over all archives.
_ROUNDS = 18
#: The same on a large log, or once a first search missed the limit.
_FEW_ROUNDS = 10
#: Rounds of a merge within the tree.
_TREE_ROUNDS = 6
#: Slots from which on a log is large.
_LARGE_SLOTS = 200_000

#: Largest deviation that is aimed at where only the root mean square is limited, as a multiple of
#: the limit.
_MAX_PER_RMS = 4.0
#: Root mean square that is aimed at where the maximum is limited, as a share of the limit.
_RMS_PER_MAX = 0.5

#: Searches with lower and lower targets, while the limit is missed.
_MAX_ATTEMPTS = 4
#: Factor by which the next target is below the one that should suffice.
_TIGHTER = 0.97
#: Least factor by which a target is lowered at once.
_MIN_TARGET_FACTOR = 0.5

#: Merged maps that are improved by local search.
_FINALISTS = 2
#: Knots that a local search may encode for each of them in all.
_WORK = 300_000
#: Least number of knots that it may encode at once.
_MIN_WORK = 60_000
#: Knots that it may encode at once for each knot of the walks.
_WORK_PER_KNOT = 100

#: Slots up to which a map is also searched from scratch.
_SCRATCH_SLOTS = 4000

#: Share by which walks grow when their error has to fall by a factor e.
_GROWTH = 1.1

#: Share of the limit that a local search targets.
_LOCAL_AIM = 0.999
#: Largest factor by which deviation and error may differ between curves and points.
_MAX_RATIO_FACTOR = 1.6

#: Times that knots are added where the maximum is missed at a knot that was added before.
_MAX_REPAIRS = 6


@dataclass(frozen=True)
class DeviationLimit:
    """Metres by which a merge may move curves.

    Parameters
    ----------
    metres : float
        The limit.
    maximum : bool
        Whether it holds at any time; else for the root mean square of each archive.
    """

    metres: float
    maximum: bool

    def excess(self, deviations: Sequence[Deviation]) -> NDArray[np.float64]:
        """Deviation of each archive's curves as a multiple of the limit."""
        moved = [deviation.maximum if self.maximum else deviation.rms for deviation in deviations]
        return np.array(moved) / self.metres


@dataclass(frozen=True, eq=False)
class MergedMap:
    """A map of all archives, with the walks of all their tracks in the order of their starts.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid.
    ids : tuple of str
        Names of the tracks.
    grid_walks : GridWalks
        Map and walks.
    deviations : tuple of Deviation
        How far each archive's curves were moved.
    size : int
        Encoded size in bytes.
    """

    grid: QuantisationGrid
    ids: tuple[str, ...]
    grid_walks: GridWalks
    deviations: tuple[Deviation, ...]
    size: int


class _GridCost(NamedTuple):
    """Bits of the walks rounded to a grid with those for their error, and slots of the grid."""

    bits: float
    slots: int


@dataclass(frozen=True, eq=False)
class _Search:
    """What all searches of one merge share."""

    archives: tuple[ArchiveCurves, ...]
    limit: DeviationLimit

    @cached_property
    def limit_shares(self) -> NDArray[np.float64]:
        """Share of the limit of each archive."""
        return np.array([archive.limit_share for archive in self.archives])

    def excess(self, deviations: Sequence[Deviation]) -> NDArray[np.float64]:
        """Deviation of each archive's curves as a multiple of its share of the limit."""
        return self.limit.excess(deviations) / self.limit_shares

    def allowed(self, grid: QuantisationGrid, shares: NDArray[np.float64]) -> AllowedDeviation:
        """Deviation on a grid that targets these shares of the limit."""
        # Aim a little below the limit. What isn't limited has a target as well, in proportion to
        # the limit: prices of squared error follow the one, and the other keeps points from
        # straying.
        reach = self.limit.metres / step_size(grid.space)
        if self.limit.maximum:
            return AllowedDeviation(
                _RMS_PER_MAX * reach * shares, MAX_ERROR_AIM * reach * float(shares.min())
            )
        return AllowedDeviation(RMSE_AIM * reach * shares, _MAX_PER_RMS * reach)

    def refine_within_limit(self, grid: QuantisationGrid, branch: Branch) -> MergedMap | None:
        """Refine the walks of all archives until they keep the limit."""
        # Refine and repair, with lower targets each time, until all archives keep the limit.
        time_grid, groups = branch.time_grid(grid), branch.point_groups()
        shares = self.limit_shares
        rounds = _ROUNDS if len(time_grid.time_steps) < _LARGE_SLOTS else _FEW_ROUNDS
        for _ in range(_MAX_ATTEMPTS):
            outcome = refine(
                time_grid,
                len(branch.curves),
                groups,
                *snap_to_time_grid(time_grid, branch.walks),
                self.allowed(grid, shares),
                rounds,
            )
            if outcome is None:
                return None
            merged = self.repair(grid, branch, outcome)
            if merged is None or self.keeps_limit(merged):
                return merged

            # Aim lower where an archive misses the limit.
            excess = np.maximum(self.excess(merged.deviations), 1e-9)
            factor = np.maximum(_TIGHTER / excess, _MIN_TARGET_FACTOR)
            shares, rounds = np.where(excess > 1, shares * factor, shares), _FEW_ROUNDS
            branch = replace(branch, walks=outcome.walks)
        return None

    def learn_from_scratch(self, grid: QuantisationGrid, branch: Branch) -> MergedMap | None:
        """Learn walks without those of the archives.

        Only the mean over all archives is within the limit.
        """
        time_grid = branch.time_grid(grid)
        if self.limit.maximum or len(time_grid.time_steps) > _SCRATCH_SLOTS:
            return None
        plan = Plan(target=float(self.allowed(grid, self.limit_shares).rms.mean()), rounds=_ROUNDS)
        outcome = fit(time_grid, len(branch.curves), plan)
        return None if outcome is None else self.repair(grid, branch, outcome)

    def keeps_limit(self, merged: MergedMap) -> bool:
        """Whether each archive is within its limit."""
        return bool((self.excess(merged.deviations) <= 1).all())

    def expected_size(self, merged: MergedMap) -> float:
        """Size of walks, with the bytes that it takes to bring them within the limit."""
        excess = max(self.excess(merged.deviations).max(), 1.0)
        return merged.size * (1 + _GROWTH * float(np.log(excess)))

    def repair(self, grid: QuantisationGrid, branch: Branch, outcome: Outcome) -> MergedMap | None:
        """Where the maximum is limited, bring the segments that miss it within it.

        None if that fails.
        """
        # New knots may miss the maximum between the points of the time before.
        grid_walks = outcome.walks
        for _ in range(_MAX_REPAIRS if self.limit.maximum else 0):
            deviations = self.measure(grid, branch, grid_walks)
            if (self.excess(deviations) <= 1).all():
                break

            # Compare the walks with the curves at the knots of both.
            walks = dequantise_walks(grid_walks, grid, branch.ids)
            tracks = [
                _sample_at_knots(curve, walk)
                for curve, walk in zip(branch.curves, walks, strict=True)
            ]
            changed = enforce_max_error(tracks, grid, grid_walks, MAX_ERROR_AIM * self.limit.metres)
            if changed is None:
                return None
            grid, grid_walks = changed

        # Measure again: the repairs changed the walks, and may have changed the grid.
        return MergedMap(
            grid,
            branch.ids,
            grid_walks,
            self.measure(grid, branch, grid_walks),
            len(encode(grid_walks)),
        )

    def improve_walks(self, merged: MergedMap) -> MergedMap:
        """Improve walks by local search; each archive keeps to its own limit."""
        # Set up the time grid of all curves, and the work of one step of the search.
        branch = concatenate_branches(build_leaves(self.archives, merged.grid)).sorted()
        time_grid, groups = branch.time_grid(merged.grid), branch.point_groups()
        work = max(_MIN_WORK, _WORK_PER_KNOT * sum(archive.knots for archive in self.archives))

        # A maximum is the same for curves and points.
        if self.limit.maximum:
            maximum = self.allowed(merged.grid, self.limit_shares).maximum
            improved = self.apply_step(
                merged, branch, partial(improve_walks, time_grid, maximum=maximum, work=work)
            )
            return merged if improved is None else self.select_better(improved, merged)

        # Root mean squares differ between curves and points: measure both after each step.
        last, best = merged, merged
        for _ in range(_WORK // work):
            budgets = ErrorBudgets(
                groups,
                _LOCAL_AIM * self.limit_shares / self.limit_per_step(time_grid, groups, last),
            )
            improved = self.apply_step(
                last, branch, partial(improve_walks, time_grid, budgets=budgets, work=work)
            )
            if improved is None:
                break
            last, best = improved, self.select_better(improved, best)
        return best

    def limit_per_step(
        self, time_grid: TimeGrid, groups: NDArray[np.int64], last: MergedMap
    ) -> NDArray[np.float64]:
        """Share of the limit by which each archive's curves move when its points move by a step.

        It is the ratio of the two in the last walks, in grid steps.
        """
        slot_nodes, positions = snap_to_time_grid(time_grid, last.grid_walks)
        segments = list_segments(time_grid, slot_nodes, len(positions))
        errors, _ = sample_errors(time_grid, segments, positions)
        rms = np.sqrt(
            np.bincount(groups, weights=time_grid.weights * errors**2)
            / np.bincount(groups, weights=time_grid.weights)
        )
        expected = step_size(last.grid.space) / self.limit.metres
        ratio: NDArray[np.float64] = np.clip(
            self.limit.excess(last.deviations) / np.maximum(rms, 1e-9),
            expected / _MAX_RATIO_FACTOR,
            expected * _MAX_RATIO_FACTOR,
        )
        return ratio

    def select_better(self, improved: MergedMap, best: MergedMap) -> MergedMap:
        """The smaller one of those that keep the limit."""
        if not self.keeps_limit(improved):
            return best
        return best if self.keeps_limit(best) and best.size <= improved.size else improved

    def apply_step(
        self, last: MergedMap, branch: Branch, step: Callable[[Outcome], Outcome]
    ) -> MergedMap | None:
        """Apply a step of a local search to walks; None if it changes nothing."""
        # A step that finds nothing returns the very outcome that it was given.
        start = Outcome(last.grid_walks, last.size, 0.0)
        outcome = step(start)
        return None if outcome is start else self.repair(last.grid, branch, outcome)

    def measure(
        self, grid: QuantisationGrid, branch: Branch, grid_walks: GridWalks
    ) -> tuple[Deviation, ...]:
        """How far each archive's curves were moved."""
        walks = dequantise_walks(grid_walks, grid, branch.ids)
        nodes = node_positions(grid_walks, grid)
        deviations = []
        for number, archive in enumerate(self.archives):
            tracks = [i for i, group in enumerate(branch.groups) if group == number]
            deviations.append(
                measure_deviation(
                    [branch.curves[i] for i in tracks],
                    [walks[i] for i in tracks],
                    nodes,
                    archive.at_knots,
                )
            )
        return tuple(deviations)


def merge_archives(
    archives: Sequence[ArchiveCurves],
    limit: DeviationLimit,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MergedMap | None:
    """Find one map, and walks on it, for the curves of all archives.

    The grids of the archives, and finer and coarser ones around them, are ranked by the bits of
    walks rounded to them. On the best few, the walks of all archives are refined together. Of more
    than two archives, neighbours are merged first, as the leaves of a tree.

    Parameters
    ----------
    archives : sequence of ArchiveCurves
        At least one; all on one plane.
    limit : DeviationLimit
        How far curves may be moved.
    executor : Executor, optional
        Runs searches and branches; the result does not depend on it.
    progress : callable, optional
        Called with the number of searches done, and the number of all.

    Returns
    -------
    MergedMap or None
        The smallest map found; None if none kept the limit.
    """
    # Workers get the archives and the limit once, for all grids.
    search = _Search(tuple(archives), limit)
    with share_value(executor, search) as shared:
        # The best grids first, then finer ones, one after the other.
        ranked = _rank_grids(_list_grids(archives, _NEAR_SHIFTS), shared)
        finer = [grid for grid in _list_grids(archives[:1], _FINER_SHIFTS) if grid not in ranked]
        for grids in (ranked, *([grid] for grid in finer)):
            # Merge on each grid.
            starts = [(grid, _merge_as_tree(search, grid, executor)) for grid in grids]
            merged_maps: list[MergedMap] = []
            for done, results in enumerate(shared.map(_search_grid, starts), 1):
                merged_maps += results
                if progress is not None:
                    progress(done, len(grids))

            # Improve the best maps. Those that miss the limit still may do so afterwards.
            finalists = sorted(merged_maps, key=search.expected_size)[:_FINALISTS]
            improved = shared.map(_Search.improve_walks, finalists)
            within_limit = [
                merged for merged in (*improved, *merged_maps) if search.keeps_limit(merged)
            ]
            if within_limit:
                return min(within_limit, key=lambda merged: merged.size)
    return None


def _search_grid(search: _Search, start: tuple[QuantisationGrid, Branch | None]) -> list[MergedMap]:
    """Merge all archives on one grid, from merged branches if there are any."""
    grid, branch = start
    if branch is None:
        branch = concatenate_branches(build_leaves(search.archives, grid))
    branch = branch.sorted()
    results = search.refine_within_limit(grid, branch), search.learn_from_scratch(grid, branch)
    return [merged for merged in results if merged is not None]


def _merge_as_tree(
    search: _Search, grid: QuantisationGrid, executor: Executor | None
) -> Branch | None:
    """Merge neighbours, then neighbours of the results, until one is left.

    Two archives or fewer are not merged yet.
    """
    if len(search.archives) <= 2:
        return None
    merge_pair = partial(_merge_pair, grid, search.allowed(grid, np.ones(1)))
    branch: Branch = reduce_tree(
        executor, merge_pair, enumerate(search.archives), partial(_build_numbered_leaf, grid)
    )
    return branch


def _build_numbered_leaf(grid: QuantisationGrid, numbered: tuple[int, ArchiveCurves]) -> Branch:
    number, archive = numbered
    return build_leaf(archive, grid, number)


def _merge_pair(
    grid: QuantisationGrid, allowed: AllowedDeviation, first: Branch, second: Branch
) -> Branch:
    """Merge two branches; where refinement fails, they are only concatenated."""
    both = concatenate_branches([first, second])
    time_grid = both.time_grid(grid)
    # Within the tree, all archives share one price; each keeps its own limit at the root.
    single_group = np.zeros(len(time_grid.times), np.int64)
    outcome = refine(
        time_grid,
        len(both.curves),
        single_group,
        *snap_to_time_grid(time_grid, both.walks),
        allowed,
        _TREE_ROUNDS,
    )
    return both if outcome is None else replace(both, walks=outcome.walks)


def _list_grids(
    archives: Sequence[ArchiveCurves], shifts: Sequence[tuple[int, int]]
) -> list[QuantisationGrid]:
    """Grids to try: those of the largest archives, with step sizes around their own."""
    largest = sorted(archives, key=lambda archive: -archive.knots)[:_MAX_ARCHIVE_GRIDS]
    grids = [
        replace(
            archive.grid,
            space=archive.grid.space + space_shift,
            time=archive.grid.time + time_shift,
        )
        for archive in largest
        for space_shift, time_shift in shifts
    ]
    return list(
        dict.fromkeys(
            grid for grid in grids if 0 <= grid.space < STEP_SIZES and 0 <= grid.time < STEP_SIZES
        )
    )


def _rank_grids(
    grids: Sequence[QuantisationGrid], shared: SharedValue[_Search]
) -> list[QuantisationGrid]:
    """The grids of least cost, as many as there is time for; those that lose a gap are left out."""
    costs = list(shared.map(_find_grid_cost, grids))
    order = sorted(
        (number for number, cost in enumerate(costs) if cost.bits < np.inf),
        key=lambda number: costs[number].bits,
    )
    if not order:
        return []
    # The time of a search grows with the slots of its grid.
    count = min(max(_MAX_TOTAL_SLOTS // costs[order[0]].slots, 1), _MAX_GRIDS)
    return [grids[number] for number in order[:count]]


def _find_grid_cost(search: _Search, grid: QuantisationGrid) -> _GridCost:
    """Cost of the walks rounded to a grid; infinite if the grid loses a gap."""
    # Leave out grids so coarse in time that a gap is lost.
    branch = concatenate_branches(build_leaves(search.archives, grid))
    time_grid = branch.time_grid(grid)
    slots = len(time_grid.time_steps)
    if len(time_grid.first_slots) < sum(1 + _count_gaps(curve) for curve in branch.curves):
        return _GridCost(np.inf, slots)

    # Bits of the rounded walks.
    slot_nodes, positions = snap_to_time_grid(time_grid, branch.walks)
    size = len(encode(walks_of(time_grid, slot_nodes, positions, len(branch.curves))))

    # Bits that it takes to bring their error within the limit.
    segments = list_segments(time_grid, slot_nodes, len(positions))
    errors, _ = sample_errors(time_grid, segments, positions)
    square = (
        float(np.average(errors**2, weights=time_grid.weights))
        / float(search.allowed(grid, np.ones(1)).rms[0]) ** 2
    )
    knots = sum(archive.knots for archive in search.archives)
    return _GridCost(8 * size + _ERROR_BITS * knots * square, slots)


def _count_gaps(curve: Curve) -> int:
    """Number of gaps of a curve that are longer than the time slack."""
    return int((np.diff(curve.track.times)[curve.gaps] > TIME_SLACK).sum())


def _sample_at_knots(curve: Curve, walk: Walk) -> Track:
    """Points of the curve at its own knots and at those of a walk."""
    times = np.concatenate(
        [
            union_of_knot_times(curve.track.times[first:after], walk)
            for first, after in split_at_gaps(curve.gaps)
        ]
    )
    return Track(curve.track.id, times, positions_at(curve.walk, curve.track.positions, times))
