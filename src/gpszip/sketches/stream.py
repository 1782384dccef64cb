"""A coreset of samples that come in one by one, in bounded memory, and of coresets made elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import InputError, OptionError, TrackError
from gpszip.model import Plane
from gpszip.sketches.coreset import OVERSAMPLING, Coreset
from gpszip.sketches.kernels import blocks as kernel

__all__ = ["CoresetStream", "merge_coresets"]


class CoresetStream:
    """One pass over a track, in chunks of any size, in bounded memory.

    Every 2 samples become a block. Whenever there are ``16 * size`` blocks, the neighbours that cost least as one are
    merged until ``8 * size`` are left, which takes O(log size) amortised for each block; at last, ``size`` are made of
    these. So at most ``16 * size`` blocks, 1 sample and the chunk at hand are in memory. As blocks are sketches, merging
    loses only where breaks may fall: no error adds up over the merges. What comes out depends on the samples, not on how
    they were cut into chunks.

    Parameters
    ----------
    size : int
        Blocks of the coreset, at least 1.
    id : str
        Name of the track.
    plane : Plane, optional
        Where the positions lie on the earth.

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
            raise OptionError(f"size is {size}; a coreset has at least 1 block")
        self.size = size
        self.id = id
        self.plane = plane
        self.samples = 0
        self._count = 0
        self._rows: NDArray[np.float64] | None = None
        self._pending: tuple[NDArray[np.float64], ...] = ()
        self._last = -np.inf

    @property
    def blocks(self) -> int:
        """Number of blocks in memory at this moment."""
        return self._count

    def push(
        self, times: ArrayLike, positions: ArrayLike, weights: ArrayLike | None = None
    ) -> None:
        """Take in the next samples.

        Parameters
        ----------
        times : array_like, shape (n,)
            Seconds, increasing, after those of the last chunk.
        positions : array_like, shape (n, d)
            Metres.
        weights : array_like, shape (n,), optional
            Positive; 1 where left out.

        Raises
        ------
        TrackError
            If time stands still or goes back, or a number is not finite; nothing of the chunk is taken in then.
        """
        chunk = self._validate(times, positions, weights)
        if len(chunk[0]) == 0:
            return
        if self._rows is None:
            self._rows = np.empty(
                (2 * OVERSAMPLING * self.size, kernel.FIXED_COLUMNS + 3 * chunk[1].shape[1])
            )
        self._last = float(chunk[0][-1])
        self.samples += len(chunk[0])
        if self._pending:
            chunk = tuple(np.concatenate(both) for both in zip(self._pending, chunk, strict=True))
        whole = len(chunk[0]) // kernel.LEAF_SAMPLES * kernel.LEAF_SAMPLES
        if whole:
            self._count = kernel.absorb_samples(
                self._rows,
                self._count,
                OVERSAMPLING * self.size,
                *(values[:whole] for values in chunk),
            )
        self._pending = tuple(values[whole:].copy() for values in chunk)

    def coreset(self) -> Coreset:
        """Return the coreset of all samples so far; the stream can go on.

        Raises
        ------
        InputError
            If there was no sample.
        """
        if self._rows is None:
            raise InputError("no samples came in: there is nothing to make a coreset of")
        rows = self._rows[: self._count]
        if len(self._pending[0]):
            times, places, weights = self._pending
            rows = np.concatenate(
                [rows, kernel.block_rows(times, places, weights, np.array([0, len(times)]))]
            )
        return Coreset((self.id,), np.zeros(len(rows), np.int64), rows.copy(), self.plane).reduced(
            self.size
        )

    def _validate(
        self, times: ArrayLike, positions: ArrayLike, weights: ArrayLike | None
    ) -> tuple[NDArray[np.float64], ...]:
        when, where = (
            np.ascontiguousarray(times, dtype=np.float64),
            np.ascontiguousarray(positions, dtype=np.float64),
        )
        heavy = (
            np.ones(len(when))
            if weights is None
            else np.ascontiguousarray(weights, dtype=np.float64)
        )
        name = f"track {self.id!r}"
        dimension = (
            where.shape[-1]
            if self._rows is None
            else (self._rows.shape[1] - kernel.FIXED_COLUMNS) // 3
        )
        if when.ndim != 1 or where.shape != (len(when), dimension) or heavy.shape != when.shape:
            raise TrackError(
                f"{name}: times have shape {when.shape} and positions {where.shape}; expected (n,) and (n, {dimension})"
            )
        if not (
            np.isfinite(when).all()
            and np.isfinite(where).all()
            and np.isfinite(heavy).all()
            and (heavy > 0).all()
        ):
            raise TrackError(
                f"{name}: a sample is not finite, or its weight is not positive; drop or repair such samples first"
            )
        back = np.diff(when, prepend=self._last) <= 0
        if back.any():
            at = int(back.argmax())
            raise TrackError(
                f"{name}: sample {self.samples + at}: time {when[at]:g} does not follow the one before; sort or split the track"
            )
        return when, where, heavy


def merge_coresets(parts: Sequence[Coreset], *, size: int | None = None) -> Coreset:
    """Unite coresets of different tracks, or of stretches of the same tracks that follow each other.

    Parameters
    ----------
    parts : sequence of Coreset
        On one plane.
    size : int, optional
        Largest number of blocks of the result; all are kept where left out.

    Returns
    -------
    Coreset
        Tracks in the order in which the parts first name them; stretches of one track in order of time.

    Raises
    ------
    OptionError
        If the planes differ, or stretches of one track overlap in time.

    Examples
    --------
    >>> one, two = CoresetStream(2, id="a"), CoresetStream(2, id="b")
    >>> one.push([0, 1], [[0.0], [1.0]])
    >>> two.push([0, 1], [[5.0], [6.0]])
    >>> merge_coresets([one.coreset(), two.coreset()]).tracks
    ('a', 'b')
    """
    if not parts:
        raise InputError("no coresets: there is nothing to merge")
    first = parts[0]
    for part in parts:
        if part.dimension != first.dimension or part.plane != first.plane:
            raise OptionError("the coresets lie on different planes; read their logs together")
    names = tuple(dict.fromkeys(name for part in parts for name in part.tracks))
    number = {name: i for i, name in enumerate(names)}
    owners = np.concatenate(
        [np.array([number[name] for name in part.tracks], np.int64)[part.owners] for part in parts]
    )
    rows = np.concatenate([part.rows for part in parts])
    order = np.lexsort((rows[:, kernel.FIRST], owners))
    owners, rows = owners[order], rows[order]
    over = (owners[1:] == owners[:-1]) & (rows[1:, kernel.FIRST] <= rows[:-1, kernel.LAST])
    if over.any():
        at = int(over.argmax())
        raise OptionError(
            f"track {names[owners[at]]!r}: two stretches overlap at time {rows[at + 1, kernel.FIRST]:g}; give each its own name"
        )
    whole = replace(first, tracks=names, owners=owners, rows=rows)
    return whole if size is None else whole.reduced(size)
