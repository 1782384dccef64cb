"""Logs in TCX, the Training Center XML of Garmin: activities with times, and planned courses.

The laps and tracks of an activity are one track. Trackpoints often have no position, while a device
has no fix or is indoors; they are counted as dropped.
"""

from __future__ import annotations

from dataclasses import replace

from gpszip.errors import NoPositionsError
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.xml.batches import open_batches
from gpszip.io.logs.xml.facts import fields_to_collect
from gpszip.io.logs.xml.interpret import interpret_points, replacement_repairs
from gpszip.io.logs.xml.point_collector import PointCollector, Vocabulary, collect_points
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair
from gpszip.model.text import count_text

__all__ = ["TCX_VOCABULARY", "read_tcx", "read_tcx_batches"]

TCX_VOCABULARY = Vocabulary(
    format_name="TCX",
    points=frozenset({"trackpoint"}),
    parents=frozenset({"activity", "course", "transition"}),
    plans=frozenset({"course"}),
    segment="track",
    titles=frozenset({"id", "name"}),
    waypoint="coursepoint",
    containers=frozenset({"extensions", "position", "heartratebpm", "tpx"}),
    # Names that GPX and other logs use.
    renamed={
        "latitudedegrees": "lat",
        "longitudedegrees": "lon",
        "altitudemeters": "ele",
        "distancemeters": "distance",
        "heartratebpm/value": "hr",
    },
    has_attributes=False,
)


def read_tcx(source: Source, request: Request) -> RawLog:
    """Read the activities and courses of a TCX file.

    All laps of an activity are one track, named by its ``Id``, which is mostly the time of its
    start. Each activity of a multisport session is a track, and so are the transitions between
    them. The times of courses are plans, so courses are shapes.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        The fields of trackpoints to keep: ``ele``, ``hr``, ``cadence``, ``distance``, and those of
        extensions, such as ``speed`` and ``watts``.

    Returns
    -------
    RawLog
        Activities and courses in the order of the file. Coordinates that are missing or can't be
        read are NaN. Course points are left out.

    Raises
    ------
    InputError
        If the file is damaged, has a document type or goes beyond a limit; if no trackpoint has a
        position, or there are times and none can be read; or if none has a field to keep.

    Examples
    --------
    >>> position = "<LatitudeDegrees>48.1</LatitudeDegrees><LongitudeDegrees>11</LongitudeDegrees>"
    >>> point = f"<Time>1970-01-01T00:00:01Z</Time><Position>{position}</Position>"
    >>> activity = f"<Id>run</Id><Lap><Track><Trackpoint>{point}</Trackpoint></Track></Lap>"
    >>> text = f"<TrainingCenterDatabase><Activity>{activity}</Activity></TrainingCenterDatabase>"
    >>> log = read_tcx(Source("a.tcx", data=text.encode()), Request())
    >>> log.ids, log.times.tolist(), log.coordinates.tolist()
    (('run',), [1.0], [[48.1, 11.0]])
    """
    # Collect the texts of all trackpoints.
    collector, replaced = collect_points(source, TCX_VOCABULARY, fields_to_collect(request))
    where = source.name
    points = collector.finish()
    if not len(points):
        course_points = count_text(collector.waypoints, "course point")
        only = f", only {course_points}" if collector.waypoints else ""
        raise NoPositionsError(
            f"no trackpoint{only}; GPSZip reads activities and courses with trackpoints", path=where
        )
    if points.lat.null_count == len(points):
        raise NoPositionsError(
            f"none of {count_text(len(points), 'trackpoint')} has a position, as of a workout "
            "indoors",
            path=where,
            remedy="leave the file out",
        )

    # Interpret them.
    return _complete(interpret_points(points, source, request, "course"), collector, replaced)


def read_tcx_batches(source: Source, request: Request) -> LogBatches | None:
    """Open a TCX file to be read in batches, as :func:`read_tcx` reads it at once.

    Parameters
    ----------
    source, request
        As for :func:`read_tcx`.

    Returns
    -------
    LogBatches or None
        None for a file that is refused when it is read at once.
    """
    wanted = fields_to_collect(request)
    return open_batches(
        source,
        request,
        lambda parser: PointCollector(parser, TCX_VOCABULARY, wanted, in_batches=True),
        _complete,
        "TCX",
        "course",
    )


def _complete(log: RawLog, collector: PointCollector, replaced: ReplacedBytes) -> RawLog:
    """Add what the file has besides trackpoints."""
    course_points = count_text(collector.waypoints, "course point")
    left_out = (LeftOut(f"{log.name}: {course_points}", "not a track"),)
    return replace(
        log,
        repairs=(
            *replacement_repairs(replaced, log.name),
            *_repeated_positions(collector.repeated_positions, log.name),
            *log.repairs,
        ),
        left_out=left_out if collector.waypoints else (),
    )


def _repeated_positions(count: int, where: str) -> tuple[Repair, ...]:
    what = "positions after the first one of a trackpoint not read"
    return (Repair(what, count, where, drops=False),) if count else ()
