"""From a map and walks on a quantisation grid to an archive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.archive import Archive
from gpszip.container.contents import Contents, Group, MapReference, Section
from gpszip.errors import OptionError
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid, refined_grid, step_index
from gpszip.model.grid_walks import GridWalks, ends_of_walks

if TYPE_CHECKING:
    from gpszip.codec.prior import Prior
    from gpszip.run.executor import Executor

__all__ = ["new_archive", "with_error_bound", "with_sampling", "with_sections"]

#: Archives smaller than this don't keep how their log was sampled: the byte for it is more than
#: half a percent of them.
_MIN_BYTES_WITH_SAMPLING = 256

#: Bytes that a group of walks takes at least, so that cutting an archive into groups costs little.
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
    time_ranges: Sequence[NDArray[np.float64]] | None = None,
    step: float = 0.0,
    is_draft: bool = False,
) -> Archive:
    """Code map and walks as an archive.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid of the walks; on a known map, the grid of that map, refined ``refinements`` times.
    ids : sequence of str
        Name of each walk.
    grid_walks : GridWalks
        Nodes in the order in which the walks first visit them, after those of the known map.
    layer : {None, "bz2"}
        ``"bz2"`` packs the walks once more.
    extras : sequence of Section
        Further sections of the file.
    known_map : Archive, optional
        The map on which the walks lie, if it is not to be in the archive.
    refinements : int, default 0
        How often the steps of that map's grid are halved.
    executor : Executor, optional
        Codes walks, and groups of walks.
    time_ranges : sequence of float64 array, shape (n, 2), optional
        For each walk the times of the first and last sample of each gap-free piece, in seconds.
        Travel is claimed between them alone; from the first knot to the last where left out.
    step : float, default 0
        Seconds between two samples of the most densely sampled track. The ``time_ranges`` may be
        rounded by less than that.
    is_draft : bool, default False
        Whether the archive is only worked on, so that its walks are coded in one mode, as one
        group: searching the smallest takes three times as long.

    Returns
    -------
    Archive
        One that has decoded nothing yet: its answers come from the bytes.

    Raises
    ------
    OptionError
        If nodes are numbered in another way.
    """
    from gpszip.codec.ends import find_piece_ends
    from gpszip.codec.modes import encode_smallest
    from gpszip.codec.walks import encode_in_modes

    # The grid and the prior are those of the known map, where there is one.
    prior = None if known_map is None else known_map.prior(refinements)
    _check_numbers(grid_walks, 0 if prior is None else prior.nodes)
    walks_grid = grid if known_map is None else refined_grid(known_map.grid, refinements)
    if time_ranges is not None and grid_walks.timed:
        ends = find_piece_ends(time_ranges, grid_walks, walks_grid, step)
        grid_walks = replace(grid_walks, ends=ends)

    # One group, or several if it is large.
    if is_draft:
        payload, _ = encode_in_modes(grid_walks, prior, 0, np.zeros(0), walks_grid)
    else:
        payload = encode_smallest(grid_walks, prior, executor, grid=walks_grid)
    groups = [Group(0, len(ids), payload)]
    if not is_draft and len(payload) >= 2 * _GROUP_BYTES and len(ids) > 1:
        count = len(payload) // _GROUP_BYTES
        groups = _encode_groups(grid_walks, walks_grid, count, prior, executor)

    # A single track named like the first of the known map needs no name.
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


def _check_numbers(grid_walks: GridWalks, known: int) -> None:
    """Refuse nodes that are not numbered by visit: decoded walks would visit others."""
    # The first visit to a node gives it the number after the highest so far.
    nodes = np.concatenate([np.array([known - 1]), *(walk.nodes for walk in grid_walks.walks)])
    highest = np.maximum.accumulate(nodes)
    if (nodes[1:] > highest[:-1] + 1).any() or highest[-1] >= len(grid_walks.nodes):
        raise OptionError(
            "nodes are not numbered in the order in which the walks first visit them",
            remedy="number them by gpszip.codec.numbering.number_by_visit",
        )


def with_sections(archive: Archive, extras: Sequence[Section]) -> Archive:
    """Return the archive with further sections."""
    return replace(
        archive, contents=replace(archive.contents, extras=(*archive.contents.extras, *extras))
    )


def with_error_bound(archive: Archive, error_bound: ErrorBound | None) -> Archive:
    """Return the archive with the error bound that its walks hold."""
    return replace(archive, contents=replace(archive.contents, error_bound=error_bound))


def with_sampling(archive: Archive, seconds: float | None) -> Archive:
    """Return the archive with the time between two samples of its log, unless it is very small."""
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
    """Cut the walks into at most ``count`` groups of about equally many knots, and code each."""
    from gpszip.run.executor import share_value

    # Cut before each walk that goes beyond an equal share of the knots. A long walk may take up
    # several shares, so that there are fewer groups.
    knots = np.cumsum([len(walk.nodes) for walk in grid_walks.walks])
    quotas = knots[-1] * np.arange(1, count) / count
    cuts = np.unique(np.searchsorted(knots, quotas, side="right"))
    bounds = [0, *(int(cut) for cut in cuts if 0 < cut < len(knots)), len(knots)]
    # Workers get the walks once, rather than with each group.
    with share_value(executor, (grid_walks, grid, prior)) as shared:
        return list(shared.map(_encode_group, pairwise(bounds)))


def _encode_group(
    shared: tuple[GridWalks, QuantisationGrid, Prior | None], bounds: tuple[int, int]
) -> Group:
    """Code the walks ``bounds[0]`` to ``bounds[1] - 1`` as a group of their own."""
    from gpszip.codec.modes import encode_smallest
    from gpszip.codec.numbering import number_by_visit

    # Note the time steps between which the group has travel: queries skip it at other times.
    (grid_walks, grid, prior), (first, after) = shared, bounds
    walks = grid_walks.walks[first:after]
    time_range = (
        min(int(walk.time_steps[0]) for walk in walks),
        max(int(walk.time_steps[-1]) for walk in walks),
    )

    # The group has its own nodes, ends and numbers of walks without times.
    ends = ends_of_walks(grid_walks, first, after)
    untimed = frozenset(number - first for number in grid_walks.untimed if first <= number < after)
    group_walks = number_by_visit(
        GridWalks(grid_walks.nodes, walks, grid_walks.timed, ends, untimed),
        0 if prior is None else prior.nodes,
    )
    payload = encode_smallest(group_walks, prior, grid=grid)
    return Group(first, after - first, payload, time_range)
