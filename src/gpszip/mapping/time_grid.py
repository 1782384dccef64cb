"""The time grid of the connected map: slots where knots may lie, and exact sums of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import BoundError
from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.model import GridWalks, QuantisationGrid, Track
from gpszip.model.grid import step_size

__all__ = [
    "TimeGrid",
    "build_time_grid",
    "count_slots",
    "mask_near_knots",
    "reweight_samples",
    "select_samples",
    "select_slots",
    "sparsify",
    "transfer_knots",
]

#: Ticks of a time step.
_TICKS_PER_TIME_STEP = 256

#: Position ticks of a grid step, where the log's extent allows that many.
_MAX_TICKS_PER_STEP = 64

#: Whole number that stands for a weight of 1 where tracks have weights.
_TICKS_PER_WEIGHT = 16

#: Every time step has a slot while there are at most this many steps for each sample; else only
#: those next to samples have.
_MAX_STEPS_PER_SAMPLE = 16

#: Time steps of a piece that may have slots beyond those for its samples.
_EXTRA_STEPS = 64

#: A sparse grid pays only where it has at most this share of the slots.
_MAX_SPARSE_SHARE = 0.7

#: Time steps by which a sample may be off a whole step and still lie on it.
_TIME_TOLERANCE = 1e-6

#: The same in seconds: samples are rounded to microseconds, and a track that continues a walk
#: begins at its last knot.
_TIME_ROUNDING = 1e-6

#: The same in time steps at most, for steps of microseconds.
_MAX_TIME_TOLERANCE = 0.25

#: Samples near a slot from which on their mean is its position.
_MIN_SMOOTHED = 3

#: Limit of the estimated sum of squared ticks, so that the real one stays within 62 bits.
_MAX_SQUARE_SUM = 2.0**58

#: Grid steps between samples of one piece from which on the square of one position alone takes more
#: than 64 bits: whatever is measured then is nonsense.
_MAX_EXTENT = 2.0**33

#: Samples of the longest segment that squares are summed over.
_MAX_SEGMENT_WEIGHT = 100_000


@dataclass(frozen=True, eq=False)
class TimeGrid:
    """Slots of all tracks one after the other, and sums that measure a segment between any two.

    Parameters
    ----------
    time_steps : int64 array, shape (S,)
        Time of each slot, in time steps.
    ticks : int64 array, shape (S,)
        The same in ticks.
    positions : float64 array, shape (S, d)
        Position of the log at each slot, in grid steps from the origin.
    centers : int64 array, shape (S, d)
        The same in ticks.
    sums : int64 array, shape (S, 2d + 4)
        Sums over all samples before each slot.
    ticks_per_step : float
        Position ticks of a grid step.
    first_slots, last_slots : int64 arrays, shape (P,)
        First and last slot of each piece; gaps separate pieces.
    piece_tracks : int64 array, shape (P,)
        Track of each piece.
    ends : int64 array, shape (S,)
        Number of samples before each slot; at the last slot of a piece, all of its samples count.
    times : float64 array, shape (n,)
        Time of each sample, in time steps.
    sample_positions : float64 array, shape (n, d)
        Position of each sample, in grid steps.
    weights : int64 array, shape (n,)
        Weight of each sample: 1, or sixteenths where tracks have weights.
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
        """Number of samples n; with weights, their sum."""
        return int(self.weights.sum())


@dataclass(frozen=True)
class _Piece:
    """A piece of a track: its samples ``first`` to ``after`` - 1, and its time steps."""

    first: int
    after: int
    first_step: int
    last_step: int


def build_time_grid(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    grid: QuantisationGrid,
    *,
    sparse: bool = False,
) -> TimeGrid:
    """Build the slots of tracks, at whole time steps of a quantisation grid.

    Parameters
    ----------
    tracks : sequence of Track
        At least one.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    grid : QuantisationGrid
        Origin, epoch and step sizes.
    sparse : bool, default False
        Leave out time steps that are not next to a sample or halfway between two.

    Returns
    -------
    TimeGrid
        Each piece starts at or before its first sample and ends at or after its last, and spans at
        least one time step.
    """
    # Express samples in steps of the grid, and find the pieces.
    track_times = [_in_time_steps(track, grid) for track in tracks]
    tolerance = _time_tolerance(grid)
    track_pieces = [
        _find_pieces(t, gap, tolerance) for t, gap in zip(track_times, gaps, strict=True)
    ]
    positions = np.concatenate([_in_grid_steps(track, grid) for track in tracks])
    offsets = np.cumsum([0] + [len(t) for t in track_times])
    times = np.concatenate(track_times)
    weights = _integer_weights(tracks)

    # List the slots of each piece, and the samples before each.
    piece_steps, piece_ends, sample_ranges = [], [], []
    first_slots, last_slots, piece_tracks, piece_starts = [], [], [], []
    count = 0
    for owner, (offset, pieces) in enumerate(zip(offsets[:-1], track_pieces, strict=True)):
        for piece in pieces:
            first, after = offset + piece.first, offset + piece.after
            steps = _list_time_steps(times[first:after], piece, sparse)
            # A sample at the very time of a slot, but for rounding, lies after it.
            ends = first + np.searchsorted(times[first:after], steps - 1e-9)
            ends[0], ends[-1] = first, after
            piece_steps.append(steps)
            piece_ends.append(ends)
            sample_ranges.append(np.full((len(steps), 2), (first, after)))
            first_slots.append(count)
            count += len(steps)
            last_slots.append(count - 1)
            piece_tracks.append(owner)
            piece_starts.append(first)

    # Sum the samples up in ticks.
    time_steps = np.concatenate(piece_steps)
    slot_positions = _smooth_positions(times, positions, time_steps, np.concatenate(sample_ranges))
    unit = _choose_ticks_per_step(positions, np.array(piece_starts), int(weights.sum()))
    ends = np.concatenate(piece_ends).astype(np.int64)
    return TimeGrid(
        time_steps=time_steps,
        ticks=time_steps * _TICKS_PER_TIME_STEP,
        positions=slot_positions,
        centers=np.rint(slot_positions * unit).astype(np.int64),
        sums=_sum_samples(times, positions, weights, ends, unit),
        ticks_per_step=float(unit),
        first_slots=np.array(first_slots),
        last_slots=np.array(last_slots),
        piece_tracks=np.array(piece_tracks),
        ends=ends,
        times=times,
        sample_positions=positions,
        weights=weights,
    )


def count_slots(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], grid: QuantisationGrid
) -> int:
    """Count the slots that :func:`build_time_grid` would build."""
    count = 0
    for track, gap in zip(tracks, gaps, strict=True):
        times = _in_time_steps(track, grid)
        count += sum(
            len(_list_time_steps(times[piece.first : piece.after], piece, False))
            for piece in _find_pieces(times, gap, _time_tolerance(grid))
        )
    return count


def select_slots(time_grid: TimeGrid, keep: NDArray[np.bool_]) -> TimeGrid:
    """Keep some of the slots; the first and the last slots of all pieces must be among them."""
    number = np.cumsum(keep) - 1
    return replace(
        time_grid,
        time_steps=time_grid.time_steps[keep],
        ticks=time_grid.ticks[keep],
        positions=time_grid.positions[keep],
        centers=time_grid.centers[keep],
        sums=time_grid.sums[keep],
        ends=time_grid.ends[keep],
        first_slots=number[time_grid.first_slots],
        last_slots=number[time_grid.last_slots],
    )


def sparsify(time_grid: TimeGrid) -> TimeGrid | None:
    """Keep the slots that a sparse grid would have; None if those are most of the slots."""
    # Pieces without a slot at each time step are sparse already.
    counts = time_grid.last_slots - time_grid.first_slots + 1
    is_dense = (
        counts
        > time_grid.time_steps[time_grid.last_slots] - time_grid.time_steps[time_grid.first_slots]
    )
    keep = np.repeat(~is_dense, counts)
    keep[time_grid.first_slots] = keep[time_grid.last_slots] = True

    # In a dense piece, slot and time step differ by a constant.
    samples = time_grid.ends[time_grid.last_slots] - time_grid.ends[time_grid.first_slots]
    times = time_grid.times[np.repeat(is_dense, samples)]
    offset = np.repeat(
        (time_grid.first_slots - time_grid.time_steps[time_grid.first_slots])[is_dense],
        samples[is_dense],
    )

    # Keep the slots next to samples, and those halfway between two of a piece.
    is_same_piece = offset[1:] == offset[:-1]
    halfway = np.rint((times[1:] + times[:-1]) / 2)[is_same_piece]
    for steps, step_offset in (
        (np.floor(times), offset),
        (np.ceil(times), offset),
        (halfway, offset[1:][is_same_piece]),
    ):
        # The step just outside of a piece belongs to the next one, whose first slot is kept.
        keep[np.minimum(step_offset + steps.astype(np.int64), len(keep) - 1)] = True
    return select_slots(time_grid, keep) if keep.sum() < _MAX_SPARSE_SHARE * len(keep) else None


def reweight_samples(time_grid: TimeGrid, weights: NDArray[np.int64]) -> TimeGrid:
    """Return the same slots with sums in which each sample counts by a further weight.

    ``time_grid`` has the sums without it.
    """
    # Most samples keep their weight: add only what the others weigh more.
    heavier = np.flatnonzero(weights != 1)
    added = _sum_samples(
        time_grid.times[heavier],
        time_grid.sample_positions[heavier],
        (weights[heavier] - 1) * time_grid.weights[heavier],
        np.searchsorted(heavier, time_grid.ends),
        time_grid.ticks_per_step,
    )
    return replace(time_grid, sums=time_grid.sums + added)


def select_samples(time_grid: TimeGrid, keep: NDArray[np.bool_]) -> TimeGrid:
    """Keep some of the samples, for a maximum error; the sums remain those of all samples."""
    before = np.concatenate([[0], np.cumsum(keep)])
    return replace(
        time_grid,
        ends=before[time_grid.ends],
        times=time_grid.times[keep],
        sample_positions=time_grid.sample_positions[keep],
        weights=time_grid.weights[keep],
    )


def _integer_weights(tracks: Sequence[Track]) -> NDArray[np.int64]:
    """Weights of all samples: 1, or sixteenths where tracks have weights."""
    if all(track.weights is None for track in tracks):
        return np.ones(sum(map(len, tracks)), np.int64)
    weights = np.concatenate(
        [np.ones(len(track)) if track.weights is None else track.weights for track in tracks]
    )
    rounded: NDArray[np.int64] = np.maximum(np.rint(_TICKS_PER_WEIGHT * weights), 1).astype(
        np.int64
    )
    return rounded


def _sum_samples(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.int64],
    ends: NDArray[np.int64],
    ticks_per_step: float,
) -> NDArray[np.int64]:
    """Prefix sums of the samples in whole ticks."""
    return prefix_sums(
        np.rint(times * _TICKS_PER_TIME_STEP).astype(np.int64),
        np.rint(positions * ticks_per_step).astype(np.int64),
        weights,
        ends,
    )


def _in_time_steps(track: Track, grid: QuantisationGrid) -> NDArray[np.float64]:
    # Round to microseconds first: a log shifted by a round number gives the very same time steps.
    seconds = np.rint((track.times - grid.epoch / 1000) * 1e6) / 1e6
    return np.asarray(seconds / step_size(grid.time))


def _in_grid_steps(track: Track, grid: QuantisationGrid) -> NDArray[np.float64]:
    # Round to micrometres first, for the same reason.
    metres = np.rint((track.positions - np.array(grid.origin) / 1000) * 1e6) / 1e6
    return np.asarray(metres / step_size(grid.space))


def _time_tolerance(grid: QuantisationGrid) -> float:
    """Time steps by which a sample may be off a whole step and still lie on it."""
    rounding = _TIME_ROUNDING / step_size(grid.time)
    return min(max(_TIME_TOLERANCE, rounding), _MAX_TIME_TOLERANCE)


def _find_pieces(
    times: NDArray[np.float64], gap: NDArray[np.bool_], tolerance: float
) -> list[_Piece]:
    """Pieces between gaps; a gap that does not contain a whole time step is none."""
    pieces: list[_Piece] = []
    bounds = np.concatenate([[0], np.flatnonzero(gap) + 1, [len(times)]])
    for first, after in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        first_step = int(np.floor(times[first] + tolerance))
        last_step = max(int(np.ceil(times[after - 1] - tolerance)), first_step + 1)
        if pieces and first_step <= pieces[-1].last_step:
            before = pieces.pop()
            pieces.append(
                _Piece(before.first, after, before.first_step, max(last_step, before.last_step))
            )
        else:
            pieces.append(_Piece(first, after, first_step, last_step))
    return pieces


def _list_time_steps(times: NDArray[np.float64], piece: _Piece, sparse: bool) -> NDArray[np.int64]:
    """Time steps of the slots of a piece."""
    low, high = piece.first_step, piece.last_step
    if not sparse and high - low < _MAX_STEPS_PER_SAMPLE * len(times) + _EXTRA_STEPS:
        return np.arange(low, high + 1, dtype=np.int64)
    halfway = np.rint((times[1:] + times[:-1]) / 2)
    near = np.concatenate([np.floor(times), np.ceil(times), halfway, [low, high]]).astype(np.int64)
    return np.unique(near[(near >= low) & (near <= high)])


def mask_near_knots(
    sparse_grid: TimeGrid, full: TimeGrid, knots: NDArray[np.int64], reach: int
) -> NDArray[np.bool_]:
    """Mark the full slots that are sparse ones, or at most ``reach`` slots from a knot.

    ``knots`` are the numbers of the full slots that carry knots.
    """
    near = np.zeros(len(full.time_steps), np.bool_)
    near[np.searchsorted(_slot_keys(full), _slot_keys(sparse_grid))] = True
    for shift in range(-reach, reach + 1):
        near[np.clip(knots + shift, 0, len(near) - 1)] = True
    return near


def transfer_knots(
    slot_nodes: NDArray[np.int64], sparse_grid: TimeGrid, full: TimeGrid
) -> NDArray[np.int64]:
    """Move knots from sparse slots to full slots at the same times; -1 where there is no knot."""
    knots = np.flatnonzero(slot_nodes >= 0)
    transferred = np.full(len(full.time_steps), -1, np.int64)
    slots = np.searchsorted(_slot_keys(full), _slot_keys(sparse_grid)[knots])
    transferred[slots] = slot_nodes[knots]
    return transferred


def place_walks(time_grid: TimeGrid, walks: GridWalks, ratio: float) -> NDArray[np.int64]:
    """Put the knots of walks on the nearest slots of another grid.

    Parameters
    ----------
    time_grid : TimeGrid
        The slots.
    walks : GridWalks
        One walk for each track.
    ratio : float
        Time step of the walks in time steps of the slots.

    Returns
    -------
    int64 array, shape (S,)
        Node of each slot, -1 where there is no knot. Of two knots at one slot, the later one
        counts; where none lies at an end of a piece, the nearest knot's node is there, too.
    """
    # Find the slots of each track.
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    pieces = np.searchsorted(time_grid.piece_tracks, np.arange(len(walks.walks) + 1))
    for walk, first, after in zip(walks.walks, pieces[:-1], pieces[1:], strict=True):
        start, end = time_grid.first_slots[first], time_grid.last_slots[after - 1] + 1
        steps, knot_steps = time_grid.time_steps[start:end], walk.time_steps * ratio
        slot_nodes[start + _find_nearest(steps, knot_steps)] = walk.nodes

        # Each piece begins and ends with a knot.
        ends = np.concatenate(
            [time_grid.first_slots[first:after], time_grid.last_slots[first:after]]
        )
        ends = ends[slot_nodes[ends] < 0]
        slot_nodes[ends] = walk.nodes[_find_nearest(knot_steps, time_grid.time_steps[ends])]
    return slot_nodes


def _find_nearest(values: NDArray[Any], wanted: NDArray[Any]) -> NDArray[np.int64]:
    """Index of the nearest one of sorted values to each one wanted."""
    after = np.clip(np.searchsorted(values, wanted), 1, max(len(values) - 1, 1))
    if len(values) == 1:
        return np.zeros(len(wanted), np.int64)
    is_before_nearer = wanted - values[after - 1] <= values[after] - wanted
    return np.asarray(after - is_before_nearer, np.int64)


def _slot_keys(time_grid: TimeGrid) -> NDArray[np.int64]:
    """Increasing keys of the slots by piece and time step, the same for sparse and full slots."""
    piece = np.repeat(
        np.arange(len(time_grid.first_slots)), time_grid.last_slots - time_grid.first_slots + 1
    )
    first_steps = time_grid.time_steps[time_grid.first_slots]
    spans = time_grid.time_steps[time_grid.last_slots] - first_steps + 1
    before = np.cumsum(spans) - spans
    keys: NDArray[np.int64] = before[piece] + time_grid.time_steps - first_steps[piece]
    return keys


def _smooth_positions(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    time_steps: NDArray[np.int64],
    sample_ranges: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Position of the log at each slot.

    It is the mean of the samples within half a time step where there are three or more, else that
    on the straight line between two samples.
    """
    # Running sums give the mean of any samples; all slots of a piece share a sample range.
    smoothed = np.empty((len(time_steps), positions.shape[1]))
    total = np.concatenate([np.zeros((1, positions.shape[1])), np.cumsum(positions, axis=0)])
    starts = np.flatnonzero(np.diff(sample_ranges[:, 0], prepend=-1))
    for a, b in zip(starts.tolist(), [*starts[1:].tolist(), len(time_steps)], strict=True):
        # Interpolate along each axis.
        first, last = sample_ranges[a]
        piece_times, steps = times[first:last], time_steps[a:b].astype(float)
        for axis in range(positions.shape[1]):
            smoothed[a:b, axis] = np.interp(steps, piece_times, positions[first:last, axis])

        # Average where samples are dense.
        low = first + np.searchsorted(piece_times, steps - 0.5)
        high = first + np.searchsorted(piece_times, steps + 0.5)
        dense = np.flatnonzero(high - low >= _MIN_SMOOTHED)
        smoothed[a + dense] = (total[high[dense]] - total[low[dense]]) / (high - low)[dense, None]
    return smoothed


def _choose_ticks_per_step(
    positions: NDArray[np.float64], piece_starts: NDArray[np.int64], weight: int
) -> int:
    """Ticks of a grid step such that sums of squares over a long segment stay within 62 bits.

    The squares are of positions relative to those of the same piece.

    Raises
    ------
    BoundError
        If these lie so far apart that no sum of squares can be had.
    """
    # How far apart the samples of a piece are.
    extents = np.maximum.reduceat(positions, piece_starts, axis=0) - np.minimum.reduceat(
        positions, piece_starts, axis=0
    )
    extent = float(extents.max()) + 1.0
    if extent > _MAX_EXTENT:
        raise BoundError(
            "positions of a track lie too far apart for so small an error",
            remedy="allow a larger error, or drop positions that are far off (--clean)",
        )

    # The finest ticks that fit.
    unit = _MAX_TICKS_PER_STEP
    while unit > 1 and (extent * unit) ** 2 * min(weight, _MAX_SEGMENT_WEIGHT) > _MAX_SQUARE_SUM:
        unit //= 2
    return unit
