"""The time grid of the connected map: samples reduced to exact sums at the slots where knots may lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.model import QuantisationGrid, Track
from gpszip.model.grid import step_size

__all__ = [
    "TimeGrid",
    "build_time_grid",
    "count_slots",
    "mask_near_knots",
    "reweight_samples",
    "select_slots",
    "sparsify",
    "transfer_knots",
]

#: Time ticks of a cell, and position ticks of a quantum where the log's extent allows it.
_TICKS_PER_TIME_STEP = 256
_MAX_TICKS_PER_STEP = 64
#: What a weight of 1 counts where tracks have weights.
_TICKS_PER_WEIGHT = 16
#: Every cell carries a slot while there are at most this many for each sample; else only those next to samples.
_MAX_STEPS_PER_SAMPLE = 16
#: Slots are thinned only where at most this share of them is left.
_MAX_SPARSE_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class TimeGrid:
    """All slots of all tracks in a row, and the sums that price any part between two of them.

    Parameters
    ----------
    time_steps : int64 array, shape (S,)
        Time cell of each slot.
    ticks : int64 array, shape (S,)
        The same instants in ticks.
    positions : float64 array, shape (S, d)
        Where the log is at each slot, in quanta from the origin.
    centers : int64 array, shape (S, d)
        The same, in ticks.
    sums : int64 array, shape (S, 2d + 4)
        Sums over all samples before each slot.
    ticks_per_step : float
        Position ticks of a quantum.
    first_slots, last_slots : int64 arrays, shape (P,)
        First and last slot of each piece; pieces are what lies between gaps.
    piece_tracks : int64 array, shape (P,)
        Track of each piece.
    ends : int64 array, shape (S,)
        Number of samples before each slot; at the last slot of a piece, all of its samples count.
    times : float64 array, shape (n,)
        Time of each sample, in cells.
    sample_positions : float64 array, shape (n, d)
        Position of each sample, in quanta.
    weights : int64 array, shape (n,)
        What each sample counts; 1, or of weighted tracks sixteenths of their weights.
    """

    time_steps: NDArray[np.int64]
    ticks: NDArray[np.int64]
    positions: NDArray[np.float64]
    centers: NDArray[np.int64]
    sums: NDArray[np.int64]
    ticks_per_step: float
    first_slots: NDArray[np.int64]
    last_slots: NDArray[np.int64]
    piece_tracks: NDArray[np.int64]
    ends: NDArray[np.int64]
    times: NDArray[np.float64]
    sample_positions: NDArray[np.float64]
    weights: NDArray[np.int64]

    @property
    def samples(self) -> int:
        """Number of samples n; of weighted ones, the sum of their weights."""
        return int(self.weights.sum())


def build_time_grid(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    grid: QuantisationGrid,
    *,
    sparse: bool = False,
) -> TimeGrid:
    """Lay the slots of a frame's time grid over the tracks.

    Parameters
    ----------
    tracks : sequence of Track
        At least one.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    grid : Frame
        Origin, epoch and quanta.
    sparse : bool, default False
        Leave out the cells that are not next to a sample or halfway between two.

    Returns
    -------
    Slots
        Each piece starts at or before its first sample and ends at or after its last, and spans at least one cell.
    """
    times = [_in_time_steps(track, grid) for track in tracks]
    spans = [_find_pieces(t, gap) for t, gap in zip(times, gaps, strict=True)]
    positions = np.concatenate([_in_grid_steps(track, grid) for track in tracks])
    offsets = np.cumsum([0] + [len(t) for t in times])
    every = np.concatenate(times)
    weights = _integer_weights(tracks)
    cells, ends, froms, first_slots, last_slots, piece_tracks = [], [], [], [], [], []
    count = 0
    for owner, (offset, pieces) in enumerate(zip(offsets[:-1], spans, strict=True)):
        for a, b, low, high in pieces:
            steps = _list_time_steps(every[offset + a : offset + b], low, high, sparse)
            end = offset + a + np.searchsorted(every[offset + a : offset + b], steps - 1e-9)
            end[0], end[-1] = offset + a, offset + b
            cells.append(steps)
            ends.append(end)
            froms.append(np.full((len(steps), 2), (offset + a, offset + b)))
            first_slots.append(count)
            count += len(steps)
            last_slots.append(count - 1)
            piece_tracks.append(owner)
    cell = np.concatenate(cells)
    spots = _smooth_positions(every, positions, cell, np.concatenate(froms))
    unit = _choose_ticks_per_step(
        positions,
        np.concatenate(
            [
                [offset + piece[0] for piece in pieces]
                for offset, pieces in zip(offsets, spans, strict=False)
            ]
        ),
        int(weights.sum()),
    )
    before = np.concatenate(ends).astype(np.int64)
    return TimeGrid(
        cell, cell * _TICKS_PER_TIME_STEP, spots, np.rint(spots * unit).astype(np.int64),
        _prefix_sums(every, positions, weights, before, unit), float(unit),
        np.array(first_slots), np.array(last_slots), np.array(piece_tracks), before, every, positions, weights,
    )  # fmt: skip


def count_slots(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], grid: QuantisationGrid
) -> int:
    """Count the slots that :func:`build_time_grid` would lay."""
    count = 0
    for track, gap in zip(tracks, gaps, strict=True):
        times = _in_time_steps(track, grid)
        count += sum(
            len(_list_time_steps(times[a:b], low, high, False))
            for a, b, low, high in _find_pieces(times, gap)
        )
    return count


def select_slots(time_grid: TimeGrid, keep: NDArray[np.bool_]) -> TimeGrid:
    """Return only those slots that are to be kept; all first and last slots of pieces must be among them."""
    number = np.cumsum(keep) - 1
    return replace(
        time_grid, time_steps=time_grid.time_steps[keep], ticks=time_grid.ticks[keep], positions=time_grid.positions[keep], centers=time_grid.centers[keep],
        sums=time_grid.sums[keep], ends=time_grid.ends[keep], first_slots=number[time_grid.first_slots], last_slots=number[time_grid.last_slots],
    )  # fmt: skip


def sparsify(time_grid: TimeGrid) -> TimeGrid | None:
    """Return the slots that a sparse grid would have; None if those are most of them."""
    counts = time_grid.last_slots - time_grid.first_slots + 1
    dense = (
        counts
        > time_grid.time_steps[time_grid.last_slots] - time_grid.time_steps[time_grid.first_slots]
    )
    keep = np.repeat(~dense, counts)
    keep[time_grid.first_slots] = keep[time_grid.last_slots] = True
    samples = time_grid.ends[time_grid.last_slots] - time_grid.ends[time_grid.first_slots]
    times = time_grid.times[np.repeat(dense, samples)]
    offset = np.repeat(
        (time_grid.first_slots - time_grid.time_steps[time_grid.first_slots])[dense], samples[dense]
    )
    halfway = np.rint((times[1:] + times[:-1]) / 2)[offset[1:] == offset[:-1]]
    for near, first in (
        (np.floor(times), offset),
        (np.ceil(times), offset),
        (halfway, offset[1:][offset[1:] == offset[:-1]]),
    ):
        # what lies just outside of a piece is an end of one, too
        keep[np.minimum(first + near.astype(np.int64), len(keep) - 1)] = True
    return select_slots(time_grid, keep) if keep.sum() < _MAX_SPARSE_SHARE * len(keep) else None


def reweight_samples(time_grid: TimeGrid, weights: NDArray[np.int64]) -> TimeGrid:
    """Return the same slots with sums in which each sample counts as often as its weight says."""
    return replace(
        time_grid,
        sums=_prefix_sums(
            time_grid.times,
            time_grid.sample_positions,
            weights * time_grid.weights,
            time_grid.ends,
            time_grid.ticks_per_step,
        ),
    )


def _integer_weights(tracks: Sequence[Track]) -> NDArray[np.int64]:
    if all(track.weights is None for track in tracks):
        return np.ones(sum(map(len, tracks)), np.int64)
    every = [np.ones(len(track)) if track.weights is None else track.weights for track in tracks]
    whole: NDArray[np.int64] = np.maximum(
        np.rint(_TICKS_PER_WEIGHT * np.concatenate(every)), 1
    ).astype(np.int64)
    return whole


def _prefix_sums(
    times: NDArray[np.float64],
    spots: NDArray[np.float64],
    weights: NDArray[np.int64],
    ends: NDArray[np.int64],
    unit: float,
) -> NDArray[np.int64]:
    return prefix_sums(
        np.rint(times * _TICKS_PER_TIME_STEP).astype(np.int64),
        np.rint(spots * unit).astype(np.int64),
        weights,
        ends,
    )


def _in_time_steps(track: Track, grid: QuantisationGrid) -> NDArray[np.float64]:
    # microseconds first: a log that was shifted by a round number gives the very same cells
    seconds = np.rint((track.times - grid.epoch / 1000) * 1e6) / 1e6
    return np.asarray(seconds / step_size(grid.time))


def _in_grid_steps(track: Track, grid: QuantisationGrid) -> NDArray[np.float64]:
    metres = np.rint((track.positions - np.array(grid.origin) / 1000) * 1e6) / 1e6
    return np.asarray(metres / step_size(grid.space))


def _find_pieces(
    times: NDArray[np.float64], gap: NDArray[np.bool_]
) -> list[tuple[int, int, int, int]]:
    """Sample range and first and last cell of each piece; a gap that no whole cell fits in is none."""
    pieces: list[tuple[int, int, int, int]] = []
    bounds = np.concatenate([[0], np.flatnonzero(gap) + 1, [len(times)]])
    for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        low = int(np.floor(times[a] + 1e-6))
        high = max(int(np.ceil(times[b - 1] - 1e-6)), low + 1)
        if pieces and low <= pieces[-1][3]:
            before = pieces.pop()
            pieces.append((before[0], b, before[2], max(high, before[3])))
        else:
            pieces.append((a, b, low, high))
    return pieces


def _list_time_steps(
    times: NDArray[np.float64], low: int, high: int, sparse: bool
) -> NDArray[np.int64]:
    if not sparse and high - low < _MAX_STEPS_PER_SAMPLE * len(times) + 64:
        return np.arange(low, high + 1, dtype=np.int64)
    halfway = np.rint((times[1:] + times[:-1]) / 2)
    near = np.concatenate([np.floor(times), np.ceil(times), halfway, [low, high]]).astype(np.int64)
    return np.unique(near[(near >= low) & (near <= high)])


def mask_near_knots(
    sparse_grid: TimeGrid, full: TimeGrid, knots: NDArray[np.int64], reach: int
) -> NDArray[np.bool_]:
    """Tell which of the full slots are sparse ones, or at most ``reach`` slots from those with the given numbers."""
    near = np.zeros(len(full.time_steps), np.bool_)
    near[np.searchsorted(_slot_keys(full), _slot_keys(sparse_grid))] = True
    for step in range(-reach, reach + 1):
        near[np.clip(knots + step, 0, len(near) - 1)] = True
    return near


def transfer_knots(
    at: NDArray[np.int64], sparse_grid: TimeGrid, full: TimeGrid
) -> NDArray[np.int64]:
    """Give the knots on sparse slots to the full slots of the same cells; -1 where there is no knot."""
    knots = np.flatnonzero(at >= 0)
    carried = np.full(len(full.time_steps), -1, np.int64)
    carried[np.searchsorted(_slot_keys(full), _slot_keys(sparse_grid)[knots])] = at[knots]
    return carried


def _slot_keys(time_grid: TimeGrid) -> NDArray[np.int64]:
    """Increasing numbers of the slots by piece and cell, the same for sparse and full slots."""
    piece = np.repeat(
        np.arange(len(time_grid.first_slots)), time_grid.last_slots - time_grid.first_slots + 1
    )
    spans = (
        time_grid.time_steps[time_grid.last_slots] - time_grid.time_steps[time_grid.first_slots] + 1
    )
    before = np.cumsum(spans) - spans
    order: NDArray[np.int64] = (
        before[piece] + time_grid.time_steps - time_grid.time_steps[time_grid.first_slots][piece]
    )
    return order


def _smooth_positions(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    cells: NDArray[np.int64],
    ranges: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Mean of the samples within half a cell of each slot where there are three or more, else the straight line's position."""
    out = np.empty((len(cells), positions.shape[1]))
    total = np.concatenate([np.zeros((1, positions.shape[1])), np.cumsum(positions, axis=0)])
    edges = np.flatnonzero(np.diff(ranges[:, 0], prepend=-1))
    for a, b in zip(edges.tolist(), [*edges[1:].tolist(), len(cells)], strict=True):
        first, last = ranges[a]
        t, at = times[first:last], cells[a:b].astype(float)
        for axis in range(positions.shape[1]):
            out[a:b, axis] = np.interp(at, t, positions[first:last, axis])
        low, high = first + np.searchsorted(t, at - 0.5), first + np.searchsorted(t, at + 0.5)
        many = np.flatnonzero(high - low >= 3)
        out[a + many] = (total[high[many]] - total[low[many]]) / (high - low)[many, None]
    return out


def _choose_ticks_per_step(
    positions: NDArray[np.float64], starts: NDArray[np.int64], weight: int
) -> int:
    """Ticks of a quantum such that the squares of positions about a piece's own, summed over a long part, stay within 62 bits."""
    spread = np.maximum.reduceat(positions, starts, axis=0) - np.minimum.reduceat(
        positions, starts, axis=0
    )
    extent = float(spread.max()) + 1.0
    unit = _MAX_TICKS_PER_STEP
    while unit > 1 and (extent * unit) ** 2 * min(weight, 100_000) > 2.0**58:
        unit //= 2
    return unit
