"""Logs in GeoJSON: lines with the times of their positions, lines without times, and points.

:func:`read_geojson` reads feature by feature. A file is a log of lines, or a log of points; what it
holds besides is left out and listed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.features import (
    BadPosition,
    FeatureError,
    Line,
    NoFeatureError,
    PropertyNames,
    read_feature,
)
from gpszip.io.logs.geojson.json_columns import abbreviate
from gpszip.io.logs.geojson.points import PointTable, dropped_positions_repair
from gpszip.io.logs.geojson.times import has_text_times, read_times
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, UnreadableCell, unused_name
from gpszip.io.storage.source import Source
from gpszip.io.values.json_stream import Document, detect_encoding, read_json
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["read_geojson", "sniff_geojson"]

#: Bytes from which JSON is recognised: an object, a list of objects, or a sequence whose objects
#: follow a record separator.
_SNIFFED_BYTES = 1000

#: Space before the first object, with the record separator of RFC 8142 and the byte order mark.
_SPACE = " \t\r\n\x1e\ufeff"

#: Features that are left out and listed one by one; further ones are counted.
_MAX_NAMED_FEATURES = 10

Floats = NDArray[np.float64]


def sniff_geojson(head: bytes) -> bool:
    """Whether a file that starts like this is JSON with objects.

    Examples
    --------
    >>> sniff_geojson(b'{"type": "FeatureCollection"'), sniff_geojson(b'[ {"type": "Feature"')
    (True, True)
    >>> sniff_geojson(b"[t],x,y")
    False
    """
    # A list holds objects or nothing; `[t],x,y` is the header of a table.
    text = head[:_SNIFFED_BYTES].decode(detect_encoding(head), "ignore").lstrip(_SPACE)
    return text[:1] == "{" or (text[:1] == "[" and text[1:].lstrip()[:1] in ("{", "]"))


def read_geojson(source: Source, request: Request) -> RawLog:
    """Read a log from LineStrings or from Points.

    A line has its times in the property ``coordTimes`` or ``times``, or as the fourth number of
    each position, and its name in ``track_id``, ``id`` or ``name``. A line without times is read
    as a shape, as is each line of a MultiLineString without times. A point has its time and name
    among its properties. Features may be in a FeatureCollection, in a list, or one on each line of
    the file. Positions that are no two finite numbers are dropped and counted.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Unit of time, attributes, columns among the properties (for lines, those of times and
        names), and whether features that can't be used are left out.

    Returns
    -------
    RawLog
        Geometries that are no lines are left out. If no line has times, but points have, the log
        is in its points, and lines are left out.

    Raises
    ------
    InputError
        If it is no GeoJSON, names another coordinate system than WGS 84, has a feature that can't
        be used, or has neither a line nor a point with times.
    """
    # Read all features, as only the end of the file shows whether any line has times.
    contents = _Contents(source.name, request.skip_bad, PointTable(source.name))
    _collect_features(contents, source, PropertyNames.of(request.columns))
    metric = _is_metric(contents)

    # Is the log in its lines?
    if contents.lines and (contents.has_times or not len(contents.points)):
        return _log_from_lines(contents, request, metric=metric)
    if not len(contents.points):
        raise _no_tracks_error(contents)

    # It is in its points, unless they have no times, and there are lines as well.
    try:
        log = contents.points.log(request, metric=metric)
    except InputError:
        if not contents.lines:
            raise
        return _log_from_lines(contents, request, metric=metric)
    contents.others["line without times"] += len(contents.lines)
    return replace(log, left_out=_list_left_out(contents, "the log is in its points"))


@dataclass
class _Contents:
    """What a file holds, collected feature by feature.

    Parameters
    ----------
    name : str
        Name of the log.
    skip_bad : bool
        Whether features that can't be used are left out.
    points : PointTable
        Its points.
    lines : list of Line
        Its lines.
    has_times : bool
        Whether a line has times.
    features : int
        Number of features.
    others : Counter of str
        Kinds of geometries that are left out.
    skipped : list of InputError
        Why the first features are left out.
    more_skipped : int
        Number of further ones.
    bad : int
        Number of positions that are dropped.
    first_bad : BadPosition, optional
        The first of them.
    metric : set of bool
        Whether the collections in the file are in metres.
    crs_problem : str
        What is wrong with the coordinate system that it names; empty if it is WGS 84.
    """

    name: str
    skip_bad: bool
    points: PointTable
    lines: list[Line] = field(default_factory=list)
    has_times: bool = False
    features: int = 0
    others: Counter[str] = field(default_factory=Counter)
    skipped: list[InputError] = field(default_factory=list)
    more_skipped: int = 0
    bad: int = 0
    first_bad: BadPosition | None = None
    metric: set[bool] = field(default_factory=set)
    crs_problem: str = ""

    def skip(self, feature: int, reason: str, kind: type[InputError] = InputError) -> None:
        """Leave out a feature, or raise."""
        location = f"feature {feature}"
        if not self.skip_bad:
            raise kind(reason, path=self.name, location=location, remedy="--skip-bad leaves it out")
        if len(self.skipped) < _MAX_NAMED_FEATURES:
            self.skipped.append(kind(reason, path=self.name, location=location))
        else:
            self.more_skipped += 1


# Features


def _collect_features(contents: _Contents, source: Source, names: PropertyNames) -> None:
    """Read all features; of a damaged file, those before the damage may be kept."""
    try:
        with source.open() as stream:
            # A document is the rest of a collection whose features came before it, or else
            # a single feature.
            for part in read_json(stream, source.name):
                if not isinstance(part, Document):
                    _add_feature(contents, part.value, names)
                elif "features" in part.members or part.members.get("type") == "FeatureCollection":
                    _add_members(contents, part.members)
                else:
                    contents.metric.add(part.members.get("gpszip") == METRES_MEMBER["gpszip"])
                    _add_feature(contents, part.members, names)
    except InputError as error:
        if not (contents.skip_bad and contents.features):
            raise
        location = f"all after feature {contents.features}"
        contents.skipped.append(InputError(error.detail, path=source.name, location=location))


def _add_feature(contents: _Contents, element: Any, names: PropertyNames) -> None:
    # Read the feature; one that can't be used is left out or refused.
    contents.features += 1
    try:
        feature = read_feature(element, contents.features, names)
    except FeatureError as error:
        # JSON that doesn't begin like GeoJSON is something else.
        is_other = contents.features == 1 and isinstance(error, NoFeatureError)
        kind = NoPositionsError if is_other else InputError
        contents.skip(contents.features, str(error), kind)
        return

    # Lines
    contents.lines += feature.lines
    contents.has_times |= any(line.times is not None for line in feature.lines)
    contents.others.update(feature.others)
    contents.bad += feature.bad
    contents.first_bad = contents.first_bad or feature.first_bad

    # Points don't matter once there are lines with times.
    if feature.point is not None and contents.has_times:
        contents.others["Point"] += 1
    elif feature.point is not None:
        contents.points.add(contents.features, feature.point)


def _add_members(contents: _Contents, members: dict[str, Any]) -> None:
    """Add what a collection states besides its features."""
    if not isinstance(members.get("features"), list):
        problem = "it has no 'features'"
        if "features" in members:
            problem = f"its 'features' is {abbreviate(members['features'])}, not a list"
        raise NoPositionsError(
            f"no FeatureCollection as GeoJSON has it: {problem}", path=contents.name
        )
    # Collections in metres are GPSZip's own, so a `crs` in them means nothing.
    metric = members.get("gpszip") == METRES_MEMBER["gpszip"]
    contents.metric.add(metric)
    if not metric:
        contents.crs_problem = contents.crs_problem or crs_problem(members.get("crs"))


def _is_metric(contents: _Contents) -> bool:
    if contents.crs_problem:
        raise InputError(contents.crs_problem, path=contents.name)
    if len(contents.metric) > 1:
        raise InputError(
            "holds features in metres and others in degrees",
            path=contents.name,
            remedy="read them apart",
        )
    # A list of features outside of any collection states nothing, and is in degrees.
    return True in contents.metric


def _no_tracks_error(contents: _Contents) -> InputError:
    # Why the first feature was left out says more than that nothing is left.
    if contents.skipped:
        return contents.skipped[0]
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(contents.others.items()))
    only = f", only {kinds}" if kinds else ""
    return NoPositionsError(f"no LineString and no Point in it{only}", path=contents.name)


def _list_left_out(contents: _Contents, reason: str) -> tuple[LeftOut, ...]:
    left_out = [
        LeftOut(f"{contents.name}: {count} {kind}", reason)
        for kind, count in sorted(contents.others.items())
        if count
    ]
    left_out += [
        LeftOut(f"{error.path}: {error.location}", error.advice) for error in contents.skipped
    ]
    if contents.more_skipped:
        where = f"{contents.name}: {contents.more_skipped} more features"
        left_out.append(LeftOut(where, "can't be used"))
    return tuple(left_out)


# Lines


def _log_from_lines(contents: _Contents, request: Request, *, metric: bool) -> RawLog:
    """Make a log of the lines, and leave out the points."""
    # Leave out the points, and find the lines that can be used.
    if len(contents.points):
        contents.others["Point"] += len(contents.points)
    lines, times, unreadable = _lines_with_times(contents, request)
    if not lines:
        raise _no_tracks_error(contents)

    # A third number is a coordinate of metres, else a height that may be kept.
    table = np.concatenate([line.table for line in lines])
    has_heights = bool(np.isfinite(table[:, 2]).any())
    kept = {name: table[:, 2] for name in request.keep if name in HEIGHT_NAMES and has_heights}
    if missing := [name for name in request.keep if name not in kept]:
        raise InputError(
            f"its positions have no {missing[0]!r}",
            path=contents.name,
            remedy="only a third number, alt, can be kept",
        )
    # Positions are x, y[, z] in metres, but longitude and latitude in degrees, which a log has
    # the other way round.
    dimension = 3 if has_heights else 2
    coordinates = (table[:, :dimension] if metric else table[:, 1::-1]).copy()
    drops_heights = has_heights and not metric and not kept

    # A file with one line and no name has no ids.
    tracks = _name_lines(lines)
    codes = np.repeat(tracks.codes, [len(line.table) for line in lines]).astype(np.int32)
    is_unnamed = len(tracks.ids) == 1 and lines[0].name is None
    return RawLog(
        name=contents.name,
        ids=() if is_unnamed else tracks.ids,
        codes=None if is_unnamed else codes,
        times=np.concatenate(times),
        coordinates=coordinates,
        geographic=not metric,
        attributes=kept,
        row_noun="position",
        dropped_columns=("alt",) if drops_heights else (),
        repairs=_list_repairs(contents, tracks.renamed, table[:, 2] if kept else None),
        left_out=_list_left_out(contents, "no line"),
        unreadable=unreadable,
        untimed=tracks.untimed,
    )


def _lines_with_times(
    contents: _Contents, request: Request
) -> tuple[list[Line], list[Floats], tuple[UnreadableCell, ...]]:
    """Find the lines that can be used.

    Returns
    -------
    list of Line
        The lines.
    list of float64 array
        Their times in seconds.
    tuple of UnreadableCell
        The first time that can't be read, if there is one.
    """
    # A single position without a time is neither a track nor a shape.
    lines = _drop_single_positions(contents)

    # Leave out features whose times are texts, but no times at all.
    try:
        times = read_times(lines, request, contents.name)
    except InputError as error:
        if not contents.skip_bad:
            raise
        for feature in dict.fromkeys(line.feature for line in lines if has_text_times(line)):
            contents.skip(feature, error.advice)
        lines = [line for line in lines if not has_text_times(line)]
        times = read_times(lines, request, contents.name)

    # Leave out features none of whose times can be read.
    if times.faults:
        for feature, fault in times.faults.items():
            contents.skip(feature, fault)
        lines = [line for line in lines if line.feature not in times.faults]
        times = read_times(lines, request, contents.name)

    # Report the first time that can't be read among the lines that are left.
    if times.unreadable is None:
        return lines, times.seconds, ()
    return lines, times.seconds, (UnreadableCell("times", *times.unreadable),)


def _drop_single_positions(contents: _Contents) -> list[Line]:
    """Return the lines except those of one position without a time."""
    lines = [line for line in contents.lines if line.times is not None or len(line.table) > 1]
    dropped = len(contents.lines) - len(lines)
    if dropped:
        contents.others["line of one position without a time"] += dropped
    return lines


@dataclass(frozen=True)
class _NamedLines:
    """The tracks that lines belong to.

    Parameters
    ----------
    ids : tuple of str
        Names of the tracks.
    codes : list of int
        Index of its track for each line.
    untimed : frozenset of int
        Codes of the tracks that are shapes.
    renamed : int
        Number of features whose tracks have another name than the feature.
    """

    ids: tuple[str, ...]
    codes: list[int]
    untimed: frozenset[int]
    renamed: int


def _name_lines(lines: Sequence[Line]) -> _NamedLines:
    """Assign lines to tracks.

    Lines of one name are one track if they have times. Each line without times is a shape, with a
    name that no other track has.
    """
    # A feature without a name is named by its number.
    # Numbers count from 0 here, as the only track of a log without names is 0.
    given = {line.name for line in lines if line.name is not None}
    names = [
        line.name if line.name is not None else unused_name(str(line.feature - 1), given)
        for line in lines
    ]

    # Rename shapes whose name is taken.
    reserved = set(names)
    taken = {name for name, line in zip(names, lines, strict=True) if line.times is not None}
    last_numbers: Counter[str] = Counter()
    track_names = []
    for name, line in zip(names, lines, strict=True):
        is_shape = line.times is None
        track_name = _free_name(name, taken, reserved, last_numbers) if is_shape else name
        track_names.append(track_name)
        taken.add(track_name)

    # Number tracks in the order in which they appear.
    index = {name: code for code, name in enumerate(dict.fromkeys(track_names))}
    codes = [index[name] for name in track_names]
    untimed = frozenset(code for code, line in zip(codes, lines, strict=True) if line.times is None)

    # Count features whose first line was renamed.
    is_first = [i == 0 or lines[i - 1].feature != line.feature for i, line in enumerate(lines)]
    renamed = sum(
        new != old and first for new, old, first in zip(track_names, names, is_first, strict=True)
    )
    return _NamedLines(tuple(index), codes, untimed, renamed)


def _free_name(name: str, taken: set[str], reserved: set[str], last_numbers: Counter[str]) -> str:
    """Return the name, or the first of ``name-2``, ``name-3``, ... that is free.

    Such a name is free if no track has it and no feature states it. ``last_numbers`` keeps the
    search short if many shapes have the same name.
    """
    free = name
    while free in taken or (free != name and free in reserved):
        last_numbers[name] += 1
        free = f"{name}-{last_numbers[name] + 1}"
    return free


def _list_repairs(contents: _Contents, renamed: int, heights: Floats | None) -> tuple[Repair, ...]:
    repairs = []
    if contents.first_bad is not None:
        repairs.append(dropped_positions_repair(contents.bad, contents.first_bad, contents.name))

    if renamed:
        what = "lines without times renamed, as another track has their name"
        repairs.append(Repair(what, renamed, contents.name, drops=False))

    if heights is not None and (is_missing := np.isnan(heights)).any():
        what = "positions without a height, which is unknown there"
        where = f"{contents.name}: position {int(is_missing.argmax()) + 1}"
        repairs.append(Repair(what, int(is_missing.sum()), where, drops=False))
    return tuple(repairs)
