"""Floating car data of SUMO (``--fcd-output``): vehicles and persons in each step of time.

The file is read as a stream by expat. Entities can't be declared, and tags and names have limits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request, unused_name
from gpszip.io.logs.sniff.text import decode_head
from gpszip.io.logs.xml.text import Utf8Transcoder
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["read_sumo", "read_sumo_batches"]

#: Elements with a position. Ids are unique among those of one name.
_KINDS = ("vehicle", "person", "container")

#: Attributes that are numbers, by their names in the file: m/s, degrees clockwise from north,
#: metres along the lane, degrees, metres.
_NUMBERS = {"speed": "speed", "heading": "angle", "pos": "pos", "slope": "slope", "alt": "z"}

#: Attributes that are texts.
_TEXTS = ("type", "lane", "edge", "vehicle")

#: Bytes that the parser gets at a time: 256 KiB.
_CHUNK_BYTES = 1 << 18

#: Bytes of one tag or comment, at most: the parser keeps them in memory.
_MAX_TAG_BYTES = 1 << 23

#: Different names of elements and attributes, at most: the parser keeps them in memory.
_MAX_NAMES = 10_000

#: Points that are turned into columns together.
_BATCH_POINTS = 1 << 16

#: The options of SUMO in the comment at the start of a file, and the one that asks for degrees.
_OPTIONS = re.compile(r"<(?:\w*[cC]onfiguration)\b")
_GEO = re.compile(r"<fcd-output\.geo\s+value=\"(?:true|1|yes|on|x|t)\"")

#: Positions at the start of a file.
_POSITION = re.compile(r"\s(x|y)=\"(-?\d+(?:\.(\d+))?)\"")

#: Largest numbers that may be degrees.
_LARGEST = {"x": 180.0, "y": 90.0}

#: Decimals of metres, unless the user of SUMO asked for others. Degrees have six.
_METRE_DECIMALS = 2

_NAN = float("nan")


def read_sumo(source: Source, request: Request) -> RawLog:
    """Read the positions of vehicles, persons and containers; each is a track.

    Whether they are degrees is said by the options of SUMO at the start of the file, or by
    ``columns``: ``lat=y,lon=x`` or ``x=x,y=y``. Else they are metres if they are too large for
    degrees, or have at most two decimals.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: speed in m/s, heading in degrees, pos, slope, alt, type, lane, edge and
        vehicle.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the file is damaged, or positions may be degrees or metres.

    Examples
    --------
    >>> text = b'<fcd-export><timestep time="1.5"><vehicle id="a" x="9.5" y="7" speed="3"/>'
    >>> text += b'</timestep></fcd-export>'
    >>> log = read_sumo(Source("a.xml", data=text), Request(keep=("speed",)))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist(), log.geographic
    (('a',), [1.5], [[9.5, 7.0]], False)
    """
    return read_points(source, request, _parse)


def read_sumo_batches(source: Source, request: Request) -> LogBatches:
    """Open floating car data to be read in batches; see :func:`read_sumo`."""
    kind = CoordinateKind(_is_geographic(source, request), 2)
    return open_points(source, request, _parse, kind)


def _parse(source: Source, request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no vehicle or person in this output of SUMO"
    # Set the parser up for UTF-8, whatever the file declares.
    collector = _Collector(findings, geographic=_is_geographic(source, request))
    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler = collector.start
    parser.StartDoctypeDeclHandler = collector.refuse_doctype
    utf8 = Utf8Transcoder(source.head())

    # Parse chunk by chunk.
    fed = 0
    with source.open() as stream:
        is_at_end = False
        while not is_at_end:
            chunk = read_chunk(stream, _CHUNK_BYTES)
            is_at_end = not chunk
            try:
                text = utf8.encode(chunk, final=is_at_end)
                fed += len(text)
                parser.Parse(text, is_at_end)
            except expat.ExpatError as error:
                raise _damage(source, error, utf8.skipped_lines, collector.points) from None
            except UnicodeDecodeError:
                remedy = "fetch it again, or save it as UTF-8"
                raise InputError("damaged text", path=source.name, remedy=remedy) from None

            # The parser keeps an unfinished tag, and all names.
            if fed - parser.CurrentByteIndex > _MAX_TAG_BYTES or len(parser.intern) > _MAX_NAMES:
                raise InputError(
                    "a tag that is too long, or too many names of elements",
                    path=source.name,
                    remedy="check that SUMO wrote this file",
                )
            if len(collector.times) >= _BATCH_POINTS or is_at_end:
                yield collector.take()


def _damage(source: Source, error: expat.ExpatError, skipped: int, points: int) -> InputError:
    return InputError(
        f"damaged XML: {expat.ErrorString(error.code)}, after {points:,} points",
        path=source.name,
        location=f"line {error.lineno + skipped}",
        remedy="let SUMO end its run, or close the elements that are open",
    )


# Degrees or metres


def _is_geographic(source: Source, request: Request) -> bool:
    """Whether positions are degrees."""
    # The user knows best, then the options of SUMO.
    columns = request.columns if isinstance(request.columns, Mapping) else {}
    if {"lat", "lon", "x", "y"} & columns.keys():
        return "lat" in columns or "lon" in columns
    text = decode_head(source.head())
    start = text.split("<timestep", 1)[0]
    if _OPTIONS.search(start):
        return _GEO.search(start) is not None

    # Numbers alone often show that they are no degrees.
    found = _POSITION.findall(text)
    is_large = any(abs(float(number)) > _LARGEST[axis] for axis, number, _ in found)
    if is_large or all(len(decimals) <= _METRE_DECIMALS for *_, decimals in found):
        return False
    raise InputError(
        "x and y may be degrees or metres",
        path=source.name,
        remedy="say which: --columns lat=y,lon=x or --columns x=x,y=y",
    )


# Points


@dataclass
class _Collector:
    """Collects the points that the parser finds.

    Parameters
    ----------
    findings : Findings
        Counts what can't be read.
    geographic : bool
        Whether x and y are longitude and latitude.
    """

    findings: Findings
    geographic: bool
    time: float = _NAN
    points: int = 0
    times: list[float] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    positions: list[tuple[float, float]] = field(default_factory=list)
    rows: list[dict[str, str]] = field(default_factory=list)
    _names: dict[tuple[str, str], str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def start(self, element: str, attributes: dict[str, str]) -> None:
        """Note a step of time or a position."""
        if element == "timestep":
            self.time = _seconds(attributes.get("time", ""))
        elif element in _KINDS:
            self.times.append(self.time)
            self.ids.append(self._name(element, attributes.get("id", "")))
            self.positions.append((_number(attributes.get("x")), _number(attributes.get("y"))))
            self.rows.append(attributes)
            self.points += 1

    def refuse_doctype(self, *_declaration: Any) -> None:
        """Raise: a document type may declare entities that expand without end."""
        raise InputError(
            "has a document type, which SUMO doesn't write",
            path=self.findings.name,
            remedy="remove the line with <!DOCTYPE",
        )

    def take(self) -> PointBatch:
        """Return the points collected so far, and forget them."""
        coordinates = np.array(self.positions, np.float64).reshape(-1, 2)
        numbers = {
            name: np.array([_number(row.get(key)) for row in self.rows], np.float64)
            for name, key in _NUMBERS.items()
        }
        # NumPy's own texts would all take as much memory as the longest one.
        texts = {key: np.array([row.get(key, "") for row in self.rows], object) for key in _TEXTS}
        batch = PointBatch(
            np.array(self.times, np.float64),
            coordinates[:, ::-1] if self.geographic else coordinates,
            {**numbers, **texts},
            self.ids,
            self.geographic,
        )
        self.times, self.ids, self.positions, self.rows = [], [], [], []
        return batch

    def _name(self, kind: str, id_: str) -> str:
        """Return the name of a track; a person may have the id of a vehicle."""
        name = self._names.get((kind, id_))
        if name is None:
            name = id_ if id_ not in self._taken else unused_name(f"{id_} ({kind})", self._taken)
            self._names[kind, id_] = name
            self._taken.add(name)
        return name


def _number(text: str | None) -> float:
    try:
        return float(text) if text is not None else _NAN
    except ValueError:
        return _NAN


def _seconds(text: str) -> float:
    """Return a time in seconds; it may be written as days:hours:minutes:seconds."""
    parts = [_number(part) for part in reversed(text.split(":"))]
    factors = (1.0, 60.0, 3600.0, 86_400.0)
    if len(parts) > len(factors):
        return _NAN
    return sum(part * factor for part, factor in zip(parts, factors, strict=False))
