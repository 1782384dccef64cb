"""Logs in GeoJSON: lines with the times of their positions, lines without times, and points with a time each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.features import (
    BadPosition,
    FeatureError,
    Line,
    PropertyNames,
    read_feature,
)
from gpszip.io.logs.geojson.json_columns import abbreviate
from gpszip.io.logs.geojson.json_stream import Document, detect_encoding, read_json
from gpszip.io.logs.geojson.points import HEIGHT_NAMES, PointTable, dropped_positions_repair
from gpszip.io.logs.geojson.times import has_text_times, read_times
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.raw import RawLog, Request, UnreadableCell, unused_name
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["read_geojson", "sniff_geojson"]

#: Bytes by which JSON is told: an object, a list of objects, or a sequence whose objects follow a record separator.
_SNIFFED_BYTES = 1000

#: How many features are named that are left out; further ones are counted.
_MAX_NAMED_FEATURES = 10

Floats = NDArray[np.float64]


def sniff_geojson(head: bytes) -> bool:
    """Whether a file that starts like this is JSON with types.

    Examples
    --------
    >>> sniff_geojson(b'{"type": "FeatureCollection"'), sniff_geojson(b'[ {"type": "Feature"'), sniff_geojson(b"[t],x,y")
    (True, True, False)
    """
    text = head[:_SNIFFED_BYTES].decode(detect_encoding(head), "ignore").lstrip(" \t\r\n\x1e\ufeff")
    return text[:1] == "{" or (text[:1] == "[" and text[1:].lstrip()[:1] in ("{", "]"))


def read_geojson(source: Source, request: Request) -> RawLog:
    """Read a log from LineStrings or from Points.

    A line has its times in the property ``coordTimes`` or ``times``, or as the fourth number of each position, and its
    name in ``track_id``, ``id`` or ``name``. A line without any is read as a shape, as is each line of a MultiLineString
    without any. A point has time and name among its properties. Features may be in a FeatureCollection, in a list, or one
    on each line of the file. Positions that are no two finite numbers are dropped and counted.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Unit of time, attributes, columns among the properties (for lines, those of times and names), and whether features
        that can't be used are left out.

    Returns
    -------
    RawLog
        Geometries that are no lines are left out. Where no line has times and there are points with times, so are lines.

    Raises
    ------
    InputError
        If it is no GeoJSON, names another coordinate system than WGS 84, has a feature that can't be used, or has neither
        a line nor a point with times.
    """
    found = _Contents(source.name, request.skip_bad, PointTable(source.name))
    _collect_features(found, source, PropertyNames.of(request.columns))
    metric = _is_metric(found)
    if found.lines and (found.timed or not len(found.points)):
        return _log_from_lines(found, request, metric=metric)
    if not len(found.points):
        raise _no_tracks_error(found)
    try:
        log = found.points.log(request, metric=metric)
    except InputError:
        if not found.lines:
            raise
        return _log_from_lines(found, request, metric=metric)
    found.others["line without times"] += len(found.lines)
    return replace(log, left_out=_left_out(found, "the log is in its points"))


@dataclass
class _Contents:
    """What is found in a file, feature by feature."""

    name: str
    skip_bad: bool
    points: PointTable
    lines: list[Line] = field(default_factory=list)
    timed: bool = False  # whether a line has times
    features: int = 0
    others: Counter[str] = field(default_factory=Counter)  # kinds of what is left out
    skipped: list[LeftOut] = field(default_factory=list)
    more_skipped: int = 0
    bad: int = 0
    first_bad: BadPosition | None = None
    metric: set[bool] = field(default_factory=set)
    crs_problem: str = ""

    def skip(self, feature: int, reason: str) -> None:
        """Leave out a feature, or raise."""
        where = f"{self.name}: feature {feature}"
        if not self.skip_bad:
            raise InputError(f"{where}: {reason}; --skip-bad leaves it out")
        if len(self.skipped) < _MAX_NAMED_FEATURES:
            self.skipped.append(LeftOut(where, reason))
        else:
            self.more_skipped += 1


def _collect_features(found: _Contents, source: Source, names: PropertyNames) -> None:
    """Read all features; where a file is damaged from some place on, those before may be kept."""
    try:
        with source.open() as stream:
            for part in read_json(stream, source.name):
                if not isinstance(part, Document):
                    _add_feature(found, part.value, names)
                elif "features" in part.members or part.members.get("type") == "FeatureCollection":
                    _add_members(found, part.members)
                else:
                    found.metric.add(part.members.get("gpszip") == METRES_MEMBER["gpszip"])
                    _add_feature(found, part.members, names)
    except InputError as error:
        if not (found.skip_bad and found.features):
            raise
        found.skipped.append(
            LeftOut(
                f"{source.name}: all after feature {found.features}",
                str(error).removeprefix(f"{source.name}: "),
            )
        )


def _add_feature(found: _Contents, element: Any, names: PropertyNames) -> None:
    found.features += 1
    try:
        feature = read_feature(element, found.features, names)
    except FeatureError as error:
        found.skip(found.features, str(error))
        return
    found.lines += feature.lines
    found.timed |= any(line.times is not None for line in feature.lines)
    found.others.update(feature.others)
    found.bad += feature.bad
    found.first_bad = found.first_bad or feature.first_bad
    if feature.point is not None and found.timed:
        found.others["Point"] += 1
    elif feature.point is not None:
        found.points.add(found.features, feature.point)


def _add_members(found: _Contents, members: dict[str, Any]) -> None:
    """Take in what a collection says besides its features."""
    if not isinstance(members.get("features"), list):
        what = (
            f"its 'features' is {abbreviate(members['features'])}, not a list"
            if "features" in members
            else "it has no 'features'"
        )
        raise InputError(f"{found.name}: no FeatureCollection as GeoJSON has it: {what}")
    metric = members.get("gpszip") == METRES_MEMBER["gpszip"]
    found.metric.add(metric)
    found.crs_problem = found.crs_problem or ("" if metric else crs_problem(members.get("crs")))


def _is_metric(found: _Contents) -> bool:
    if found.crs_problem:
        raise InputError(f"{found.name}: {found.crs_problem}")
    if len(found.metric) > 1:
        raise InputError(
            f"{found.name}: holds features in metres and others in degrees; read them apart"
        )
    return True in found.metric


def _no_tracks_error(found: _Contents) -> InputError:
    if found.skipped:
        return InputError(f"{found.skipped[0].name}: {found.skipped[0].reason}")
    only = ", ".join(f"{count} {kind}" for kind, count in sorted(found.others.items()))
    return InputError(
        f"{found.name}: no LineString and no Point in it" + (f", only {only}" if only else "")
    )


def _left_out(found: _Contents, reason: str) -> tuple[LeftOut, ...]:
    kinds = [
        LeftOut(f"{found.name}: {count} {kind}", reason)
        for kind, count in sorted(found.others.items())
        if count
    ]
    more = (
        [LeftOut(f"{found.name}: {found.more_skipped} more features", "can't be used")]
        if found.more_skipped
        else []
    )
    return (*kinds, *found.skipped, *more)


def _log_from_lines(found: _Contents, request: Request, *, metric: bool) -> RawLog:
    if len(found.points):
        found.others["Point"] += len(found.points)
    lines, times, unread = _timed_lines(found, request)
    if not lines:
        raise _no_tracks_error(found)
    table = np.concatenate([line.table for line in lines])
    heights = bool(np.isfinite(table[:, 2]).any())

    # third numbers: a coordinate of metres, else a column that may be kept
    kept = {name: table[:, 2] for name in request.keep if name in HEIGHT_NAMES and heights}
    if missing := [name for name in request.keep if name not in kept]:
        raise InputError(
            f"{found.name}: its positions have no {missing[0]!r}; only a third number, alt, can be kept"
        )
    coordinates = table[:, : 3 if heights else 2].copy() if metric else table[:, 1::-1].copy()

    tracks = _tracks(lines)
    codes = np.repeat(tracks.codes, [len(line.table) for line in lines]).astype(np.int32)
    plain = len(tracks.ids) == 1 and lines[0].name is None
    return RawLog(
        name=found.name,
        ids=() if plain else tracks.ids,
        codes=None if plain else codes,
        times=np.concatenate(times),
        coordinates=coordinates,
        geographic=not metric,
        attributes=kept,
        row_noun="position",
        dropped_columns=("alt",) if heights and not metric and not kept else (),
        repairs=_repairs(found, tracks.renamed, table[:, 2] if kept else None),
        left_out=_left_out(found, "no line"),
        unreadable=unread,
        untimed=tracks.untimed,
    )


def _timed_lines(
    found: _Contents, request: Request
) -> tuple[list[Line], list[Floats], tuple[UnreadableCell, ...]]:
    """The lines that can be used, with their times in seconds."""
    lines = _lines_of_two(found)

    # times that are texts, but no times at all
    try:
        times = read_times(lines, request, found.name)
    except InputError as error:
        if not found.skip_bad:
            raise
        for feature in dict.fromkeys(line.feature for line in lines if has_text_times(line)):
            found.skip(feature, str(error).rsplit(": times: ", 1)[-1])
        lines = [line for line in lines if not has_text_times(line)]
        times = read_times(lines, request, found.name)

    # features of which no time can be read
    if times.faults:
        for feature, fault in times.faults.items():
            found.skip(feature, fault)
        lines = [line for line in lines if line.feature not in times.faults]
        times = read_times(lines, request, found.name)
    unread = () if times.unreadable is None else (UnreadableCell("times", *times.unreadable),)
    return lines, times.seconds, unread


def _lines_of_two(found: _Contents) -> list[Line]:
    """Lines but those that are one position, and no time."""
    lines = [line for line in found.lines if line.times is not None or len(line.table) > 1]
    if len(lines) < len(found.lines):
        found.others["line of one position without a time"] += len(found.lines) - len(lines)
    return lines


@dataclass(frozen=True)
class _Tracks:
    """Names of tracks, the track of each line, those that are shapes, and how many have another name than their feature."""

    ids: tuple[str, ...]
    codes: list[int]
    untimed: frozenset[int]
    renamed: int


def _tracks(lines: Sequence[Line]) -> _Tracks:
    """Lines of one name are one track if they have times; each line without times is a shape, whose name no other track has."""
    # names that features have, and for those without one their numbers
    given = {line.name for line in lines if line.name is not None}
    names = [
        line.name if line.name is not None else unused_name(str(line.feature - 1), given)
        for line in lines
    ]

    # shapes whose name is taken
    reserved = set(names)
    taken = {name for name, line in zip(names, lines, strict=True) if line.times is not None}
    tries: Counter[str] = Counter()
    own = []
    for name, line in zip(names, lines, strict=True):
        own.append(name if line.times is not None else _free(name, taken, reserved, tries))
        taken.add(own[-1])

    # tracks in the order in which they appear
    index = {name: code for code, name in enumerate(dict.fromkeys(own))}
    codes = [index[name] for name in own]
    untimed = frozenset(code for code, line in zip(codes, lines, strict=True) if line.times is None)
    begins = [i == 0 or lines[i - 1].feature != line.feature for i, line in enumerate(lines)]
    renamed = sum(new != old and first for new, old, first in zip(own, names, begins, strict=True))
    return _Tracks(tuple(index), codes, untimed, renamed)


def _free(name: str, taken: set[str], reserved: set[str], tries: Counter[str]) -> str:
    """The name, or the first of ``name-2``, ``name-3``, ... that no track has, and no feature names."""
    own = name
    while own in taken or (own != name and own in reserved):
        tries[name] += 1
        own = f"{name}-{tries[name] + 1}"
    return own


def _repairs(found: _Contents, renamed: int, heights: Floats | None) -> tuple[Repair, ...]:
    repairs = []
    if found.first_bad is not None:
        repairs.append(dropped_positions_repair(found.bad, found.first_bad, found.name))
    if renamed:
        repairs.append(
            Repair(
                "lines without times renamed, as another track has their name",
                renamed,
                found.name,
                drops=False,
            )
        )
    if heights is not None and (missing := np.isnan(heights)).any():
        where = f"{found.name}: position {int(missing.argmax()) + 1}"
        repairs.append(
            Repair(
                "positions without a height, which is unknown there",
                int(missing.sum()),
                where,
                drops=False,
            )
        )
    return tuple(repairs)
