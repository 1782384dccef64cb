"""Logs of the robot toolkit CARMEN: poses of laser scans, or else of odometry.

Each line is a message: its name, its values, the time of the message, the computer, and the time
since the log began. Scans carry the pose of the robot, which mapping programs correct.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats

__all__ = ["read_carmen", "read_carmen_batches"]


class _Message(NamedTuple):
    """A kind of message with a pose, and where it is among its words.

    Parameters
    ----------
    name : str
        Its first word.
    tail : int
        Words after the readings.
    pose : int
        Words of these before x, y and the angle of the robot.
    head : int
        Words before the readings; the last of them is the number of readings. 0 if it has none.
    """

    name: str
    tail: int
    pose: int
    head: int


#: Messages with poses, the preferred one first.
_MESSAGES = (
    _Message("FLASER", 9, 0, 2),
    _Message("ROBOTLASER1", 14, 3, 9),
    _Message("ODOM", 9, 0, 0),
)

#: Words at the end of a message: its time, the computer, the time since the log began.
_TIME, _HOST = -3, -2

#: Degrees from north to the direction of x.
_EAST = 90.0

#: Degrees in a circle.
_CIRCLE = 360.0

#: Decimals of headings.
_DECIMALS = 6

#: Letters of a line that messages show.
_MAX_SHOWN_LETTERS = 40

Floats = NDArray[np.float64]


def read_carmen(source: Source, request: Request) -> RawLog:
    """Read the poses of a robot.

    They come from FLASER messages, whose poses mapping programs correct; else from ROBOTLASER1,
    else from ODOM. The three are never mixed. The time is that of the message, not of the log.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: theta in radians, heading in degrees clockwise from the direction of y.

    Returns
    -------
    RawLog
        One track in metres. Messages that can't be read are not in it, but counted.

    Raises
    ------
    InputError
        If there is no message with a pose.

    Examples
    --------
    >>> line = b"FLASER 2 0.8 0.9 1.5 -2 0.1 1.6 -2.1 0.1 976052857.5 host 0.2"
    >>> log = read_carmen(Source("a.log", data=line), Request(keep=("theta",)))
    >>> log.times.tolist(), log.coordinates.tolist(), log.attributes["theta"].tolist()
    ([976052857.5], [[1.5, -2.0]], [0.1])
    """
    return read_points(source, request, _parse)


def read_carmen_batches(source: Source, request: Request) -> LogBatches:
    """Open a log of CARMEN to be read in batches; see :func:`read_carmen`."""
    return open_points(source, request, _parse, CoordinateKind(geographic=False, dimension=2))


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no FLASER, ROBOTLASER1 or ODOM message that can be read"
    chosen = _choose(source)
    for lines in read_lines(source):
        # Count the messages that are not read.
        for message in _MESSAGES:
            if message is not chosen:
                count = pc.sum(_is_message(lines, message)).as_py() or 0
                what = f"{message.name} messages ignored beside {chosen.name}"
                findings.count(what, count)

        # Read the others.
        found = pc.utf8_trim_whitespace(lines.filter(_is_message(lines, chosen)))
        words, is_whole = _last_words(found, chosen)
        broken = found.filter(pa.array(~is_whole))
        shown = broken[0].as_py()[:_MAX_SHOWN_LETTERS] if len(broken) else ""
        findings.count("messages that can't be read dropped", len(broken), drops=True, value=shown)
        yield _batch(words, chosen)


def _is_message(lines: Any, message: _Message) -> Any:
    return pc.starts_with(lines, f"{message.name} ")


def _choose(source: Source) -> _Message:
    """Return the kind of message to read; the file is read up to the first preferred one."""
    best = len(_MESSAGES) - 1
    for lines in read_lines(source):
        for i, message in enumerate(_MESSAGES[:best]):
            if pc.any(_is_message(lines, message)).as_py():
                best = i
                break
        if best == 0:
            break
    return _MESSAGES[best]


def _last_words(found: Any, message: _Message) -> tuple[list[Floats], NDArray[np.bool_]]:
    """Return the last words of messages as numbers, and whether each message is whole.

    Words are returned only of messages that are.
    """
    # A message that lost some of its readings would have its pose elsewhere.
    count = pc.count_substring_regex(found, r"\S+")
    words = count.to_numpy() - message.tail
    is_whole = words == 1
    if message.head:
        pattern = rf"^(?:\S+\s+){{{message.head - 1}}}(?P<n>\d{{1,6}})\s"
        readings = to_floats(pc.struct_field(pc.extract_regex(found, pattern), "n"))
        # ROBOTLASER1 goes on with remissions and their number.
        more = words - message.head - readings
        is_whole = more == 0 if message.pose == 0 else more >= 1

    # Split the others from their ends. The name of the computer is no number.
    whole = found.filter(pa.array(is_whole))
    parts = pc.utf8_split_whitespace(whole, max_splits=message.tail, reverse=True)
    columns = [
        to_floats(pc.list_element(parts, i + 1)) if i != message.tail + _HOST else np.zeros(0)
        for i in range(message.tail)
    ]
    return columns, is_whole


def _batch(words: list[Floats], message: _Message) -> PointBatch:
    x, y, theta = words[message.pose : message.pose + 3]
    heading = np.round((_EAST - np.degrees(theta)) % _CIRCLE, _DECIMALS)
    attributes: dict[str, NDArray[np.generic]] = {"theta": theta, "heading": heading}
    return PointBatch(words[_TIME], np.stack([x, y], axis=1), attributes, None, geographic=False)
