"""Encoding a log batch by batch, as walks on the nodes that are known by then.

Batches are encoded by themselves, wave by wave: those of one wave on what the waves before have
added. So the result depends neither on the executor nor on the number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.numbering import number_by_visit
from gpszip.codec.prior import Prior
from gpszip.errors import BoundError
from gpszip.geo.gaps import find_gaps
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.on_known_map import learn_on
from gpszip.model import GridWalk, GridWalks, Options, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.model.log import Log
from gpszip.pipeline.bounds import holds
from gpszip.pipeline.slices import Slice, join_at_cut
from gpszip.run.executor import Executor, share_value
from gpszip.walks.error import ErrorSummary, measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions, quantise_walks
from gpszip.walks.shapes import SyntheticTimes

__all__ = ["BaseMap", "encode_batch", "encode_batches", "read_slice"]

#: Shares of the bound that are tried for the walks of a batch, one after the other.
_SHARES = (0.998, 0.97, 0.9, 0.75)

#: Shares of an RMSE that a batch may exceed where nothing smaller is found: other batches take
#: less, and the sum counts.
_EXCEEDING_SHARES = (1.02, 1.05)

#: Shares of a maximum error to which knots are inserted at last.
_INSERTION_SHARES = (1.0, 0.7, 0.5)

#: The same for an RMSE: a maximum of 1.7 RMSE mostly keeps it.
_INSERTION_SHARES_OF_RMSE = (1.7, 1.0, 0.7)

#: Times of shapes where nothing else is known: a metre takes a second.
_PLAIN_TIMES = SyntheticTimes()

#: Batches of the first wave; each wave has twice as many as the one before.
_WAVE = 8

#: Knots of the walks that later batches know, at most: priming a coder takes time for each.
_MAX_PRIOR_KNOTS = 100_000


@dataclass(frozen=True, eq=False)
class BaseMap:
    """What all batches are encoded on.

    Parameters
    ----------
    grid : QuantisationGrid
        Of nodes and times.
    prior : Prior
        Walks that are known, and with them the nodes.
    gap : float
        Seconds above which an interval is a gap.
    options : Options
        With the bound that each batch is to hold.
    refinements : int
        How often the steps of a known map are halved.
    share : float
        Share of a batch in the work that the effort allows.
    shape_times : SyntheticTimes
        Times of tracks without any.
    """

    grid: QuantisationGrid
    prior: Prior
    gap: float
    options: Options
    refinements: int = 0
    share: float = 1.0
    shape_times: SyntheticTimes = _PLAIN_TIMES


def encode_batches(
    log: Log,
    base: BaseMap,
    batches: Sequence[Sequence[Slice]],
    executor: Executor,
    report: Callable[[float], None],
) -> GridWalks:
    """Encode all batches and join the walks of each track.

    Parameters
    ----------
    log : Log
        Shapes get the times of ``base``.
    base : BaseMap
        What is known before.
    batches : sequence of sequences of Slice
        All samples of the log.
    executor : Executor
        Where batches are encoded.
    report : callable
        Called with the share that is done.

    Returns
    -------
    GridWalks
        The known nodes, then others in the order of their first visit, no two at one position;
        a walk for each track.

    Raises
    ------
    BoundError
        If a batch can't hold the bound.
    """
    # Encode in waves: the batches of one know the nodes that all waves before it added.
    state = _EncodedSoFar(log, base)
    done = 0
    for wave in _waves(batches):
        with share_value(executor, state.base) as shared:
            work = ([read_slice(log, each) for each in batch] for batch in wave)
            for batch, grid_walks in zip(wave, shared.map(encode_batch, work), strict=True):
                state.add(batch, grid_walks)
                done += 1
                report(done / len(batches))
        state.extend_base()

    # Nodes that several batches added at one position become one.
    nodes = state.grid_walks.nodes
    _, first, number = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    merged = first[number.reshape(-1)].astype(np.int32)
    walks = tuple(
        GridWalk(merged[walk.nodes], walk.time_steps, walk.gaps) for walk in state.grid_walks.walks
    )
    return number_by_visit(GridWalks(nodes, walks), base.prior.nodes)


def read_slice(log: Log, which: Slice) -> Track:
    """Read the samples of a slice, overlaps included."""
    track = log.read(log.tracks[which.track], which.first, which.last)
    return replace(track, id=which.name)


def encode_batch(base: BaseMap, tracks: Sequence[Track]) -> GridWalks:
    """Encode one batch; of the nodes, only those are returned that it adds.

    Nodes of the walks count the known ones first, then the added ones.
    """
    known = base.prior.nodes
    grid_walks = number_by_visit(_walks_within_bound(base, tracks), known)
    return replace(grid_walks, nodes=grid_walks.nodes[known:])


def _waves(batches: Sequence[Sequence[Slice]]) -> Iterator[Sequence[Sequence[Slice]]]:
    first, count = 0, _WAVE
    while first < len(batches):
        yield batches[first : first + count]
        first, count = first + count, 2 * count


class _EncodedSoFar:
    """Walks encoded so far, and the base map for those to come."""

    def __init__(self, log: Log, base: BaseMap) -> None:
        self.log = log
        self.base = base
        self._nodes = [base.prior.walks.nodes]
        self._walks: list[GridWalk | None] = [None] * len(log.tracks)
        # Number of each node of the base map among all nodes.
        self._number = np.arange(base.prior.nodes)
        # Walks of batches that later ones don't know yet, with the numbers of their nodes.
        self._unknown: list[tuple[GridWalks, NDArray[np.int64]]] = []

    @property
    def grid_walks(self) -> GridWalks:
        """All walks."""
        walks = tuple(walk for walk in self._walks if walk is not None)
        return GridWalks(np.concatenate(self._nodes), walks)

    def add(self, batch: Sequence[Slice], grid_walks: GridWalks) -> None:
        """Add the walks of a batch, of which ``grid_walks`` holds the added nodes alone."""
        # Number the nodes of the batch among all.
        added = sum(map(len, self._nodes)) + np.arange(len(grid_walks.nodes))
        number = np.concatenate([self._number, added]).astype(np.int32)
        self._nodes.append(grid_walks.nodes)
        if len(added):
            self._unknown.append((grid_walks, added))

        # a slice continues the walk of its track
        for each, walk in zip(batch, grid_walks.walks, strict=True):
            renumbered = GridWalk(number[walk.nodes], walk.time_steps, walk.gaps)
            before = self._walks[each.track]
            self._walks[each.track] = (
                renumbered if before is None else self._joined(before, renumbered, each)
            )

    def extend_base(self) -> None:
        """Add the new nodes, and the walks that visit them, to the base map."""
        # Find how many knots the prior may still take: priming a coder takes time for each.
        prior, known = self.base.prior.walks, self.base.prior.nodes
        capacity = _MAX_PRIOR_KNOTS - sum(len(walk.nodes) for walk in prior.walks)
        nodes, walks, number = [prior.nodes], list(prior.walks), [self._number]

        # As many batches as the prior has capacity for.
        for grid_walks, added in self._unknown:
            visiting = [walk for walk in grid_walks.walks if (walk.nodes >= known).any()]
            capacity -= sum(len(walk.nodes) for walk in visiting)
            if capacity < 0:
                break
            first = sum(map(len, nodes))
            renumber = np.append(np.arange(known), first + np.arange(len(added))).astype(np.int32)
            walks += [
                GridWalk(renumber[walk.nodes], walk.time_steps, walk.gaps) for walk in visiting
            ]
            nodes.append(grid_walks.nodes)
            number.append(added)

        # The coder's model is primed once, before several batches ask for it.
        self._unknown = []
        if len(nodes) > 1:
            extended = Prior(GridWalks(np.concatenate(nodes), tuple(walks)))
            extended.model(0)
            self.base = replace(self.base, prior=extended)
            self._number = np.concatenate(number)

    def _joined(self, before: GridWalk, after: GridWalk, which: Slice) -> GridWalk:
        """Join the walks of two slices; under a maximum, the joint gets the knots that it needs."""
        # Samples that both slices have.
        track = self.log.tracks[which.track]
        last = min(2 * which.begin - which.first, len(track))
        overlap = self.base.shape_times.assign_to(self.log.read(track, which.first, last))
        cut_time = float(overlap.times[which.begin - which.first])

        # The walks, joined where they fit best.
        grid = self.base.grid
        nodes = np.concatenate(self._nodes)
        positions = np.asarray(grid.origin) / 1000 + nodes * step_size(grid.space)
        walk, met = join_at_cut(before, after, overlap, cut_time, grid, positions)
        limit = self.base.options.max_error
        if met or limit is None:
            return walk
        return self._joint_within(limit, walk, overlap, nodes)

    def _joint_within(
        self, limit: float, walk: GridWalk, overlap: Track, nodes: NDArray[np.int64]
    ) -> GridWalk:
        """Insert the knots that the samples of the overlap need to keep a maximum error."""
        # The knots about the overlap.
        grid, steps = self.base.grid, walk.time_steps
        low, high = (overlap.times[[0, -1]] - grid.epoch / 1000) / step_size(grid.time)
        a = max(int(np.searchsorted(steps, low, side="right")) - 1, 0)
        b = min(int(np.searchsorted(steps, high)) + 1, len(steps))
        around = GridWalk(walk.nodes[a:b], steps[a:b], walk.gaps[a : b - 1])

        # With the knots inserted.
        result = enforce_max_error(
            [overlap], grid, GridWalks(nodes, (around,)), limit, known=len(nodes)
        )
        if result is None:
            return walk
        self._nodes.append(result[1].nodes[len(nodes) :])
        new = result[1].walks[0]
        return GridWalk(
            np.concatenate([walk.nodes[:a], new.nodes, walk.nodes[b:]]),
            np.concatenate([steps[:a], new.time_steps, steps[b:]]),
            np.concatenate([walk.gaps[:a], new.gaps, walk.gaps[b - 1 :]]),
        )


def _walks_within_bound(base: BaseMap, tracks: Sequence[Track]) -> GridWalks:
    """Walks on known and new nodes that hold the bound, or exceed an RMSE by a few percent."""
    # Find the gaps: intervals in which nothing is known of the path.
    gaps = [find_gaps(track, base.gap) for track in tracks]
    tracks = [base.shape_times.assign_to(track) for track in tracks]
    options = base.options

    # Aim at a share of the bound, on the known nodes and those that the walks need besides.
    def learn(share: float) -> GridWalks | None:
        target = options.tightened(share)
        return learn_on(
            base.prior,
            base.grid,
            tracks,
            gaps,
            rmse=target.rmse,
            max_error=target.max_error,
            effort=target.effort,
            share=base.share,
        )

    # Tighter and tighter targets.
    for share in _SHARES:
        walks = learn(share)
        if walks is not None and holds(_measure(tracks, walks, base.grid), options):
            return walks
        if walks is None and options.rmse is not None:
            break  # a tighter RMSE can't be reached either

    # An RMSE a little above; other batches take less.
    if options.rmse is not None and options.max_error is None:
        for share in _EXCEEDING_SHARES:
            walks = learn(share)
            if walks is not None:
                return walks
    return _insert_knots(base, tracks, gaps)


def _insert_knots(
    base: BaseMap, tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]
) -> GridWalks:
    """Walks with as many knots as the bound takes, from a straight segment for each piece."""
    # Straight segments, on nodes behind the known ones.
    known = base.prior.walks.nodes
    straight = _straight_walks(tracks, gaps, base.grid)
    shifted = tuple(
        replace(walk, nodes=walk.nodes + np.int32(len(known))) for walk in straight.walks
    )
    start = GridWalks(np.concatenate([known, straight.nodes]), shifted)

    # Knots at the worst samples, until the bound holds.
    options = base.options
    limit = options.max_error or options.rmse or 0.0
    shares = _INSERTION_SHARES if options.max_error is not None else _INSERTION_SHARES_OF_RMSE
    for share in shares:
        result = enforce_max_error(tracks, base.grid, start, share * limit, known=len(known))
        if result is not None and holds(_measure(tracks, result[1], base.grid), options):
            return result[1]
    raise BoundError(
        "the map's grid is too coarse for the bound on some of the log",
        remedy="allow a larger error, or more memory",
    )


def _straight_walks(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], grid: QuantisationGrid
) -> GridWalks:
    """A straight segment from the first sample of each piece to its last."""
    positions, walks, offset = [], [], 0
    for track, gap in zip(tracks, gaps, strict=True):
        beside_gaps = np.flatnonzero(gap)
        ends = np.unique(np.concatenate([[0, len(track) - 1], beside_gaps, beside_gaps + 1]))
        is_gap = gap[ends[:-1]] & (np.diff(ends) == 1)
        nodes = np.arange(offset, offset + len(ends), dtype=np.int32)
        walks.append(Walk(track.id, nodes, track.times[ends], is_gap))
        positions.append(track.positions[ends])
        offset += len(ends)
    return quantise_walks(np.concatenate(positions), walks, grid)


def _measure(
    tracks: Sequence[Track], grid_walks: GridWalks, grid: QuantisationGrid
) -> ErrorSummary:
    walks = dequantise_walks(grid_walks, grid, [track.id for track in tracks])
    return measure_errors(tracks, walks, node_positions(grid_walks, grid))
