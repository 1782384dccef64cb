"""From a map and walks on a lattice to an archive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.archive import Archive
from gpszip.container.contents import Contents, Group, MapReference, Section
from gpszip.model.frame import Frame, quantum_index, refined_frame
from gpszip.model.lattice import LatticeWalks, ends_within
from gpszip.model.promise import Promise
from gpszip.run.executor import Executor, sharing

if TYPE_CHECKING:
    from gpszip.codec.prior import Past

__all__ = ["keeping", "new_archive", "promising", "sampled"]

#: Smaller archives are not told how their log was sampled: a byte is a byte.
_TOLD = 256

#: Groups of walks take at least this many bytes, so that cutting an archive in groups costs next to nothing.
_GROUP_BYTES = 1 << 16


def new_archive(
    frame: Frame,
    ids: Sequence[str],
    lattice: LatticeWalks,
    *,
    layer: str | None = None,
    extras: Sequence[Section] = (),
    on: Archive | None = None,
    halvings: int = 0,
    executor: Executor | None = None,
    spans: Sequence[NDArray[np.float64]] | None = None,
    step: float = 0.0,
) -> Archive:
    """Code map and walks as an archive.

    Parameters
    ----------
    frame : Frame
        The lattice; on a map kept elsewhere, that map's own, its quanta halved ``halvings`` times.
    ids : sequence of str
        Name of each walk.
    lattice : LatticeWalks
        Nodes in the order in which the walks first visit them, after those of the map kept elsewhere.
    layer : str, optional
        ``"bz2"`` packs the walks once more.
    extras : sequence of Section
        What is kept besides.
    on : Archive, optional
        The map on which the walks lie, if it is not to be in the archive.
    halvings : int, default 0
        How often that map's quanta are halved.
    executor : Executor, optional
        Where walks, and runs of them, are coded.
    spans : sequence of float64 array, shape (n, 2), optional
        For each walk the times of the first and last sample of each run without a gap, in seconds; between them alone travel is
        claimed. From knot to knot where left out.
    step : float, default 0
        Seconds between two samples, of the track that has the most; ends may be rounded by less than that.

    Returns
    -------
    Archive
        One that has decoded nothing yet: what it answers comes from the bytes.
    """
    from gpszip.codec.ends import ends_of
    from gpszip.codec.modes import encode_smallest

    past = None if on is None else on.past(halvings)
    own = frame if on is None else refined_frame(on.frame, halvings)
    if spans is not None and lattice.timed:
        lattice = replace(lattice, ends=ends_of(spans, lattice, own, step))
    payload = encode_smallest(lattice, past, executor, frame=own)
    groups = [Group(0, len(ids), payload)]
    if len(payload) >= 2 * _GROUP_BYTES and len(ids) > 1:
        groups = _groups(lattice, own, len(payload) // _GROUP_BYTES, past, executor)
    reference = None if on is None else MapReference(on.hash, halvings)
    contents = Contents(frame if on is None else None, tuple(ids), tuple(groups), reference, tuple(extras), layer)
    if on is not None and contents.plain and contents.ids == on.ids[:1]:
        contents = replace(contents, ids=None)
    return Archive(contents, on)


def keeping(archive: Archive, extras: Sequence[Section]) -> Archive:
    """Return the archive with further sections."""
    return replace(archive, contents=replace(archive.contents, extras=(*archive.contents.extras, *extras)))


def promising(archive: Archive, promise: Promise | None) -> Archive:
    """Return the archive with what its walks have been found to keep."""
    return replace(archive, contents=replace(archive.contents, promise=promise))


def sampled(archive: Archive, seconds: float | None) -> Archive:
    """Return the archive with the time between two samples of its log, where a byte for that is less than half a percent."""
    if seconds is None or archive.size < _TOLD:
        return archive
    return replace(archive, contents=replace(archive.contents, sampling=quantum_index(seconds)))


def _groups(lattice: LatticeWalks, frame: Frame, count: int, past: Past | None, executor: Executor | None) -> list[Group]:
    """Cut the walks in at most so many runs of about as many knots each."""
    ends = np.cumsum([len(walk.nodes) for walk in lattice.walks])
    cuts = np.unique(np.searchsorted(ends, ends[-1] * np.arange(1, count) / count, side="right"))
    bounds = [0, *(int(cut) for cut in cuts if 0 < cut < len(ends)), len(ends)]
    with sharing(executor, (lattice, frame, past)) as shared:
        return list(shared.map(_group, pairwise(bounds)))


def _group(shared: tuple[LatticeWalks, Frame, Past | None], run: tuple[int, int]) -> Group:
    """Code one run of walks by itself."""
    from gpszip.codec.modes import encode_smallest
    from gpszip.codec.walks import number_by_visit

    (lattice, frame, past), (first, after) = shared, run
    walks = lattice.walks[first:after]
    span = (min(int(walk.cells[0]) for walk in walks), max(int(walk.cells[-1]) for walk in walks))
    part = LatticeWalks(lattice.nodes, walks, lattice.timed, ends_within(lattice, first, after))
    part = replace(part, untimed=frozenset(number - first for number in lattice.untimed if first <= number < after))
    own = number_by_visit(part, 0 if past is None else past.nodes)
    return Group(first, after - first, encode_smallest(own, past, frame=frame), span)
