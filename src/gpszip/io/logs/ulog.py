"""Logs of the autopilot PX4 (ULog).

A file describes its own messages: formats name the fields of each topic, and data follow. Layout
and topics are those of the ULog file format of PX4.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.point_batches import Findings, PointBatch, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut

__all__ = ["read_ulog"]

#: Bytes of the header of a file and of a message.
_HEADER, _MESSAGE = 16, 3

#: Types of messages.
_TYPES = frozenset(b"BFIMPQALCDSOR")

#: Topics with positions, the preferred one first: what was measured comes before estimates.
_TOPICS = (
    "vehicle_gps_position",
    "sensor_gps",
    "vehicle_global_position",
    "vehicle_local_position",
)

#: Types of fields.
_FIELD_TYPES = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
    "char": "S1",
}

#: A field of a format: its type, the length of an array, its name.
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,5})\])? (\w+)")

#: Degrees in the numbers of E7, and metres in mm.
_E7 = 1e-7
_MM = 1e-3

#: Seconds in microseconds.
_MICROSECOND = 1e-6

#: Decimals of times, degrees and metres.
_TIME_DECIMALS = 6
_E7_DECIMALS = 7
_MM_DECIMALS = 3
_SPEED_DECIMALS = 4

#: Smallest type of a fix with a position: 2-D.
_FIX = 2

#: Microseconds since 1970 below which a clock was not set: 2001.
_LEAST_UTC = 1e15

#: The flag of data that were appended after the end, and where their offsets are.
_APPENDED_FLAG, _INCOMPATIBLE, _OFFSETS = 1, 8, 16

Floats = NDArray[np.float64]
Rows = NDArray[np.void]


def read_ulog(source: Source, request: Request) -> RawLog:
    """Read the positions of a flight.

    They come from the first of these topics that has some: vehicle_gps_position and sensor_gps
    (measured), vehicle_global_position, vehicle_local_position (in metres, x to the east). Others
    are counted. Times are those of the autopilot's clock, set to UTC by the median difference from
    the time of GPS; without that, seconds since its start.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt in metres, speed in m/s, course and heading in degrees,
        satellites; and whether to read a damaged file up to the damage.

    Returns
    -------
    RawLog
        One track, or one for each receiver.

    Raises
    ------
    InputError
        If the file is damaged, or no topic has a position.
    """
    return read_points(source, request, _parse)


def _parse(source: Source, request: Request, findings: Findings) -> Iterator[PointBatch]:
    log = _read_messages(source, request, findings)
    findings.empty = f"no position in any of {', '.join(_TOPICS)}"
    findings.remedy = "choose a log of a flight with GPS"
    findings.count("dropouts of the logger", log.dropouts, value=f"{log.dropout_ms:,} ms in all")

    # GPS knows UTC.
    tables = {topic: log.tables(topic) for topic in _TOPICS}
    offset = _offset_of_clock([*tables[_TOPICS[0]], *tables[_TOPICS[1]]])

    # Yield the positions of the first topic that has some, and count those of the others.
    chosen = ""
    for topic in _TOPICS:
        if chosen:
            count = sum(map(len, tables[topic]))
            findings.count(f"positions of {topic} ignored beside {chosen}", count)
            continue
        batches = [_batch(topic, rows, offset, findings) for rows in tables[topic]]
        if any(len(batch.times) for batch in batches):
            chosen = topic
            yield from _named(batches, source.stem)
            points = sum(len(batch.times) for batch in batches)
            no_clock = "points timed from the start of the autopilot, as GPS gives no time"
            findings.count(no_clock, points if offset is None else 0)


# Messages


@dataclass
class _Log:
    """The messages of a file that matter.

    Parameters
    ----------
    formats : dict of str to list
        Type, length and name of each field of a format; the length is 0 for a single value.
    topics : dict of int to (str, int)
        Topic and number of its source for each number of messages.
    data : dict of int to bytearray
        Data of each of them.
    sizes : dict of int to int
        Bytes of one message of each of them.
    dropouts, dropout_ms : int
        Times at which the logger lost messages, and how long these were.
    odd : int
        Messages that don't fit their formats.
    """

    formats: dict[str, list[tuple[str, int, str]]] = field(default_factory=dict)
    topics: dict[int, tuple[str, int]] = field(default_factory=dict)
    data: dict[int, bytearray] = field(default_factory=dict)
    sizes: dict[int, int] = field(default_factory=dict)
    dropouts: int = 0
    dropout_ms: int = 0
    odd: int = 0

    def add(self, kind: int, body: bytes) -> None:
        """Note what a message says."""
        # Data are most of a file. All messages of one topic have one size.
        if kind == ord("D") and len(body) > 2:
            number = int.from_bytes(body[:2], "little")
            if number not in self.data:
                return
            if self.sizes.setdefault(number, len(body) - 2) == len(body) - 2:
                self.data[number] += body[2:]
            else:
                self.odd += 1

        # Subscriptions number the topics.
        elif kind == ord("A") and len(body) > 3:
            topic = body[3:].decode("ascii", "replace")
            number = int.from_bytes(body[1:3], "little")
            self.topics[number] = (topic, body[0])
            if topic in _TOPICS:
                self.data.setdefault(number, bytearray())

        # Formats come before them, dropouts wherever they happened.
        elif kind == ord("F"):
            name, _, fields = body.decode("ascii", "replace").partition(":")
            self.formats[name] = [
                (kind, int(length or 0), label) for kind, length, label in _FIELD.findall(fields)
            ]
        elif kind == ord("O") and len(body) >= 2:
            self.dropouts += 1
            self.dropout_ms += int.from_bytes(body[:2], "little")

    def tables(self, topic: str) -> list[Rows]:
        """Return the messages of a topic, one table for each source, in the order of these."""
        # Each source has messages of its own number.
        numbers = [n for n, (name, _) in self.topics.items() if name == topic and self.data.get(n)]
        numbers.sort(key=lambda number: self.topics[number][1])

        # Read the fields where the format of the topic has them.
        tables = []
        for number in numbers:
            size = self.sizes[number]
            kinds = _plain_fields(self.formats, topic, size)
            names = list(kinds)
            rows = np.dtype(
                {
                    "names": names,
                    "formats": [kinds[name][0] for name in names],
                    "offsets": [kinds[name][1] for name in names],
                    "itemsize": size,
                }
            )
            tables.append(np.frombuffer(self.data[number], rows))
        return tables


def _plain_fields(
    formats: Mapping[str, list[tuple[str, int, str]]], topic: str, size: int
) -> dict[str, tuple[str, int]]:
    """Return type and offset of each single value of a topic that a message of a size holds."""
    offset = 0
    found: dict[str, tuple[str, int]] = {}
    for kind, length, label in formats.get(topic, []):
        # Topics with positions have no formats within formats.
        if kind not in _FIELD_TYPES:
            break
        item = np.dtype(_FIELD_TYPES[kind]).itemsize
        if not length and offset + item <= size:
            found.setdefault(label, (_FIELD_TYPES[kind], offset))
        offset += item * (length or 1)
    return found


def _read_messages(source: Source, request: Request, findings: Findings) -> _Log:
    """Read all messages of a file."""
    data = source.read()
    log = _Log()
    position, ends = _HEADER, [len(data)]
    while position + _MESSAGE <= len(data):
        size, kind = struct.unpack_from("<HB", data, position)
        end = position + _MESSAGE + size
        if kind not in _TYPES:
            _note_damage(source, request, findings, log, position)
            break

        # Data that were appended begin where they say, whatever message they cut.
        if end > ends[0]:
            position = ends.pop(0) if len(ends) > 1 else len(data)
            findings.count("messages that are cut short dropped", 1)
            continue

        # Note what the message says.
        body = data[position + _MESSAGE : end]
        if kind == ord("B"):
            ends = sorted({*_appended(body), len(data)})
            ends = [offset for offset in ends if end <= offset <= len(data)]
        log.add(kind, body)
        position = end
        if position == ends[0] and len(ends) > 1:
            ends.pop(0)
    findings.count("messages of another size than their format dropped", log.odd)
    return log


def _appended(body: bytes) -> list[int]:
    """Return the offsets of data that were appended."""
    is_appended = len(body) > _INCOMPATIBLE and body[_INCOMPATIBLE] & _APPENDED_FLAG
    if not is_appended or len(body) < _OFFSETS + 24:
        return []
    return [offset for offset in struct.unpack_from("<3Q", body, _OFFSETS) if offset]


def _note_damage(
    source: Source, request: Request, findings: Findings, log: _Log, position: int
) -> None:
    """Raise for a damaged file, unless its start may be read."""
    if not (request.skip_bad and any(log.data.values())):
        raise InputError(
            "damaged ULog file: a message of an unknown type",
            path=source.name,
            location=f"byte {position:,}",
            remedy="fetch it again; --skip-bad reads what comes before",
        )
    findings.left_out.append(
        LeftOut(f"{source.name}: all after byte {position:,}", "a message of an unknown type")
    )


# Positions


def _offset_of_clock(tables: list[Rows]) -> float | None:
    """Return UTC less the time of the autopilot in microseconds; None if it is unknown."""
    for rows in tables:
        get = _getter(rows)
        utc, since_start = get("time_utc_usec"), get("timestamp")
        is_known = (utc > _LEAST_UTC) & np.isfinite(since_start)
        if is_known.any():
            return float(np.median((utc - since_start)[is_known]))
    return None


def _batch(topic: str, rows: Rows, offset: float | None, findings: Findings) -> PointBatch:
    """Return the positions of a topic."""
    get = _getter(rows)
    # Positions, and whether they are known.
    is_local = topic == "vehicle_local_position"
    if is_local:
        coordinates = np.stack([get("y"), get("x")], axis=1)
        is_fix = get("xy_valid", 1.0) > 0
    else:
        coordinates = _degrees(rows, get)
        is_fix = (get("fix_type", float(_FIX)) >= _FIX) & (coordinates != 0).any(axis=1)
    what = f"positions of {topic} without a fix dropped"
    findings.count(what, (~is_fix).sum(), drops=True)

    # Times
    times = np.round((get("timestamp") + (offset or 0.0)) * _MICROSECOND, _TIME_DECIMALS)
    attributes = _attributes(get, is_local=is_local)
    return PointBatch(
        times[is_fix],
        coordinates[is_fix],
        {name: values[is_fix] for name, values in attributes.items()},
        None,
        not is_local,
    )


def _getter(rows: Rows) -> Callable[..., Floats]:
    """Return a function that returns a field as floats, or a value for a field that is missing."""

    def get(name: str, missing: float = np.nan) -> Floats:
        if name not in (rows.dtype.names or ()) or rows.dtype[name].kind not in "iuf":
            return np.full(len(rows), missing)
        values: Floats = rows[name].astype(np.float64)
        return values

    return get


def _degrees(rows: Rows, get: Callable[..., Floats]) -> Floats:
    # Fields were renamed when they became degrees.
    names = rows.dtype.names or ()
    if "latitude_deg" in names:
        return np.stack([get("latitude_deg"), get("longitude_deg")], axis=1)
    degrees = np.stack([get("lat"), get("lon")], axis=1)
    if "lat" in names and rows.dtype["lat"].kind == "i":
        degrees = np.round(degrees * _E7, _E7_DECIMALS)
    return degrees


def _attributes(get: Callable[..., Floats], *, is_local: bool) -> dict[str, NDArray[np.generic]]:
    """Return all that is known besides the position."""
    # Heights are in mm, m, or metres down from the start.
    mm = get("alt")
    alt = get("altitude_msl_m")
    is_mm = np.isfinite(get("fix_type")) & np.isnan(alt)
    alt = np.where(np.isnan(alt), np.where(is_mm, np.round(mm * _MM, _MM_DECIMALS), mm), alt)
    alt = -get("z") if is_local else alt

    # Speeds of GPS, or those to north and east.
    north = np.where(np.isnan(get("vel_n")), get("vx"), get("vel_n"))
    east = np.where(np.isnan(get("vel_e")), get("vy"), get("vel_e"))
    speed = np.where(np.isnan(get("vel_m_s")), np.hypot(north, east), get("vel_m_s"))
    return {
        "alt": alt,
        "speed": np.round(speed, _SPEED_DECIMALS),
        "course": np.round(np.degrees(get("cog_rad")) % 360, _SPEED_DECIMALS),
        "heading": np.round(np.degrees(get("heading")) % 360, _SPEED_DECIMALS),
        "satellites": get("satellites_used"),
    }


def _named(batches: list[PointBatch], stem: str) -> Iterator[PointBatch]:
    """Yield batches with the names of their tracks, if there are several."""
    if len(batches) == 1:
        yield batches[0]
        return
    for number, batch in enumerate(batches):
        tracks: Any = np.full(len(batch.times), f"{stem}-{number}", object)
        yield batch._replace(tracks=tracks)
