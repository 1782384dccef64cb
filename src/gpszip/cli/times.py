"""Instants that a user asks for: a list, or a file with one in each line."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

from gpszip.errors import InputError, OptionError

__all__ = ["parse_times"]


def parse_times(text: str) -> list[float]:
    """Instants in seconds in the log's own zero.

    Parameters
    ----------
    text : str
        Numbers or ISO 8601 dates with commas between them, or the name of a file with one in each line, of which the first
        column counts and a first line without a time is a header.

    Raises
    ------
    InputError
        If the file can't be read or a line holds no time.
    OptionError
        If the text is neither.

    Examples
    --------
    >>> parse_times("10, 20.5,1970-01-01T00:01:00Z")
    [10.0, 20.5, 60.0]
    """
    words = [word.strip() for word in text.split(",")]
    times = [_parse_time(word) for word in words]
    found = [time for time in times if time is not None]
    if len(found) == len(words):
        return found
    if os.path.isfile(text):  # noqa: PTH113  # unlike pathlib's, it never raises
        return _read_times(Path(text))
    bad = words[times.index(None)]
    raise OptionError(
        f"--at: {bad!r} is no time and {text!r} no file; write seconds such as 10,20.5 or dates such as 2024-05-01T10:00:00Z"
    )


def _read_times(path: Path) -> list[float]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't be read as text: {error}") from None
    rows = [
        (number, _parse_time(line.split(",")[0].strip()))
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]
    if rows and rows[0][1] is None:
        rows = rows[1:]
    for number, time in rows:
        if time is None:
            raise InputError(
                f"{path}: line {number}: {lines[number - 1]!r} is no time; write one number of seconds or date in each line"
            )
    if not rows:
        raise InputError(
            f"{path}: no times in it; write one number of seconds or date in each line"
        )
    return [time for _, time in rows if time is not None]


def _parse_time(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(word)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
