"""Join archives that lie on one grid, without learning anything anew: the inverse of selecting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.archive import Archive
from gpszip.archive.create import new_archive, with_error_bound
from gpszip.archive.joined_curves import join_curves
from gpszip.archive.renumber import number_on_known_map
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.errors import OptionError
from gpszip.lossless.kept import smaller_section
from gpszip.model.error_bound import ErrorBound, rounded_bound, rounded_bounds
from gpszip.model.grid_walks import GridWalk, GridWalks
from gpszip.walks.quantised import merge_grid_walks

__all__ = ["join"]

#: What to do with archives that can't be joined.
_REMEDY = "'gpszip merge' makes one map of any archives"

#: Grid steps by which two archives may differ about a knot that both have: new knots are rounded.
_KNOT_TOLERANCE = 1.0

#: Seconds by which two parts may overlap: both round the time of the cut outwards to a
#: millisecond.
_MAX_OVERLAP = 2.5e-3

Floats = NDArray[np.float64]


class _JoinedWalk(NamedTuple):
    """A track as the archives so far have it.

    Parameters
    ----------
    walk : GridWalk
        Its knots.
    time_ranges : float64 array, shape (pieces, 2)
        Seconds at which travel begins and ends in each piece; empty for a shape.
    sources : tuple of (int, int)
        Numbers of the archives and of the track in each, in the order of time.
    """

    walk: GridWalk
    time_ranges: Floats
    sources: tuple[tuple[int, int], ...]


def join(archives: Sequence[Archive], *, names: Sequence[str] | None = None) -> Archive:
    """Join archives that lie on one grid, such as those that one archive was split into.

    Tracks of one id become one, if they follow each other in time: where the knots of one go on
    where those of the other end, without a gap.

    Parameters
    ----------
    archives : sequence of Archive
        At least one.
    names : sequence of str, optional
        What messages call them; their numbers by default.

    Returns
    -------
    Archive
        All tracks, in the order in which the archives first have them. It states the largest of the
        error bounds, if all archives state one of a kind. Columns within an error may differ; each
        stays within the largest of its bounds.

    Raises
    ------
    OptionError
        If there is no archive, grids or known maps differ, tracks of one id overlap in time, or
        some archives keep other exact columns than the others.
    """
    _check_together(archives, names or [f"archive {i + 1}" for i in range(len(archives))])
    first = archives[0]

    # All walks on the nodes of all archives; the same knots have the same nodes.
    walks = merge_grid_walks([archive.grid_walks for archive in archives])
    first_walks = np.cumsum([0, *(len(archive.ids) for archive in archives)]).tolist()

    # Append the walks of each track in the order of time.
    by_id: dict[str, _JoinedWalk] = {}
    for source, number in _by_time(archives):
        walk = archives[source].walks[number]
        own = walks.walks[first_walks[source] + number]
        ranges = walk.time_ranges
        if walk.times is None:
            ranges = np.zeros((0, 2))
        elif ranges is None:
            ranges = _knot_ranges(own, walk.times)
        added = _JoinedWalk(own, ranges, ((source, number),))
        before = by_id.get(walk.id)
        by_id[walk.id] = added if before is None else _append(before, added, walk.id, walks.nodes)

    # One archive of them, with the tracks in the order in which the archives first have them.
    ids = dict.fromkeys(name for archive in archives for name in archive.ids)
    joined = [by_id[name] for name in ids]
    untimed = frozenset(i for i, track in enumerate(joined) if not len(track.time_ranges))
    timed = len(untimed) < len(joined)
    grid_walks = GridWalks(
        walks.nodes,
        tuple(track.walk for track in joined),
        timed,
        untimed=untimed if timed else frozenset(),
    )
    reference = first.contents.map
    whole = new_archive(
        first.grid,
        list(ids),
        number_on_known_map(first, grid_walks),
        layer=first.contents.layer,
        extras=(
            *_kept_section(archives, list(ids), joined),
            *join_curves(archives, [track.sources for track in joined]),
        ),
        known_map=None if reference is None else first.map,
        refinements=0 if reference is None else reference.refinements,
        time_ranges=[track.time_ranges for track in joined] if timed else None,
    )
    whole = with_error_bound(whole, _joint_bound([archive.error_bound for archive in archives]))
    return replace(whole, contents=replace(whole.contents, sampling=first.contents.sampling))


def _check_together(archives: Sequence[Archive], names: Sequence[str]) -> None:
    """Refuse archives that don't lie on one grid, or keep different columns."""
    if not archives:
        raise OptionError("no archive was given to join", remedy="name the parts of an archive")

    # Numbers of nodes and times mean the same on one grid only.
    first = archives[0]
    for archive, where in zip(archives[1:], names[1:], strict=True):
        if archive.grid != first.grid:
            raise OptionError(
                "lies on another grid than the first one", location=where, remedy=_REMEDY
            )
        if archive.contents.map != first.contents.map:
            raise OptionError(
                "lies on another known map than the first one", location=where, remedy=_REMEDY
            )
        if archive.timed != first.timed:
            raise OptionError("of two archives, only one has times", location=where, remedy=_REMEDY)

        # What is kept beside the walks.
        if archive.kept_columns != first.kept_columns:
            raise OptionError(
                "keeps other columns than the first one", location=where, remedy=_REMEDY
            )


def _by_time(archives: Sequence[Archive]) -> list[tuple[int, int]]:
    """Archive and number of each walk, in the order of their first knots."""
    walks = [
        (0.0 if walk.times is None else float(walk.times[0]), source, number)
        for source, archive in enumerate(archives)
        for number, walk in enumerate(archive.walks)
    ]
    return [(source, number) for _, source, number in sorted(walks)]


def _knot_ranges(walk: GridWalk, times: Floats) -> Floats:
    """First and last knot of each piece in seconds, where an archive states no finer ends."""
    gaps = np.flatnonzero(walk.gaps)
    return np.stack([times[np.append(0, gaps + 1)], times[np.append(gaps, len(times) - 1)]], axis=1)


def _append(
    before: _JoinedWalk, after: _JoinedWalk, name: str, nodes: NDArray[np.int64]
) -> _JoinedWalk:
    """Append a later walk of a track.

    Where the first knots of the later walk come before the last knot of the earlier one, both have
    the segment at which the track was cut, and it stands once.
    """
    if not len(before.time_ranges) or not len(after.time_ranges):
        raise OptionError("has no times in several archives", location=f"track {name!r}")
    if after.time_ranges[0, 0] < before.time_ranges[-1, 1] - _MAX_OVERLAP:
        raise OptionError(
            "overlaps in time with the same track of another archive",
            location=f"track {name!r}",
            remedy=_REMEDY,
        )

    # Later knots that the earlier walk has, too.
    shared = int(np.searchsorted(after.walk.time_steps, before.walk.time_steps[-1], side="right"))
    _check_shared(before.walk, after.walk, shared, name, nodes)
    shared = min(shared, len(after.walk.nodes))
    goes_on = shared > 0

    # Without such knots, nothing is known of the time between.
    walk = GridWalk(
        np.concatenate([before.walk.nodes, after.walk.nodes[shared:]]),
        np.concatenate([before.walk.time_steps, after.walk.time_steps[shared:]]),
        np.concatenate(
            [
                before.walk.gaps,
                after.walk.gaps[shared - 1 :] if goes_on else np.append(True, after.walk.gaps),
            ]
        ),
    )
    ranges = np.concatenate([before.time_ranges, after.time_ranges])
    if goes_on:
        ranges = np.concatenate([before.time_ranges, after.time_ranges[1:]])
        ranges[len(before.time_ranges) - 1, 1] = after.time_ranges[0, 1]
    return _JoinedWalk(walk, ranges, before.sources + after.sources)


def _check_shared(
    before: GridWalk, after: GridWalk, shared: int, name: str, nodes: NDArray[np.int64]
) -> None:
    """Refuse knots of a later walk that contradict the earlier walk."""
    steps = after.time_steps[:shared].astype(np.float64)
    own = nodes[after.nodes[:shared]].astype(np.float64)
    is_gap = after.gaps[: max(shared - 1, 0)].any() or (
        shared > 0 and len(before.nodes) > 1 and before.gaps[-1]
    )
    earlier = before.time_steps.astype(np.float64)
    at_same = np.stack([np.interp(steps, earlier, axis) for axis in nodes[before.nodes].T], axis=1)
    if is_gap or (np.abs(at_same - own) > _KNOT_TOLERANCE).any():
        raise OptionError(
            "doesn't go on where another archive ends it",
            location=f"track {name!r}",
            remedy=_REMEDY,
        )


def _kept_section(
    archives: Sequence[Archive],
    ids: Sequence[str],
    joined: Sequence[_JoinedWalk],
) -> tuple[Section, ...]:
    """Kept columns and times of all archives, track by track; nothing where none are kept."""
    if archives[0].kept_columns is None:
        return ()
    times: list[Floats] = []
    columns: dict[str, list[NDArray[np.generic]]] = {name: [] for name in archives[0].kept_columns}
    counts = []
    for name, track in zip(ids, joined, strict=True):
        # A sample at the very time of the cut is in both archives.
        last, count = -np.inf, 0
        for source, _ in track.sources:
            own_times = archives[source].sample_times(name)
            is_new = own_times > last
            times.append(own_times[is_new])
            for column, values in archives[source].attributes(name).items():
                columns[column].append(values[is_new])
            last = max(last, own_times.max(initial=-np.inf))
            count += int(is_new.sum())
        counts.append(count)

    joined_columns = {name: np.concatenate(values) for name, values in columns.items()}
    body = encode_attributes(KeptColumns(tuple(counts), np.concatenate(times), joined_columns))
    return (Section(*smaller_section(body, len(ids))),)


def _joint_bound(bounds: Sequence[ErrorBound | None]) -> ErrorBound | None:
    """Bound that holds for all samples together; None unless all archives state one of a kind."""
    stated = [bound for bound in bounds if bound is not None]
    if len(stated) < len(bounds):
        return None
    if len(set(stated)) == 1:
        return stated[0]

    # A root mean square of all samples is at most the largest of the parts.
    maxima = [bound.metres if bound.maximum else bound.max_error for bound in stated]
    largest = None if None in maxima else max(m for m in maxima if m is not None)
    if any(bound.maximum for bound in stated):
        return None if largest is None else rounded_bound(largest, maximum=True)
    rmse = max(bound.metres for bound in stated)
    return rounded_bound(rmse, maximum=False) if largest is None else rounded_bounds(rmse, largest)
