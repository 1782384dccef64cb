"""GPX: the tracks in it, by GDAL, whose times are good to the millisecond."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, OutputError
from gpszip.geo.planes import to_geographic
from gpszip.io.raw_log import RawLog, Request, unused
from gpszip.io.source import Source
from gpszip.io.timestamps import seconds
from gpszip.io.track_table import DEGREE_DIGITS, decimal
from gpszip.model import Track
from gpszip.model.reading import LeftOut

__all__ = ["HEIGHTS", "read_gpx", "sniff_gpx", "write_gpx"]

_ROOT = re.compile(rb"^(\xef\xbb\xbf)?\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<(\w+:)?gpx[\s>]", re.DOTALL)
_DANGER = re.compile(rb"<!DOCTYPE|<!ENTITY|<OGR\w*DataSource", re.IGNORECASE)
#: What the height above the sea is called; GPX has room for one such column.
HEIGHTS = ("alt", "altitude", "ele", "elevation", "height")
#: Fields of a track point besides its place and time that can be kept, as GDAL names them.
_FIELDS = ("ele", "magvar", "geoidheight", "name", "cmt", "desc", "src", "sym", "type", "fix", "sat", "hdop", "vdop", "pdop")
_TRACK_POINT = re.compile(rb"<(?:\w+:)?trkpt\b[^>]*?(?:/>|>(.*?)</(?:\w+:)?trkpt\s*>)", re.DOTALL)
_COURSE = re.compile(rb"<(?:\w+:)?course\s*>\s*([-+]?[0-9]+\.?[0-9]*|\.[0-9]+)\s*<")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_YEAR_1, _YEAR_10000 = -62_135_596_800_000, 253_402_300_800_000  # milliseconds
_POINT = np.dtype([("order", "u1"), ("kind", "<u4"), ("lon", "<f8"), ("lat", "<f8")])


def sniff_gpx(head: bytes) -> bool:
    """Whether a file that starts like this is GPX.

    Examples
    --------
    >>> sniff_gpx(b'<?xml version="1.0"?> <gpx version="1.1">')
    True
    """
    return _ROOT.match(head) is not None or (head[:2] in (b"\xff\xfe", b"\xfe\xff") and "<gpx" in head[:4000].decode("utf-16", "ignore"))


def read_gpx(source: Source, request: Request) -> RawLog:
    """Read all tracks of a GPX file; the segments of a track follow each other, and long pauses between them are gaps.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: ``ele`` or another field of the points, but of their extensions only the course, as heading.

    Returns
    -------
    RawLog
        Tracks by name; those of one name are numbered. Routes and waypoints are left out.

    Raises
    ------
    InputError
        If it is damaged or refused (a document type or entities), or has no track point or no times.
    """
    data = source.read()
    if found := _DANGER.search(data):
        raise InputError(f"{source.name}: holds {found[0].decode()!r}, which no GPX file needs; remove it")
    keep = _fields(data, request, source.name)
    columns, geometry = _points(data, ["track_fid", "time", *dict.fromkeys(keep.values())], source.name)
    if not len(geometry):
        raise InputError(f"{source.name}: no track points{_others(data)}; GPSZip reads tracks (trk)")
    points = _coordinates(geometry, source.name)
    cells = pa.chunked_array([pa.array(columns["time"], pa.string())])
    times = seconds(cells, None, f"{source.name}: time", dates=request.dates)
    if np.isnan(times).all():
        raise InputError(f"{source.name}: no point has a time; GPSZip needs the times of the points")
    fids, codes = np.unique(columns["track_fid"], return_inverse=True)
    ids = _ids(data, fids, source.stem)
    return RawLog(
        name=source.name,
        ids=ids,
        codes=codes.astype(np.int32) if ids else None,
        times=times,
        coordinates=np.stack([points["lat"], points["lon"]], axis=1),
        geographic=True,
        attributes={name: _kept(columns[field]) for name, field in keep.items()} | (_courses(data, len(times)) if request.heading else {}),
        word="point",
        labels=True,
        dropped=_dropped(data, keep.values()),
        left_out=_left_out(data, source.name),
    )


def write_gpx(tracks: Iterable[Track], sink: BinaryIO, decimals: int) -> None:
    """Write each track as a ``trk`` of one segment; times count from 1970.

    Parameters
    ----------
    tracks : iterable of Track
        On the earth; an attribute ``ele`` or ``alt`` is kept.
    sink : binary file
        Where to.
    decimals : int
        Of metres; degrees have five more, seconds have three.

    Raises
    ------
    OutputError
        If a track is in x and y.
    """
    sink.write(b'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="GPSZip" xmlns="http://www.topografix.com/GPX/1/1">\n')
    for track in tracks:
        if track.plane is None:
            raise OutputError("GPX holds latitudes and longitudes, but this log is in x and y; write CSV, Parquet or GeoJSON")
        sink.write(f"<trk><name>{_xml(track.id)}</name><trkseg>\n".encode())
        lines = _trackpoints(track, decimals + DEGREE_DIGITS)
        sink.write("\n".join(lines.to_pylist()).encode())
        sink.write(b"\n</trkseg></trk>\n")
    sink.write(b"</gpx>\n")


def _fields(data: bytes, request: Request, where: str) -> dict[str, str]:
    keep = {name: "ele" if name in HEIGHTS else name for name in request.keep}
    for name, field in keep.items():
        if field not in _FIELDS or f"<{field}".encode() not in data:
            there = [known for known in _FIELDS if f"<{known}".encode() in data]
            raise InputError(f"{where}: no {name!r} to keep; its points have: {', '.join(there) or 'place and time only'}")
    return keep


def _dropped(data: bytes, kept: Iterable[str]) -> tuple[str, ...]:
    present = [name for name in ("ele", "extensions") if f"<{name}".encode() in data]
    return tuple(name for name in present if name not in set(kept))


def _points(data: bytes, fields: Sequence[str], where: str) -> tuple[dict[str, NDArray[Any]], NDArray[np.object_]]:
    import pyogrio

    try:
        meta, _, geometry, arrays = pyogrio.raw.read(data, layer="track_points", columns=fields, datetime_as_string=True)
    except pyogrio.errors.DataSourceError as error:
        raise InputError(f"{where}: damaged GPX file: {str(error).split('; It might')[0][:200]}") from None
    return dict(zip(meta["fields"].tolist(), arrays, strict=True)), geometry


def _courses(data: bytes, points: int) -> dict[str, NDArray[np.float64]]:
    """Courses of the track points, which GDAL doesn't tell: an element of a point (GPX 1.0) or of its extensions."""
    if b"course>" not in data:
        return {}
    inside = _TRACK_POINT.findall(_COMMENT.sub(b"", data))
    found = [_COURSE.search(one) for one in inside]
    if len(inside) != points or not any(found):
        return {}
    return {"heading": np.array([float(one[1]) if one else np.nan for one in found])}


def _coordinates(geometry: NDArray[np.object_], where: str) -> NDArray[Any]:
    packed = b"".join(geometry.tolist())
    if len(packed) != len(geometry) * _POINT.itemsize:
        raise InputError(f"{where}: holds points of a kind that GPX doesn't have")
    return np.frombuffer(packed, _POINT)


def _ids(data: bytes, fids: NDArray[np.int32], stem: str) -> tuple[str, ...]:
    import pyogrio

    titles = pyogrio.raw.read(data, layer="tracks", columns=["name"], read_geometry=False)[3][0]
    names = [titles[fid] for fid in fids.tolist()]
    if names == [None]:
        return ()
    taken: set[str] = set()
    for i, name in enumerate(names):
        names[i] = unused(name if name is not None else f"{stem}-{i + 1}", taken)
        taken.add(names[i])
    return tuple(names)


def _kept(column: NDArray[Any]) -> NDArray[np.generic]:
    if column.dtype.kind in "fiu":
        return column.astype(np.float64)
    return np.array(["" if value is None else str(value) for value in column.tolist()], dtype=np.str_)


def _counts(data: bytes) -> dict[str, int]:
    return {"waypoints": len(re.findall(rb"<wpt[\s>]", data)), "routes": len(re.findall(rb"<rte[\s>]", data))}


def _others(data: bytes) -> str:
    found = [f"{count} {kind}" for kind, count in _counts(data).items() if count]
    return f", only {' and '.join(found)}" if found else ""


def _left_out(data: bytes, where: str) -> tuple[LeftOut, ...]:
    return tuple(LeftOut(f"{where}: {count} {kind}", "not a track") for kind, count in _counts(data).items() if count)


def _xml(text: str) -> str:
    return escape("".join(letter for letter in text if letter >= " " or letter in "\t\n\r"), {"\r": "&#13;"})


def _trackpoints(track: Track, digits: int) -> Any:
    lat, lon = to_geographic(track.positions[:, :2], track.plane)  # type: ignore[arg-type]
    milliseconds = np.rint(track.times * 1000)
    if milliseconds[0] < _YEAR_1 or milliseconds[-1] >= _YEAR_10000:
        raise OutputError(f"track {track.id!r}: times outside the years 1 to 9999 can't be dates; write CSV")
    when = pc.strftime(pa.array(milliseconds.astype(np.int64), pa.timestamp("ms", "UTC")), "%Y-%m-%dT%H:%M:%SZ")
    parts = ['<trkpt lat="', _digits(lat, digits), '" lon="', _digits(lon, digits), '">', *_ele(track), "<time>", when, "</time></trkpt>"]
    return pc.binary_join_element_wise(*parts, "")


def _digits(degrees: NDArray[np.float64], digits: int) -> Any:
    return pc.cast(pa.array(decimal(degrees, digits)), pa.string())


def _ele(track: Track) -> list[Any]:
    heights = next((track.attributes[name] for name in HEIGHTS if name in track.attributes), None)
    if heights is None:
        return []
    known = pa.array(np.isfinite(heights.astype(np.float64)))
    text = pc.binary_join_element_wise("<ele>", pc.cast(pa.array(decimal(heights.astype(np.float64), 3)), pa.string()), "</ele>", "")
    return [pc.if_else(known, text, "")]
