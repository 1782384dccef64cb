"""The time grid of the connected map: samples reduced to exact sums at the slots where knots may lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.model import Frame, Track
from gpszip.model.frame import quantum

__all__ = ["Slots", "carry_knots", "count_slots", "lay_slots", "pick_slots", "slots_near", "thin_slots", "weigh_samples"]

#: Time ticks of a cell, and position ticks of a quantum where the log's extent allows it.
_TIME_TICKS = 256
_PLACE_TICKS = 64
#: What a weight of 1 counts where tracks have weights.
_WEIGHT_TICKS = 16
#: Every cell carries a slot while there are at most this many for each sample; else only those next to samples.
_CELLS_PER_SAMPLE = 16
#: Slots are thinned only where at most this share of them is left.
_THIN = 0.7


@dataclass(frozen=True, eq=False)
class Slots:
    """All slots of all tracks in a row, and the sums that price any part between two of them.

    Parameters
    ----------
    cells : int64 array, shape (S,)
        Time cell of each slot.
    ticks : int64 array, shape (S,)
        The same instants in ticks.
    places : float64 array, shape (S, d)
        Where the log is at each slot, in quanta from the origin.
    centers : int64 array, shape (S, d)
        The same, in ticks.
    sums : int64 array, shape (S, 2d + 4)
        Sums over all samples before each slot.
    place_unit : float
        Position ticks of a quantum.
    firsts, lasts : int64 arrays, shape (P,)
        First and last slot of each piece; pieces are what lies between gaps.
    owners : int64 array, shape (P,)
        Track of each piece.
    ends : int64 array, shape (S,)
        Number of samples before each slot; at the last slot of a piece, all of its samples count.
    times : float64 array, shape (n,)
        Time of each sample, in cells.
    spots : float64 array, shape (n, d)
        Position of each sample, in quanta.
    weights : int64 array, shape (n,)
        What each sample counts; 1, or of weighted tracks sixteenths of their weights.
    """

    cells: NDArray[np.int64]
    ticks: NDArray[np.int64]
    places: NDArray[np.float64]
    centers: NDArray[np.int64]
    sums: NDArray[np.int64]
    place_unit: float
    firsts: NDArray[np.int64]
    lasts: NDArray[np.int64]
    owners: NDArray[np.int64]
    ends: NDArray[np.int64]
    times: NDArray[np.float64]
    spots: NDArray[np.float64]
    weights: NDArray[np.int64]

    @property
    def samples(self) -> int:
        """Number of samples n; of weighted ones, the sum of their weights."""
        return int(self.weights.sum())


def lay_slots(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], frame: Frame, *, sparse: bool = False) -> Slots:
    """Lay the slots of a frame's time grid over the tracks.

    Parameters
    ----------
    tracks : sequence of Track
        At least one.
    gaps : sequence of bool array
        For each track, which of its n - 1 steps between samples are gaps.
    frame : Frame
        Origin, epoch and quanta.
    sparse : bool, default False
        Leave out the cells that are not next to a sample or halfway between two.

    Returns
    -------
    Slots
        Each piece starts at or before its first sample and ends at or after its last, and spans at least one cell.
    """
    times = [_in_cells(track, frame) for track in tracks]
    spans = [_pieces(t, gap) for t, gap in zip(times, gaps, strict=True)]
    places = np.concatenate([_in_quanta(track, frame) for track in tracks])
    offsets = np.cumsum([0] + [len(t) for t in times])
    every = np.concatenate(times)
    weights = _weights(tracks)
    cells, ends, froms, firsts, lasts, owners = [], [], [], [], [], []
    count = 0
    for owner, (offset, pieces) in enumerate(zip(offsets[:-1], spans, strict=True)):
        for a, b, low, high in pieces:
            grid = _slot_cells(every[offset + a : offset + b], low, high, sparse)
            end = offset + a + np.searchsorted(every[offset + a : offset + b], grid - 1e-9)
            end[0], end[-1] = offset + a, offset + b
            cells.append(grid)
            ends.append(end)
            froms.append(np.full((len(grid), 2), (offset + a, offset + b)))
            firsts.append(count)
            count += len(grid)
            lasts.append(count - 1)
            owners.append(owner)
    cell = np.concatenate(cells)
    spots = _smooth_places(every, places, cell, np.concatenate(froms))
    unit = _place_ticks(
        places,
        np.concatenate([[offset + piece[0] for piece in pieces] for offset, pieces in zip(offsets, spans, strict=False)]),
        int(weights.sum()),
    )
    before = np.concatenate(ends).astype(np.int64)
    return Slots(
        cell, cell * _TIME_TICKS, spots, np.rint(spots * unit).astype(np.int64),
        _sums(every, places, weights, before, unit), float(unit),
        np.array(firsts), np.array(lasts), np.array(owners), before, every, places, weights,
    )  # fmt: skip


def count_slots(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], frame: Frame) -> int:
    """Count the slots that :func:`lay_slots` would lay."""
    count = 0
    for track, gap in zip(tracks, gaps, strict=True):
        times = _in_cells(track, frame)
        count += sum(len(_slot_cells(times[a:b], low, high, False)) for a, b, low, high in _pieces(times, gap))
    return count


def pick_slots(slots: Slots, keep: NDArray[np.bool_]) -> Slots:
    """Return only those slots that are to be kept; all first and last slots of pieces must be among them."""
    number = np.cumsum(keep) - 1
    return replace(
        slots, cells=slots.cells[keep], ticks=slots.ticks[keep], places=slots.places[keep], centers=slots.centers[keep],
        sums=slots.sums[keep], ends=slots.ends[keep], firsts=number[slots.firsts], lasts=number[slots.lasts],
    )  # fmt: skip


def thin_slots(slots: Slots) -> Slots | None:
    """Return the slots that a sparse grid would have; None if those are most of them."""
    counts = slots.lasts - slots.firsts + 1
    dense = counts > slots.cells[slots.lasts] - slots.cells[slots.firsts]
    keep = np.repeat(~dense, counts)
    keep[slots.firsts] = keep[slots.lasts] = True
    samples = slots.ends[slots.lasts] - slots.ends[slots.firsts]
    times = slots.times[np.repeat(dense, samples)]
    offset = np.repeat((slots.firsts - slots.cells[slots.firsts])[dense], samples[dense])
    halfway = np.rint((times[1:] + times[:-1]) / 2)[offset[1:] == offset[:-1]]
    for near, first in ((np.floor(times), offset), (np.ceil(times), offset), (halfway, offset[1:][offset[1:] == offset[:-1]])):
        # what lies just outside of a piece is an end of one, too
        keep[np.minimum(first + near.astype(np.int64), len(keep) - 1)] = True
    return pick_slots(slots, keep) if keep.sum() < _THIN * len(keep) else None


def weigh_samples(slots: Slots, weights: NDArray[np.int64]) -> Slots:
    """Return the same slots with sums in which each sample counts as often as its weight says."""
    return replace(slots, sums=_sums(slots.times, slots.spots, weights * slots.weights, slots.ends, slots.place_unit))


def _weights(tracks: Sequence[Track]) -> NDArray[np.int64]:
    if all(track.weights is None for track in tracks):
        return np.ones(sum(map(len, tracks)), np.int64)
    every = [np.ones(len(track)) if track.weights is None else track.weights for track in tracks]
    whole: NDArray[np.int64] = np.maximum(np.rint(_WEIGHT_TICKS * np.concatenate(every)), 1).astype(np.int64)
    return whole


def _sums(
    times: NDArray[np.float64], spots: NDArray[np.float64], weights: NDArray[np.int64], ends: NDArray[np.int64], unit: float
) -> NDArray[np.int64]:
    return prefix_sums(np.rint(times * _TIME_TICKS).astype(np.int64), np.rint(spots * unit).astype(np.int64), weights, ends)


def _in_cells(track: Track, frame: Frame) -> NDArray[np.float64]:
    # microseconds first: a log that was shifted by a round number gives the very same cells
    seconds = np.rint((track.times - frame.epoch / 1000) * 1e6) / 1e6
    return np.asarray(seconds / quantum(frame.time))


def _in_quanta(track: Track, frame: Frame) -> NDArray[np.float64]:
    metres = np.rint((track.positions - np.array(frame.origin) / 1000) * 1e6) / 1e6
    return np.asarray(metres / quantum(frame.space))


def _pieces(times: NDArray[np.float64], gap: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
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


def _slot_cells(times: NDArray[np.float64], low: int, high: int, sparse: bool) -> NDArray[np.int64]:
    if not sparse and high - low < _CELLS_PER_SAMPLE * len(times) + 64:
        return np.arange(low, high + 1, dtype=np.int64)
    halfway = np.rint((times[1:] + times[:-1]) / 2)
    near = np.concatenate([np.floor(times), np.ceil(times), halfway, [low, high]]).astype(np.int64)
    return np.unique(near[(near >= low) & (near <= high)])


def slots_near(thin: Slots, full: Slots, knots: NDArray[np.int64], reach: int) -> NDArray[np.bool_]:
    """Tell which of the full slots are sparse ones, or at most ``reach`` slots from those with the given numbers."""
    near = np.zeros(len(full.cells), np.bool_)
    near[np.searchsorted(_order(full), _order(thin))] = True
    for step in range(-reach, reach + 1):
        near[np.clip(knots + step, 0, len(near) - 1)] = True
    return near


def carry_knots(at: NDArray[np.int64], thin: Slots, full: Slots) -> NDArray[np.int64]:
    """Give the knots on sparse slots to the full slots of the same cells; -1 where there is no knot."""
    knots = np.flatnonzero(at >= 0)
    carried = np.full(len(full.cells), -1, np.int64)
    carried[np.searchsorted(_order(full), _order(thin)[knots])] = at[knots]
    return carried


def _order(slots: Slots) -> NDArray[np.int64]:
    """Increasing numbers of the slots by piece and cell, the same for sparse and full slots."""
    piece = np.repeat(np.arange(len(slots.firsts)), slots.lasts - slots.firsts + 1)
    spans = slots.cells[slots.lasts] - slots.cells[slots.firsts] + 1
    before = np.cumsum(spans) - spans
    order: NDArray[np.int64] = before[piece] + slots.cells - slots.cells[slots.firsts][piece]
    return order


def _smooth_places(
    times: NDArray[np.float64], places: NDArray[np.float64], cells: NDArray[np.int64], ranges: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Mean of the samples within half a cell of each slot where there are three or more, else the straight line's position."""
    out = np.empty((len(cells), places.shape[1]))
    total = np.concatenate([np.zeros((1, places.shape[1])), np.cumsum(places, axis=0)])
    edges = np.flatnonzero(np.diff(ranges[:, 0], prepend=-1))
    for a, b in zip(edges.tolist(), [*edges[1:].tolist(), len(cells)], strict=True):
        first, last = ranges[a]
        t, at = times[first:last], cells[a:b].astype(float)
        for axis in range(places.shape[1]):
            out[a:b, axis] = np.interp(at, t, places[first:last, axis])
        low, high = first + np.searchsorted(t, at - 0.5), first + np.searchsorted(t, at + 0.5)
        many = np.flatnonzero(high - low >= 3)
        out[a + many] = (total[high[many]] - total[low[many]]) / (high - low)[many, None]
    return out


def _place_ticks(places: NDArray[np.float64], starts: NDArray[np.int64], weight: int) -> int:
    """Ticks of a quantum such that the squares of positions about a piece's own, summed over a long part, stay within 62 bits."""
    spread = np.maximum.reduceat(places, starts, axis=0) - np.minimum.reduceat(places, starts, axis=0)
    extent = float(spread.max()) + 1.0
    unit = _PLACE_TICKS
    while unit > 1 and (extent * unit) ** 2 * min(weight, 100_000) > 2.0**58:
        unit //= 2
    return unit
