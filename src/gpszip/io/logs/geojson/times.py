"""The times of the lines of a GeoJSON file.

All lines are read together: only all times show the unit of numbers, or the order of day and month
in dates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.geojson.features import Line
from gpszip.io.logs.geojson.json_columns import abbreviate, concatenate_columns
from gpszip.io.logs.raw import Request
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds

__all__ = ["LineTimes", "has_text_times", "read_times"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LineTimes:
    """Times of lines.

    Parameters
    ----------
    seconds : list of float64 array
        Times of each line; NaN for a time that is missing or can't be read, and throughout for a
        line without times.
    unreadable : tuple of int and str, optional
        The first row, counted through all lines, whose time can't be read, and its text.
    faults : mapping of int to str
        For each feature none of whose times can be read, by its number, what is wrong.
    """

    seconds: list[Floats]
    unreadable: tuple[int, str] | None
    faults: dict[int, str]


def has_text_times(line: Line) -> bool:
    """Whether a line has times that are texts, and no numbers."""
    # Booleans are read as texts, and so are reported like a text that is no time.
    return line.times is not None and (
        pa.types.is_string(line.times.type) or pa.types.is_boolean(line.times.type)
    )


def read_times(lines: Sequence[Line], request: Request, name: str) -> LineTimes:
    """Read the times of all lines: numbers as one column, and texts as another.

    Parameters
    ----------
    lines : sequence of Line
        The lines of a feature follow each other.
    request : Request
        The unit of numbers and the order of day and month; found from all times if left out.
    name : str
        Name of the log for messages.

    Returns
    -------
    LineTimes

    Raises
    ------
    InputError
        If texts are no times at all.
    """
    # Read numbers and texts apart. A position without a time that can be read has NaN.
    seconds = [np.full(len(line.table), np.nan) for line in lines]
    has_text = [np.zeros(len(line.table), dtype=np.bool_) for line in lines]
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    for texts in (False, True):
        # Concatenate the times of these lines.
        chosen = [
            i
            for i, line in enumerate(lines)
            if line.times is not None and has_text_times(line) == texts
        ]
        if not chosen:
            continue
        chunks = [lines[i].times for i in chosen]
        if texts:
            chunks = [pc.cast(chunk, pa.string()) for chunk in chunks]
        column = concatenate_columns(chunks)

        # Read them, and split them again.
        column_seconds = times_to_seconds(
            column,
            unit,
            name,
            f"feature {lines[chosen[0]].feature}: times",
            origin=unit_origin(request.time_unit),
            dates=request.dates,
        )
        ends = np.cumsum([len(chunk) for chunk in chunks])[:-1]
        line_seconds = np.split(column_seconds, ends)
        is_given = np.split(pc.is_valid(column).to_numpy(), ends)
        for k, i in enumerate(chosen):
            seconds[i], has_text[i] = line_seconds[k], is_given[k] & texts
    return LineTimes(
        seconds, _first_unreadable(lines, seconds, has_text), _faults(lines, seconds, has_text)
    )


def _first_unreadable(
    lines: Sequence[Line], seconds: list[Floats], has_text: list[Flags]
) -> tuple[int, str] | None:
    # Only texts may be unreadable: nulls are missing times, and numbers are always times.
    rows_before = 0
    for line, line_seconds, line_has_text in zip(lines, seconds, has_text, strict=True):
        unreadable = line_has_text & np.isnan(line_seconds)
        if unreadable.any():
            row = int(unreadable.argmax())
            return rows_before + row, str(line.times[row].as_py())
        rows_before += len(line_seconds)
    return None


def _faults(lines: Sequence[Line], seconds: list[Floats], has_text: list[Flags]) -> dict[int, str]:
    # One time that can be read on any line saves the feature.
    faults = {}
    for feature, group in groupby(range(len(lines)), key=lambda i: lines[i].feature):
        with_text = [i for i in group if has_text[i].any()]
        if with_text and not any(np.isfinite(seconds[i]).any() for i in with_text):
            first = with_text[0]
            value = lines[first].times[int(has_text[first].argmax())].as_py()
            faults[feature] = f"no time of it can be read, such as {abbreviate(value)}"
    return faults
