"""The second pass over a log larger than memory: batch after batch of its samples becomes walks on what is known by then."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Prior
from gpszip.codec.walks import number_by_visit
from gpszip.errors import BoundError
from gpszip.geo.gaps import find_gaps
from gpszip.io.large.store import StoredTrack
from gpszip.mapping.max_error import enforce_max_error
from gpszip.model import GridWalk, GridWalks, Options, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.pipeline.compress import holds
from gpszip.pipeline.slices import Stretch, seam
from gpszip.run.executor import Executor, share_value
from gpszip.walks.error import ErrorSummary, measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions, quantise_walks

__all__ = ["SHARES", "Ground", "Samples", "lay", "lay_batch", "read_stretch"]

#: Shares of the bound that are tried for the walks, one after the other.
SHARES = (0.998, 0.97, 0.9, 0.75)

#: Shares of a root mean square error that a batch may take which can't be had for less: others take less, and the sum counts.
_OVER = (1.02, 1.05)

#: Batches that are laid on the same ground at first; then ever twice as many. What they add is known to those that follow, as
#: long as the walks that are known have no more than so many knots.
_WAVE, _MOST_KNOTS = 8, 100_000


class Samples(Protocol):
    """Where stretches of tracks are read from."""

    @property
    def tracks(self) -> tuple[StoredTrack, ...]: ...  # noqa: D102

    def read(self, track: StoredTrack, first: int = 0, last: int | None = None) -> Track:
        """Samples of a track."""
        ...


@dataclass(frozen=True, eq=False)
class Ground:
    """What batches have in common, wherever they are worked on; each has so large a share in the work of the effort asked for."""

    grid: QuantisationGrid
    known: Prior
    gap: float
    options: Options
    refinements: int = 0
    share: float = 1.0


def lay(
    log: Samples,
    ground: Ground,
    batches: Sequence[Sequence[Stretch]],
    executor: Executor,
    tell: Callable[[float], None],
) -> GridWalks:
    """Lay all batches and join their walks.

    Batches are laid by themselves, wave by wave: those of one wave on what the waves before have left, so that the result depends
    neither on the executor nor on how many work.

    Parameters
    ----------
    log : Samples
        The log.
    ground : Ground
        What is known before.
    batches : sequence of sequences of Stretch
        All of the log.
    executor : Executor
        Where batches are worked on.
    tell : callable
        Told which share is done.

    Returns
    -------
    LatticeWalks
        The nodes that are known, then others in the order of their first visit, no two at one place; a walk for each track.

    Raises
    ------
    BoundError
        If a batch can't hold the bound.
    """
    sheet, done, fixed = _Sheet(log, ground), 0, ground.known.nodes
    for wave in _waves(batches):
        with share_value(executor, sheet.ground) as shared:
            work = ([read_stretch(log, stretch) for stretch in own] for own in wave)
            for own, grid_walks in zip(wave, shared.map(lay_batch, work), strict=True):
                sheet.add(own, grid_walks)
                done += 1
                tell(done / len(batches))
        sheet.grow()
    _, first, number = np.unique(
        sheet.grid_walks.nodes, axis=0, return_index=True, return_inverse=True
    )
    same = first[number.reshape(-1)].astype(np.int32)
    walks = tuple(
        GridWalk(same[walk.nodes], walk.time_steps, walk.gaps) for walk in sheet.grid_walks.walks
    )
    return number_by_visit(GridWalks(sheet.grid_walks.nodes, walks), fixed)


def _waves(batches: Sequence[Sequence[Stretch]]) -> Iterator[Sequence[Sequence[Stretch]]]:
    first, count = 0, _WAVE
    while first < len(batches):
        yield batches[first : first + count]
        first, count = first + count, 2 * count


class _Sheet:
    """The walks so far, and the ground for those to come."""

    def __init__(self, log: Samples, ground: Ground) -> None:
        self.log, self.ground = log, ground
        self._nodes = [ground.known.walks.nodes]
        self._walks: list[GridWalk | None] = [None] * len(log.tracks)
        self._number = np.arange(ground.known.nodes)  # of each known node among all
        self._fresh: list[tuple[GridWalks, NDArray[np.int64]]] = []

    @property
    def grid_walks(self) -> GridWalks:
        """All walks."""
        return GridWalks(
            np.concatenate(self._nodes), tuple(walk for walk in self._walks if walk is not None)
        )

    def add(self, stretches: Sequence[Stretch], grid_walks: GridWalks) -> None:
        """Take in the walks of a batch over the known nodes and its own, which alone are in the lattice."""
        own = sum(map(len, self._nodes)) + np.arange(len(grid_walks.nodes))
        number = np.concatenate([self._number, own]).astype(np.int32)
        self._nodes.append(grid_walks.nodes)
        if len(own):
            self._fresh.append((grid_walks, own))
        for stretch, walk in zip(stretches, grid_walks.walks, strict=True):
            here = GridWalk(number[walk.nodes], walk.time_steps, walk.gaps)
            before = self._walks[stretch.track]
            self._walks[stretch.track] = (
                here
                if before is None
                else _sewn(self.log, self.ground, before, here, stretch, self._nodes)
            )

    def grow(self) -> None:
        """Make nodes that batches have added known to those that follow, with the walks that visit them."""
        known, fixed = self.ground.known.walks, self.ground.known.nodes
        room = _MOST_KNOTS - sum(len(walk.nodes) for walk in known.walks)
        nodes, walks, number = [known.nodes], list(known.walks), [self._number]
        for grid_walks, own in self._fresh:
            added = sum(map(len, nodes))
            visiting = [walk for walk in grid_walks.walks if (walk.nodes >= fixed).any()]
            room -= sum(len(walk.nodes) for walk in visiting)
            if room < 0:
                break
            renumber = np.append(np.arange(fixed), added + np.arange(len(own))).astype(np.int32)
            walks += [
                GridWalk(renumber[walk.nodes], walk.time_steps, walk.gaps) for walk in visiting
            ]
            nodes.append(grid_walks.nodes)
            number.append(own)
        self._fresh = []
        if len(nodes) > 1:
            prior = Prior(GridWalks(np.concatenate(nodes), tuple(walks)))
            prior.model(0)  # learnt once, before several batches ask for it
            self.ground, self._number = replace(self.ground, known=prior), np.concatenate(number)


def read_stretch(log: Samples, stretch: Stretch) -> Track:
    """Samples of a stretch and of the overlaps about it."""
    return replace(
        log.read(log.tracks[stretch.track], stretch.first, stretch.last),
        id=f"{stretch.track}/{stretch.begin}",
    )


def lay_batch(ground: Ground, tracks: Sequence[Track]) -> GridWalks:
    """Walks of the stretches on the known nodes and new ones after these, of which only the new ones are returned."""
    found = number_by_visit(_walks(ground, tracks), ground.known.nodes)
    return replace(found, nodes=found.nodes[ground.known.nodes :])


def _walks(ground: Ground, tracks: Sequence[Track]) -> GridWalks:
    from gpszip.mapping.on_known_map import learn_on

    gaps = [find_gaps(track, ground.gap) for track in tracks]

    def laid(share: float) -> GridWalks | None:
        aim = ground.options.tightened(share)
        return learn_on(
            ground.known,
            ground.grid,
            tracks,
            gaps,
            rmse=aim.rmse,
            max_error=aim.max_error,
            effort=aim.effort,
            share=ground.share,
        )

    for share in SHARES:
        found = laid(share)
        if found is not None and holds(_fit(tracks, found, ground.grid), ground.options):
            return found
        if found is None and ground.options.rmse is not None:
            break  # nor for less
    over = (
        laid(share)
        for share in _OVER
        if ground.options.rmse is not None and ground.options.max_error is None
    )
    return next((found for found in over if found is not None), None) or _every_need(
        ground, tracks, gaps
    )


def _every_need(
    ground: Ground, tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]
) -> GridWalks:
    """Walks with as many knots as it takes: no sample is farther away than the bound allows."""
    known, own = ground.known.walks.nodes, _ends(tracks, gaps, ground.grid)
    shifted = tuple(replace(walk, nodes=walk.nodes + np.int32(len(known))) for walk in own.walks)
    start = GridWalks(np.concatenate([known, own.nodes]), shifted)
    limit = ground.options.max_error or ground.options.rmse or 0.0
    for share in (1.0, 0.7, 0.5) if ground.options.max_error is not None else (1.7, 1.0, 0.7):
        found = enforce_max_error(tracks, ground.grid, start, share * limit, known=len(known))
        if found is not None and holds(_fit(tracks, found[1], ground.grid), ground.options):
            return found[1]
    raise BoundError(
        "the map's lattice is too coarse for the bound on some of the log; allow a larger error, or more memory"
    )


def _ends(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], grid: QuantisationGrid
) -> GridWalks:
    """Walks straight from the first sample of each piece to its last."""
    places, walks, offset = [], [], 0
    for track, gap in zip(tracks, gaps, strict=True):
        ends = np.unique(
            np.concatenate([[0, len(track) - 1], np.flatnonzero(gap), np.flatnonzero(gap) + 1])
        )
        silent = gap[ends[:-1]] & (np.diff(ends) == 1)
        walks.append(
            Walk(
                track.id,
                np.arange(offset, offset + len(ends), dtype=np.int32),
                track.times[ends],
                silent,
            )
        )
        places.append(track.positions[ends])
        offset += len(ends)
    return quantise_walks(np.concatenate(places), walks, grid)


def _sewn(
    log: Samples,
    ground: Ground,
    before: GridWalk,
    after: GridWalk,
    stretch: Stretch,
    nodes: list[NDArray[np.int64]],
) -> GridWalk:
    """One walk of two stretches; where they don't meet within a maximum, it gets the knots that it needs."""
    track = log.tracks[stretch.track]
    overlap = log.read(track, stretch.first, min(2 * stretch.begin - stretch.first, track.count))
    every = np.concatenate(nodes)
    places = np.asarray(ground.grid.origin) / 1000 + every * step_size(ground.grid.space)
    when = float(overlap.times[stretch.begin - stretch.first])
    walk, met = seam(before, after, overlap, when, ground.grid, places)
    if met or ground.options.max_error is None:
        return walk
    return _mended_seam(ground, walk, overlap, nodes)


def _mended_seam(
    ground: Ground, walk: GridWalk, overlap: Track, nodes: list[NDArray[np.int64]]
) -> GridWalk:
    """The walk with the knots that samples about a seam need to keep the maximum; new nodes are added to the list."""
    every = np.concatenate(nodes)
    low, high = (overlap.times[[0, -1]] - ground.grid.epoch / 1000) / step_size(ground.grid.time)
    a = max(int(np.searchsorted(walk.time_steps, low, side="right")) - 1, 0)
    b = min(int(np.searchsorted(walk.time_steps, high)) + 1, len(walk.time_steps))
    part = GridWalk(walk.nodes[a:b], walk.time_steps[a:b], walk.gaps[a : b - 1])
    found = enforce_max_error(
        [overlap],
        ground.grid,
        GridWalks(every, (part,)),
        ground.options.max_error or 0.0,
        known=len(every),
    )
    if found is None:
        return walk
    nodes.append(found[1].nodes[len(every) :])
    new = found[1].walks[0]
    return GridWalk(
        np.concatenate([walk.nodes[:a], new.nodes, walk.nodes[b:]]),
        np.concatenate([walk.time_steps[:a], new.time_steps, walk.time_steps[b:]]),
        np.concatenate([walk.gaps[:a], new.gaps, walk.gaps[b - 1 :]]),
    )


def _fit(tracks: Sequence[Track], grid_walks: GridWalks, grid: QuantisationGrid) -> ErrorSummary:
    return measure_errors(
        tracks,
        dequantise_walks(grid_walks, grid, [track.id for track in tracks]),
        node_positions(grid_walks, grid),
    )
