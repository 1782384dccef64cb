"""Logs of OwnTracks Recorder (.rec): messages of phones, one on each line.

A line has the time of receipt, the kind of message, and the message as JSON. Phones without a
network send positions later, so the time in the message counts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.source import Source

__all__ = ["read_owntracks", "read_owntracks_batches"]

#: Members of a message by attribute, with the factor to metres and m/s.
_ATTRIBUTES = {
    "alt": ("alt", 1.0),
    "accuracy": ("acc", 1.0),
    "speed": ("vel", 1 / 3.6),
    "course": ("cog", 1.0),
    "battery": ("batt", 1.0),
}

#: Decimals of speeds: km/h are whole numbers.
_DECIMALS = 6

#: Letters of a kind of messages that are shown.
_MAX_KIND_LETTERS = 30

_NAN = float("nan")


def read_owntracks(source: Source, request: Request) -> RawLog:
    r"""Read the positions of a log of OwnTracks Recorder.

    The time is ``tst`` of the message. Messages of other types are counted. Messages with a
    ``topic`` are a track for each topic.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt and accuracy in metres, speed in m/s, course in degrees, battery
        in percent.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If there is no message with a position.

    Examples
    --------
    >>> line = b'2024-05-04T09:00:00Z\t*\t{"_type":"location","tst":7,"lat":48.1,"lon":11.5}'
    >>> log = read_owntracks(Source("a.rec", data=line), Request())
    >>> log.times.tolist(), log.coordinates.tolist()
    ([7.0], [[48.1, 11.5]])
    """
    return read_points(source, request, _parse)


def read_owntracks_batches(source: Source, request: Request) -> LogBatches:
    """Open a log of OwnTracks to be read in batches; see :func:`read_owntracks`."""
    kind = CoordinateKind(geographic=True, dimension=2)
    return open_points(source, request, _parse, kind)


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no location in this log of OwnTracks"
    findings.remedy = "record messages that are not encrypted"
    for lines in read_lines(source):
        rows: list[tuple[float, ...]] = []
        topics: list[str] = []
        for line in lines.to_pylist():
            message = _message(line, findings)
            if message is not None:
                rows.append(_row(message))
                topics.append(_topic(message))

        # An empty list has no columns.
        table = np.array(rows, np.float64).reshape(-1, 3 + len(_ATTRIBUTES))
        attributes: dict[str, NDArray[np.generic]] = {
            name: table[:, 3 + i] for i, name in enumerate(_ATTRIBUTES)
        }
        yield PointBatch(table[:, 0], table[:, 1:3], attributes, topics)


def _message(line: str, findings: Findings) -> dict[str, Any] | None:
    """Return the location in a line; count what is none."""
    # Names of waypoints may have tabs, which JSON escapes.
    if not line.strip():
        return None
    try:
        message = json.loads(line.split("\t", 2)[-1])
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        findings.count("lines that are no message left out", 1, value=line[:_MAX_KIND_LETTERS])
        return None

    # Transitions and waypoints have positions, too, but of places.
    kind = message.get("_type")
    if kind == "location":
        return message
    findings.count("messages other than locations ignored", 1, value=str(kind)[:_MAX_KIND_LETTERS])
    return None


def _row(message: dict[str, Any]) -> tuple[float, ...]:
    at = (_number(message.get(name)) for name in ("tst", "lat", "lon"))
    values = (
        round(_number(message.get(name)) * factor, _DECIMALS)
        for name, factor in _ATTRIBUTES.values()
    )
    return (*at, *values)


def _topic(message: dict[str, Any]) -> str:
    topic = message.get("topic")
    # Half surrogate pairs, which JSON may escape, are no text.
    return topic.encode("utf-8", "backslashreplace").decode() if isinstance(topic, str) else ""


def _number(value: Any) -> float:
    # Some clients write numbers as texts.
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return _NAN
    try:
        return float(value)
    except (ValueError, OverflowError):
        return _NAN
