"""Traces of aircraft as readsb and tar1090 write them, such as those of ADS-B archives.

A trace is an object of JSON with the address of the aircraft and the list of its positions, whose
times count from its ``timestamp``. Such files are often gzipped under the name ``.json``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request, unused_name
from gpszip.io.storage.source import Source
from gpszip.io.values.json_stream import Document, Element, read_json

__all__ = ["read_readsb", "read_readsb_batches"]

#: Numbers of an entry that are read: time, latitude, longitude, altitude, speed, track, flags,
#: vertical rate; and the altitude by GPS.
_FIELDS = 8
_GPS_ALTITUDE = 10

#: The flag of the first position of a flight.
_NEW_LEG = 2

#: Metres in a foot, and m/s in a knot and in a foot per minute.
_FOOT = 0.3048
_KNOT = 1852 / 3600
_FOOT_PER_MINUTE = 0.3048 / 60

#: Decimals of metres and of m/s.
_DECIMALS = 4

#: Decimals of seconds.
_TIME_DECIMALS = 3

_NAN = float("nan")


def read_readsb(source: Source, request: Request) -> RawLog:
    """Read the positions of a trace.

    Each leg is a track: the first is named by the address of the aircraft, the next ones
    ``3c6444-2``, ``3c6444-3``.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt (by pressure; none on the ground) and gps_alt in metres, speed and
        climb in m/s, course in degrees, ground (1 or 0).

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the file is damaged, or has no position.

    Examples
    --------
    >>> text = b'{"icao":"3c6444","timestamp":60.0,"trace":[[1.5,48,11,"ground",10,90,0,null]]}'
    >>> log = read_readsb(Source("a.json", data=text), Request(keep=("speed", "ground")))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist()
    (('3c6444',), [61.5], [[48.0, 11.0]])
    >>> log.attributes["speed"].tolist(), log.attributes["ground"].tolist()
    ([5.1444], [1.0])
    """
    return read_points(source, request, _parse)


def read_readsb_batches(source: Source, request: Request) -> LogBatches:
    """Open traces to be read one by one; see :func:`read_readsb`."""
    return open_points(source, request, _parse, CoordinateKind(geographic=True, dimension=2))


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no position in this trace"
    names: dict[str, None] = {}
    rows: list[tuple[float, ...]] = []
    with source.open() as stream:
        for part in read_json(stream, source.name, ("trace",)):
            # Entries come before the object that says when they count from.
            if isinstance(part, Element):
                if (row := _row(part.value)) is not None:
                    rows.append(row)
                else:
                    findings.count("entries that are no position dropped", 1, drops=True)
            elif isinstance(part, Document):
                yield _batch(part.members, rows, names, source.name)
                rows = []


def _row(entry: Any) -> tuple[float, ...] | None:
    """Return the numbers of an entry; None if it is none."""
    if not isinstance(entry, list) or len(entry) < _FIELDS:
        return None
    time, lat, lon, alt, *others = (_number(value) for value in entry[:_FIELDS])
    gps_alt = _number(entry[_GPS_ALTITUDE]) if len(entry) > _GPS_ALTITUDE else _NAN
    return (time, lat, lon, alt, *others, gps_alt, float(entry[3] == "ground"))


def _batch(
    trace: dict[str, Any], rows: list[tuple[float, ...]], names: dict[str, None], where: str
) -> PointBatch:
    """Return the positions of a trace."""
    # A trace without its time would be a guess.
    start = _number(trace.get("timestamp"))
    if rows and not np.isfinite(start):
        raise InputError(
            "a trace without its timestamp", path=where, remedy="fetch or write it again"
        )
    table = np.array(rows, np.float64).reshape(-1, _FIELDS + 2)

    # Name the legs.
    flags = np.nan_to_num(table[:, 6], posinf=0, neginf=0)
    begins = np.fmod(flags, 2 * _NEW_LEG) >= _NEW_LEG
    begins[:1] = False
    leg = np.cumsum(begins)
    icao = trace.get("icao")
    titles = []
    for _ in range(int(leg[-1]) + 1 if len(leg) else 0):
        titles.append(unused_name(icao if isinstance(icao, str) else "", names))
        names[titles[-1]] = None

    # Bring feet and knots to metres and m/s.
    attributes: dict[str, NDArray[np.generic]] = {
        "alt": np.round(table[:, 3] * _FOOT, _DECIMALS),
        "gps_alt": np.round(table[:, 8] * _FOOT, _DECIMALS),
        "speed": np.round(table[:, 4] * _KNOT, _DECIMALS),
        "course": table[:, 5],
        "climb": np.round(table[:, 7] * _FOOT_PER_MINUTE, _DECIMALS),
        "ground": table[:, 9],
    }
    times = np.round(start + table[:, 0], _TIME_DECIMALS)
    return PointBatch(times, table[:, 1:3], attributes, np.array(titles, object)[leg])


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return _NAN
    try:
        return float(value)
    except OverflowError:
        return _NAN
