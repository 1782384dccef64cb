"""Logs in GPX: tracks with times, and tracks and routes without times, which are shapes.

GPSZip has its own reader because others lose or change data and don't report it. GDAL's driver
reads ``48,1371`` as 48 and takes 0 for what is no number; it leaves out extensions, and times that
are written in unusual ways. gpxpy has had no release since 2023, and took ten times as long.
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
from gpszip.model.read_result import LeftOut
from gpszip.model.text import count_text

__all__ = ["GPX_VOCABULARY", "read_gpx", "read_gpx_batches"]

GPX_VOCABULARY = Vocabulary(
    format_name="GPX",
    points=frozenset({"trkpt", "rtept"}),
    parents=frozenset({"trk", "rte"}),
    plans=frozenset({"rte", "rtept"}),
    segment="trkseg",
    titles=frozenset({"name"}),
    waypoint="wpt",
    containers=frozenset({"extensions", "link"}),
    no_fields=frozenset({"link"}),
)


def read_gpx(source: Source, request: Request) -> RawLog:
    """Read the tracks and routes of a GPX file.

    The segments of a track with times are one track; long pauses between them are gaps. A track
    without any times is a shape, and so is each route. How a shape goes from one segment to the
    next is not known, so each segment becomes a separate shape.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        The unit of times that are numbers, and the elements of points to keep (``ele``, ``hr``,
        ``speed``), also from extensions. Other common names of them are understood
        (``heart_rate``).

    Returns
    -------
    RawLog
        Tracks and routes in the order of the file, with numbers after names that occur twice.
        Coordinates that can't be read are NaN. Waypoints are left out.

    Raises
    ------
    InputError
        If the file is damaged, has a document type or goes beyond a limit; if no point has a
        position, or there are times and none can be read; or if no point has an element to keep.

    Examples
    --------
    >>> point = '<trkpt lat="48.1" lon="11.5"><time>1970-01-01T00:00:01Z</time><hr>120</hr></trkpt>'
    >>> data = f"<gpx><trk><name>walk</name><trkseg>{point}</trkseg></trk></gpx>".encode()
    >>> log = read_gpx(Source("a.gpx", data=data), Request(keep=("heart_rate",)))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist(), log.attributes["heart_rate"].tolist()
    (('walk',), [1.0], [[48.1, 11.5]], [120.0])
    """
    # Collect the texts of all points.
    collector, replaced = collect_points(source, GPX_VOCABULARY, fields_to_collect(request))
    if not collector.count:
        waypoints = count_text(collector.waypoints, "waypoint")
        only = f", only {waypoints}" if collector.waypoints else ""
        raise NoPositionsError(
            f"no track points{only}; GPSZip reads tracks (trk) and routes (rte)", path=source.name
        )

    # Interpret them.
    log = interpret_points(collector.finish(), source, request)
    return _complete(log, collector, replaced)


def read_gpx_batches(source: Source, request: Request) -> LogBatches | None:
    """Open a GPX file to be read in batches, as :func:`read_gpx` reads it at once.

    Parameters
    ----------
    source, request
        As for :func:`read_gpx`.

    Returns
    -------
    LogBatches or None
        None for a file that is refused when it is read at once.
    """
    wanted = fields_to_collect(request)
    return open_batches(
        source,
        request,
        lambda parser: PointCollector(parser, GPX_VOCABULARY, wanted, in_batches=True),
        _complete,
        "GPX",
    )


def _complete(log: RawLog, collector: PointCollector, replaced: ReplacedBytes) -> RawLog:
    """Add what the file has besides points."""
    waypoints = count_text(collector.waypoints, "waypoint")
    left_out = (LeftOut(f"{log.name}: {waypoints}", "not a track"),)
    return replace(
        log,
        repairs=(*replacement_repairs(replaced, log.name), *log.repairs),
        left_out=left_out if collector.waypoints else (),
    )
