"""Logs in KML: tracks with times, points with times, and lines without, which are shapes.

GPSZip has its own reader because GDAL's reads a ``gx:Track`` as a line and drops all its times.
KMZ is a zip archive with a KML file, which is unpacked before.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from xml.parsers.expat import XMLParserType

from gpszip.errors import NoPositionsError
from gpszip.io.logs.kml.collector import KmlCollector, Notes
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.xml.batches import open_batches
from gpszip.io.logs.xml.facts import fields_to_collect
from gpszip.io.logs.xml.interpret import interpret_points, replacement_repairs
from gpszip.io.logs.xml.parser import parse_chunks
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair
from gpszip.model.text import count_text

__all__ = ["read_kml", "read_kml_batches"]


def read_kml(source: Source, request: Request) -> RawLog:
    """Read the tracks, points and lines of a KML file.

    A placemark with a track (``gx:Track``, or ``Track`` of KML 2.3) is a track; those of a
    ``gx:MultiTrack`` follow each other, and long pauses between them are gaps. If no track has
    times, the points with a time (``TimeStamp``, or the beginning of a ``TimeSpan``) of each folder
    are a track. A line, and a track without times, is a shape.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        The unit of times that are numbers, and the fields to keep: ``ele``, names of
        ``SimpleArrayData``, ``SimpleData`` and ``Data``, and ``heading`` of ``gx:angles``.

    Returns
    -------
    RawLog
        Tracks and lines in the order of the file, named by their placemarks, else by the folder or
        document. Coordinates that can't be read are NaN. Points without a time, polygons and
        network links are left out.

    Raises
    ------
    InputError
        If the file is damaged, has a document type or goes beyond a limit; if nothing is a track,
        no point has a position, or there are times and none can be read; or if no point has a field
        to keep.

    Examples
    --------
    >>> track = "<when>1970-01-01T00:00:01Z</when><gx:coord>11.5 48.1 500</gx:coord>"
    >>> text = f"<kml><Placemark><name>walk</name><gx:Track>{track}</gx:Track></Placemark></kml>"
    >>> log = read_kml(Source("a.kml", data=text.encode()), Request(keep=("ele",)))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist(), log.attributes["ele"].tolist()
    (('walk',), [1.0], [[48.1, 11.5]], [500.0])
    """
    # Collect the texts of all points.
    wanted = fields_to_collect(request)
    chunks = parse_chunks(source, lambda parser: KmlCollector(parser, wanted), "KML")
    [(collector, replaced)] = deque(chunks, maxlen=1)
    points = collector.finish()
    if not len(points):
        left_out = _left_out(collector.notes, source.name)
        only = ", ".join(item.name.removeprefix(f"{source.name}: ") for item in left_out)
        raise NoPositionsError(
            f"no tracks{only and ', only '}{only}; GPSZip reads tracks, points with times, and "
            "lines",
            path=source.name,
        )

    # Interpret them.
    return _complete(interpret_points(points, source, request), collector, replaced)


def read_kml_batches(source: Source, request: Request) -> LogBatches | None:
    """Open a KML file to be read in batches of whole tracks, as :func:`read_kml` reads it at once.

    Parameters
    ----------
    source, request
        As for :func:`read_kml`.

    Returns
    -------
    LogBatches or None
        None for a file of points with times, which are sorted by their folders, and for one that is
        refused when it is read at once.
    """
    wanted = fields_to_collect(request)
    collectors: list[KmlCollector] = []

    def make_collector(parser: XMLParserType) -> KmlCollector:
        collectors.append(KmlCollector(parser, wanted, in_batches=True))
        return collectors[-1]

    # The first collector has seen the whole file by now.
    opened = open_batches(source, request, make_collector, _complete, "KML")
    return None if collectors[0].is_point_log else opened


def _complete(log: RawLog, collector: KmlCollector, replaced: ReplacedBytes) -> RawLog:
    """Add what the file has besides points."""
    return replace(
        log,
        repairs=(
            *replacement_repairs(replaced, log.name),
            *_repairs(collector.notes, log.name),
            *log.repairs,
        ),
        left_out=_left_out(collector.notes, log.name),
    )


def _left_out(notes: Notes, where: str) -> tuple[LeftOut, ...]:
    """List the items that hold no track."""
    return tuple(
        LeftOut(f"{where}: {count_text(count, item.one, item.many)}", item.reason)
        for item, count in notes.items.items()
    )


def _repairs(notes: Notes, where: str) -> tuple[Repair, ...]:
    return tuple(
        Repair(what, count, f"{where}: placemark {notes.first[what]}", drops=drops)
        for (what, drops), count in notes.repairs.items()
    )
