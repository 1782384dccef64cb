"""The times of the lines of a GeoJSON file, read together: what unit or order of day and month they have, all of them tell."""

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


@dataclass(frozen=True, eq=False)
class LineTimes:
    """Times of lines.

    Parameters
    ----------
    seconds : list of float64 array
        Of each line; NaN where a time is missing or can't be read, and throughout for a line without times.
    unreadable : tuple of int and str, optional
        The first row, counted through all lines, whose time can't be read, and what it holds.
    faults : mapping of int to str
        What is wrong with each feature that has times of which none can be read, by its number.
    """

    seconds: list[NDArray[np.float64]]
    unreadable: tuple[int, str] | None
    faults: dict[int, str]


def has_text_times(line: Line) -> bool:
    """Whether a line has times that are texts, and no numbers."""
    return line.times is not None and (
        pa.types.is_string(line.times.type) or pa.types.is_boolean(line.times.type)
    )


def read_times(lines: Sequence[Line], request: Request, name: str) -> LineTimes:
    """Read the times of all lines, those that are numbers and those that are texts each as one column.

    Parameters
    ----------
    lines : sequence of Line
        Those of a feature follow each other.
    request : Request
        The unit of numbers and the order of day and month; told from all times where left out.
    name : str
        Name of the log for messages.

    Returns
    -------
    Times

    Raises
    ------
    InputError
        If texts are no times at all.
    """
    found = [np.full(len(line.table), np.nan) for line in lines]
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    given = [
        np.zeros(len(line.table), dtype=np.bool_) for line in lines
    ]  # where there is a time that should be read
    for texts in (False, True):
        chosen = [
            i
            for i, line in enumerate(lines)
            if line.times is not None and has_text_times(line) == texts
        ]
        if chosen:
            parts = [lines[i].times for i in chosen]
            column = concatenate_columns(
                [pc.cast(part, pa.string()) for part in parts] if texts else parts
            )
            where = f"{name}: feature {lines[chosen[0]].feature}: times"
            read = times_to_seconds(
                column, unit, where, origin=unit_origin(request.time_unit), dates=request.dates
            )
            ends = np.cumsum([len(part) for part in parts])[:-1]
            for i, own, there in zip(
                chosen,
                np.split(read, ends),
                np.split(pc.is_valid(column).to_numpy(), ends),
                strict=True,
            ):
                found[i], given[i] = own, there & texts
    return LineTimes(found, _unread(lines, found, given), _faults(lines, found, given))


def _unread(
    lines: Sequence[Line], found: list[NDArray[np.float64]], given: list[NDArray[np.bool_]]
) -> tuple[int, str] | None:
    before = 0
    for line, own, there in zip(lines, found, given, strict=True):
        if (bad := there & np.isnan(own)).any():
            row = int(bad.argmax())
            return before + row, str(line.times[row].as_py())
        before += len(own)
    return None


def _faults(
    lines: Sequence[Line], found: list[NDArray[np.float64]], given: list[NDArray[np.bool_]]
) -> dict[int, str]:
    faults = {}
    for feature, group in groupby(range(len(lines)), key=lambda i: lines[i].feature):
        own = [i for i in group if given[i].any()]
        if own and not any(np.isfinite(found[i]).any() for i in own):
            first = lines[own[0]].times[int(given[own[0]].argmax())].as_py()
            faults[feature] = f"no time of it can be read, such as {abbreviate(first)}"
    return faults
