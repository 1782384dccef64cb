"""Tables and lines of predictions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.io.history_tables import write_edge_table
from gpszip.model import Network
from gpszip.model.prediction import Outlook

__all__ = ["write_outlooks"]

#: Decimals of probabilities, seconds and metres, and of degrees.
_PROBABILITY, _SECONDS, _DEGREES = 6, 1, 7

#: Columns of the table.
_COLUMNS = (
    "track_id",
    "t",
    "kind",
    "rank",
    "edge",
    "forward",
    "node",
    "probability",
    "seconds",
    "low",
    "high",
)


def write_outlooks(outlooks: Sequence[Outlook], network: Network, target: str) -> None:
    """Write a row for each next edge and each destination.

    Parameters
    ----------
    outlooks : sequence of Outlook
        What is predicted.
    network : Network
        The edges, for lines: of the next edge, and of the way to the destination.
    target : str
        Name of the file, whose suffix says the format; ``-`` is standard output, as CSV.

    Raises
    ------
    OutputError
        If there is no such format, or the file can't be written.
    """
    rows: list[tuple[Any, ...]] = []
    places: list[tuple[float, ...]] = []
    lines = []
    for outlook in outlooks:
        start = (outlook.track, round(outlook.time, 3))

        # The next edges, which have no arrival.
        for rank, road in enumerate(outlook.next, 1):
            p = round(road.probability, _PROBABILITY)
            nothing = (np.nan,) * 3
            rows.append((*start, "next", rank, road.edge, road.forward, -1, p, *nothing))
            places.append((np.nan, np.nan))
            lines.append(_line(network, ((road.edge, road.forward),)))

        # Destinations, with the seconds until then.
        for rank, goal in enumerate(outlook.destinations, 1):
            p, arrival = round(goal.probability, _PROBABILITY), goal.arrival
            seconds = (
                (np.nan,) * 3
                if arrival is None
                else tuple(
                    round(each, _SECONDS) for each in (arrival.seconds, arrival.low, arrival.high)
                )
            )
            rows.append((*start, "destination", rank, -1, False, goal.node, p, *seconds))
            places.append(goal.position[:2])
            path = ((outlook.edge, outlook.forward), *(arrival.route if arrival else ()))
            lines.append(_line(network, path))

    columns: dict[str, NDArray[Any]] = {
        name: np.array([row[i] for row in rows], object if i in {0, 2} else None)
        for i, name in enumerate(_COLUMNS)
    }
    axes = ("x", "y") if network.plane is None else ("lat", "lon")
    decimals = 3 if network.plane is None else _DEGREES
    for axis, name in enumerate(axes):
        columns[name] = np.round([place[axis] for place in places], decimals)
    write_edge_table(columns, target, "predictions", lines=lines, network=network)


def _line(network: Network, way: Sequence[tuple[int, bool]]) -> NDArray[np.float64]:
    """The line of some edges in a row."""
    parts = [network.road(edge) if forward else network.road(edge)[::-1] for edge, forward in way]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
