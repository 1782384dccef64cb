"""A map with a line for each direction in which an edge was travelled."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.track_rows import round_decimals
from gpszip.io.maps.table import MapTable
from gpszip.model.directed_edges import DirectedEdges, split_directions

__all__ = ["directed_table"]

#: Columns of a map that a line of one direction has in another form: its ends, and one count.
_COLUMNS_BY_DIRECTION = ("u", "v", "forward", "backward")

#: Kilometres per hour in a metre per second.
_KMH = 3.6

#: Decimals of speeds in km/h and of seconds.
_DECIMALS = 4


def directed_table(table: MapTable) -> MapTable:
    """Return a table with a line for each direction that was travelled.

    Parameters
    ----------
    table : MapTable
        A line for each edge.

    Returns
    -------
    MapTable
        Lines lead from u to v. Their columns are those that osmnx knows: ``u``, ``v``, ``key`` (the
        number of the line among those from u to v), ``length`` in metres, ``oneway`` (whether
        nobody travelled the other way), ``reversed`` (whether the line leads against the edge), and
        with speeds ``speed_kph`` and ``travel_time`` in seconds; further ``edge`` (the row of the
        edge in ``table``), ``traversals``, and all other columns of the edge.

    Examples
    --------
    >>> from gpszip.io.maps.table import map_table
    >>> from gpszip.model import RoadMap
    >>> nodes, edges = np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0, 1]], dtype=np.int32)
    >>> table = directed_table(map_table(RoadMap(nodes, edges, np.array([2]), np.array([1]))))
    >>> [table.properties[name].tolist() for name in ("u", "v", "traversals")]
    [[0, 1], [1, 0], [2, 1]]
    """
    # Directions
    properties = {name: table.properties[name].astype(np.int64) for name in _COLUMNS_BY_DIRECTION}
    pairs = np.stack([properties["u"], properties["v"]], axis=1).astype(np.int32)
    rows = split_directions(pairs, properties["forward"], properties["backward"])
    both = (properties["forward"] > 0) & (properties["backward"] > 0)

    # Columns
    columns: dict[str, NDArray[np.generic]] = {
        "u": rows.starts.astype(np.int64),
        "v": rows.ends.astype(np.int64),
        "key": _keys(rows),
        "edge": rows.edges.astype(np.int64),
        "traversals": rows.traversals,
        "oneway": ~both[rows.edges],
        "reversed": ~rows.forward,
    }
    for name, values in table.properties.items():
        if name not in _COLUMNS_BY_DIRECTION:
            columns[name] = values[rows.edges]
    return _turned(replace(table, properties={**columns, **_times(columns)}), rows)


def _keys(rows: DirectedEdges) -> NDArray[np.int64]:
    """Number of each line among those that lead from and to the same nodes."""
    counts: Counter[tuple[int, int]] = Counter()
    keys = []
    for start, end, _ in rows:
        keys.append(counts[start, end])
        counts[start, end] += 1
    return np.array(keys, np.int64)


def _times(columns: dict[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """Speeds and times under the names of osmnx; NaN where nobody knows them."""
    if "speed" not in columns:
        return {}
    speed, length = columns["speed"].astype(np.float64), columns["length"].astype(np.float64)
    known = np.where(speed > 0, speed, np.nan)
    return {
        "speed_kph": round_decimals(known * _KMH, _DECIMALS),
        "travel_time": round_decimals(length / known, _DECIMALS),
    }


def _turned(table: MapTable, rows: DirectedEdges) -> MapTable:
    """Return a table with the line of its edge for each row, in the row's direction."""
    # Vertices: counted from the start of the edge, or from its end.
    starts, stops = table.offsets[:-1][rows.edges], table.offsets[1:][rows.edges]
    offsets = np.append(0, np.cumsum(stops - starts))
    number = np.arange(offsets[-1]) - np.repeat(offsets[:-1], stops - starts)
    first = np.repeat(np.where(rows.forward, starts, stops - 1), stops - starts)
    step = np.repeat(np.where(rows.forward, 1, -1), stops - starts)

    # Cuts at the antimeridian, of which few maps have any.
    cuts: list[int] = []
    if len(table.cuts):
        bounds = zip(starts.tolist(), stops.tolist(), rows.forward.tolist(), strict=True)
        for row, (start, stop, forward) in enumerate(bounds):
            inside = table.cuts[(table.cuts > start) & (table.cuts < stop)]
            shifts = inside - start if forward else stop - inside[::-1]
            cuts += (offsets[row] + shifts).tolist()
    return replace(
        table,
        points=table.points[first + step * number],
        offsets=offsets,
        cuts=np.array(cuts, np.int64),
    )
