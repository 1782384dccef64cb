"""A track: the positions of one agent over time (thesis, definitions 4.1.1 and 4.1.5)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError, TrackError
from gpszip.model.frames import FrameMethods
from gpszip.model.grid import Plane
from gpszip.model.html import to_html
from gpszip.model.projection import map_coordinates
from gpszip.model.text import axes_text, count_text
from gpszip.model.timestamps import Times, format_span, to_seconds, wrong_unit

__all__ = ["Track", "take_samples", "time_bounds", "tracks_from_rows"]


@dataclass(frozen=True, eq=False, repr=False)
class Track(FrameMethods):
    """Times and positions of one agent, the thesis's signal P.

    Positions are kept in metres on a plane. ``coordinates`` gives them as the log has them: in
    latitude and longitude for a log in degrees.

    Parameters
    ----------
    id : str
        Name of the track, kept verbatim.
    times : array_like, shape (n,)
        Seconds, finite and strictly increasing, counted from whatever zero the log uses.
    positions : array_like, shape (n, d)
        Metres on a plane, finite, d >= 1.
    weights : array_like, shape (n,), optional
        Positive weights of the samples; all 1 where left out.
    attributes : mapping of str to array, shape (n,), optional
        Further columns of the log, such as ``alt`` or ``speed``.
    plane : Plane, optional
        The plane of a log in degrees. Left out for a log in x, y.
    timed : bool, default True
        Whether the log has times. A track without times is a shape: its ``times`` hold the distance
        along it in metres.

    Raises
    ------
    TrackError
        If there is no sample, a shape does not fit, a number is not finite, or time stands still or
        goes back.

    Examples
    --------
    >>> track = Track("walk", [0, 1, 2], [[0, 0], [1, 0], [2, 0]])
    >>> track
    Track('walk', 3 samples, 0 s to 2 s, x, y)
    >>> track[1:].times.tolist()
    [1.0, 2.0]
    """

    id: str
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64] | None = None
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    plane: Plane | None = None
    timed: bool = True

    def __post_init__(self) -> None:
        # The fields of a frozen dataclass can be set in this way only.
        object.__setattr__(self, "times", _read_only(self.times))
        object.__setattr__(self, "positions", _read_only(self.positions))
        if self.weights is not None:
            object.__setattr__(self, "weights", _read_only(self.weights))
        _check(self)

    def __repr__(self) -> str:
        first, last = float(self.times[0]), float(self.times[-1])
        span = format_span(first, last) if self.timed else f"{last - first:.10g} m without times"
        samples = count_text(len(self), "sample")
        return f"Track({self.id!r}, {samples}, {span}, {axes_text(self.dimension, self.plane)})"

    def _repr_html_(self) -> str:
        return to_html("show_tracks", [self])

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, span: slice) -> Track:
        """Samples in a time range, ``track[begin:end]``: from ``begin`` on, and before ``end``.

        Parameters
        ----------
        span : slice of times
            Seconds, ``datetime``, ``numpy.datetime64`` or ISO 8601 text; no step.

        Returns
        -------
        Track
            The same id, with the attributes and weights of these samples.

        Raises
        ------
        OptionError
            If there is no sample in the range, or the track has no times.
        """
        # Convert the bounds to seconds, which only a track with times can be compared with.
        begin, end = time_bounds(span)
        if not self.timed:
            raise OptionError("has no times, so no time range", location=f"track {self.id!r}")

        # The first sample at or after each end: one at ``begin`` counts, one at ``end`` doesn't.
        first, last = np.searchsorted(self.times, [begin, end]).tolist()

        # Name the likely mistake where nothing is found.
        if first >= last:
            bounds = np.array([begin, end])
            raise OptionError(
                f"no sample in this time range; the track has {format_span(*self.times[[0, -1]])}",
                location=f"track {self.id!r}",
                remedy=wrong_unit(bounds, *self.times[[0, -1]].tolist()),
            )

        return take_samples(self, slice(first, last))

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int(self.positions.shape[1])

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Positions in the coordinates of the log, shape (n, d).

        Latitude and longitude in degrees for a log in degrees (with a ``plane``), x, y[, z] for any
        other. Degrees are computed at each call.
        """
        return map_coordinates(self.positions, self.plane)


def take_samples(track: Track, rows: slice) -> Track:
    """Return some samples of a track, with their weights and attributes.

    Examples
    --------
    >>> take_samples(Track("walk", [0, 1, 2], [[0, 0], [1, 0], [2, 0]]), slice(2)).times.tolist()
    [0.0, 1.0]
    """
    return replace(
        track,
        times=track.times[rows],
        positions=track.positions[rows],
        weights=None if track.weights is None else track.weights[rows],
        attributes={name: values[rows] for name, values in track.attributes.items()},
    )


def tracks_from_rows(
    ids: Sequence[str],
    counts: Sequence[int],
    times: ArrayLike,
    positions: ArrayLike,
    attributes: Mapping[str, NDArray[np.generic]],
    plane: Plane | None,
) -> list[Track]:
    """Make tracks with times of successive rows, which they share instead of copies.

    Parameters
    ----------
    ids : sequence of str, length k
        Names of the tracks.
    counts : sequence of int, length k
        Samples of each track; n in all.
    times, positions : array_like, shape (n,) and (n, d)
        Seconds and metres, track after track.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    plane : Plane or None
        The plane of a log in degrees.

    Raises
    ------
    TrackError
        As :class:`Track` raises it.

    Examples
    --------
    >>> rows = np.arange(3.0), np.zeros((3, 2))
    >>> [len(track) for track in tracks_from_rows(["a", "b"], [1, 2], *rows, {}, None)]
    [1, 2]
    """
    # Check all rows at once: by itself, each of 100,000 short tracks would take 25 us.
    times, positions = _read_only(times), _read_only(positions)
    ends = np.cumsum(counts).tolist()
    bounds = [slice(end - count, end) for count, end in zip(counts, ends, strict=True)]
    begins = np.zeros(len(times) + 1, np.bool_)
    begins[[0, *ends]] = True
    is_good = (
        min(counts, default=1) > 0
        and bool(np.isfinite(times).all() and np.isfinite(positions).all())
        and bool(((times[1:] > times[:-1]) | begins[1:-1]).all())
    )

    # A track that is wrong says so itself.
    tracks = []
    for name, rows in zip(ids, bounds, strict=True):
        values: dict[str, Any] = {
            "id": name,
            "times": times[rows],
            "positions": positions[rows],
            "weights": None,
            "attributes": {column: cells[rows] for column, cells in attributes.items()},
            "plane": plane,
            "timed": True,
        }
        if is_good:
            track = object.__new__(Track)
            track.__dict__.update(values)
        else:
            track = Track(**values)
        tracks.append(track)
    return tracks


def time_bounds(span: slice) -> tuple[float, float]:
    """Both ends of a slice of times in seconds; infinite where left out.

    Examples
    --------
    >>> time_bounds(slice("1970-01-02", None))
    (86400.0, inf)
    """
    if not isinstance(span, slice):
        raise TypeError(f"a track is sliced by time, track[begin:end], not by {span!r}")
    if span.step is not None:
        raise OptionError("a time range has no step; give [begin:end]")
    # An end that is left out is open: all samples are after -inf and before inf.
    begin, end = (
        default if bound is None else _single_time(bound)
        for bound, default in ((span.start, -math.inf), (span.stop, math.inf))
    )
    return begin, end


def _single_time(bound: Times) -> float:
    # A list is no end of a range. NaT is NaN here, which NumPy sorts after all times: as an end, it
    # would select all samples.
    seconds = to_seconds(bound, name="the time range")
    if seconds.size != 1 or np.isnan(seconds).any():
        raise OptionError(f"the time range ends at {bound!r}, which is not one time")
    return float(seconds.reshape(-1)[0])


def _read_only(values: ArrayLike) -> NDArray[np.float64]:
    # A copy in any case: the caller's array stays writable, and changes to it don't reach the
    # track. Row by row in memory (C order), as kernels expect it.
    array: NDArray[np.float64] = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def _check(track: Track) -> None:
    name = f"track {track.id!r}"
    times, positions = track.times, track.positions

    # Shapes.
    if (
        times.ndim != 1
        or positions.ndim != 2
        or len(positions) != len(times)
        or positions.shape[1] < 1
    ):
        raise TrackError(
            f"times have shape {times.shape} and positions {positions.shape}; "
            "expected (n,) and (n, d)",
            location=name,
        )
    if len(times) == 0:
        raise TrackError("no samples", location=name)

    # Numbers.
    if not (np.isfinite(times).all() and np.isfinite(positions).all()):
        broken = ~(np.isfinite(times) & np.isfinite(positions).all(axis=1))
        raise TrackError(
            f"sample {int(broken.argmax())} is not finite",
            location=name,
            remedy="drop or repair such samples first",
        )
    late = times[1:] <= times[:-1]
    if late.any():
        sample = int(late.argmax()) + 1
        raise TrackError(
            f"time {times[sample]:.15g} is not later than {times[sample - 1]:.15g}",
            location=f"{name}: sample {sample}",
            remedy="sort or split the track",
        )

    # NaN is not finite either. An infinite weight would make every mean NaN.
    weights = track.weights
    if weights is not None and (
        weights.shape != times.shape or not (np.isfinite(weights) & (weights > 0)).all()
    ):
        raise TrackError(f"weights must be {len(times)} positive finite numbers", location=name)
