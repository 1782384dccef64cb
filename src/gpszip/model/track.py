"""A track: the positions of one agent over time (thesis, definitions 4.1.1 and 4.1.5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import TrackError
from gpszip.model.grid import Plane

__all__ = ["Track"]


@dataclass(frozen=True, eq=False)
class Track:
    """Times and positions of one agent, the thesis's signal P.

    Parameters
    ----------
    id : str
        Name of the track, kept verbatim.
    times : array_like, shape (n,)
        Seconds in the log's own zero, finite and strictly increasing.
    positions : array_like, shape (n, d)
        Metres on a plane, finite, d >= 1.
    weights : array_like, shape (n,), optional
        Positive weights of the samples; all 1 where left out.
    attributes : mapping of str to array, shape (n,), optional
        Further columns of the log, such as ``alt`` or ``speed``.
    plane : Plane, optional
        Where the positions lie on the earth. Left out for a log that came with x and y.
    timed : bool, default True
        Whether the log has times. A track without times is a shape: its ``times`` hold the distance along it in metres.

    Raises
    ------
    TrackError
        If there is no sample, a shape does not fit, a number is not finite, or time stands still or goes back.

    Examples
    --------
    >>> track = Track("walk", [0, 1, 2], [[0, 0], [1, 0], [2, 0]])
    >>> len(track), track.dimension
    (3, 2)
    """

    id: str
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64] | None = None
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    plane: Plane | None = None
    timed: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", _frozen(self.times))
        object.__setattr__(self, "positions", _frozen(self.positions))
        if self.weights is not None:
            object.__setattr__(self, "weights", _frozen(self.weights))
        _check(self)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int(self.positions.shape[1])


def _frozen(values: ArrayLike) -> NDArray[np.float64]:
    array: NDArray[np.float64] = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def _check(track: Track) -> None:
    name = f"track {track.id!r}"
    times, positions = track.times, track.positions
    if (
        times.ndim != 1
        or positions.ndim != 2
        or len(positions) != len(times)
        or positions.shape[1] < 1
    ):
        raise TrackError(
            f"{name}: times have shape {times.shape} and positions {positions.shape}; expected (n,) and (n, d)"
        )
    if len(times) == 0:
        raise TrackError(f"{name}: no samples")
    broken = ~(np.isfinite(times) & np.isfinite(positions).all(axis=1))
    if broken.any():
        raise TrackError(
            f"{name}: sample {int(broken.argmax())} is not finite; drop or repair such samples first"
        )
    still = np.diff(times) <= 0
    if still.any():
        where = int(still.argmax()) + 1
        raise TrackError(
            f"{name}: sample {where}: time {times[where]:g} does not follow {times[where - 1]:g}; sort or split the track"
        )
    if track.weights is not None and (
        track.weights.shape != times.shape or not (track.weights > 0).all()
    ):
        raise TrackError(f"{name}: weights must be {len(times)} positive numbers")
