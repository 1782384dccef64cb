"""Features of GeoJSON that are points: rows of a table, whose columns are their properties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.geojson.features import BadPosition, Point, position_table
from gpszip.io.logs.geojson.json_columns import abbreviate, build_column, concatenate_columns
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.tables.roles import find_roles
from gpszip.io.tables.table import build_raw_log
from gpszip.model.read_result import Repair

__all__ = ["HEIGHT_NAMES", "PointTable", "dropped_positions_repair"]

#: What the third number of a position may be asked for as.
HEIGHT_NAMES = ("alt", "altitude", "ele", "elevation", "height")

#: Points whose properties become columns together.
_BATCH_POINTS = 1 << 14

#: Cells that may be empty as only some points have a property; beyond that, points are no rows of a table.
_MAX_EMPTY_CELLS = 50_000_000


class PointTable:
    """Gathers points, and holds them as columns.

    Parameters
    ----------
    name : str
        Name of the log for messages.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._held: list[tuple[int, Point]] = []
        self._tables: list[NDArray[np.float64]] = []
        self._columns: dict[str, list[Any]] = {}
        self._rows = self._empty = self._bad = 0
        self._first_bad: BadPosition | None = None

    def __len__(self) -> int:
        """Return how many points there are, with those whose position can't be read."""
        return self._rows + self._bad + len(self._held)

    def add(self, number: int, point: Point) -> None:
        """Take in the point of a feature of this number.

        Raises
        ------
        InputError
            If there are too many properties that only few points have.
        """
        self._held.append((number, point))
        if len(self._held) == _BATCH_POINTS:
            self._flush()

    def log(self, request: Request, *, metric: bool) -> RawLog:
        """Return the points as a log.

        Parameters
        ----------
        request : Request
            Columns among the properties, unit of time and attributes.
        metric : bool
            Whether coordinates are metres.

        Raises
        ------
        InputError
            If no property holds their times, or no position can be read.
        """
        self._flush()
        if not self._rows:
            value = self._first_bad.value if self._first_bad is not None else ""
            raise InputError(
                f"{self._name}: no Point is at a longitude and a latitude; the first is at {value}"
            )
        names, columns = self._named(metric=metric)
        own = {"x": "x", "y": "y"} if metric else {"lat": "lat", "lon": "lon"}
        by_role = request.columns if isinstance(request.columns, Mapping) else {}
        roles = find_roles(
            names, {**by_role, **own}, request.keep, self._name, heading=request.heading
        )
        roles = replace(
            roles, hemispheres=()
        )  # coordinates of GeoJSON have a sign, whatever properties there are
        repairs = (
            ()
            if self._first_bad is None
            else (dropped_positions_repair(self._bad, self._first_bad, self._name),)
        )
        return build_raw_log(
            [columns[i]() for i in roles.used], names, roles, request, self._name, repairs=repairs
        )

    def _named(self, *, metric: bool) -> tuple[list[str], list[Any]]:
        """Names of all columns, and functions that make them."""
        table = np.concatenate(self._tables)
        axes = ["x", "y"] if metric else ["lon", "lat"]
        third = bool(np.isfinite(table[:, 2]).any())
        if third and (metric or not any(name.lower() in HEIGHT_NAMES for name in self._columns)):
            axes.append("z" if metric else "alt")
        others = [name for name in self._columns if name not in axes]
        numbers = [lambda i=i: pa.chunked_array([pa.array(table[:, i])]) for i in range(len(axes))]
        return [*axes, *others], [
            *numbers,
            *(lambda name=name: concatenate_columns(self._whole(name)) for name in others),
        ]

    def _whole(self, name: str) -> list[Any]:
        """The parts of a column, with nulls for the rows at the end."""
        parts = self._columns[name]
        return [*parts, pa.nulls(self._rows - sum(map(len, parts)))]

    def _flush(self) -> None:
        """Turn the points held into columns."""
        if not self._held:
            return
        held, self._held = self._held, []

        # their positions; points without one are dropped
        table = position_table([point.coordinates for _, point in held])
        good = np.isfinite(table[:, :2]).all(axis=1)
        if not good.all():
            number, point = held[int(good.argmin())]
            self._first_bad = self._first_bad or BadPosition(
                f"feature {number}", abbreviate(point.coordinates)
            )
            self._bad += int((~good).sum())
        rows = [held[row][1].properties for row in np.flatnonzero(good).tolist()]
        self._tables.append(table[good])

        # their properties
        names = dict.fromkeys(chain.from_iterable(rows))
        self._empty += len(names) * len(rows) - sum(map(len, rows))
        if self._empty > _MAX_EMPTY_CELLS:
            raise InputError(
                f"{self._name}: its points have {len(names):,} different properties, most of them in few; write it as CSV"
            )
        for name in names:
            parts = self._columns.setdefault(name, [])
            if missing := self._rows - sum(map(len, parts)):
                parts.append(pa.nulls(missing))
            parts.append(build_column([row.get(name) for row in rows]))
        self._rows += len(rows)


def dropped_positions_repair(count: int, first: BadPosition, name: str) -> Repair:
    """Tell of positions that can't be read."""
    return Repair(
        "positions without a longitude and latitude dropped",
        count,
        f"{name}: {first.where}",
        value=first.value,
    )
