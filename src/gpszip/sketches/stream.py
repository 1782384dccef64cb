"""Coresets of a stream of samples, in bounded memory, and of other coresets merged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import InputError, OptionError, TrackError
from gpszip.kernels.read_only import read_only
from gpszip.model import Plane
from gpszip.sketches.coreset import OVERSAMPLING, Coreset
from gpszip.sketches.kernels import blocks as kernel

__all__ = ["CoresetStream", "merge_coresets"]


class _Chunk(NamedTuple):
    """Samples as arrays."""

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64]


class CoresetStream:
    """Builds the coreset of a track in one pass over chunks of any size, in bounded memory.

    Every two samples become a block. Whenever there are ``16 * size`` blocks, the cheapest
    neighbours are merged until ``8 * size`` are left, in amortised time O(log size) for each
    block. At the end, ``size`` blocks are made of these. So the memory holds at most
    ``16 * size`` blocks, one sample and the current chunk.

    Blocks hold exact moments, so that no error adds up over the merges; only the times at which
    a function can break without an error become fewer. The result depends on the samples, not on
    the chunks.

    Parameters
    ----------
    size : int
        Blocks of the coreset, at least 1.
    id : str
        Name of the track.
    plane : Plane, optional
        The planes of the positions.

    Examples
    --------
    >>> stream = CoresetStream(4)
    >>> for hour in range(3):
    ...     stream.push(np.arange(96.0) + 96 * hour, np.full((96, 2), float(hour)))
    >>> len(stream.coreset()), stream.coreset().samples, stream.coreset().rmse
    (4, 288, 0.0)
    """

    def __init__(self, size: int, *, id: str = "0", plane: Plane | None = None) -> None:
        if size < 1:
            raise OptionError(f"size is {size}", remedy="a coreset has at least 1 block")
        self.size = size
        self.id = id
        self.plane = plane
        self.samples = 0
        self._count = 0
        self._rows: NDArray[np.float64] | None = None
        self._pending: _Chunk | None = None
        self._last = -np.inf

    @property
    def blocks(self) -> int:
        """Number of blocks in memory."""
        return self._count

    def push(
        self, times: ArrayLike, positions: ArrayLike, weights: ArrayLike | None = None
    ) -> None:
        """Add the next samples.

        Parameters
        ----------
        times : array_like, shape (n,)
            Seconds, increasing, after those of the last chunk.
        positions : array_like, shape (n, d)
            Metres.
        weights : array_like, shape (n,), optional
            Positive; default 1.

        Raises
        ------
        TrackError
            If times don't increase, or a number is not finite. The chunk is not added then.
        """
        # Check the chunk before the state changes, so that a bad one leaves no trace.
        chunk = self._validate(times, positions, weights)
        if len(chunk.times) == 0:
            return

        # The first chunk fixes the dimension.
        if self._rows is None:
            width = kernel.FIXED_COLUMNS + 3 * chunk.positions.shape[1]
            # Once these are full, half of them are left after merging.
            self._rows = np.empty((2 * OVERSAMPLING * self.size, width))
        self._last = float(chunk.times[-1])
        self.samples += len(chunk.times)

        # Samples that did not fill a leaf come first.
        if self._pending is not None:
            pairs = zip(self._pending, chunk, strict=True)
            chunk = _Chunk(*(np.concatenate(pair) for pair in pairs))

        # Add full leaves; keep the rest for the next chunk.
        end = len(chunk.times) // kernel.LEAF_SAMPLES * kernel.LEAF_SAMPLES
        if end:
            self._count = kernel.absorb_samples(
                self._rows,
                self._count,
                OVERSAMPLING * self.size,
                *(read_only(values[:end]) for values in chunk),
            )
        # Copies, since slices would keep the full chunk in memory.
        self._pending = _Chunk(*(values[end:].copy() for values in chunk))

    def coreset(self) -> Coreset:
        """Return the coreset of all samples so far; more samples may follow.

        Raises
        ------
        InputError
            If there is no sample.
        """
        if self._rows is None or self._pending is None:
            raise InputError("no samples came in: there is nothing to make a coreset of")

        # Samples that don't fill a leaf become one more block.
        rows = self._rows[: self._count]
        if len(self._pending.times):
            cuts = np.array([0, len(self._pending.times)])
            rest = _Chunk(*map(read_only, self._pending))
            rows = np.concatenate([rows, kernel.block_rows(*rest, cuts)])
        owners = np.zeros(len(rows), np.int64)
        return Coreset((self.id,), owners, rows.copy(), self.plane).reduced(self.size)

    def _validate(
        self, times: ArrayLike, positions: ArrayLike, weights: ArrayLike | None
    ) -> _Chunk:
        """Return the arguments as arrays; raise TrackError if they can't be added."""
        # Convert to doubles; samples without weights count once each.
        name = f"track {self.id!r}"
        times = np.ascontiguousarray(times, dtype=np.float64)
        positions = np.ascontiguousarray(positions, dtype=np.float64)
        if weights is None:
            weights = np.ones(len(times))
        weights = np.ascontiguousarray(weights, dtype=np.float64)

        # Shapes.
        if self._rows is None:
            dimension = positions.shape[-1]
        else:
            dimension = (self._rows.shape[1] - kernel.FIXED_COLUMNS) // 3
        if (
            times.ndim != 1
            or positions.shape != (len(times), dimension)
            or weights.shape != times.shape
        ):
            raise TrackError(
                f"times have shape {times.shape} and positions {positions.shape}; "
                f"expected (n,) and (n, {dimension})",
                location=name,
            )

        # Values.
        is_finite = all(np.isfinite(values).all() for values in (times, positions, weights))
        if not is_finite or (weights <= 0).any():
            raise TrackError(
                "a sample is not finite, or its weight is not positive",
                location=name,
                remedy="drop or repair such samples first",
            )

        # Order, from the last sample of the previous chunk on.
        goes_back = np.diff(times, prepend=self._last) <= 0
        if goes_back.any():
            row = int(goes_back.argmax())
            raise TrackError(
                f"time {times[row]:.15g} is not later than the one before",
                location=f"{name}: sample {self.samples + row}",
                remedy="sort or split the track",
            )
        return _Chunk(times, positions, weights)


def merge_coresets(coresets: Sequence[Coreset], *, size: int | None = None) -> Coreset:
    """Merge coresets of different tracks, or of consecutive slices of the same tracks.

    Parameters
    ----------
    coresets : sequence of Coreset
        On the same planes.
    size : int, optional
        Largest number of blocks of the result. Default: all blocks are kept.

    Returns
    -------
    Coreset
        Tracks in the order of their first coresets; slices of a track in order of time.

    Raises
    ------
    OptionError
        If the planes differ, or slices of a track overlap in time.

    Examples
    --------
    >>> first, second = CoresetStream(2, id="a"), CoresetStream(2, id="b")
    >>> first.push([0, 1], [[0.0], [1.0]])
    >>> second.push([0, 1], [[5.0], [6.0]])
    >>> merge_coresets([first.coreset(), second.coreset()]).tracks
    ('a', 'b')
    """
    # Positions are comparable only on one plane.
    if not coresets:
        raise InputError("no coresets: there is nothing to merge")
    first = coresets[0]
    for coreset in coresets:
        if coreset.dimension != first.dimension or coreset.plane != first.plane:
            raise OptionError(
                "the coresets lie on different planes", remedy="read their logs together"
            )

    # Common numbers for the tracks.
    names = tuple(dict.fromkeys(name for coreset in coresets for name in coreset.tracks))
    numbers = {name: i for i, name in enumerate(names)}
    owners = np.concatenate(
        [
            np.array([numbers[name] for name in coreset.tracks], np.int64)[coreset.owners]
            for coreset in coresets
        ]
    )
    rows = np.concatenate([coreset.rows for coreset in coresets])

    # Blocks by track and time.
    order = np.lexsort((rows[:, kernel.FIRST], owners))
    owners, rows = owners[order], rows[order]
    overlaps = (owners[1:] == owners[:-1]) & (rows[1:, kernel.FIRST] <= rows[:-1, kernel.LAST])
    if overlaps.any():
        row = int(overlaps.argmax())
        raise OptionError(
            f"two slices overlap at time {rows[row + 1, kernel.FIRST]:.15g}",
            location=f"track {names[owners[row]]!r}",
            remedy="give each its own name",
        )

    # Merge neighbouring blocks if there are more than allowed.
    merged = replace(first, tracks=names, owners=owners, rows=rows)
    return merged if size is None else merged.reduced(size)
