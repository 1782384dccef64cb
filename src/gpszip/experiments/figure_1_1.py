"""Figure 1-1: the density of the points of taxis, and the same zoomed in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.cells import draw_cells
from gpszip.drawing.map_figure import from_above
from gpszip.drawing.style import FigureType
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.table import Column, Table, Value
from gpszip.testing import taxis

__all__ = ["run"]

#: Generated taxis and samples of each, and the same of a quick run.
_TAXIS, _QUICK = (40, 4_281), (4, 500)

#: Cells along the longer side of a picture.
_CELLS = 160

#: Side of the zoomed part relative to the longer side.
_ZOOM = 0.25

#: Share of the points of each axis, at either end, that are left out: outliers.
_CUT = 0.001

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Density:
    """Points counted in square cells of a rectangle.

    ``xs`` and ``ys`` are the borders of the cells, ``counts`` has a row for each column of cells.
    """

    xs: Floats
    ys: Floats
    counts: NDArray[np.int64]

    @property
    def cell(self) -> float:
        """Side of a cell in metres."""
        return float(self.xs[1] - self.xs[0])


def run(setting: Setting) -> Outcome:
    """Draw the density of all tracks, and of the quarter of the side that has most points."""
    # All points but outliers.
    vehicles, samples = _QUICK if setting.quick else _TAXIS
    tracks = setting.logs or taxis(vehicles, points=samples, seed=setting.seed).tracks
    points = from_above(np.concatenate([track.positions[:, :2] for track in tracks]))
    low, high = np.quantile(points, [_CUT, 1 - _CUT], axis=0)
    whole = _count(points, low, high)

    # A square about the densest place.
    side = _ZOOM * float((high - low).max())
    center = _densest(whole, side)
    zoomed = _count(points, center - side / 2, center + side / 2)
    pictures = (
        Picture(
            "all", "Points in each cell; the square is that of the next.", _draw(whole, zoomed)
        ),
        Picture("zoomed", "The square, in smaller cells.", _draw(zoomed)),
    )
    return Outcome((_table({"all": whole, "zoomed": zoomed}),), pictures)


def _count(points: Floats, low: Floats, high: Floats) -> _Density:
    """Count the points in the cells of a rectangle."""
    cell = max(float((high - low).max()) / _CELLS, 1e-6)
    xs, ys = (
        start + cell * np.arange(max(int(np.ceil((end - start) / cell)), 1) + 1)
        for start, end in zip(low, high, strict=True)
    )
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=(xs, ys))
    return _Density(xs, ys, counts.astype(np.int64))


def _densest(density: _Density, side: float) -> Floats:
    """Return the center of the square of a side, on a raster of half sides, with most points."""
    # Sums of squares by sums of all cells to the south-west.
    size = max(round(side / density.cell), 1)
    padded = np.pad(density.counts, ((0, size), (0, size)))
    sums = np.pad(padded.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    inner = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]

    # The first of the largest.
    x, y = np.unravel_index(int(inner.argmax()), inner.shape)
    return np.array([density.xs[0] + x * density.cell, density.ys[0] + y * density.cell]) + side / 2


def _table(densities: dict[str, _Density]) -> Table:
    # Points that are shown, and how they are spread.
    columns = (
        Column("picture", "picture"),
        Column("points", "points"),
        Column("cell_m", "cell m", 1),
        Column("cells", "cells with points"),
        Column("most", "most in a cell"),
    )

    # A row for each picture.
    rows: tuple[Mapping[str, Value], ...] = tuple(
        {
            "picture": name,
            "points": int(each.counts.sum()),
            "cell_m": each.cell,
            "cells": int((each.counts > 0).sum()),
            "most": int(each.counts.max()),
        }
        for name, each in densities.items()
    )
    return Table("", "Points in square cells", columns, rows)


def _draw(density: _Density, square: _Density | None = None) -> FigureType:
    frame = None if square is None else (square.xs, square.ys)
    return draw_cells(density.xs, density.ys, density.counts, square=frame)
