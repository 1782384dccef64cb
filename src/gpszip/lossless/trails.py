"""Walks as predictions of exact logs: where each track is when, in the log's own coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["NO_TRAILS", "NamedTrails", "Trail", "Trails"]


@dataclass(frozen=True, eq=False)
class Trail:
    """Knots of one walk, which is linear in time between them.

    Every machine has the same bits here: additions, multiplications, divisions and square roots of
    float64 alone lead from an archive's integers to these numbers.

    Parameters
    ----------
    times : float64 array, shape (k,)
        Seconds of the knots, which never decrease. Pieces begin and end when the log does.
    positions : float64 array, shape (k, d)
        Degrees of latitude and longitude, or the log's own coordinates.
    is_end : bool array, shape (k,)
        Whether a piece begins or ends here.
    is_stay : bool array, shape (k,)
        Whether the walk stays where it is up to this knot.
    is_gap : bool array, shape (k,)
        Whether a gap ends here.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    is_end: NDArray[np.bool_]
    is_stay: NDArray[np.bool_]
    is_gap: NDArray[np.bool_]


class Trails(Protocol):
    """The walks of an archive with times."""

    @property
    def names(self) -> Sequence[str]:
        """Name of each track."""

    @property
    def axes(self) -> int:
        """Number of coordinates of positions."""

    @property
    def time_step(self) -> float:
        """Seconds to which times of knots are rounded."""

    def trail(self, number: int) -> Trail | None:
        """Knots of a track; None for one without times."""


@dataclass(frozen=True)
class NamedTrails:
    """Trails of an archive whose walks don't predict logs.

    Parameters
    ----------
    names : sequence of str
        Name of each track.
    """

    names: Sequence[str] = ()
    axes: int = 0
    time_step: float = 0.0

    def trail(self, number: int) -> Trail | None:
        """None for any track."""
        del number
        return None


#: Trails where there are no walks.
NO_TRAILS: Trails = NamedTrails()
