"""Simplifiers of other packages, as functions that return the samples kept."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import from_above
from gpszip.model import Track

__all__ = ["is_installed", "movingpandas_td_tr", "shapely_simplify", "vw_and_rdp"]

Ints = NDArray[np.int64]

#: Nanoseconds of a second.
_NANOSECONDS = 1e9


def is_installed(package: str) -> bool:
    """Whether a package is installed; a folder of its name is not a package.

    Examples
    --------
    >>> is_installed("numpy"), is_installed("no_such_package")
    (True, False)
    """
    spec = find_spec(package)
    return spec is not None and spec.origin is not None


def shapely_simplify(track: Track, tolerance: float) -> Ints:
    """Return the samples that ``shapely`` keeps: Douglas-Peucker by GEOS, in x and y."""
    from shapely import LineString, get_coordinates

    # The number of a sample goes along as its height, which distances leave out.
    numbered = np.column_stack([from_above(track.positions), np.arange(len(track))])
    simple = LineString(numbered).simplify(tolerance, preserve_topology=False)
    kept: Ints = get_coordinates(simple, include_z=True)[:, 2].astype(np.int64)
    return kept


def vw_and_rdp(function: str) -> Callable[[Track, float], Ints]:
    """Return a function of the package ``simplification``, in x and y."""

    def keep(track: Track, tolerance: float) -> Ints:
        from simplification import cutil

        samples = getattr(cutil, function)(
            np.ascontiguousarray(from_above(track.positions)), tolerance
        )
        return np.asarray(samples, np.int64)

    return keep


def movingpandas_td_tr(track: Track, tolerance: float) -> Ints:
    """Return the samples that the ``TopDownTimeRatioGeneralizer`` of movingpandas keeps."""
    with warnings.catch_warnings():
        # It warns of packages that it doesn't need for this.
        warnings.simplefilter("ignore")
        import geopandas
        import movingpandas
        import pandas as pd

        # Times since the first sample, which suit any clock.
        since = np.round((track.times - track.times[0]) * _NANOSECONDS).astype(np.int64)
        points = geopandas.points_from_xy(*from_above(track.positions).T)
        frame = geopandas.GeoDataFrame(
            {"number": np.arange(len(track))},
            geometry=points,
            index=pd.DatetimeIndex(pd.to_datetime(since)),
            crs="EPSG:3857",
        )
        trajectory = movingpandas.Trajectory(frame, track.id)
        simple = movingpandas.TopDownTimeRatioGeneralizer(trajectory).generalize(tolerance)
        return np.unique(np.asarray(simple.df["number"], np.int64))
