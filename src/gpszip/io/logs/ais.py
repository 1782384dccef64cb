"""Positions of ships in tables: the CSV of the Danish and of the American coast guard.

They are read as any CSV, but AIS has numbers that stand for no value, each row names its ship, and
the dates of Danish files begin with the day.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.csv import read_csv
from gpszip.io.logs.csv_batches import read_csv_batches
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.raw import RawLog, Request, UnreadableCell
from gpszip.io.logs.sniff.text import AIS_SHIP, column_names, plain_name
from gpszip.io.storage.source import Source

__all__ = ["read_ais", "read_ais_batches"]

#: A column that only Danish files have.
_DANISH = "typeofmobile"

#: Latitude and longitude of ships that don't know their position.
_NO_POSITION = (91.0, 181.0)

#: Smallest numbers that stand for no value, by the names of their columns without case and marks:
#: degrees, and knots.
_NO_VALUE = {"heading": 511.0, "trueheading": 511.0, "cog": 360.0, "sog": 102.3}


def read_ais(source: Source, request: Request) -> RawLog:
    r"""Read the positions of ships; each MMSI is a track.

    Latitude 91 and longitude 181 are no position; a heading of 511, a course of 360 degrees and a
    speed of 102.3 knots are no values.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        As for CSV. Attributes stay in the numbers of the file: degrees, and knots.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        As for CSV.

    Examples
    --------
    >>> text = b"MMSI,BaseDateTime,LAT,LON,Heading\n7,2024-01-01T00:00:00,47.6,-122.3,511\n"
    >>> log = read_ais(Source("a.csv", data=text), Request(keep=("Heading",)))
    >>> log.ids, log.coordinates.tolist(), log.attributes["Heading"].tolist()
    (('7',), [[47.6, -122.3]], [nan])
    """
    return _without_fillers(read_csv(source, _of_ships(source, request)))


def read_ais_batches(source: Source, request: Request) -> LogBatches:
    """Open positions of ships to be read in batches; see :func:`read_ais`."""
    opened = read_csv_batches(source, _of_ships(source, request))

    def batches() -> Iterator[RawLog]:
        yield from map(_without_fillers, opened.batches)

    return replace(opened, batches=batches())


def _of_ships(source: Source, request: Request) -> Request:
    """Return the request with what is known of these files; the user overrules it."""
    names = column_names(source.head())
    if isinstance(request.columns, tuple) or AIS_SHIP not in names:
        return request
    columns: Mapping[str, str] = {"id": names[AIS_SHIP], **(request.columns or {})}
    is_danish = _DANISH in names and request.dates is None
    return replace(request, columns=columns, dates="dmy" if is_danish else request.dates)


def _without_fillers(log: RawLog) -> RawLog:
    """Return a log with NaN where numbers stand for no value."""
    # Columns in metres are no positions of AIS.
    if not log.geographic:
        return log
    is_none = log.coordinates == np.array(_NO_POSITION)
    unreadable = list(log.unreadable)
    for axis in np.flatnonzero(is_none.any(axis=0)).tolist():
        row = int(is_none[:, axis].argmax())
        cell = UnreadableCell(log.axes[axis], row, f"{_NO_POSITION[axis]:g}")
        if cell.column not in {known.column for known in unreadable}:
            unreadable.append(cell)
    return replace(
        log,
        coordinates=np.where(is_none, np.nan, log.coordinates),
        unreadable=tuple(unreadable),
        attributes={name: _clean(name, values) for name, values in log.attributes.items()},
    )


def _clean(name: str, values: NDArray[np.generic]) -> NDArray[np.generic]:
    least = _NO_VALUE.get(plain_name(name))
    if least is None or values.dtype.kind not in "iuf":
        return values
    numbers = values.astype(np.float64)
    return np.where(numbers >= least, np.nan, numbers)
