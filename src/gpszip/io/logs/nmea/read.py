"""Logs in NMEA 0183: sentences of GPS receivers, as loggers, ships and phones keep them.

All positions are one track. Everything is read in batches, so logs may be larger than memory.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.nmea.epochs import (
    DAY,
    EPOCH,
    Calendar,
    EpochCounts,
    find_first_date,
    read_epochs,
)
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, UnreadableCell, find_kept
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["read_nmea", "read_nmea_batches"]

#: Attributes of positions, by the names under which they may be kept.
_SYNONYMS = {
    "alt": HEIGHT_NAMES,
    "speed": ("speed",),
    "course": ("course", "heading", "track"),
    "satellites": ("satellites", "sat", "sats"),
    "hdop": ("hdop",),
}

#: Days from 1970 to 1999-08-22, when the week number of GPS started at 0 again: receivers that
#: don't know show later days 1024 weeks early.
_FIRST_DAY = 10_825

#: Types of sentences with messages of AIS.
_AIS = frozenset({"VDM", "VDO"})

#: Share of damaged sentences above which a file is not complete, as for points of tracks.
_MAX_WRONG_SHARE = 0.1

#: Types of other sentences that messages name.
_MAX_SHOWN_TYPES = 8

Records = NDArray[np.void]
Floats = NDArray[np.float64]


def read_nmea(source: Source, request: Request) -> RawLog:
    """Read the positions of a log of NMEA 0183.

    Sentences of one time are one point: its position comes from GGA, GNS, RMC or GLL, its date
    from RMC or ZDA, its speed and course from RMC or VTG. A date holds until the next one, over
    midnights, and also for the points before the first date. Sentences with a wrong checksum are
    left out and counted. Positions that the receiver marks as not valid are not read.

    Parameters
    ----------
    source : Source
        The file or stream, also in UTF-16. Bytes between sentences are passed over.
    request : Request
        Attributes to keep: alt in metres, speed in m/s, course in degrees, satellites, hdop.

    Returns
    -------
    RawLog
        One track. Without any date, its times are seconds from the midnight before its start.

    Raises
    ------
    InputError
        If there is no sentence with a position, or an attribute to keep is none of these.

    Examples
    --------
    >>> rmc = b"$GPRMC,000001.5,A,4807.038,N,01131.000,E,022.4,084.4,230394,,*06"
    >>> log = read_nmea(Source("a.nmea", data=rmc), Request(keep=("speed",)))
    >>> log.coordinates.round(6).tolist(), log.times.tolist(), log.attributes["speed"].tolist()
    ([[48.1173, 11.516667]], [764380801.5], [11.523556])
    """
    reader = _Reader(source, request)
    batches = list(reader.epochs())
    epochs = np.concatenate([epochs for epochs, _ in batches])
    return reader.log(epochs, np.concatenate([times for _, times in batches]), 1, is_last=True)


def read_nmea_batches(source: Source, request: Request) -> LogBatches:
    """Open a log of NMEA 0183 to be read in batches; see :func:`read_nmea`."""
    return LogBatches(_read_batches(source, request), CoordinateKind(geographic=True, dimension=2))


def _read_batches(source: Source, request: Request) -> Iterator[RawLog]:
    # What was repaired is complete at the end of the file, so an empty batch tells it.
    reader = _Reader(source, request)
    first = 1
    for epochs, times in reader.epochs():
        if len(epochs):
            yield reader.log(epochs, times, first)
        first += len(epochs)
    yield reader.log(np.zeros(0, EPOCH), np.zeros(0), first, is_last=True)


class _Reader:
    """Reads one file, and counts what was left out."""

    def __init__(self, source: Source, request: Request) -> None:
        self._name, self._source = source.name, source
        self._kept = find_kept(request, _SYNONYMS, "course", source.name)
        self._counts = EpochCounts()
        self._odd_days = 0
        self._first_odd_day = 0.0
        self._points = 0

    def epochs(self) -> Iterator[tuple[Records, Floats]]:
        """Yield epochs with a position, readable or not, with their times in seconds."""
        # The first date may come late.
        first_day = find_first_date(self._source)
        self._has_dates = first_day is not None
        self._calendar = Calendar(first_day or 0.0)
        for epochs in read_epochs(self._source, self._counts):
            times = self._calendar.to_seconds(epochs)
            rows = epochs["has_position"]
            self._note_odd_days(times[rows & ~epochs["void"]])
            self._points += int(rows.sum())
            yield epochs[rows], times[rows]
        if not self._points and not self._counts.untimed.any():
            raise self._no_position_error()

    def log(self, epochs: Records, times: Floats, first: int, *, is_last: bool = False) -> RawLog:
        """Return epochs as a log; the last one of a file tells what was repaired."""
        # The receiver's mark counts, whatever the position.
        is_void = epochs["void"]
        lat, lon = (np.where(is_void, np.nan, epochs[axis]) for axis in ("lat", "lon"))
        unreadable: tuple[UnreadableCell, ...] = ()
        if is_void.any():
            unreadable = (UnreadableCell("status", int(is_void.argmax()), "not valid"),)

        # Attributes that are there, but not asked for, are named.
        dropped = tuple(
            name
            for name in _SYNONYMS
            if name not in self._kept.values() and np.isfinite(epochs[name]).any()
        )
        return RawLog(
            name=self._name,
            ids=(),
            codes=None,
            times=times,
            coordinates=np.stack([lat, lon], axis=1),
            geographic=True,
            attributes={name: epochs[column].copy() for name, column in self._kept.items()},
            first=first,
            row_noun="point",
            dropped_columns=dropped,
            repairs=self._repairs() if is_last else (),
            left_out=self._left_out() if is_last else (),
            unreadable=unreadable,
            time_of_day=not self._has_dates,
        )

    def _note_odd_days(self, times: Floats) -> None:
        """Count points before 1999-08-22 or in the future, if the file has dates."""
        days = times[np.isfinite(times)] // DAY
        odd = days[(days < _FIRST_DAY) | (days > time.time() // DAY + 1)]
        if self._has_dates and len(odd):
            self._first_odd_day = self._first_odd_day if self._odd_days else float(odd[0])
            self._odd_days += len(odd)

    # What was repaired and left out

    def _repairs(self) -> tuple[Repair, ...]:
        # Points.
        counts, undated = self._counts, "points without a date dated by the sentences around them"
        undated_count = self._calendar.undated
        if not self._has_dates:
            undated = "points timed from the midnight before the first one, as the log has no date"
            undated_count = self._points
        odd = (
            "points with dates before August 1999 or in the future, perhaps by a wrong week number"
        )
        odd_day = str(np.datetime64(int(self._first_odd_day), "D"))
        untimed = int(counts.untimed.max())

        # Sentences.
        others = ", ".join(name for name, _ in counts.others.most_common(_MAX_SHOWN_TYPES))
        all_others = sum(counts.others.values())
        kinds = (
            ("points without a time dropped", untimed, True, ""),
            (undated, undated_count, False, ""),
            (f"{odd} of the receiver, kept", self._odd_days, False, odd_day),
            ("sentences with a wrong checksum left out", counts.wrong, False, ""),
            ("sentences without a position ignored", all_others, False, others),
        )
        return tuple(
            Repair(what, count, self._name, drops=drops, value=value)
            for what, count, drops, value in kinds
            if count
        )

    def _left_out(self) -> tuple[LeftOut, ...]:
        wrong, found = self._counts.wrong, self._counts.wrong + self._counts.read
        if wrong <= _MAX_WRONG_SHARE * found:
            return ()
        what = f"{self._name}: {wrong:,} of {found:,} sentences"
        return (LeftOut(what, "their checksums are wrong or missing"),)

    def _no_position_error(self) -> InputError:
        # All sentences with positions may be damaged.
        counts = self._counts
        if counts.wrong:
            reason = f"the checksums of all its {counts.wrong:,} sentences are wrong"
            return InputError(reason, path=self._name, remedy="fetch or record it again")

        # Say what is in it. Positions of ships are in messages of AIS, not the log's own.
        found = [f"{n:,} {name}" for name, n in counts.others.most_common(_MAX_SHOWN_TYPES)]
        only = ", ".join(found) or "dates and speeds"
        is_ais = not _AIS.isdisjoint(counts.others)
        return NoPositionsError(
            f"NMEA 0183 without a sentence of positions (RMC, GGA, GNS, GLL), only {only}",
            path=self._name,
            remedy="decode messages of AIS to CSV first" if is_ais else "record RMC or GGA",
        )
