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
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid, refined_grid, step_index
from gpszip.model.grid_walks import GridWalks, ends_of_walks
from gpszip.run.executor import Executor, share_value

if TYPE_CHECKING:
    from gpszip.codec.prior import Prior

__all__ = ["new_archive", "with_error_bound", "with_sampling", "with_sections"]

#: Smaller archives are not told how their log was sampled: a byte is a byte.
_MIN_BYTES_WITH_SAMPLING = 256

#: Groups of walks take at least this many bytes, so that cutting an archive in groups costs next to nothing.
_GROUP_BYTES = 1 << 16


def new_archive(
    grid: QuantisationGrid,
    ids: Sequence[str],
    grid_walks: GridWalks,
    *,
    layer: str | None = None,
    extras: Sequence[Section] = (),
    known_map: Archive | None = None,
    refinements: int = 0,
    executor: Executor | None = None,
    spans: Sequence[NDArray[np.float64]] | None = None,
    step: float = 0.0,
) -> Archive:
    """Code map and walks as an archive.

    Parameters
    ----------
    grid : Frame
        The lattice; on a map kept elsewhere, that map's own, its quanta halved ``halvings`` times.
    ids : sequence of str
        Name of each walk.
    grid_walks : LatticeWalks
        Nodes in the order in which the walks first visit them, after those of the map kept elsewhere.
    layer : str, optional
        ``"bz2"`` packs the walks once more.
    extras : sequence of Section
        What is kept besides.
    known_map : Archive, optional
        The map on which the walks lie, if it is not to be in the archive.
    refinements : int, default 0
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
    from gpszip.codec.ends import find_piece_ends
    from gpszip.codec.modes import encode_smallest

    prior = None if known_map is None else known_map.prior(refinements)
    own = grid if known_map is None else refined_grid(known_map.grid, refinements)
    if spans is not None and grid_walks.timed:
        grid_walks = replace(grid_walks, ends=find_piece_ends(spans, grid_walks, own, step))
    payload = encode_smallest(grid_walks, prior, executor, grid=own)
    groups = [Group(0, len(ids), payload)]
    if len(payload) >= 2 * _GROUP_BYTES and len(ids) > 1:
        groups = _encode_groups(grid_walks, own, len(payload) // _GROUP_BYTES, prior, executor)
    reference = None if known_map is None else MapReference(known_map.hash, refinements)
    contents = Contents(
        grid if known_map is None else None,
        tuple(ids),
        tuple(groups),
        reference,
        tuple(extras),
        layer,
    )
    if known_map is not None and contents.is_single_group and contents.ids == known_map.ids[:1]:
        contents = replace(contents, ids=None)
    return Archive(contents, known_map)


def with_sections(archive: Archive, extras: Sequence[Section]) -> Archive:
    """Return the archive with further sections."""
    return replace(
        archive, contents=replace(archive.contents, extras=(*archive.contents.extras, *extras))
    )


def with_error_bound(archive: Archive, error_bound: ErrorBound | None) -> Archive:
    """Return the archive with what its walks have been found to keep."""
    return replace(archive, contents=replace(archive.contents, error_bound=error_bound))


def with_sampling(archive: Archive, seconds: float | None) -> Archive:
    """Return the archive with the time between two samples of its log, where a byte for that is less than half a percent."""
    if seconds is None or archive.size < _MIN_BYTES_WITH_SAMPLING:
        return archive
    return replace(archive, contents=replace(archive.contents, sampling=step_index(seconds)))


def _encode_groups(
    grid_walks: GridWalks,
    grid: QuantisationGrid,
    count: int,
    prior: Prior | None,
    executor: Executor | None,
) -> list[Group]:
    """Cut the walks in at most so many runs of about as many knots each."""
    ends = np.cumsum([len(walk.nodes) for walk in grid_walks.walks])
    cuts = np.unique(np.searchsorted(ends, ends[-1] * np.arange(1, count) / count, side="right"))
    bounds = [0, *(int(cut) for cut in cuts if 0 < cut < len(ends)), len(ends)]
    with share_value(executor, (grid_walks, grid, prior)) as shared:
        return list(shared.map(_encode_group, pairwise(bounds)))


def _encode_group(
    shared: tuple[GridWalks, QuantisationGrid, Prior | None], run: tuple[int, int]
) -> Group:
    """Code one run of walks by itself."""
    from gpszip.codec.modes import encode_smallest
    from gpszip.codec.walks import number_by_visit

    (grid_walks, grid, prior), (first, after) = shared, run
    walks = grid_walks.walks[first:after]
    span = (
        min(int(walk.time_steps[0]) for walk in walks),
        max(int(walk.time_steps[-1]) for walk in walks),
    )
    part = GridWalks(
        grid_walks.nodes, walks, grid_walks.timed, ends_of_walks(grid_walks, first, after)
    )
    part = replace(
        part,
        untimed=frozenset(
            number - first for number in grid_walks.untimed if first <= number < after
        ),
    )
    own = number_by_visit(part, 0 if prior is None else prior.nodes)
    return Group(first, after - first, encode_smallest(own, prior, grid=grid), span)
