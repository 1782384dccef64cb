"""Logs larger than memory: a map is learnt from an excerpt, then batch after batch of all samples becomes walks on it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, open_archive, promising, sampled
from gpszip.coding.past import Past
from gpszip.errors import BoundError, OptionError
from gpszip.geo.gaps import estimate_gap, silences
from gpszip.geo.sampling import sampling_step
from gpszip.io.streaming import StoredLog, count_rows, store_logs
from gpszip.mapping.connected import RMSE_OF_MAXIMUM
from gpszip.mapping.fitting import Fit, fit
from gpszip.mapping.lattice_map import join_lattices, node_positions, to_lattice, walks_of
from gpszip.mapping.maximum import mend
from gpszip.mapping.stretches import Stretch, cut_stretches, gather, seam
from gpszip.model import Executor, Frame, LatticeWalk, LatticeWalks, Listener, Options, Progress, Reading, Report, Track, Walk
from gpszip.model.executor import sharing
from gpszip.model.frame import quantum
from gpszip.pipeline.compressing import holds, promised, report_on

__all__ = ["compress_large", "fits"]

#: Bytes that one sample takes at most while a whole log is compressed in memory, and those that the program takes by itself.
_IN_MEMORY, _PROGRAM = 700, 300 << 20

#: Bytes for a row that is being sorted, for a sample of the excerpt, and for one of a batch.
_SORTED, _LEARNT, _LAID = 150, 700, 1200

#: Samples of a batch, of which several are in work at once, and of an excerpt at most.
_BATCH, _AT_ONCE, _EXCERPT = 100_000, 4, 2_000_000

#: A log is dense if blocks of so many samples, on average, have lines whose RMSE is at most this share of the bound.
_DENSE, _LINES = 40, 0.8

#: Shares of the bound for which a map is learnt, until one is found; else so many samples are the map as they are. Walks on a map
#: whose nodes stay need some room for error; on one that was learnt without any, some batches can't hold the bound.
_EXCERPT_SHARES, _VERBATIM = (0.95, 0.85, 0.75), 1000

#: Shares of the bound that are tried for the walks, one after the other.
_SHARES = (0.998, 0.97, 0.9, 0.75)

#: Shares of a root mean square error that a batch may take which can't be had for less: others take less, and the sum counts.
_OVER = (1.02, 1.05)


@dataclass(frozen=True, eq=False)
class _Ground:
    """What all batches have in common, wherever they are worked on."""

    frame: Frame
    known: Past
    gap: float
    options: Options


def fits(sources: Any, memory: int, *, format: str | None = None, columns: Any = None) -> bool:
    """Whether logs can be compressed as a whole within so many bytes of memory."""
    return _PROGRAM + _IN_MEMORY * count_rows(sources, format=format, columns=columns) <= memory


def compress_large(
    sources: Any,
    options: Options,
    *,
    memory: int,
    executor: Executor | None = None,
    progress: Listener | None = None,
    **reading: Any,
) -> tuple[Archive, Report, Reading]:
    """Compress logs of any size in bounded memory.

    The first pass sorts all samples by track and time into a temporary file. From an excerpt of whole stretches, evenly
    spread over the log, frame and map are learnt as usual. The second pass lays batches of tracks, long ones cut in stretches,
    as walks on that map, each by itself, so that the result does not depend on the executor. A last pass measures what the
    archive's bytes decode to at every sample.

    Parameters
    ----------
    sources : path, str or sequence of them
        CSV or Parquet of any size, folders of Parquet; other formats file by file.
    options : Options
        With rmse, max_error, or neither; what only a log in memory allows is refused.
    memory : int
        Bytes that the process should take at most, at least 400 MiB; other processes that work for it take no more each.
    executor : Executor, optional
        Where batches are worked on; the log stays with the process that asks. Of threads, as many work as there is memory for.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.
    **reading
        What :func:`gpszip.io.streaming.store_logs` takes.

    Returns
    -------
    Archive, Report, Reading
        The reading is without its tracks.

    Raises
    ------
    OptionError
        If an option needs the whole log at once, or memory is too small.
    BoundError
        If the bound can't be held.
    """
    from gpszip.run.threads import Threads

    start = time.perf_counter()
    _check(options, memory)
    room = memory - _PROGRAM
    tell = progress or (lambda _event: None)
    tell(Progress("read", 0.0))
    with store_logs(sources, rows=room // _SORTED, **reading) as log:
        tell(Progress("read", 1.0))
        excerpt = _excerpt(log, min(room // _LEARNT, _EXCERPT))
        gap = estimate_gap(excerpt) if options.gap is None else options.gap
        options, notes = _bounded(excerpt, gap, options)
        sampling = sampling_step(excerpt, [silences(track, gap) for track in excerpt])
        batch = max(min(_BATCH, room // (_LAID * _AT_ONCE)), 5000)
        workers = executor or Threads()
        if isinstance(workers, Threads):
            workers = Threads(max(min(workers.workers, room // (_LAID * batch)), 1))
        for share in _SHARES:
            ground = _learned(log, excerpt, gap, options.tightened(share), workers, tell)
            archive, found = _laid(log, ground, batch, workers, tell)
            if holds(found, options):
                archive = sampled(promising(archive, promised(options, found)), sampling)
                return archive, report_on(archive, found, options, notes, gap, time.perf_counter() - start), log.reading
    raise BoundError("the bound can't be held batch by batch; allow a larger error, or more memory")


def _check(options: Options, memory: int) -> None:
    if memory < _PROGRAM + (100 << 20):
        raise OptionError(f"{memory / 2**20:.0f} MiB are too little memory to work in; give at least {(_PROGRAM >> 20) + 100} MiB")
    unfit = {
        "k and m": options.thesis, "bytes and ratio": options.sized, "keep": bool(options.keep or options.keep_times),
        "no-times": not options.times, "coreset": options.coreset is not None, "layer": options.layer is not None,
    }  # fmt: skip
    wrong = next((name for name, given in unfit.items() if given), None)
    if wrong is not None:
        raise OptionError(f"{wrong} can't be had of a log larger than the memory given; allow more memory, or leave it out")


def _excerpt(log: StoredLog, samples: int) -> list[Track]:
    """Stretches evenly spread over the log, and the one that begins first, of about so many samples in all."""
    stretches = cut_stretches([track.count for track in log.tracks], max(min(_BATCH, samples // 4), 1000))
    earliest = min(range(len(log.tracks)), key=lambda i: log.read(log.tracks[i], 0, 1).times[0])
    first = next(one for one in stretches if one.track == earliest)
    total = sum(one.end - one.begin for one in stretches)
    chosen, reached, taken = [], 0, 0
    for one in stretches:
        reached += one.end - one.begin
        # as much of the samples so far as the budget is of all samples
        if one is first or taken + (one.end - one.begin) / 2 <= min(samples / total, 1.0) * reached:
            chosen.append(one)
            taken += one.end - one.begin
    return [replace(log.read(log.tracks[one.track], one.begin, one.end), id=f"{one.track}/{one.begin}") for one in chosen]


def _bounded(excerpt: Sequence[Track], gap: float, options: Options) -> tuple[Options, tuple[str, ...]]:
    from gpszip.mapping.noise import sensible_rmse

    if options.bounded:
        return options, ()
    rmse = sensible_rmse(excerpt, [silences(track, gap) for track in excerpt])
    return replace(options, rmse=rmse), (f"no bound was given: RMSE {rmse:g} m was estimated from an excerpt",)


def _learned(log: StoredLog, excerpt: Sequence[Track], gap: float, options: Options, executor: Executor, tell: Listener) -> _Ground:
    from gpszip.mapping.connected import learn
    from gpszip.mapping.verbatim import keep_samples

    gaps = [silences(track, gap) for track in excerpt]
    few, few_gaps = _thinned(excerpt, gaps, options)
    found = None
    for share in _EXCERPT_SHARES:
        aim = options.tightened(share)
        found = found or learn(
            few, few_gaps, rmse=aim.rmse, max_error=aim.max_error, effort=aim.effort, executor=executor,
            progress=lambda done, whole: tell(Progress("learn", done / whole)),
        )  # fmt: skip
    if found is None:
        start = log.read(log.tracks[0], 0, min(_VERBATIM, log.tracks[0].count))
        found = keep_samples([start], [silences(start, gap)], options.max_error or options.rmse or 0.0)
    known = Past(found[1])
    known.model(0)  # learnt once, before several batches ask for it
    return _Ground(found[0], known, gap, options)


def _thinned(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], options: Options
) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """Few weighted samples of a log that is sampled far more densely than its error asks for: they show more of it at once."""
    from gpszip.mapping.thinning import thin_out
    from gpszip.sketches.partition import build

    size = sum(map(len, tracks)) // _DENSE
    bound = options.rmse if options.rmse is not None else RMSE_OF_MAXIMUM * (options.max_error or 0.0)
    if size < len(tracks) or build(tracks, size=size).rmse > _LINES * bound:
        return tracks, gaps
    return thin_out(tracks, gaps, size)


def _laid(log: StoredLog, ground: _Ground, batch: int, executor: Executor, tell: Listener) -> tuple[Archive, Fit]:
    """Lay all batches, join their walks, write and measure the archive."""
    batches = gather(cut_stretches([track.count for track in log.tracks], batch), batch)
    walks: list[LatticeWalk | None] = [None] * len(log.tracks)
    nodes = [ground.known.walks.nodes]
    with sharing(executor, ground) as shared:
        found = shared.map(_lay_batch, ([_read(log, stretch) for stretch in own] for own in batches))
        for number, (own, lattice) in enumerate(zip(batches, found, strict=True), 1):
            new = sum(map(len, nodes)) + np.arange(len(lattice.nodes))
            renumber = np.concatenate([np.arange(ground.known.nodes), new]).astype(np.int32)
            nodes.append(lattice.nodes)
            for stretch, walk in zip(own, lattice.walks, strict=True):
                here = LatticeWalk(renumber[walk.nodes], walk.cells, walk.gaps)
                before = walks[stretch.track]
                walks[stretch.track] = here if before is None else _sewn(log, ground, before, here, stretch, nodes)
            tell(Progress("encode", number / len(batches)))
    lattice = join_lattices([LatticeWalks(np.concatenate(nodes), tuple(walk for walk in walks if walk is not None))])
    archive = new_archive(ground.frame, [track.id for track in log.tracks], lattice)
    return archive, _measured(log, archive, batches, executor, tell)


def _read(log: StoredLog, stretch: Stretch) -> Track:
    return replace(log.read(log.tracks[stretch.track], stretch.first, stretch.last), id=f"{stretch.track}/{stretch.begin}")


def _lay_batch(ground: _Ground, tracks: Sequence[Track]) -> LatticeWalks:
    """Walks of the stretches on the known nodes and new ones after these, of which only the new ones are returned."""
    found = _walks(ground, tracks)
    return replace(found, nodes=found.nodes[ground.known.nodes :])


def _walks(ground: _Ground, tracks: Sequence[Track]) -> LatticeWalks:
    from gpszip.mapping.known import learn_on

    gaps = [silences(track, ground.gap) for track in tracks]

    def laid(share: float) -> LatticeWalks | None:
        aim = ground.options.tightened(share)
        return learn_on(ground.known, ground.frame, tracks, gaps, rmse=aim.rmse, max_error=aim.max_error, effort=aim.effort)

    for share in _SHARES:
        found = laid(share)
        if found is not None and holds(_fit(tracks, found, ground.frame), ground.options):
            return found
        if found is None and ground.options.rmse is not None:
            break  # nor for less
    over = (laid(share) for share in _OVER if ground.options.rmse is not None)
    return next((found for found in over if found is not None), None) or _every_need(ground, tracks, gaps)


def _every_need(ground: _Ground, tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> LatticeWalks:
    """Walks with as many knots as it takes: no sample is farther away than the bound allows."""
    known, own = ground.known.walks.nodes, _ends(tracks, gaps, ground.frame)
    shifted = tuple(replace(walk, nodes=walk.nodes + np.int32(len(known))) for walk in own.walks)
    start = LatticeWalks(np.concatenate([known, own.nodes]), shifted)
    limit = ground.options.max_error or ground.options.rmse or 0.0
    for share in (1.0, 0.7, 0.5) if ground.options.max_error is not None else (1.7, 1.0, 0.7):
        found = mend(tracks, ground.frame, start, share * limit, known=len(known))
        if found is not None and holds(_fit(tracks, found[1], ground.frame), ground.options):
            return found[1]
    raise BoundError("the map's lattice is too coarse for the bound on some of the log; allow a larger error, or more memory")


def _ends(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], frame: Frame) -> LatticeWalks:
    """Walks straight from the first sample of each piece to its last."""
    places, walks, offset = [], [], 0
    for track, gap in zip(tracks, gaps, strict=True):
        ends = np.unique(np.concatenate([[0, len(track) - 1], np.flatnonzero(gap), np.flatnonzero(gap) + 1]))
        silent = gap[ends[:-1]] & (np.diff(ends) == 1)
        walks.append(Walk(track.id, np.arange(offset, offset + len(ends), dtype=np.int32), track.times[ends], silent))
        places.append(track.positions[ends])
        offset += len(ends)
    return to_lattice(np.concatenate(places), walks, frame)


def _sewn(
    log: StoredLog, ground: _Ground, before: LatticeWalk, after: LatticeWalk, stretch: Stretch, nodes: list[NDArray[np.int64]]
) -> LatticeWalk:
    """One walk of two stretches; where they don't meet within a maximum, it gets the knots that it needs."""
    track = log.tracks[stretch.track]
    overlap = log.read(track, stretch.first, min(2 * stretch.begin - stretch.first, track.count))
    every = np.concatenate(nodes)
    places = np.asarray(ground.frame.origin) / 1000 + every * quantum(ground.frame.space)
    when = float(overlap.times[stretch.begin - stretch.first])
    walk, met = seam(before, after, overlap, when, ground.frame, places)
    if met or ground.options.max_error is None:
        return walk
    return _mended_seam(ground, walk, overlap, nodes)


def _mended_seam(ground: _Ground, walk: LatticeWalk, overlap: Track, nodes: list[NDArray[np.int64]]) -> LatticeWalk:
    """The walk with the knots that samples about a seam need to keep the maximum; new nodes are added to the list."""
    every = np.concatenate(nodes)
    low, high = (overlap.times[[0, -1]] - ground.frame.epoch / 1000) / quantum(ground.frame.time)
    a = max(int(np.searchsorted(walk.cells, low, side="right")) - 1, 0)
    b = min(int(np.searchsorted(walk.cells, high)) + 1, len(walk.cells))
    part = LatticeWalk(walk.nodes[a:b], walk.cells[a:b], walk.gaps[a : b - 1])
    found = mend([overlap], ground.frame, LatticeWalks(every, (part,)), ground.options.max_error or 0.0, known=len(every))
    if found is None:
        return walk
    nodes.append(found[1].nodes[len(every) :])
    new = found[1].walks[0]
    return LatticeWalk(
        np.concatenate([walk.nodes[:a], new.nodes, walk.nodes[b:]]),
        np.concatenate([walk.cells[:a], new.cells, walk.cells[b:]]),
        np.concatenate([walk.gaps[:a], new.gaps, walk.gaps[b - 1 :]]),
    )


def _fit(tracks: Sequence[Track], lattice: LatticeWalks, frame: Frame) -> Fit:
    return fit(tracks, walks_of(lattice, frame, [track.id for track in tracks]), node_positions(lattice, frame))


def _measured(log: StoredLog, archive: Archive, batches: Sequence[Sequence[Stretch]], executor: Executor, tell: Listener) -> Fit:
    """Decode the archive's bytes and compare them with every sample, batch by batch."""
    read_back = open_archive(archive.to_bytes())
    walks = read_back.walks
    points, squares, worst, uncovered = 0, 0.0, 0.0, 0
    with sharing(executor, read_back.road_map.nodes) as shared:
        work = ([_with_walk(log, walks[stretch.track], stretch) for stretch in batch] for batch in batches)
        for number, found in enumerate(shared.map(_measure_batch, work), 1):
            points, uncovered, worst = points + found.points, uncovered + found.uncovered, max(worst, found.max_error)
            squares += found.rmse**2 * (found.points - found.uncovered)
            tell(Progress("measure", number / len(batches)))
    return Fit(math.sqrt(squares / max(points - uncovered, 1)), worst, points, uncovered)


def _with_walk(log: StoredLog, walk: Walk, stretch: Stretch) -> tuple[Track, Walk]:
    """Samples of a stretch, and the knots of its track's walk about them."""
    track = log.read(log.tracks[stretch.track], stretch.begin, stretch.end)
    assert walk.times is not None
    first = max(int(np.searchsorted(walk.times, track.times[0])) - 2, 0)
    after = int(np.searchsorted(walk.times, track.times[-1])) + 2
    return track, Walk(walk.id, walk.nodes[first:after], walk.times[first:after], walk.gaps[first : after - 1])


def _measure_batch(nodes: NDArray[np.float64], work: Sequence[tuple[Track, Walk]]) -> Fit:
    return fit([track for track, _ in work], [walk for _, walk in work], nodes)
