"""Walks changed until no sample is farther away than a maximum.

Where a segment misses a sample by more, it gets another knot at its worst sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.numbering import number_by_visit
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.walks.error import TIME_SLACK, positions_at, synchronised_errors
from gpszip.walks.quantised import knot_times

__all__ = ["enforce_max_error"]

#: New knots take an existing node within this share of the maximum.
_SNAP_SHARE = 0.5

#: Largest number of refinements of the grid.
_REFINEMENTS = 8

#: Step indices of an octave: so many make half the step size.
_OCTAVE = 8

#: Every so many refinements, space is refined in place of time.
_SPACE_REFINEMENT_EVERY = 3

#: Share of the maximum to which a shifted knot brings a sample.
_SHIFTED_SHARE = 0.9

#: Rounds without another knot after which a walk that still misses is given up.
_MAX_STALE_ROUNDS = 24

#: Segments on either side of one that misses the maximum that its changes may concern.
_SEGMENTS_BESIDE = 2

#: Rounds after which a walk that still misses is given up.
_MAX_ROUNDS = 400


def enforce_max_error(
    tracks: Sequence[Track],
    grid: QuantisationGrid,
    grid_walks: GridWalks,
    max_error: float,
    *,
    known: int | None = None,
) -> tuple[QuantisationGrid, GridWalks] | None:
    """Add knots, or move them to other nodes, until each sample is within a maximum of its walk.

    Where the grid is too coarse for that, its time step is halved, or every third time its space
    step.

    Parameters
    ----------
    tracks : sequence of Track
        The samples.
    grid : QuantisationGrid
        The grid of the walks.
    grid_walks : GridWalks
        One walk with times for each track, which covers the track's samples.
    max_error : float
        Largest synchronised distance in metres.
    known : int, optional
        Number of the first nodes that belong to an existing map: they stay, and so does the grid.

    Returns
    -------
    (QuantisationGrid, GridWalks) or None
        None if the maximum is still missed.

    Examples
    --------
    >>> track = Track("a", range(5), [[0.0, 0.0], [1.0, 0.0], [2.0, 4.0], [3.0, 0.0], [4.0, 0.0]])
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 4]), np.array([False]))
    >>> grid = QuantisationGrid((0, 0), 0, 128, 128)
    >>> walks = GridWalks(np.array([[0, 0], [4, 0]]), (walk,))
    >>> _, changed = enforce_max_error([track], grid, walks, 0.5)
    >>> changed.walks[0].time_steps.tolist()
    [0, 1, 2, 3, 4]
    """
    # Try the grid as it is, then finer ones.
    for refinement in range(_REFINEMENTS):
        # Change one walk after the other; all share the new nodes.
        nodes, walks, is_missed = grid_walks.nodes, list(grid_walks.walks), False
        for number, track in enumerate(tracks):
            walks[number], nodes, misses = _enforce_on_walk(
                track, walks[number], nodes, grid, max_error
            )
            is_missed = is_missed or misses
        if not is_missed:
            return grid, number_by_visit(
                GridWalks(nodes, tuple(walks), grid_walks.timed), known or 0
            )

        # Refine the grid, and begin again with the walks as given.
        if known is not None or min(grid.space, grid.time) < _OCTAVE:
            break
        if refinement % _SPACE_REFINEMENT_EVERY == _SPACE_REFINEMENT_EVERY - 1:
            grid, grid_walks = _refine_space(grid, grid_walks)
        else:
            grid, grid_walks = _refine_time(grid, grid_walks)
    return None


def _refine_time(
    grid: QuantisationGrid, grid_walks: GridWalks
) -> tuple[QuantisationGrid, GridWalks]:
    walks = tuple(GridWalk(walk.nodes, 2 * walk.time_steps, walk.gaps) for walk in grid_walks.walks)
    return replace(grid, time=grid.time - _OCTAVE), replace(grid_walks, walks=walks)


def _refine_space(
    grid: QuantisationGrid, grid_walks: GridWalks
) -> tuple[QuantisationGrid, GridWalks]:
    refined_walks = replace(grid_walks, nodes=2 * grid_walks.nodes)
    return replace(grid, space=grid.space - _OCTAVE), refined_walks


def _enforce_on_walk(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> tuple[GridWalk, NDArray[np.int64], bool]:
    """Changed walk and nodes, and whether the maximum is still missed."""
    # A change moves little of the walk: measure all samples before and after all changes, and only
    # those about the misses between them.
    for _ in range(_MAX_ROUNDS):
        near = _find_samples_near_misses(track, walk, nodes, grid, max_error)
        if len(near) == 0:
            return walk, nodes, False
        part = Track(track.id, track.times[near], track.positions[near])
        walk, nodes, is_missed = _enforce_on_samples(part, walk, nodes, grid, max_error)
        if is_missed:
            break
    return walk, nodes, True


def _find_samples_near_misses(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> NDArray[np.intp]:
    """The samples of each segment that misses the maximum, and of some to either side."""
    # Find the segments that miss it.
    worst = _find_worst_samples(track, walk, nodes, grid, max_error)
    times = knot_times(walk.time_steps, grid)
    segment = np.searchsorted(times, track.times[worst], side="right")

    # Mark the samples from some knots before to some knots behind each.
    first = times[np.clip(segment - 1 - _SEGMENTS_BESIDE, 0, len(times) - 1)]
    last = times[np.clip(segment + _SEGMENTS_BESIDE, 0, len(times) - 1)]
    changes = np.zeros(len(track) + 1, np.int64)
    np.add.at(changes, np.searchsorted(track.times, first - TIME_SLACK), 1)
    np.add.at(changes, np.searchsorted(track.times, last + TIME_SLACK, side="right"), -1)
    return np.flatnonzero(np.cumsum(changes[:-1]))


def _enforce_on_samples(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> tuple[GridWalk, NDArray[np.int64], bool]:
    """Changed walk and nodes, and whether some of a track's samples still miss the maximum."""
    # Find the samples that miss the maximum; give up after some rounds without a new knot.
    stale_rounds = 0
    for turn in range(_MAX_ROUNDS):
        worst = _find_worst_samples(track, walk, nodes, grid, max_error)
        if len(worst) == 0:
            return walk, nodes, False
        if stale_rounds > _MAX_STALE_ROUNDS:
            break

        # Shift knots every other round while no segment takes another one; else add knots at
        # nodes, which have to be nearer and nearer.
        knots = len(walk.time_steps)
        if stale_rounds and turn % 2 == 0:
            walk, nodes = _shift_knots(track, worst, walk, nodes, grid, max_error)
        else:
            time_steps = _choose_time_steps(track.times[worst], walk, grid, beside=turn % 2 == 1)
            knot_nodes, nodes = _find_nodes(
                track, time_steps, nodes, grid, _SNAP_SHARE ** (1 + turn / 4) * max_error
            )
            walk = _insert_knots(walk, time_steps, knot_nodes)
        stale_rounds = stale_rounds + 1 if len(walk.time_steps) == knots else 0
    return walk, nodes, True


def _find_worst_samples(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> NDArray[np.intp]:
    """The farthest sample of each segment, where that is too far away."""
    # Measure all samples.
    positions = np.asarray(grid.origin, dtype=np.float64) / 1000 + nodes * step_size(grid.space)
    times = knot_times(walk.time_steps, grid)
    errors = synchronised_errors(track, Walk(track.id, walk.nodes, times, walk.gaps), positions)

    # Of those that are too far away, keep the farthest of each segment.
    too_far = np.flatnonzero(errors > max_error)
    segment = np.searchsorted(times, track.times[too_far], side="right")
    order = np.lexsort((-errors[too_far], segment))
    is_first = np.append(True, np.diff(segment[order]) > 0)[: len(order)]
    worst: NDArray[np.intp] = np.sort(too_far[order[is_first]])
    return worst


def _shift_knots(
    track: Track,
    worst: NDArray[np.intp],
    walk: GridWalk,
    nodes: NDArray[np.int64],
    grid: QuantisationGrid,
    max_error: float,
) -> tuple[GridWalk, NDArray[np.int64]]:
    """Shift knots at adjacent time steps so that the samples between them come within the maximum.

    Of the two knots around a sample, the nearer one gets a new node.
    """
    # Samples in time steps; those between two adjacent knots.
    exact_steps = (track.times[worst] - grid.epoch / 1000) / step_size(grid.time)
    nearest = np.clip(
        np.rint(exact_steps).astype(np.int64), walk.time_steps[0], walk.time_steps[-1]
    )
    second = nearest + np.where(exact_steps >= nearest, 1, -1)
    is_between = np.isin(nearest, walk.time_steps) & np.isin(second, walk.time_steps)
    worst, exact_steps, nearest = worst[is_between], exact_steps[is_between], nearest[is_between]

    # Offset of each sample from the walk.
    size = step_size(grid.space)
    origin = np.asarray(grid.origin, dtype=np.float64) / 1000
    decoded = Walk(track.id, walk.nodes, knot_times(walk.time_steps, grid), walk.gaps)
    offset = track.positions[worst] - positions_at(
        decoded, origin + nodes * size, track.times[worst]
    )

    # A knot's shift moves the walk at the sample by its share of the time; shift so far that only
    # a share of the maximum remains.
    shift = (1 - _SHIFTED_SHARE * max_error / np.linalg.norm(offset, axis=1)) / (
        1 - np.abs(exact_steps - nearest)
    )
    knot = np.searchsorted(walk.time_steps, nearest)
    new_nodes = nodes[walk.nodes[knot]] + np.rint(offset * shift[:, None] / size).astype(np.int64)
    knot_nodes = walk.nodes.copy()
    knot_nodes[knot] = np.arange(len(nodes), len(nodes) + len(knot), dtype=np.int32)
    return replace(walk, nodes=knot_nodes), np.concatenate((nodes, new_nodes))


def _choose_time_steps(
    times: NDArray[np.float64], walk: GridWalk, grid: QuantisationGrid, *, beside: bool
) -> NDArray[np.int64]:
    """The nearest time step to each time, in the order of time.

    With ``beside``, the second nearest where a knot has the nearest and none the second nearest.
    """
    exact_steps = (times - grid.epoch / 1000) / step_size(grid.time)
    nearest = np.rint(exact_steps).astype(np.int64)
    if beside:
        second = nearest + np.where(exact_steps >= nearest, 1, -1)
        nearest = np.where(
            np.isin(nearest, walk.time_steps) & ~np.isin(second, walk.time_steps), second, nearest
        )
    return np.unique(np.clip(nearest, walk.time_steps[0], walk.time_steps[-1]))


def _find_nodes(
    track: Track,
    time_steps: NDArray[np.int64],
    nodes: NDArray[np.int64],
    grid: QuantisationGrid,
    reach: float,
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Node near the track at each time step: an existing one within reach, else a new one.

    Returns
    -------
    knot_nodes : int32 array
        Node of each time step.
    nodes : int64 array, shape (V, d)
        The nodes with the new ones.
    """
    # Positions of the track in grid steps.
    size = step_size(grid.space)
    positions = (
        _box_centres(track, knot_times(time_steps, grid), step_size(grid.time) / 2)
        - np.asarray(grid.origin) / 1000
    ) / size

    # Round those without a near node to new nodes.
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(nodes).query(positions)
    is_new = distance * size > reach
    new_nodes, number = np.unique(
        np.rint(positions[is_new]).astype(np.int64), axis=0, return_inverse=True
    )
    knot_nodes = np.where(is_new, 0, nearest).astype(np.int32)
    knot_nodes[is_new] = len(nodes) + number.reshape(-1)
    return knot_nodes, np.concatenate((nodes, new_nodes))


def _box_centres(
    track: Track, times: NDArray[np.float64], half_width: float
) -> NDArray[np.float64]:
    """Centre of the bounding box of the samples within ``half_width`` seconds of each time.

    Where there are no samples, it is the interpolated position.
    """
    centres = np.stack([np.interp(times, track.times, axis) for axis in track.positions.T], axis=1)
    first = np.searchsorted(track.times, times - half_width)
    after = np.searchsorted(track.times, times + half_width)
    has_samples = after > first
    if has_samples.any():
        # Reduceat takes bounds in pairs; a row of padding lets the last one end at the end.
        bounds = np.stack((first[has_samples], after[has_samples]), axis=1).ravel()
        padded = np.concatenate((track.positions, track.positions[-1:]))
        low = np.minimum.reduceat(padded, bounds)[::2]
        high = np.maximum.reduceat(padded, bounds)[::2]
        centres[has_samples] = (low + high) / 2
    return centres


def _insert_knots(
    walk: GridWalk, time_steps: NDArray[np.int64], knot_nodes: NDArray[np.int32]
) -> GridWalk:
    """Insert knots into a walk; a knot at the same time step moves to the new node.

    In gaps, no knots are inserted.
    """
    # Move knots at the same time steps.
    after = np.searchsorted(walk.time_steps, time_steps)
    is_same = walk.time_steps[np.minimum(after, len(walk.time_steps) - 1)] == time_steps
    nodes = walk.nodes.copy()
    nodes[after[is_same]] = knot_nodes[is_same]

    # Insert the others.
    is_between = ~is_same & ~np.append(walk.gaps, True)[after - 1]
    index = after[is_between]
    return GridWalk(
        np.insert(nodes, index, knot_nodes[is_between]),
        np.insert(walk.time_steps, index, time_steps[is_between]),
        np.insert(walk.gaps, index - 1, False),
    )
