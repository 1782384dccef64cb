"""Epochs of a receiver: the sentences of one moment, merged, with the date of their day.

RMC, GGA, GLL and GNS of one moment repeat one position, whatever their talkers. Only RMC and ZDA
have dates, so an epoch without one takes its date from those around it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.nmea.sentences import (
    KINDS,
    POSITION_KINDS,
    SENTENCE,
    SentenceCounts,
    read_sentences,
)
from gpszip.io.storage.source import Source

__all__ = ["EPOCH", "Calendar", "EpochCounts", "find_first_date", "read_epochs"]

#: Seconds in a day.
DAY = 86_400.0

#: Seconds by which the time of day steps back at midnight, at least. Smaller steps are faults.
_MIN_MIDNIGHT_STEP = DAY / 2

#: Sentences at one time, at most; more come from a clock that stands still.
_MAX_SENTENCES = 10_000

#: Types in the order in which they are asked for each quantity: RMC's date before that of ZDA.
_PREFERENCE = {
    "day": ("RMC", "ZDA"),
    "alt": ("GGA", "GNS"),
    "speed": ("RMC", "VTG"),
    "course": ("RMC", "VTG"),
    "satellites": ("GGA", "GNS"),
    "hdop": ("GGA", "GNS"),
}

#: The columns of epochs; the time is in seconds of the day.
EPOCH = np.dtype([*SENTENCE.descr[1:], ("has_position", np.bool_)])

Floats = NDArray[np.float64]
Records = NDArray[np.void]


@dataclass
class EpochCounts(SentenceCounts):
    """Counts of sentences, with those of positions without a time by type.

    Parameters
    ----------
    untimed : int array, shape (4,)
        For each type with a position, its sentences without a time.
    """

    untimed: NDArray[np.int64] = field(default_factory=lambda: np.zeros(POSITION_KINDS, np.int64))


def read_epochs(source: Source, counts: EpochCounts) -> Iterator[Records]:
    """Yield the epochs of a file with a position, or with a date, in batches.

    Parameters
    ----------
    source : Source
        The file or stream.
    counts : EpochCounts
        Grows while the file is read.

    Yields
    ------
    structured array, shape (n,)
        Of the type EPOCH, in the order of the file.
    """
    # The last epoch in memory may go on in the next batch.
    pending = np.zeros(0, SENTENCE)
    for batch in read_sentences(source, counts):
        sentences = np.concatenate([pending, _take_timed(batch, counts)])
        epoch = _number_epochs(sentences)
        is_complete = epoch < epoch[-1] if len(epoch) else np.zeros(0, np.bool_)
        if len(sentences) - is_complete.sum() > _MAX_SENTENCES:
            is_complete[:] = True
        yield _merge(sentences[is_complete], epoch[is_complete])
        pending = sentences[~is_complete]
    yield _merge(pending, _number_epochs(pending))


def _take_timed(sentences: Records, counts: EpochCounts) -> Records:
    """Return sentences except those of positions without a time, which are counted."""
    # Receivers write such sentences until they know the time. VTG never has one.
    is_untimed = np.isnan(sentences["time"]) & (sentences["kind"] < POSITION_KINDS)
    counts.untimed += np.bincount(sentences["kind"][is_untimed], minlength=POSITION_KINDS)
    timed: Records = sentences[~is_untimed]
    return timed


def _number_epochs(sentences: Records) -> NDArray[np.intp]:
    """Number the epochs of sentences: one begins with each new time."""
    # VTG belongs to the sentence with a time before it, at the start of a file to the first one.
    times = sentences["time"]
    has_time = np.isfinite(times)
    changes = np.zeros(len(times), np.intp)
    changes[np.flatnonzero(has_time)[1:]] = np.diff(times[has_time]) != 0
    return np.cumsum(changes)


def _merge(sentences: Records, epoch: NDArray[np.intp]) -> Records:
    """Merge the sentences of each epoch."""
    # Number epochs from 0. An epoch has a time, unless it has only VTG.
    first = int(epoch[0]) if len(epoch) else 0
    epoch = epoch - first
    merged = np.zeros(int(epoch[-1]) + 1 if len(epoch) else 0, EPOCH)
    kind = sentences["kind"]
    for name in EPOCH.names or ():
        if EPOCH[name] == np.float64:
            merged[name] = np.nan
    has_time = np.isfinite(sentences["time"])
    merged["time"][epoch[has_time]] = sentences["time"][has_time]

    # Take each quantity from the first sentence of the preferred type that has it.
    for name, kinds in _PREFERENCE.items():
        for preferred in reversed(kinds):
            is_given = (kind == KINDS.index(preferred)) & np.isfinite(sentences[name])
            rows = np.flatnonzero(is_given)[::-1]
            merged[name][epoch[rows]] = sentences[name][rows]

    # Latitude and longitude come from one sentence.
    is_position = np.isfinite(sentences["lat"]) & np.isfinite(sentences["lon"])
    for code in reversed(range(POSITION_KINDS)):
        rows = np.flatnonzero(is_position & (kind == code))[::-1]
        merged["lat"][epoch[rows]] = sentences["lat"][rows]
        merged["lon"][epoch[rows]] = sentences["lon"][rows]
        merged["has_position"][epoch[kind == code]] = True

    # One sentence that says so makes the epoch void.
    merged["void"][epoch[sentences["void"]]] = True
    return merged


# Dates


@dataclass
class Calendar:
    """Turns seconds of the day into seconds since 1970, epoch by epoch.

    Midnights are counted: each time of day that steps back by more than half a day begins a new
    day. An epoch without a date has that of the last epoch with one, plus the midnights since.

    Parameters
    ----------
    first_day : float
        Days since 1970 at the start of the file; 0 if the file has no date.
    """

    first_day: float
    midnights: int = 0
    undated: int = 0
    _last_time: float = np.nan

    def to_seconds(self, epochs: Records) -> Floats:
        """Return the times of the next epochs of the file."""
        # Count midnights.
        times, days = epochs["time"], _trusted_days(epochs)
        midnights = self.midnights + count_midnights(times, self._last_time)

        # Carry the last date on, without the midnights before it.
        rows = np.arange(len(times))
        dated = np.maximum.accumulate(np.where(np.isfinite(days), rows, -1))
        carried = np.where(dated >= 0, (days - midnights)[dated], self.first_day)
        day = np.where(np.isfinite(epochs["day"]), epochs["day"], carried + midnights)

        # Keep the state for the next epochs.
        if len(times):
            self._last_time, self.midnights = float(times[-1]), int(midnights[-1])
            self.first_day = float(carried[-1])
        self.undated += int((np.isnan(epochs["day"]) & epochs["has_position"]).sum())
        return np.asarray(day * DAY + times)


def count_midnights(times: Floats, last_time: float = np.nan) -> NDArray[np.int64]:
    """Count the midnights before each time of day.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds of the day.
    last_time : float, optional
        The time before the first one.

    Examples
    --------
    >>> count_midnights(np.array([86_399.0, 0.0, 50.0, 40.0])).tolist()
    [0, 1, 1, 1]
    """
    steps = np.diff(times, prepend=last_time)
    return np.cumsum(steps < -_MIN_MIDNIGHT_STEP)


def find_first_date(source: Source) -> float | None:
    """Find the date of the first epoch of a file, in days since 1970; None if it has no dates.

    The file is read up to its first date, and the midnights before that are counted back.
    """
    midnights, last_time = 0, np.nan
    for epochs in read_epochs(source, EpochCounts()):
        counted = midnights + count_midnights(epochs["time"], last_time)
        dated = np.flatnonzero(np.isfinite(_trusted_days(epochs)))
        if len(dated):
            first = dated[0]
            return float(epochs["day"][first] - counted[first])
        if len(epochs):
            midnights, last_time = int(counted[-1]), float(epochs["time"][-1])
    return None


def _trusted_days(epochs: Records) -> Floats:
    # Before a receiver has a fix, its clock may be years wrong.
    return np.where(epochs["void"], np.nan, epochs["day"])
