"""Features of GeoJSON that are points: rows of a table, whose columns are their properties."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.geojson.features import BadPosition, Point, position_table
from gpszip.io.logs.geojson.json_columns import abbreviate, build_column, concatenate_columns
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request
from gpszip.io.tables.roles import find_roles
from gpszip.io.tables.table import build_raw_log
from gpszip.model.read_result import Repair

__all__ = ["PointTable", "dropped_positions_repair"]

#: Points whose properties are turned into columns together.
_BATCH_POINTS = 1 << 14

#: Cells that may be empty since only some points have a property. Points with more empty cells are
#: no rows of a table.
_MAX_EMPTY_CELLS = 50_000_000


class _Column(NamedTuple):
    """A column of the table, built only if it is used."""

    name: str
    build: Callable[[], Any]


class PointTable:
    """Collects points, and holds them as columns.

    Parameters
    ----------
    name : str
        Name of the log for messages.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._pending: list[tuple[int, Point]] = []  # with the numbers of their features
        self._positions: list[NDArray[np.float64]] = []
        self._chunks: dict[str, list[Any]] = {}  # of each property
        self._rows = 0
        self._empty_cells = 0
        self._bad = 0
        self._first_bad: BadPosition | None = None

    def __len__(self) -> int:
        """Return the number of points, including those whose position can't be read."""
        return self._rows + self._bad + len(self._pending)

    def add(self, number: int, point: Point) -> None:
        """Add the point of the feature with this number.

        Raises
        ------
        InputError
            If there are too many properties that only few points have.
        """
        self._pending.append((number, point))
        if len(self._pending) == _BATCH_POINTS:
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
        # Include the pending points, and refuse a log without any position.
        self._flush()
        if not self._rows:
            value = self._first_bad.value if self._first_bad is not None else ""
            raise InputError(
                f"no Point is at a longitude and a latitude; the first is at {value}",
                path=self._name,
            )

        # Find out which column holds what. Coordinates of GeoJSON have a sign, so there are no
        # hemispheres, whatever properties there are.
        columns = self._columns(metric=metric)
        names = [column.name for column in columns]
        axes = {"x": "x", "y": "y"} if metric else {"lat": "lat", "lon": "lon"}
        by_role = request.columns if isinstance(request.columns, Mapping) else {}
        roles = find_roles(
            names,
            {**by_role, **axes},
            request.keep,
            self._name,
            heading=request.heading,
            accuracy=request.accuracy,
            optional=request.optional,
        )
        roles = replace(roles, hemispheres=())

        # Count the dropped positions, and build only the columns that have a role.
        repairs: tuple[Repair, ...] = ()
        if self._first_bad is not None:
            repairs = (dropped_positions_repair(self._bad, self._first_bad, self._name),)
        used = [columns[i].build() for i in roles.used]
        return build_raw_log(used, names, roles, request, self._name, repairs=repairs)

    def _columns(self, *, metric: bool) -> list[_Column]:
        """Return the columns of coordinates, then those of properties."""
        # A third number is z or, if no property is a height, the height.
        table = np.concatenate(self._positions)
        axes = ["x", "y"] if metric else ["lon", "lat"]
        has_height = any(name.lower() in HEIGHT_NAMES for name in self._chunks)
        if np.isfinite(table[:, 2]).any() and (metric or not has_height):
            axes.append("z" if metric else "alt")

        # Columns are built on demand. A property named as an axis is hidden by the coordinates.
        coordinates = [
            _Column(name, partial(_to_column, table[:, i])) for i, name in enumerate(axes)
        ]
        properties = [
            _Column(name, partial(self._property, name))
            for name in self._chunks
            if name not in axes
        ]
        return [*coordinates, *properties]

    def _property(self, name: str) -> Any:
        return concatenate_columns(self._all_rows(name))

    def _all_rows(self, name: str) -> list[Any]:
        """Return the chunks of a property, with nulls for the last rows if they don't have it."""
        chunks = self._chunks[name]
        return [*chunks, pa.nulls(self._rows - sum(map(len, chunks)))]

    def _flush(self) -> None:
        """Turn the pending points into columns."""
        # Take the pending points out, so that the next batch starts empty.
        if not self._pending:
            return
        pending, self._pending = self._pending, []

        # Read their positions, and drop points without one.
        table = position_table([point.coordinates for _, point in pending])
        good = np.isfinite(table[:, :2]).all(axis=1)
        if not good.all():
            number, point = pending[int(good.argmin())]
            self._first_bad = self._first_bad or BadPosition(
                f"feature {number}", abbreviate(point.coordinates)
            )
            self._bad += int((~good).sum())
        rows = [pending[row][1].properties for row in np.flatnonzero(good).tolist()]
        self._positions.append(table[good])

        # Bound the memory of properties that few points have.
        names = dict.fromkeys(chain.from_iterable(rows))
        self._empty_cells += len(names) * len(rows) - sum(map(len, rows))
        if self._empty_cells > _MAX_EMPTY_CELLS:
            raise InputError(
                f"its points have {len(names):,} different properties, most of them in few",
                path=self._name,
                remedy="write only the time and the name of each point",
            )

        # Add a chunk to each property, after nulls for earlier rows that don't have it.
        for name in names:
            chunks = self._chunks.setdefault(name, [])
            if missing := self._rows - sum(map(len, chunks)):
                chunks.append(pa.nulls(missing))
            chunks.append(build_column([row.get(name) for row in rows]))
        self._rows += len(rows)


def _to_column(values: NDArray[np.float64]) -> Any:
    return pa.chunked_array([pa.array(values)])


def dropped_positions_repair(count: int, first: BadPosition, name: str) -> Repair:
    """Return the record of positions that can't be read."""
    return Repair(
        "positions without a longitude and latitude dropped",
        count,
        f"{name}: {first.where}",
        value=first.value,
    )
