"""Parse the times that a user asks for: a list, or a file with one time a line."""

from __future__ import annotations

import math
import os
from datetime import UTC, datetime
from pathlib import Path

from gpszip.errors import InputError, OptionError

__all__ = ["parse_time", "parse_times"]


def parse_times(text: str) -> list[float]:
    """Return times in seconds, counted from the zero of the log.

    Parameters
    ----------
    text : str
        Numbers or ISO 8601 dates, separated by commas; or the name of a file with one time in the
        first column of each line. A first line without a time is a header.

    Raises
    ------
    InputError
        If the file can't be read or a line has no time.
    OptionError
        If the text is neither a list of times nor a file.

    Examples
    --------
    >>> parse_times("10, 20.5,1970-01-01T00:01:00Z")
    [10.0, 20.5, 60.0]
    """
    # Try a list first: all words are times, or it is the name of a file.
    words = [word.strip() for word in text.split(",")]
    times = [parse_time(word) for word in words]
    valid_times = [time for time in times if time is not None]
    if len(valid_times) == len(words):
        return valid_times
    if os.path.isfile(text):  # noqa: PTH113  # unlike pathlib's, it never raises
        return _read_times(Path(text))

    # Name the first word that is no time.
    invalid = words[times.index(None)]
    raise OptionError(
        f"--at: {invalid!r} is no time and {text!r} no file",
        remedy="write seconds such as 10,20.5 or dates such as 2024-05-01T10:00:00Z",
    )


def _read_times(path: Path) -> list[float]:
    # Read the lines.
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"can't be read as text: {error}", path=path) from None
    # Further columns are ignored, so that a CSV log can be named. Blank lines don't count, but keep
    # the numbers of lines in messages right.
    rows = [
        (number, parse_time(line.split(",")[0].strip()))
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]

    # Drop the header, and refuse any other line without a time.
    if rows and rows[0][1] is None:
        rows = rows[1:]
    for number, time in rows:
        if time is None:
            raise InputError(
                f"{lines[number - 1]!r} is no time",
                path=path,
                location=f"line {number}",
                remedy="write one number of seconds or date in each line",
            )
    if not rows:
        raise InputError(
            "no times in it", path=path, remedy="write one number of seconds or date in each line"
        )
    return [time for _, time in rows if time is not None]


def parse_time(word: str) -> float | None:
    """Return one time in seconds, counted from the zero of the log; None if the text is no time.

    Examples
    --------
    >>> parse_time("1970-01-01T00:01:00Z"), parse_time("noon")
    (60.0, None)
    """
    # Numbers come first: 20240501 is seconds here, though it is an ISO 8601 date as well. "nan" and
    # "inf" are numbers to Python, but no times.
    try:
        seconds = float(word)
    except ValueError:
        pass
    else:
        return seconds if math.isfinite(seconds) else None
    try:
        time = datetime.fromisoformat(word)
    except ValueError:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
