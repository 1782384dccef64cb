"""Positions that can't be on the globe, and positions at 0,0 that were hardly measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["GlobeCheck", "find_zero_positions", "format_off_globe"]

#: Positions off the globe that a log may have at any rate. More of them are no single bad values:
#: the columns are no latitude and longitude in degrees.
_MAX_OFF_COUNT = 3

#: Share of all positions that may be off the globe.
_MAX_OFF_SHARE = 0.05

#: Degrees between the highest latitude on the globe and the lowest one off it, below which the
#: coordinates look swapped: longitudes read as latitudes go past 90 without a gap, bad values are
#: further off.
_MAX_SWAPPED_STEP = 1.0

#: Degrees, about 10 km, by which all other positions are away from 0,0 if that was not measured.
_FAR_FROM_ZERO = 0.09

Floats = NDArray[np.float64]


@dataclass
class GlobeCheck:
    """Counts positions off the globe, batch by batch, and decides whether they may be left out.

    Parameters
    ----------
    on, off : int
        Number of positions on the globe and off it.
    path, location : str
        File and row of the first position off the globe; empty if there is none.
    first : tuple of float, optional
        Its latitude and longitude.
    """

    on: int = 0
    off: int = 0
    path: str = ""
    location: str = ""
    first: tuple[float, float] | None = None
    _may_be_swapped: bool = True
    _highest_on: float = 0.0
    _lowest_off: float = np.inf

    def find(
        self, degrees: Floats, rows: NDArray[np.intp], path: str, row_noun: str
    ) -> NDArray[np.bool_]:
        """Return which positions are off the globe; longitudes from 180 to 360 are on it.

        Parameters
        ----------
        degrees : float64 array, shape (n, 2)
            Latitude and longitude.
        rows : int array, shape (n,)
            Row numbers for messages.
        path : str
            Name of the log.
        row_noun : str
            Its word for a row.
        """
        # Longitudes run from -180 to 180 in most logs, and from 0 to 360 in some.
        lat, lon = degrees[:, 0], degrees[:, 1]
        off: NDArray[np.bool_] = (np.abs(lat) > 90) | (lon < -180) | (lon > 360)
        off_count = int(np.count_nonzero(off))
        self.on += len(off) - off_count
        self.off += off_count
        if self.first is None and off.any():
            i = int(off.argmax())
            self.path, self.location = path, f"{row_noun} {int(rows[i])}"
            self.first = (float(lat[i]), float(lon[i]))

        # Collect what distinguishes swapped coordinates from bad values.
        size = np.abs(lat)
        self._may_be_swapped &= bool((np.abs(lon) <= 90).all() and (size <= 180).all())
        on_globe = size[~off] if off_count else size
        self._highest_on = max(self._highest_on, float(on_globe.max(initial=0.0)))
        self._lowest_off = min(self._lowest_off, float(size[off].min(initial=np.inf)))
        return off

    def check(self, *, skip_bad: bool) -> None:
        """Raise if the positions off the globe are too many for single bad values.

        Parameters
        ----------
        skip_bad : bool
            Whether any number of bad positions may be left out, as long as one is good.

        Raises
        ------
        InputError
            If latitude and longitude look swapped, or the columns are no degrees.
        """
        # Decide whether they may be left out.
        step = self._lowest_off - self._highest_on
        swapped = self._may_be_swapped and (not self.on or step < _MAX_SWAPPED_STEP)
        # Few is a twentieth of all, or up to three as long as they don't outnumber the good ones.
        positions = self.on + self.off
        few = self.off <= max(_MAX_OFF_SHARE * positions, min(_MAX_OFF_COUNT, self.on))
        if self.first is None or (self.on and (skip_bad or (few and not swapped))):
            return

        # Say what they are, and what to do.
        lat, lon = self.first
        if swapped:
            raise InputError(
                f"latitude {lat:g}, longitude {lon:g}: they look swapped",
                path=self.path,
                location=self.location,
                remedy="name them: --columns lat=COLUMN,lon=COLUMN",
            )
        share = f" ({self.off} of {positions} such)" if self.on else ""
        or_skip = "; --skip-bad leaves them out" if self.on else ""
        raise InputError(
            f"latitude {lat:g}, longitude {lon:g}: not degrees{share}",
            path=self.path,
            location=self.location,
            remedy=f"if they are metres, name them so: --columns x=COLUMN,y=COLUMN{or_skip}",
        )


def find_zero_positions(degrees: Floats) -> NDArray[np.bool_]:
    """Return which positions are exactly 0,0 while all others are more than 10 km away.

    Parameters
    ----------
    degrees : float64 array, shape (n, 2)
        Latitude and longitude.

    Examples
    --------
    >>> find_zero_positions(np.array([[48.1, 11.5], [0, 0]])).tolist()
    [False, True]
    >>> find_zero_positions(np.array([[0.01, 0.01], [0, 0]])).tolist()
    [False, False]
    """
    zero: NDArray[np.bool_] = (degrees[:, 0] == 0) & (degrees[:, 1] == 0)
    if not zero.any():
        return zero
    others = np.abs(degrees[~zero])
    return zero & bool(len(others) and (others > _FAR_FROM_ZERO).any(axis=1).all())


def format_off_globe(degrees: Floats) -> str:
    """Return the coordinate that is off the globe, such as ``lat -9999``."""
    lat, lon = degrees.tolist()
    return f"lat {lat:g}" if abs(lat) > 90 else f"lon {lon:g}"
