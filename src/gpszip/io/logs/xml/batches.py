"""Logs in XML that are read in batches: parsed once for their facts, then for their points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, TypeVar
from xml.parsers.expat import XMLParserType

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.plausibility import check_plausible
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.xml.facts import find_facts
from gpszip.io.logs.xml.interpret import BatchInterpreter
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.logs.xml.parser import XmlCollector, parse_chunks
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source

__all__ = ["BatchCollector", "open_batches"]


class BatchCollector(XmlCollector, Protocol):
    """Collects points in batches.

    Attributes
    ----------
    batches : list of LogPoints
        Complete batches, to be taken out.
    """

    batches: list[LogPoints]

    def finish(self) -> LogPoints:
        """Return the points of the last batch, of which there may be none."""


Collector = TypeVar("Collector", bound=BatchCollector)

#: Adds to the last log what the collector found besides points.
_Complete = Callable[[RawLog, Collector, ReplacedBytes], RawLog]


def open_batches(
    source: Source,
    request: Request,
    make_collector: Callable[[XMLParserType], Collector],
    complete: _Complete[Collector],
    format_name: str,
    plan_noun: str = "route",
) -> LogBatches | None:
    """Open a log to be read in batches.

    Parameters
    ----------
    source : Source
        The file, which is parsed twice.
    request : Request
        The unit of times that are numbers, and the fields of points to keep.
    make_collector : callable
        Makes a collector, which sets the handlers of a parser.
    complete : callable
        Adds repairs and items that were left out to the last log.
    format_name : str
        Name of the format for messages.
    plan_noun : str
        What the format calls a planned route.

    Returns
    -------
    LogBatches or None
        None for a file without points, or one of them without a position: read at once, it is
        refused.

    Raises
    ------
    InputError
        If the file is damaged, has a document type or goes beyond a limit, or if no point has a
        field to keep.
    """
    # Parse for the facts.
    positions = 0

    def parse() -> Iterator[LogPoints]:
        nonlocal positions
        for points, _, _ in _parse(source, make_collector, format_name):
            positions += len(points) - points.lat.null_count
            yield points

    # A file without any position is refused when it is read at once, for that reason first.
    try:
        facts = find_facts(parse(), source, request)
    except InputError:
        if positions:
            raise
    if not positions:
        return None

    # Parse for the points while the batches are iterated.
    def interpret() -> Iterator[RawLog]:
        interpreter = BatchInterpreter(facts, source, request, plan_noun)
        is_first = True
        for points, collector, replaced in _parse(source, make_collector, format_name):
            log = interpreter.interpret(points)
            if collector is not None:
                log = complete(log, collector, replaced)
            if len(points) or collector is not None:
                yield check_plausible(log, request) if is_first else log
                is_first = False

    return LogBatches(interpret(), CoordinateKind(geographic=True, dimension=2))


def _parse(
    source: Source, make_collector: Callable[[XMLParserType], Collector], format_name: str
) -> Iterator[tuple[LogPoints, Collector | None, ReplacedBytes]]:
    """Yield the batches of a file; the last one with its collector."""
    for parsed in parse_chunks(source, make_collector, format_name):
        collector, replaced = parsed
        while collector.batches:
            yield collector.batches.pop(0), None, replaced
    yield collector.finish(), collector, replaced
