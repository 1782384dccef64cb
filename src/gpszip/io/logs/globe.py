"""Positions that can't be on the earth, and positions at 0,0 that were hardly measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["GlobeCheck", "find_zero_positions", "format_off_globe"]

#: Positions off the globe that a log may have: so many, or such a share of all. More of them are no single bad values, but
#: another kind of coordinates.
_MAX_OFF_COUNT, _MAX_OFF_SHARE = 3, 0.05

#: Swapped coordinates of a log that crosses latitude 90 go on from one side to the other; bad values are further off, in degrees.
_MAX_SWAPPED_STEP = 1.0

#: All others are at least so far from 0,0 if that was not measured, in degrees: 10 km.
_FAR_FROM_ZERO = 0.09

Floats = NDArray[np.float64]


@dataclass
class GlobeCheck:
    """Counts positions off the globe, batch by batch, and tells whether they may be left out.

    Parameters
    ----------
    on, off : int
        Positions on the globe and off it.
    first : str
        Where the first one off it is, and what it says; empty while there is none.
    """

    on: int = 0
    off: int = 0
    first: str = ""
    _may_be_swapped: bool = True
    _highest_on: float = 0.0
    _lowest_off: float = np.inf

    def find(self, degrees: Floats, rows: NDArray[np.intp], where: str) -> NDArray[np.bool_]:
        """Return which positions are off the globe; longitudes from 180 to 360 are on it.

        Parameters
        ----------
        degrees : float64 array, shape (n, 2)
            Latitude and longitude.
        rows : int array, shape (n,)
            Their numbers in messages.
        where : str
            Name of the log, and what it calls a row.
        """
        lat, lon = degrees[:, 0], degrees[:, 1]
        off: NDArray[np.bool_] = (np.abs(lat) > 90) | (lon < -180) | (lon > 360)
        self.on += int((~off).sum())
        self.off += int(off.sum())
        if not self.first and off.any():
            at = int(off.argmax())
            self.first = f"{where} {int(rows[at])}: latitude {lat[at]:g}, longitude {lon[at]:g}"

        # What tells swapped coordinates from bad values.
        self._may_be_swapped &= bool((np.abs(lon) <= 90).all() and (np.abs(lat) <= 180).all())
        self._highest_on = max(self._highest_on, float(np.abs(lat[~off]).max(initial=0.0)))
        self._lowest_off = min(self._lowest_off, float(np.abs(lat[off]).min(initial=np.inf)))
        return off

    def check(self, *, skip_bad: bool) -> None:
        """Raise if there are so many off the globe that the columns can't be degrees.

        Parameters
        ----------
        skip_bad : bool
            Whether bad positions are left out, however many, as long as some are good.

        Raises
        ------
        InputError
            If they look swapped, or are no degrees.
        """
        swapped = self._may_be_swapped and (
            not self.on or self._lowest_off - self._highest_on < _MAX_SWAPPED_STEP
        )
        few = self.off <= max(_MAX_OFF_SHARE * (self.on + self.off), min(_MAX_OFF_COUNT, self.on))
        if not self.off or (self.on and (skip_bad or (few and not swapped))):
            return
        if swapped:
            raise InputError(
                f"{self.first}: they look swapped; name them: --columns lat=COLUMN,lon=COLUMN"
            )
        more = f" ({self.off} of {self.on + self.off} such)" if self.on else ""
        remedy = "; --skip-bad leaves them out" if self.on else ""
        raise InputError(
            f"{self.first}: not degrees{more}; if they are metres, name them so: --columns x=COLUMN,y=COLUMN{remedy}"
        )


def find_zero_positions(degrees: Floats) -> NDArray[np.bool_]:
    """Return which positions are exactly 0,0 while all others are more than 10 km from there.

    Parameters
    ----------
    degrees : float64 array, shape (n, 2)
        Latitude and longitude.

    Examples
    --------
    >>> find_zero_positions(np.array([[48.1, 11.5], [0, 0]])).tolist(), find_zero_positions(np.array([[0.01, 0.01], [0, 0]])).tolist()
    ([False, True], [False, False])
    """
    zero: NDArray[np.bool_] = (degrees == 0).all(axis=1)
    others = np.abs(degrees[~zero])
    return zero & bool(len(others) and (others > _FAR_FROM_ZERO).any(axis=1).all())


def format_off_globe(degrees: Floats) -> str:
    """Return the coordinate that is off the globe, such as ``lat -9999``."""
    lat, lon = degrees.tolist()
    return f"lat {lat:g}" if abs(lat) > 90 else f"lon {lon:g}"
