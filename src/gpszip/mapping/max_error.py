"""Walks mended until no sample is farther away than a maximum: where a part misses, it gets another knot at its worst sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpszip.codec.walks import number_by_visit
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.walks.error import positions_at, synchronised_errors
from gpszip.walks.quantised import knot_times

__all__ = ["enforce_max_error"]

#: New knots take a node that is already there within this share of the maximum.
_SNAP = 0.5

#: How often the lattice is made finer, and how many indices of quanta make half the size.
_REFINEMENTS, _OCTAVE = 8, 8

#: Share of the maximum to which a shift brings a sample.
_WITHIN = 0.9

#: Rounds without another knot, and rounds in all, after which a walk that still misses is given up.
_STALE, _ROUNDS = 24, 400


def enforce_max_error(
    tracks: Sequence[Track],
    grid: QuantisationGrid,
    grid_walks: GridWalks,
    max_error: float,
    *,
    known: int | None = None,
) -> tuple[QuantisationGrid, GridWalks] | None:
    """Add knots, or move them to other nodes, until no sample is farther from its walk than a maximum.

    Where the lattice is too coarse for that, it gets twice as many cells, or on every third occasion lattice points.

    Parameters
    ----------
    tracks : sequence of Track
        The samples.
    grid : Frame
        The lattice.
    grid_walks : LatticeWalks
        One walk with times for each track, that covers its samples.
    max_error : float
        Largest synchronised distance in metres.
    known : int, optional
        The first so many nodes belong to a map that is there already: they stay, and so does the lattice.

    Returns
    -------
    (Frame, LatticeWalks) or None
        None if the maximum is still missed.

    Examples
    --------
    >>> track = Track("a", range(5), [[0.0, 0.0], [1.0, 0.0], [2.0, 4.0], [3.0, 0.0], [4.0, 0.0]])
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 4]), np.array([False]))
    >>> _, mended = enforce_max_error([track], QuantisationGrid((0, 0), 0, 128, 128), GridWalks(np.array([[0, 0], [4, 0]]), (walk,)), 0.5)
    >>> mended.walks[0].time_steps.tolist()
    [0, 1, 2, 3, 4]
    """
    for finer in range(_REFINEMENTS):
        nodes, walks, missed = grid_walks.nodes, list(grid_walks.walks), False
        for number, track in enumerate(tracks):
            walks[number], nodes, misses = _enforce_on_walk(
                track, walks[number], nodes, grid, max_error
            )
            missed = missed or misses
        if not missed:
            return grid, number_by_visit(
                GridWalks(nodes, tuple(walks), grid_walks.timed), known or 0
            )
        if known is not None or min(grid.space, grid.time) < _OCTAVE:
            break
        grid, grid_walks = (
            _refine_space(grid, grid_walks) if finer % 3 == 2 else _refine_time(grid, grid_walks)
        )
    return None


def _refine_time(
    grid: QuantisationGrid, grid_walks: GridWalks
) -> tuple[QuantisationGrid, GridWalks]:
    walks = tuple(GridWalk(walk.nodes, 2 * walk.time_steps, walk.gaps) for walk in grid_walks.walks)
    return replace(grid, time=grid.time - _OCTAVE), replace(grid_walks, walks=walks)


def _refine_space(
    grid: QuantisationGrid, grid_walks: GridWalks
) -> tuple[QuantisationGrid, GridWalks]:
    return replace(grid, space=grid.space - _OCTAVE), replace(
        grid_walks, nodes=2 * grid_walks.nodes
    )


def _enforce_on_walk(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> tuple[GridWalk, NDArray[np.int64], bool]:
    """Walk and nodes after mending, and whether the maximum is still missed."""
    stale = 0
    for turn in range(_ROUNDS):
        worst = _worst_samples(track, walk, nodes, grid, max_error)
        if len(worst) == 0:
            return walk, nodes, False
        if stale > _STALE:
            break
        knots = len(walk.time_steps)
        if stale and turn % 2 == 0:
            walk, nodes = _shift_knots(track, worst, walk, nodes, grid, max_error)
        else:
            cells = _time_steps(track.times[worst], walk, grid, beside=turn % 2 == 1)
            places, nodes = _find_nodes(
                track, cells, nodes, grid, _SNAP ** (1 + turn / 4) * max_error
            )
            walk = _insert_knots(walk, cells, places)
        stale = stale + 1 if len(walk.time_steps) == knots else 0
    return walk, nodes, True


def _worst_samples(
    track: Track, walk: GridWalk, nodes: NDArray[np.int64], grid: QuantisationGrid, max_error: float
) -> NDArray[np.intp]:
    """The sample of each part that is farthest away, where that is too far."""
    metres = np.asarray(grid.origin, dtype=np.float64) / 1000 + nodes * step_size(grid.space)
    times = knot_times(walk.time_steps, grid)
    errors = synchronised_errors(track, Walk(track.id, walk.nodes, times, walk.gaps), metres)
    bad = np.flatnonzero(errors > max_error)
    part = np.searchsorted(times, track.times[bad], side="right")
    order = np.lexsort((-errors[bad], part))
    first = np.append(True, np.diff(part[order]) > 0)[: len(order)]
    worst: NDArray[np.intp] = np.sort(bad[order[first]])
    return worst


def _shift_knots(
    track: Track,
    worst: NDArray[np.intp],
    walk: GridWalk,
    nodes: NDArray[np.int64],
    grid: QuantisationGrid,
    max_error: float,
) -> tuple[GridWalk, NDArray[np.int64]]:
    """Where samples lie between knots in adjacent cells, move the nearer knot so far that the sample comes within the maximum."""
    at, size = (
        (track.times[worst] - grid.epoch / 1000) / step_size(grid.time),
        step_size(grid.space),
    )
    cells = np.clip(np.rint(at).astype(np.int64), walk.time_steps[0], walk.time_steps[-1])
    second = cells + np.where(at >= cells, 1, -1)
    tight = np.isin(cells, walk.time_steps) & np.isin(second, walk.time_steps)
    worst, at, cells = worst[tight], at[tight], cells[tight]
    knot = np.searchsorted(walk.time_steps, cells)
    corner = np.asarray(grid.origin, dtype=np.float64) / 1000
    decoded = Walk(track.id, walk.nodes, knot_times(walk.time_steps, grid), walk.gaps)
    away = track.positions[worst] - positions_at(decoded, corner + nodes * size, track.times[worst])
    pull = (1 - _WITHIN * max_error / np.linalg.norm(away, axis=1)) / (1 - np.abs(at - cells))
    places = nodes[walk.nodes[knot]] + np.rint(away * pull[:, None] / size).astype(np.int64)
    moved = walk.nodes.copy()
    moved[knot] = np.arange(len(nodes), len(nodes) + len(knot), dtype=np.int32)
    return replace(walk, nodes=moved), np.concatenate((nodes, places))


def _time_steps(
    times: NDArray[np.float64], walk: GridWalk, grid: QuantisationGrid, *, beside: bool
) -> NDArray[np.int64]:
    """The nearest cell to each time; if so asked, the second nearest where a knot has the nearest one and none the second."""
    at = (times - grid.epoch / 1000) / step_size(grid.time)
    nearest = np.rint(at).astype(np.int64)
    if beside:
        second = nearest + np.where(at >= nearest, 1, -1)
        nearest = np.where(
            np.isin(nearest, walk.time_steps) & ~np.isin(second, walk.time_steps), second, nearest
        )
    return np.unique(np.clip(nearest, walk.time_steps[0], walk.time_steps[-1]))


def _find_nodes(
    track: Track,
    cells: NDArray[np.int64],
    nodes: NDArray[np.int64],
    grid: QuantisationGrid,
    reach: float,
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Node for each cell, where the track is about that instant: a known one within reach, else a new one."""
    size = step_size(grid.space)
    spots = (
        _box_centres(track, knot_times(cells, grid), step_size(grid.time) / 2)
        - np.asarray(grid.origin) / 1000
    ) / size
    away, number = cKDTree(nodes).query(spots)
    fresh = away * size > reach
    added, which = np.unique(np.rint(spots[fresh]).astype(np.int64), axis=0, return_inverse=True)
    known = np.where(fresh, 0, number).astype(np.int32)
    known[fresh] = len(nodes) + which.reshape(-1)
    return known, np.concatenate((nodes, added))


def _box_centres(track: Track, when: NDArray[np.float64], span: float) -> NDArray[np.float64]:
    """Middle of the box about the samples within so many seconds of each instant; the interpolated position where there are none."""
    there = np.stack([np.interp(when, track.times, axis) for axis in track.positions.T], axis=1)
    first, after = (
        np.searchsorted(track.times, when - span),
        np.searchsorted(track.times, when + span),
    )
    some = after > first
    if some.any():
        bounds = np.stack((first[some], after[some]), axis=1).ravel()
        padded = np.concatenate((track.positions, track.positions[-1:]))
        low, high = (
            np.minimum.reduceat(padded, bounds)[::2],
            np.maximum.reduceat(padded, bounds)[::2],
        )
        there[some] = (low + high) / 2
    return there


def _insert_knots(walk: GridWalk, cells: NDArray[np.int64], places: NDArray[np.int32]) -> GridWalk:
    """Put knots into a walk; one that has the same cell moves to the new place."""
    after = np.searchsorted(walk.time_steps, cells)
    same = walk.time_steps[np.minimum(after, len(walk.time_steps) - 1)] == cells
    nodes = walk.nodes.copy()
    nodes[after[same]] = places[same]
    between = ~same & ~np.append(walk.gaps, True)[after - 1]
    at = after[between]
    return GridWalk(
        np.insert(nodes, at, places[between]),
        np.insert(walk.time_steps, at, cells[between]),
        np.insert(walk.gaps, at - 1, False),
    )
