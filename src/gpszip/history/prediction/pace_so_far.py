"""How much better arrivals are known once a trip has shown its pace."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.history.travel_time import TravelTimes
from gpszip.history.traversals import Traversals

__all__ = ["band_factor"]

#: Edges before and after a moment of a drive that are compared.
_BEFORE, _AFTER = 20, 15

#: Moments that are looked at, spread evenly; half of them give the same factor to a few per cent.
_MOMENTS = 400

#: Moments that are needed for a factor.
_MIN_MOMENTS = 30

#: Least factor.
_MIN_FACTOR = 0.3

#: Quantiles of the band of 80 %.
_BAND = (0.1, 0.9)


def band_factor(times: TravelTimes, rows: Traversals) -> float:
    """Width of the band with the pace so far, over that without it, in logarithms.

    Drives of the archive are asked about in their middle: observed over expected seconds of what
    follows, with the pace of what came before and without.

    Parameters
    ----------
    times : TravelTimes
        Of the archive.
    rows : Traversals
        Of the archive.

    Returns
    -------
    float
        At most 1: where the pace of a trip says nothing of the rest.
    """
    # Moments with enough edges of one piece before and after.
    piece = np.cumsum(rows.starts)
    moments = np.arange(_BEFORE, len(rows) - _AFTER)
    moments = moments[piece[moments - _BEFORE] == piece[moments + _AFTER - 1]]
    duration = rows.leave - rows.enter
    moments = moments[np.isfinite(duration[moments - _BEFORE])]
    if len(moments) < _MIN_MOMENTS:
        return 1.0
    spread = np.linspace(0, len(moments) - 1, min(len(moments), _MOMENTS))
    moments = moments[spread.astype(np.int64)]

    # Observed over expected seconds of both halves.
    plain, adjusted = np.zeros(len(moments)), np.zeros(len(moments))
    for i, moment in enumerate(moments.tolist()):
        observed, expected = _seconds(times, rows, moment - _BEFORE, moment)
        pace = times.pace_so_far(observed, expected)
        observed, expected = _seconds(times, rows, moment, moment + _AFTER)
        plain[i] = observed / expected
        adjusted[i] = observed / (expected * pace)
    return float(np.clip(_width(adjusted) / _width(plain), _MIN_FACTOR, 1.0))


def _seconds(times: TravelTimes, rows: Traversals, first: int, after: int) -> tuple[float, float]:
    """Observed and expected seconds of some traversals in a row."""
    part = slice(first, after)
    expected = times.seconds(
        rows.edge[part], rows.forward[part], float(rows.enter[first]), metres=rows.metres[part]
    )
    observed = float(rows.leave[after - 1] - rows.enter[first])
    return max(observed, 1e-3), max(float(expected.sum()), 1e-3)


def _width(ratios: NDArray[np.float64]) -> float:
    """Width of the band of 80 % of ratios, in logarithms."""
    low, high = np.quantile(np.log(ratios), _BAND).tolist()
    return max(float(high - low), 1e-6)
