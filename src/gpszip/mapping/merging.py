"""One map from the curves of several archives: lattices are tried, and walks refined together, as a tree (thesis, 2.4).

The curves are measured against what comes out at every knot of either, so that a merge tells exactly how far it moved them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.coding.walks import encode, number_by_visit
from gpszip.mapping.curves import Curve, deviation, in_turn, instants, pieces_of, share_at_knots, weighed
from gpszip.mapping.drafting import list_parts, sample_errors
from gpszip.mapping.drafting import walks_of as drafted
from gpszip.mapping.fitting import SLACK, positions_at
from gpszip.mapping.lattice_map import node_positions, walks_of
from gpszip.mapping.maximum import mend
from gpszip.mapping.polishing import polish
from gpszip.mapping.refining import Allowance, draft_on, refine
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.slots import Slots, lay_slots, weigh_samples
from gpszip.model import Executor, Frame, LatticeWalk, LatticeWalks, Track, Walk
from gpszip.model.executor import Shared, sharing, united
from gpszip.model.frame import QUANTUM_STEPS, quantum
from gpszip.model.merge_report import Deviation

__all__ = ["Limit", "Merged", "Part", "merge_parts"]

T = TypeVar("T")

#: What is tried around each archive's own quanta: indices of space and time, eight to an octave.
_AROUND = ((0, 0), (0, -4), (-4, 0), (0, -8), (4, 0))
#: Where a maximum is to be kept, or nothing else has: finer ones.
_FINER = ((-8, -8), (-8, -16), (-16, -16), (-16, -24), (-24, -32), (-32, -48), (-48, -64))

#: Slots that all searches may take together, and the most of them; archives whose lattices are tried.
_BUDGET, _MOST, _LATTICES = 80_000, 4, 4

#: Slots from which on only those next to points are taken.
_SPARSE = 500_000

#: Bits for each knot that an error as large as is allowed counts for when lattices are ranked.
_ERROR = 2.0

#: Rounds of a whole search, of one on a large log, and of a merge within the tree.
_ROUNDS, _FEW_ROUNDS, _TREE_ROUNDS, _LARGE = 18, 10, 6, 200_000

#: The largest deviation, in root mean squares, that is aimed for where only the root mean square is limited.
_FAR = 4.0

#: The mean deviation aimed for, as a share of a maximum.
_RMS_OF_MAXIMUM = 0.5

#: Where what came out deviates more than is allowed, the next aim lies this much below what should do; this often.
_TIGHTER, _AIMS = 0.97, 4

#: Merged walks that are polished; knots that may be coded for each in all, and at once at least: in all, and for each of the walks.
_FINALISTS, _WORK, _WORK_AT_LEAST, _WORK_PER_KNOT = 2, 300_000, 60_000, 100
#: The heaviest weight of a part's points; the share of the limit that is aimed for in the mean of the parts, and the least and the most by
#: which the next aim is lower after a miss.
_WEIGHTS, _FULL, _LESS, _LEAST = 16, 0.94, 0.98, 0.7

#: The most weight that knots have in searches: without any between them, curves would stray there.
_AT_KNOTS = 0.6

#: How often knots are added where the maximum is missed at a knot that mending put in.
_MENDS = 6


@dataclass(frozen=True)
class Limit:
    """Metres by which curves may be moved: at any instant if ``maximum``, else in the root mean square of each archive."""

    metres: float
    maximum: bool

    def excess(self, moved: Sequence[Deviation]) -> NDArray[np.float64]:
        """What each part's curves were moved by as a multiple of what is allowed."""
        return np.array([one.maximum if self.maximum else one.rms for one in moved]) / self.metres


@dataclass(frozen=True, eq=False)
class Part:
    """The curves of one archive, on the plane that all share, and its map.

    Parameters
    ----------
    curves : tuple of Curve
        One for each track.
    nodes : float64 array, shape (V, d)
        Places of the map's nodes in metres.
    visits : tuple of int32 arrays
        Node at each knot of each curve.
    frame : Frame
        The archive's lattice, whose quanta are tried.
    step : float, optional
        Seconds between two samples of the log, where that is known.
    """

    curves: tuple[Curve, ...]
    nodes: NDArray[np.float64]
    visits: tuple[NDArray[np.int32], ...]
    frame: Frame
    step: float | None = None

    @cached_property
    def at_knots(self) -> float:
        """Share of the log's points that may lie at knots."""
        return share_at_knots(self.curves, self.step)

    @cached_property
    def points(self) -> tuple[Curve, ...]:
        """The curves as points with weights."""
        return tuple(weighed(self.curves, min(self.at_knots, _AT_KNOTS)))

    @property
    def knots(self) -> int:
        """Number of knots of all curves."""
        return sum(map(len, self.visits))


@dataclass(frozen=True, eq=False)
class Merged:
    """A map of all parts, the walks of all their tracks in the order of their starts with their names, and how far each part was moved."""

    frame: Frame
    ids: tuple[str, ...]
    lattice: LatticeWalks
    deviations: tuple[Deviation, ...]
    size: int


@dataclass(frozen=True, eq=False)
class _Branch:
    """Some of the curves with walks for them on the common lattice."""

    curves: tuple[Curve, ...]
    points: tuple[Curve, ...]
    walks: LatticeWalks
    groups: tuple[int, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(curve.track.id for curve in self.curves)

    def sorted(self) -> _Branch:
        """The same in the order of starts."""
        order = in_turn(self.curves)
        walks = LatticeWalks(self.walks.nodes, _picked(self.walks.walks, order))
        return _Branch(_picked(self.curves, order), _picked(self.points, order), number_by_visit(walks), _picked(self.groups, order))

    def slots(self, frame: Frame) -> Slots:
        """The slots of a lattice over the points, sparse ones where there would be very many."""
        tracks, gaps = [point.track for point in self.points], [point.gaps for point in self.points]
        slots = lay_slots(tracks, gaps, frame)
        return slots if len(slots.cells) < _SPARSE else lay_slots(tracks, gaps, frame, sparse=True)

    def point_groups(self) -> NDArray[np.int64]:
        """Part of each point."""
        return np.repeat(self.groups, [len(point.track) for point in self.points])


@dataclass(frozen=True, eq=False)
class _Search:
    """What all searches of one merge have in common."""

    parts: tuple[Part, ...]
    limit: Limit

    def allowed(self, frame: Frame, aims: NDArray[np.float64]) -> Allowance:
        """What may be done on a lattice to aim at these shares of the limit."""
        reach = self.limit.metres / quantum(frame.space)
        if self.limit.maximum:
            return Allowance(_RMS_OF_MAXIMUM * reach * aims, 0.999 * reach * float(aims.min()))
        return Allowance(0.9995 * reach * aims, _FAR * reach)

    def finish(self, frame: Frame, branch: _Branch) -> Merged | None:
        """Refine walks of all parts until they keep the limit."""
        branch = branch.sorted()
        slots, groups = branch.slots(frame), branch.point_groups()
        aims, rounds = np.ones(len(self.parts)), _ROUNDS if len(slots.cells) < _LARGE else _FEW_ROUNDS
        for _ in range(_AIMS):
            allowed = self.allowed(frame, aims)
            outcome = refine(slots, len(branch.curves), groups, *draft_on(slots, branch.walks), allowed, rounds)
            if outcome is None:
                return None
            found = self.mended(frame, branch, outcome)
            if found is None:
                return None
            over = np.maximum(self.limit.excess(found.deviations), 1e-9)
            if (over <= 1).all():
                return found
            aims, rounds = np.where(over > 1, aims * np.maximum(_TIGHTER / over, 0.5), aims), _FEW_ROUNDS
            branch = replace(branch, walks=outcome.walks)
        return None

    def mended(self, frame: Frame, branch: _Branch, outcome: Outcome) -> Merged | None:
        """What becomes of walks of which a few parts miss the maximum, where that is limited."""
        lattice = outcome.walks
        for _ in range(_MENDS if self.limit.maximum else 0):
            moved = self.measure(frame, branch, lattice)
            if (self.limit.excess(moved) <= 1).all():
                break
            walks = walks_of(lattice, frame, branch.ids)
            tracks = [_with_instants(curve, walk) for curve, walk in zip(branch.curves, walks, strict=True)]
            mending = mend(tracks, frame, lattice, 0.999 * self.limit.metres)
            if mending is None:
                return None
            frame, lattice = mending
        return Merged(frame, branch.ids, lattice, self.measure(frame, branch, lattice), len(encode(lattice)))

    def polish(self, found: Merged) -> Merged:
        """What becomes of walks that keep the limit by single changes; each part's points weigh such that it comes to keep it, too."""
        branch = _join(_leaves(self.parts, found.frame)).sorted()
        slots, groups, allowed = branch.slots(found.frame), branch.point_groups(), self.allowed(found.frame, np.ones(len(self.parts)))
        target, weights, best = float(allowed.rms[0]), np.ones(len(self.parts)), found
        work = max(_WORK_AT_LEAST, _WORK_PER_KNOT * sum(part.knots for part in self.parts))
        for _ in range(min(_WORK // work, 1) if self.limit.maximum else _WORK // work):
            weighing = np.rint(_WEIGHTS * weights / weights.max()).clip(1).astype(np.int64)[groups]
            heavier = replace(weigh_samples(slots, weighing), weights=weighing * slots.weights)
            start = Outcome(best.lattice, best.size, 0.0)
            maximum = allowed.maximum if self.limit.maximum else None
            outcome = polish(heavier, start, target=target, maximum=maximum, work=work)
            if outcome is start:
                break
            made = self.mended(best.frame, branch, outcome)
            if made is None:
                break
            over = np.maximum(self.limit.excess(made.deviations), 0.1)
            if (over <= 1).all() and made.size < best.size:
                best = made
            mean = float(np.sqrt((over**2).mean()))
            weights, target = weights * over / mean, target * min(max(_FULL / mean, _LEAST), 1.0 if over.max() <= 1 else _LESS)
        return best

    def measure(self, frame: Frame, branch: _Branch, lattice: LatticeWalks) -> tuple[Deviation, ...]:
        """How far each part's curves were moved."""
        walks, nodes = walks_of(lattice, frame, branch.ids), node_positions(lattice, frame)
        found = []
        for part in range(len(self.parts)):
            own = [i for i, group in enumerate(branch.groups) if group == part]
            found.append(deviation([branch.curves[i] for i in own], [walks[i] for i in own], nodes, self.parts[part].at_knots))
        return tuple(found)


def merge_parts(
    parts: Sequence[Part],
    limit: Limit,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Merged | None:
    """Find one map and walks on it for the curves of all parts.

    Lattices of the parts, and finer and coarser ones about them, are ranked by what rounding to them costs; on the best few of
    them, walks are refined together. Of more than two parts, neighbours are merged first, as the leaves of a tree.

    Parameters
    ----------
    parts : sequence of Part
        At least one; all on one plane.
    limit : Limit
        How far curves may be moved.
    executor : Executor, optional
        Where searches and branches run; the result does not depend on it.
    progress : callable, optional
        Told how many searches are done, and of how many.

    Returns
    -------
    Merged or None
        The smallest that was found; None if none kept the limit.
    """
    search = _Search(tuple(parts), limit)
    with sharing(executor, search) as shared:
        ranked = _ranked(_frames(parts, _AROUND), shared)
        finer = [frame for frame in _frames(parts[:1], _FINER) if frame not in ranked]
        for frames in (ranked, *([frame] for frame in finer)):
            starts = [(frame, _as_tree(search, frame, executor)) for frame in frames]
            found: list[Merged] = []
            for done, merged in enumerate(shared.map(_finish, starts), 1):
                if merged is not None:
                    found.append(merged)
                if progress is not None:
                    progress(done, len(frames))
            if found:
                finalists = sorted(found, key=lambda merged: merged.size)[:_FINALISTS]
                return min(shared.map(_Search.polish, finalists), key=lambda merged: merged.size)
    return None


def _picked(values: Sequence[T], order: Sequence[int]) -> tuple[T, ...]:
    return tuple(values[i] for i in order)


def _finish(search: _Search, start: tuple[Frame, _Branch | None]) -> Merged | None:
    frame, branch = start
    return search.finish(frame, _join(_leaves(search.parts, frame)) if branch is None else branch)


def _leaves(parts: Sequence[Part], frame: Frame) -> list[_Branch]:
    return [_leaf(part, frame, number) for number, part in enumerate(parts)]


def _leaf(part: Part, frame: Frame, number: int) -> _Branch:
    """Round one part to a lattice."""
    corner = np.asarray(frame.origin, dtype=np.float64) / 1000
    nodes = np.rint((part.nodes - corner) / quantum(frame.space)).astype(np.int64)
    walks = [
        LatticeWalk(visits, np.rint((curve.track.times - frame.epoch / 1000) / quantum(frame.time)).astype(np.int64), curve.gaps)
        for curve, visits in zip(part.curves, part.visits, strict=True)
    ]
    return _Branch(part.curves, part.points, LatticeWalks(nodes, tuple(walks)), (number,) * len(walks))


def _join(branches: Sequence[_Branch]) -> _Branch:
    """Put branches side by side, each with its own nodes still."""
    walks: list[LatticeWalk] = []
    first = 0
    for branch in branches:
        walks += [replace(walk, nodes=walk.nodes + np.int32(first)) for walk in branch.walks.walks]
        first += len(branch.walks.nodes)
    nodes = np.concatenate([branch.walks.nodes for branch in branches])
    groups = tuple(group for branch in branches for group in branch.groups)
    curves = tuple(curve for branch in branches for curve in branch.curves)
    points = tuple(point for branch in branches for point in branch.points)
    return _Branch(curves, points, LatticeWalks(nodes, tuple(walks)), groups)


def _as_tree(search: _Search, frame: Frame, executor: Executor | None) -> _Branch | None:
    """Merge neighbours, then neighbours of what came out, until all is one; of two parts, nothing yet."""
    if len(search.parts) <= 2:
        return None
    unite = partial(_united, frame, search.allowed(frame, np.ones(1)))
    branch: _Branch = united(executor, unite, enumerate(search.parts), partial(_leaf_on, frame))
    return branch


def _leaf_on(frame: Frame, numbered: tuple[int, Part]) -> _Branch:
    number, part = numbered
    return _leaf(part, frame, number)


def _united(frame: Frame, allowed: Allowance, one: _Branch, other: _Branch) -> _Branch:
    both = _join([one, other])
    slots = both.slots(frame)
    alike = np.zeros(len(slots.times), np.int64)
    outcome = refine(slots, len(both.curves), alike, *draft_on(slots, both.walks), allowed, _TREE_ROUNDS)
    return both if outcome is None else replace(both, walks=outcome.walks)


def _frames(parts: Sequence[Part], around: Sequence[tuple[int, int]]) -> list[Frame]:
    """Lattices to try: those of the largest parts, with quanta about their own."""
    own = sorted(parts, key=lambda part: -part.knots)[:_LATTICES]
    plane = [replace(part.frame, space=part.frame.space + s, time=part.frame.time + t) for part in own for s, t in around]
    return list(dict.fromkeys(frame for frame in plane if 0 <= frame.space < QUANTUM_STEPS and 0 <= frame.time < QUANTUM_STEPS))


def _ranked(frames: Sequence[Frame], shared: Shared[_Search]) -> list[Frame]:
    """The lattices that promise most, as many as there is time for, without those that lose a gap."""
    costs = list(shared.map(_cost, frames))
    order = sorted((number for number, (cost, _) in enumerate(costs) if cost < np.inf), key=lambda number: costs[number][0])
    if not order:
        return []
    slots = costs[order[0]][1]
    return [frames[number] for number in order[: min(max(_BUDGET // slots, 1), _MOST)]]


def _cost(search: _Search, frame: Frame) -> tuple[float, int]:
    """Bits of the walks rounded to a lattice, with what their error will take to mend; and how many slots there are."""
    branch = _join(_leaves(search.parts, frame))
    slots = branch.slots(frame)
    if len(slots.firsts) < sum(1 + _count_gaps(curve) for curve in branch.curves):
        return np.inf, len(slots.cells)
    at, places = draft_on(slots, branch.walks)
    size = len(encode(drafted(slots, at, places, len(branch.curves))))
    errors, _ = sample_errors(slots, list_parts(slots, at, len(places)), places)
    square = float(np.average(errors**2, weights=slots.weights)) / float(search.allowed(frame, np.ones(1)).rms[0]) ** 2
    return 8 * size + _ERROR * sum(part.knots for part in search.parts) * square, len(slots.cells)


def _count_gaps(curve: Curve) -> int:
    return int((np.diff(curve.track.times)[curve.gaps] > SLACK).sum())


def _with_instants(curve: Curve, walk: Walk) -> Track:
    """The curve's points at its own knots and at those of a walk."""
    own = curve.walk
    times = np.concatenate([instants(curve.track.times[first:after], walk) for first, after in pieces_of(curve.gaps)])
    return Track(curve.track.id, times, positions_at(own, curve.track.positions, times))
