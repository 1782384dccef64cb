"""Logs in GeoJSON: lines with the times of their positions, lines without times, and points.

:func:`read_geojson` reads feature by feature. A file is a log of lines, or a log of points; what it
holds besides is left out and listed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.features import (
    FeatureError,
    NoFeatureError,
    PropertyNames,
    read_feature,
)
from gpszip.io.logs.geojson.json_columns import abbreviate
from gpszip.io.logs.geojson.lines import (
    Contents,
    list_left_out,
    log_from_lines,
    no_tracks_error,
)
from gpszip.io.logs.geojson.points import PointTable
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source
from gpszip.io.values.json_stream import Document, read_json

__all__ = ["read_geojson"]


def read_geojson(source: Source, request: Request) -> RawLog:
    """Read a log from LineStrings or from Points.

    A line has its times in the property ``coordTimes`` or ``times``, or as the fourth number of
    each position, and its name in ``track_id``, ``id`` or ``name``. A line without times is read
    as a shape, as is each line of a MultiLineString without times. A point has its time and name
    among its properties. Moving features (MF-JSON) are tracks: a line with ``datetimes``, a
    ``temporalGeometry``, or a MovingPoint by itself. Features may be in a FeatureCollection, in a
    list, or one on each line of the file, also after record separators (RFC 8142). Positions that
    are no two finite numbers are dropped and counted.

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
    contents = Contents(source.name, request.skip_bad, PointTable(source.name))
    _collect_features(contents, source, PropertyNames.of(request.columns, request.keep))
    metric = _is_metric(contents)

    # Is the log in its lines?
    if contents.lines and (contents.has_times or not len(contents.points)):
        return log_from_lines(contents, request, metric=metric)
    if not len(contents.points):
        raise no_tracks_error(contents)

    # It is in its points, unless they have no times, and there are lines as well.
    try:
        log = contents.points.log(request, metric=metric)
    except InputError:
        if not contents.lines:
            raise
        return log_from_lines(contents, request, metric=metric)
    contents.others["line without times"] += len(contents.lines)
    return replace(log, left_out=list_left_out(contents, "the log is in its points"))


# Features


def _collect_features(contents: Contents, source: Source, names: PropertyNames) -> None:
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


def _add_feature(contents: Contents, element: Any, names: PropertyNames) -> None:
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


def _add_members(contents: Contents, members: dict[str, Any]) -> None:
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


def _is_metric(contents: Contents) -> bool:
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
