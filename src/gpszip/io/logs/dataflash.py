"""Logs of the autopilot ArduPilot: DataFlash, binary (.bin) or as text (.log).

A file describes its own messages: FMT messages give the name, the size and the fields of each kind.
Positions are in messages named GPS and GPS2, or in GPS with the number of the receiver.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.sniff.binary import DATAFLASH_FMT, DATAFLASH_SYNC, is_binary_dataflash
from gpszip.io.logs.sniff.text import decode_head
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats

__all__ = ["read_dataflash", "read_dataflash_batches"]

#: Bytes before the fields of a message.
_HEADER = 3

#: Bytes of a message that describes others.
_FMT_BYTES = 89

#: Bytes that are read at a time.
_CHUNK_BYTES = 1 << 22

#: Messages with positions.
_NAMES = ("GPS", "GPS2")

#: Receivers of a vehicle, at most; more are damage.
_MAX_RECEIVERS = 16

#: A description in a text: kind, bytes, name, types and names of the fields.
_TEXT_FMT = re.compile(r"^FMT,\s*\d+,\s*\d+,\s*(GPS2?),\s*(\w+),\s*([\w,\s]+)$", re.MULTILINE)

#: Types of fields by their letters, and the factors of those that are scaled.
_TYPES = {
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "M": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "a": ("S64", 1.0),
}

#: Decimals to which scaled numbers are rounded.
_DECIMALS = 7

#: Names of fields, which have changed over the years, by what they hold.
_FIELDS = {
    "status": ("Status",),
    "ms": ("GMS", "TimeMS", "Time"),
    "week": ("GWk", "Week"),
    "lat": ("Lat",),
    "lon": ("Lng",),
    "receiver": ("I",),
    "alt": ("Alt",),
    "speed": ("Spd",),
    "course": ("GCrs",),
    "satellites": ("NSats", "NSat"),
    "hdop": ("HDop",),
}

#: Attributes that may be kept.
_ATTRIBUTES = ("alt", "speed", "course", "satellites", "hdop")

#: Smallest status of a position: a 2-D fix.
_FIX = 2

#: Seconds from 1970 to the start of GPS time, 1980-01-06, and in a week.
_GPS_START = 315_964_800.0
_WEEK = 604_800.0

#: Seconds by which UTC is behind GPS time, from each date on.
_BEHIND = (
    ("1980-01-06", 0),
    ("1999-01-01", 13),
    ("2006-01-01", 14),
    ("2009-01-01", 15),
    ("2012-07-01", 16),
    ("2015-07-01", 17),
    ("2017-01-01", 18),
)

#: Decimals of seconds: times are whole milliseconds.
_TIME_DECIMALS = 3

Floats = NDArray[np.float64]


def read_dataflash(source: Source, request: Request) -> RawLog:
    r"""Read the positions of a log of ArduPilot.

    Each receiver is a track. Positions without a fix are dropped and counted, as are bytes that
    are no message. Times are those of GPS, brought to UTC.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt in metres, speed in m/s, course in degrees, satellites, hdop.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If there is no position.

    Examples
    --------
    >>> text = b"FMT, 130, 50, GPS, QBIHLL, TimeUS,Status,GMS,GWk,Lat,Lng\n"
    >>> text += b"GPS, 5, 3, 1000, 1785, 47.5, 8.25"
    >>> log = read_dataflash(Source("a.log", data=text), Request())
    >>> log.times.tolist(), log.coordinates.tolist()
    ([1395532785.0], [[47.5, 8.25]])
    """
    return read_points(source, request, _parse)


def read_dataflash_batches(source: Source, request: Request) -> LogBatches:
    """Open a log of ArduPilot to be read in batches; see :func:`read_dataflash`."""
    return open_points(source, request, _parse, CoordinateKind(geographic=True, dimension=2))


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no position with a fix in this log of ArduPilot"
    findings.remedy = "choose a log of a flight with GPS"
    is_binary = is_binary_dataflash(source.head())
    tables = _binary_tables(source, findings) if is_binary else _text_tables(source, findings)
    for name, columns in tables:
        yield _batch(name, columns, source.stem, findings)


def _batch(name: str, columns: Mapping[str, Floats], stem: str, findings: Findings) -> PointBatch:
    """Return the positions of messages of one name."""
    rows = len(columns["lat"])
    missing = np.full(rows, np.nan)
    get = {label: columns.get(label, missing) for label in _FIELDS}
    coordinates = np.stack([get["lat"], get["lon"]], axis=1)
    has_week = np.isnan(get["week"]) | (get["week"] > 0)
    has_status = np.isnan(get["status"]) | (get["status"] >= _FIX)
    is_fix = has_status & has_week & (coordinates != 0).any(axis=1)
    findings.count("positions without a fix dropped", (~is_fix).sum(), drops=True)

    # Number the receivers from 1, as the names of messages do. The first one has the name of the
    # file.
    receiver = np.where(np.isnan(get["receiver"]), _NAMES.index(name), get["receiver"])
    number = np.clip(receiver, 0, _MAX_RECEIVERS - 1).astype(np.int64)
    names = ["", *(f"{stem}-GPS{n}" for n in range(2, _MAX_RECEIVERS + 1))]
    return PointBatch(
        _utc(get["week"], get["ms"])[is_fix],
        coordinates[is_fix],
        {label: get[label][is_fix] for label in _ATTRIBUTES},
        np.array(names, object)[number][is_fix],
    )


def _utc(weeks: Floats, milliseconds: Floats) -> Floats:
    """Return weeks and milliseconds of GPS time in seconds since 1970 (UTC)."""
    seconds = _GPS_START + weeks * _WEEK + milliseconds / 1e3
    starts = [float(np.datetime64(date, "s").astype(np.int64)) for date, _ in _BEHIND]
    behind = np.array([0, *(count for _, count in _BEHIND)])
    return np.asarray(
        np.round(seconds - behind[np.searchsorted(starts, seconds, "right")], _TIME_DECIMALS)
    )


def _columns(labels: list[str], values: list[Floats]) -> dict[str, Floats]:
    """Return values by what they hold."""
    by_label = dict(zip(labels, values, strict=False))
    found = {
        name: next((by_label[label] for label in choices if label in by_label), None)
        for name, choices in _FIELDS.items()
    }
    return {name: values for name, values in found.items() if values is not None}


# Binary files


class _Layout(NamedTuple):
    """How messages of one kind are written.

    Parameters
    ----------
    name : str
        Their name.
    size : int
        Their bytes.
    types : str
        Letters for the types of their fields.
    labels : list of str
        Names of their fields.
    """

    name: str
    size: int
    types: str
    labels: list[str]


@dataclass
class _Walker:
    """Finds messages in the bytes of a file.

    Parameters
    ----------
    layouts : dict of int to _Layout
        Kinds of messages that were described.
    bodies : dict of int to bytearray
        Messages with positions since they were last taken.
    skipped : int
        Bytes that are no message.
    """

    layouts: dict[int, _Layout] = field(
        default_factory=lambda: {DATAFLASH_FMT: _Layout("FMT", _FMT_BYTES, "", [])}
    )
    bodies: dict[int, bytearray] = field(default_factory=dict)
    skipped: int = 0

    def walk(self, data: bytes) -> int:
        """Read the messages in some bytes, and return where the last one that is cut begins."""
        position = 0
        while True:
            # Pass over what is no message.
            if data[position : position + 2] != DATAFLASH_SYNC:
                start = data.find(DATAFLASH_SYNC, position)
                start = start if start >= 0 else max(position, len(data) - 1)
                self.skipped += start - position
                position = start
            if position + _HEADER > len(data):
                return position
            layout = self.layouts.get(data[position + 2])
            if layout is None:
                self.skipped += 1
                position += 1
                continue

            # Keep what is needed of a message.
            end = position + layout.size
            if end > len(data):
                return position
            if layout.name == "FMT":
                self._describe(data[position + _HEADER : end])
            elif layout.name in _NAMES:
                body = self.bodies.setdefault(data[position + 2], bytearray())
                body += data[position:end]
            position = end

    def _describe(self, body: bytes) -> None:
        kind, size = body[0], body[1]
        name, types, labels = (
            part.rstrip(b"\0").decode("ascii", "replace")
            for part in (body[2:6], body[6:22], body[22:86])
        )
        # The first description counts: later ones would read earlier bytes in another way.
        if size >= _HEADER and kind not in self.layouts:
            self.layouts[kind] = _Layout(name, size, types, labels.split(","))

    def take(self) -> Iterator[tuple[str, dict[str, Floats]]]:
        """Yield name and columns of the messages since the last time."""
        for kind, body in self.bodies.items():
            layout = self.layouts[kind]
            columns = _columns(layout.labels, _fields(layout, bytes(body)))
            if "lat" in columns and "lon" in columns:
                yield layout.name, columns
        self.bodies = {}


def _fields(layout: _Layout, body: bytes) -> list[Floats]:
    """Return the fields of messages up to the first of unknown type, NaN for texts."""
    # Messages follow each other, so a field of all of them is one column.
    offset = _HEADER
    rows = len(body) // layout.size
    values: list[Floats] = []
    for letter in layout.types:
        kind, factor = _TYPES.get(letter, ("", 1.0))
        if not kind or offset + np.dtype(kind).itemsize > layout.size:
            break
        numbers: Floats = np.full(rows, np.nan)
        if not kind.startswith("S"):
            column = np.dtype(
                {"names": ["v"], "formats": [kind], "offsets": [offset], "itemsize": layout.size}
            )
            numbers = np.frombuffer(body, column)["v"].astype(np.float64)
            numbers = np.round(numbers * factor, _DECIMALS) if factor != 1 else numbers

        # The next field follows.
        values.append(numbers)
        offset += np.dtype(kind).itemsize
    return values


def _binary_tables(source: Source, findings: Findings) -> Iterator[tuple[str, dict[str, Floats]]]:
    walker = _Walker()
    rest = b""
    with source.open() as stream:
        while chunk := read_chunk(stream, _CHUNK_BYTES):
            data = rest + chunk
            rest = data[walker.walk(data) :]
            yield from walker.take()
    findings.count("bytes that are no message passed over", walker.skipped + len(rest))


# Texts


def _text_tables(source: Source, findings: Findings) -> Iterator[tuple[str, dict[str, Floats]]]:
    # Descriptions come first.
    described = {
        name: [label.strip() for label in labels.split(",")]
        for name, _, labels in _TEXT_FMT.findall(decode_head(source.head()).replace("\r", ""))
    }
    for lines in read_lines(source):
        for name, labels in described.items():
            # Take the messages with as many cells as they have labels.
            found = lines.filter(pc.match_substring_regex(lines, rf"^{name}\s*,"))
            cells = pc.split_pattern(found, ",")
            is_whole = pc.equal(pc.list_value_length(cells), len(labels) + 1)
            broken = len(found) - (pc.sum(is_whole).as_py() or 0)
            findings.count("messages that can't be read dropped", broken, drops=True)
            cells = cells.filter(is_whole)

            # Read their cells.
            texts = [
                pc.utf8_trim_whitespace(pc.list_element(cells, i + 1)) for i in range(len(labels))
            ]
            values = [_numbers(label, text) for label, text in zip(labels, texts, strict=True)]
            columns = _columns(labels, values)
            if len(cells) and "lat" in columns and "lon" in columns:
                yield name, columns


def _numbers(label: str, texts: Any) -> Floats:
    """Return numbers; degrees without a decimal point are in 1e-7 degrees."""
    values = to_floats(pa.chunked_array(texts.chunks, pa.string()))
    if label not in (*_FIELDS["lat"], *_FIELDS["lon"]):
        return values
    has_point = pc.match_substring(texts, ".").to_numpy()
    return np.where(has_point, values, np.round(values * _TYPES["L"][1], _DECIMALS))
