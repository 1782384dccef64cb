"""The records of FIT files, as fitdecode finds them.

A file is a chain of one or more files of the standard, each with messages. Positions are in
messages ``record``; messages ``session`` tell the sports of a race, and ``file_id`` what the file
is.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from gpszip.errors import MissingExtraError
from gpszip.io.storage.source import Source

__all__ = ["FitRecords", "Session", "parse_fit"]

#: Seconds from 1970 to 1989-12-31, from which FIT counts.
_EPOCH = 631_065_600

#: Times below this count from the start of the device, not from 1989.
_MIN_TIME = 0x1000_0000

#: Decimals of stored integers after the division by their scale, of which 1,000,000 is the largest.
_DECIMALS = 9

#: Letters of an error of fitdecode that are shown.
_MAX_REASON_LETTERS = 120

#: Fields of records with a role of their own.
_LAT, _LON, _TIME = "position_lat", "position_long", "timestamp"

_NAN = float("nan")


@dataclass(frozen=True)
class Session:
    """One sport of an activity.

    Parameters
    ----------
    start : float
        When it starts, in seconds since 1970; NaN if the file doesn't say.
    sport : str
        Its name, such as ``cycling``.
    """

    start: float
    sport: str


@dataclass
class FitRecords:
    """The records of a chain of files, column by column.

    Parameters
    ----------
    times : array of float
        Seconds since 1970; NaN for a record without a time.
    lat, lon : array of float
        Semicircles, of which 2**31 are 180 degrees; NaN for a record without a position.
    fields : dict of str to list
        For each field that was asked for, its value in each record; None where it is missing.
    present : dict of str to None
        Names of all fields of records except time and position, in the order of the file.
    ends : list of int
        Number of records at the end of each file of the chain.
    sessions : list of list of Session
        Those of each file.
    kinds : list of str
        What each file is: ``activity``, ``course``, ``monitoring_b``.
    messages : Counter of str
        Messages other than records, by name.
    damage : str
        What is wrong with the file; empty if it was read to its end.
    """

    times: array[float] = field(default_factory=lambda: array("d"))
    lat: array[float] = field(default_factory=lambda: array("d"))
    lon: array[float] = field(default_factory=lambda: array("d"))
    fields: dict[str, list[Any]] = field(default_factory=dict)
    present: dict[str, None] = field(default_factory=dict)
    ends: list[int] = field(default_factory=list)
    sessions: list[list[Session]] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    messages: Counter[str] = field(default_factory=Counter)
    damage: str = ""

    def start_file(self) -> None:
        """Begin the next file of the chain."""
        self.ends.append(len(self.times))
        self.sessions.append([])
        self.kinds.append("file")


def parse_fit(source: Source, wanted: Collection[str]) -> FitRecords:
    """Read the messages of a file up to its end, or up to where it is damaged.

    Parameters
    ----------
    source : Source
        The file or stream.
    wanted : collection of str
        Names of the fields of records to collect.

    Raises
    ------
    MissingExtraError
        If fitdecode isn't installed.
    """
    # Other files are read without it.
    try:
        import fitdecode
    except ImportError:
        raise MissingExtraError("fit", "reading FIT files") from None

    # A damaged file raises whatever its first wrong byte leads to, as fitdecode trusts files. What
    # was read before counts.
    records = FitRecords(fields={name: [] for name in wanted})
    reader = fitdecode.FitReader(
        source.read(),
        processor=None,
        check_crc=fitdecode.CrcCheck.READONLY,
        error_handling=fitdecode.ErrorHandling.IGNORE,
    )
    try:
        with reader:
            for frame in reader:
                if isinstance(frame, fitdecode.FitHeader):
                    records.start_file()
                elif isinstance(frame, fitdecode.FitDataMessage):
                    _add_message(records, frame)
                elif isinstance(frame, fitdecode.FitCRC) and not frame.matched:
                    records.damage = records.damage or "its checksum is wrong"
                if records.ends:
                    records.ends[-1] = len(records.times)
    except fitdecode.FitEOFError:
        records.damage = "it is cut short"
    except Exception as error:
        reason = str(error) or type(error).__name__
        records.damage = reason.splitlines()[0][:_MAX_REASON_LETTERS]
    return records


def _add_message(records: FitRecords, message: Any) -> None:
    """Add what a message says."""
    # Records are most of a file.
    name = str(message.name)
    if name == "record":
        _add_record(records, message)
        return

    # Other messages are counted; two kinds of them tell what the records are.
    records.messages[name] += 1
    if name == "session":
        start, sport = _seconds(_value(message, "start_time")), _value(message, "sport")
        records.sessions[-1].append(Session(start, sport if isinstance(sport, str) else "activity"))
    elif name == "file_id":
        kind = _value(message, "type")
        records.kinds[-1] = kind if isinstance(kind, str) else "file"


def _add_record(records: FitRecords, message: Any) -> None:
    """Add a row to all columns."""
    # Of several fields of one name, the first with a value counts.
    row: dict[str, Any] = {}
    for item in message.fields:
        name = item.name
        if isinstance(name, str) and row.get(name) is None:
            row[name] = _exact(item)

    # Add it to the columns.
    records.times.append(_seconds(row.pop(_TIME, None)))
    records.lat.append(_number(row.pop(_LAT, None)))
    records.lon.append(_number(row.pop(_LON, None)))
    for name, column in records.fields.items():
        column.append(row.get(name))

    # Fields without a name in the standard are named by number.
    records.present |= {
        name: None
        for name, value in row.items()
        if value is not None and not name.startswith("unknown_")
    }


def _exact(item: Any) -> Any:
    """Return the value of a field without the digits that its division by the scale adds."""
    # Only numbers that are stored as floats have digits of their own.
    is_stored = item.field_def is not None and isinstance(item.raw_value, float)
    is_divided = isinstance(item.value, float) and not is_stored
    return round(item.value, _DECIMALS) if is_divided else item.value


def _value(message: Any, name: str) -> Any:
    return next((item.value for item in message.fields if item.name == name), None)


def _seconds(value: Any) -> float:
    return _EPOCH + value if isinstance(value, (int, float)) and value >= _MIN_TIME else _NAN


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else _NAN
