"""Walks mended until no sample is farther away than a maximum: where a part misses, it gets another knot at its worst sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpszip.codec.walks import number_by_visit
from gpszip.model import Frame, LatticeWalk, LatticeWalks, Track, Walk
from gpszip.model.frame import quantum
from gpszip.walks.error import positions_at, synchronised_errors
from gpszip.walks.quantised import knot_times

__all__ = ["mend"]

#: New knots take a node that is already there within this share of the maximum.
_SNAP = 0.5

#: How often the lattice is made finer, and how many indices of quanta make half the size.
_REFINEMENTS, _OCTAVE = 8, 8

#: Share of the maximum to which a shift brings a sample.
_WITHIN = 0.9

#: Rounds without another knot, and rounds in all, after which a walk that still misses is given up.
_STALE, _ROUNDS = 24, 400


def mend(
    tracks: Sequence[Track], frame: Frame, lattice: LatticeWalks, max_error: float, *, known: int | None = None
) -> tuple[Frame, LatticeWalks] | None:
    """Add knots, or move them to other nodes, until no sample is farther from its walk than a maximum.

    Where the lattice is too coarse for that, it gets twice as many cells, or on every third occasion lattice points.

    Parameters
    ----------
    tracks : sequence of Track
        The samples.
    frame : Frame
        The lattice.
    lattice : LatticeWalks
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
    >>> walk = LatticeWalk(np.array([0, 1], np.int32), np.array([0, 4]), np.array([False]))
    >>> _, mended = mend([track], Frame((0, 0), 0, 128, 128), LatticeWalks(np.array([[0, 0], [4, 0]]), (walk,)), 0.5)
    >>> mended.walks[0].cells.tolist()
    [0, 1, 2, 3, 4]
    """
    for finer in range(_REFINEMENTS):
        nodes, walks, missed = lattice.nodes, list(lattice.walks), False
        for number, track in enumerate(tracks):
            walks[number], nodes, misses = _mend_walk(track, walks[number], nodes, frame, max_error)
            missed = missed or misses
        if not missed:
            return frame, number_by_visit(LatticeWalks(nodes, tuple(walks), lattice.timed), known or 0)
        if known is not None or min(frame.space, frame.time) < _OCTAVE:
            break
        frame, lattice = _finer_space(frame, lattice) if finer % 3 == 2 else _finer_time(frame, lattice)
    return None


def _finer_time(frame: Frame, lattice: LatticeWalks) -> tuple[Frame, LatticeWalks]:
    walks = tuple(LatticeWalk(walk.nodes, 2 * walk.cells, walk.gaps) for walk in lattice.walks)
    return replace(frame, time=frame.time - _OCTAVE), replace(lattice, walks=walks)


def _finer_space(frame: Frame, lattice: LatticeWalks) -> tuple[Frame, LatticeWalks]:
    return replace(frame, space=frame.space - _OCTAVE), replace(lattice, nodes=2 * lattice.nodes)


def _mend_walk(
    track: Track, walk: LatticeWalk, nodes: NDArray[np.int64], frame: Frame, max_error: float
) -> tuple[LatticeWalk, NDArray[np.int64], bool]:
    """Walk and nodes after mending, and whether the maximum is still missed."""
    stale = 0
    for turn in range(_ROUNDS):
        worst = _worst_samples(track, walk, nodes, frame, max_error)
        if len(worst) == 0:
            return walk, nodes, False
        if stale > _STALE:
            break
        knots = len(walk.cells)
        if stale and turn % 2 == 0:
            walk, nodes = _shift_knots(track, worst, walk, nodes, frame, max_error)
        else:
            cells = _cells(track.times[worst], walk, frame, beside=turn % 2 == 1)
            places, nodes = _places(track, cells, nodes, frame, _SNAP ** (1 + turn / 4) * max_error)
            walk = _with_knots(walk, cells, places)
        stale = stale + 1 if len(walk.cells) == knots else 0
    return walk, nodes, True


def _worst_samples(track: Track, walk: LatticeWalk, nodes: NDArray[np.int64], frame: Frame, max_error: float) -> NDArray[np.intp]:
    """The sample of each part that is farthest away, where that is too far."""
    metres = np.asarray(frame.origin, dtype=np.float64) / 1000 + nodes * quantum(frame.space)
    times = knot_times(walk.cells, frame)
    errors = synchronised_errors(track, Walk(track.id, walk.nodes, times, walk.gaps), metres)
    bad = np.flatnonzero(errors > max_error)
    part = np.searchsorted(times, track.times[bad], side="right")
    order = np.lexsort((-errors[bad], part))
    first = np.append(True, np.diff(part[order]) > 0)[: len(order)]
    worst: NDArray[np.intp] = np.sort(bad[order[first]])
    return worst


def _shift_knots(
    track: Track, worst: NDArray[np.intp], walk: LatticeWalk, nodes: NDArray[np.int64], frame: Frame, max_error: float
) -> tuple[LatticeWalk, NDArray[np.int64]]:
    """Where samples lie between knots in adjacent cells, move the nearer knot so far that the sample comes within the maximum."""
    at, size = (track.times[worst] - frame.epoch / 1000) / quantum(frame.time), quantum(frame.space)
    cells = np.clip(np.rint(at).astype(np.int64), walk.cells[0], walk.cells[-1])
    second = cells + np.where(at >= cells, 1, -1)
    tight = np.isin(cells, walk.cells) & np.isin(second, walk.cells)
    worst, at, cells = worst[tight], at[tight], cells[tight]
    knot = np.searchsorted(walk.cells, cells)
    corner = np.asarray(frame.origin, dtype=np.float64) / 1000
    decoded = Walk(track.id, walk.nodes, knot_times(walk.cells, frame), walk.gaps)
    away = track.positions[worst] - positions_at(decoded, corner + nodes * size, track.times[worst])
    pull = (1 - _WITHIN * max_error / np.linalg.norm(away, axis=1)) / (1 - np.abs(at - cells))
    places = nodes[walk.nodes[knot]] + np.rint(away * pull[:, None] / size).astype(np.int64)
    moved = walk.nodes.copy()
    moved[knot] = np.arange(len(nodes), len(nodes) + len(knot), dtype=np.int32)
    return replace(walk, nodes=moved), np.concatenate((nodes, places))


def _cells(times: NDArray[np.float64], walk: LatticeWalk, frame: Frame, *, beside: bool) -> NDArray[np.int64]:
    """The nearest cell to each time; if so asked, the second nearest where a knot has the nearest one and none the second."""
    at = (times - frame.epoch / 1000) / quantum(frame.time)
    nearest = np.rint(at).astype(np.int64)
    if beside:
        second = nearest + np.where(at >= nearest, 1, -1)
        nearest = np.where(np.isin(nearest, walk.cells) & ~np.isin(second, walk.cells), second, nearest)
    return np.unique(np.clip(nearest, walk.cells[0], walk.cells[-1]))


def _places(
    track: Track, cells: NDArray[np.int64], nodes: NDArray[np.int64], frame: Frame, reach: float
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Node for each cell, where the track is about that instant: a known one within reach, else a new one."""
    size = quantum(frame.space)
    spots = (_middles(track, knot_times(cells, frame), quantum(frame.time) / 2) - np.asarray(frame.origin) / 1000) / size
    away, number = cKDTree(nodes).query(spots)
    fresh = away * size > reach
    added, which = np.unique(np.rint(spots[fresh]).astype(np.int64), axis=0, return_inverse=True)
    known = np.where(fresh, 0, number).astype(np.int32)
    known[fresh] = len(nodes) + which.reshape(-1)
    return known, np.concatenate((nodes, added))


def _middles(track: Track, when: NDArray[np.float64], span: float) -> NDArray[np.float64]:
    """Middle of the box about the samples within so many seconds of each instant; the interpolated position where there are none."""
    there = np.stack([np.interp(when, track.times, axis) for axis in track.positions.T], axis=1)
    first, after = np.searchsorted(track.times, when - span), np.searchsorted(track.times, when + span)
    some = after > first
    if some.any():
        bounds = np.stack((first[some], after[some]), axis=1).ravel()
        padded = np.concatenate((track.positions, track.positions[-1:]))
        low, high = np.minimum.reduceat(padded, bounds)[::2], np.maximum.reduceat(padded, bounds)[::2]
        there[some] = (low + high) / 2
    return there


def _with_knots(walk: LatticeWalk, cells: NDArray[np.int64], places: NDArray[np.int32]) -> LatticeWalk:
    """Put knots into a walk; one that has the same cell moves to the new place."""
    after = np.searchsorted(walk.cells, cells)
    same = walk.cells[np.minimum(after, len(walk.cells) - 1)] == cells
    nodes = walk.nodes.copy()
    nodes[after[same]] = places[same]
    between = ~same & ~np.append(walk.gaps, True)[after - 1]
    at = after[between]
    return LatticeWalk(
        np.insert(nodes, at, places[between]), np.insert(walk.cells, at, cells[between]), np.insert(walk.gaps, at - 1, False)
    )
