"""Interpret the points of a log in XML: positions, times and further fields.

What XML holds are texts. They are read column by column, alike for all formats.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import RawLog, Request, UnreadableCell
from gpszip.io.logs.xml.facts import LogFacts, find_facts, is_unknown_number
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats
from gpszip.io.values.coordinates import first_unreadable_cell, parse_degrees
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds
from gpszip.model.read_result import Repair

__all__ = ["BatchInterpreter", "interpret_points", "replacement_repairs"]

#: Bytes that NumPy may take for a column of texts; each text takes as much as the longest one.
_MAX_TEXT_BYTES = 1 << 30

#: Letters of a value that messages show.
_MAX_SHOWN_LETTERS = 40

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def interpret_points(
    points: LogPoints, source: Source, request: Request, plan_noun: str = "route"
) -> RawLog:
    """Turn the points of a file into a log.

    Parameters
    ----------
    points : LogPoints
        All points, at least one.
    source, request
        As for :func:`gpszip.io.logs.xml.facts.find_facts`; also the unit of times that are numbers.
    plan_noun : str
        What the format calls a planned route.

    Returns
    -------
    RawLog
        Tracks and routes in the order of the file, with numbers after names that occur twice.
        Coordinates that can't be read are NaN.

    Raises
    ------
    InputError
        If no point has a position, or there are times and none can be read; or if no point has a
        field to keep.
    """
    facts = find_facts([points], source, request)
    log = BatchInterpreter(facts, source, request, plan_noun).interpret(points)
    in_shape = np.repeat(facts.is_shape[facts.codes], points.segment_lengths)
    _require_usable_points(log, in_shape)
    return log


class BatchInterpreter:
    """Turns the points of a file into logs, batch by batch.

    Parameters
    ----------
    facts : LogFacts
        What all points show.
    source, request, plan_noun
        As for :func:`interpret_points`.
    """

    def __init__(
        self, facts: LogFacts, source: Source, request: Request, plan_noun: str = "route"
    ) -> None:
        self._facts, self._request = facts, request
        self._where, self._plan_noun = source.name, plan_noun
        self._rows = self._segments = 0  # of the batches before

    def interpret(self, points: LogPoints) -> RawLog:
        """Turn the next batch into a log.

        Raises
        ------
        InputError
            If there are times and none can be read.
        """
        # Find the track of each point.
        facts, where = self._facts, self._where
        first_segment = self._segments - int(points.continues)
        self._segments = first_segment + len(points.parents)
        codes = np.repeat(facts.codes[first_segment : self._segments], points.segment_lengths)

        # Read positions and times; routes have times that are plans, and are not read.
        coordinates, unreadable = _coordinates(points, facts.decimal_comma)
        time_texts = points.field("time")
        in_timed_track = pa.array(facts.has_times[points.parent_of_points])
        time_texts_of_tracks = pc.if_else(in_timed_track, time_texts, None)
        times = _times(time_texts_of_tracks, self._request, where)
        unreadable_time = first_unreadable_cell(time_texts_of_tracks, times, "time")
        if unreadable_time is not None:
            unreadable = (unreadable_time, *unreadable)

        # Read the fields to keep; shapes are marked as tracks without times.
        first, self._rows = self._rows + 1, self._rows + len(points)
        attributes = _attributes(points, facts, where)
        ignored_times = self._ignored_times(points, time_texts, first)
        unread_heights = self._unread_heights(points, attributes, first)
        return RawLog(
            name=where,
            ids=facts.ids,
            codes=codes if facts.ids else None,
            times=times,
            coordinates=coordinates,
            geographic=True,
            attributes=attributes,
            first=first,
            row_noun="point",
            ids_are_titles=True,
            dropped_columns=facts.dropped,
            repairs=(*ignored_times, *unread_heights),
            unreadable=unreadable,
            untimed=frozenset(np.unique(codes[facts.is_shape[codes]]).tolist()),
        )

    def _ignored_times(
        self, points: LogPoints, time_texts: Any, first_row: int
    ) -> tuple[Repair, ...]:
        in_route = points.plans[points.parent_of_points]
        rows = np.flatnonzero(time_texts.is_valid().to_numpy() & in_route)
        if not len(rows):
            return ()
        first, noun = int(rows[0]), self._plan_noun
        what = f"times of {noun} points not read, as {noun}s are shapes"
        value = f"time {_quote(time_texts[first].as_py())}"
        where = f"{self._where}: point {first_row + first}"
        return (Repair(what, len(rows), where, drops=False, value=value),)

    def _unread_heights(
        self, points: LogPoints, attributes: Mapping[str, NDArray[np.generic]], first_row: int
    ) -> Iterator[Repair]:
        """Count heights that are no numbers; columns that somebody named keep their texts."""
        for name, field in self._facts.kept.items():
            if field not in self._facts.mixed:
                continue
            texts, numbers = points.field(field), attributes[name].astype(np.float64)
            rows = np.flatnonzero(~np.isfinite(numbers) & ~is_unknown_number(texts))
            if len(rows):
                first = int(rows[0])
                what = "heights that can't be read left out"
                value = f"{name} {_quote(texts[first].as_py())}"
                where = f"{self._where}: point {first_row + first}"
                yield Repair(what, len(rows), where, drops=False, value=value)


def replacement_repairs(replaced: ReplacedBytes, where: str) -> tuple[Repair, ...]:
    """Return the repair for bytes that don't fit the encoding of a file, if there are any."""
    if not replaced.count:
        return ()
    what = "bytes that don't fit the file's encoding read as Windows-1252"
    return (
        Repair(what, replaced.count, where, drops=False, value=f"text {_quote(replaced.first)}"),
    )


# Positions and times


def _coordinates(points: LogPoints, comma: bool) -> tuple[Floats, tuple[UnreadableCell, ...]]:
    """Return latitude and longitude, and the first value of each that can't be read."""
    lat = parse_degrees(points.lat, "lat", decimal_comma=comma)
    lon = parse_degrees(points.lon, "lon", decimal_comma=comma)
    cells = (_first_unreadable(points.lat, lat, "lat"), _first_unreadable(points.lon, lon, "lon"))
    return np.stack([lat, lon], axis=1), tuple(cell for cell in cells if cell is not None)


def _first_unreadable(texts: Any, values: Floats, name: str) -> UnreadableCell | None:
    """Return the first coordinate that is missing or can't be read: each point must have one."""
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    row = int(bad.argmax())
    text = texts[row].as_py()
    return UnreadableCell(name, row, f"no {name}" if text is None else text)


def _times(texts: Any, request: Request, where: str) -> Floats:
    if texts.null_count == len(texts):
        return np.full(len(texts), np.nan)
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    return times_to_seconds(
        texts, unit, where, "time", origin=unit_origin(request.time_unit), dates=request.dates
    )


def _require_usable_points(log: RawLog, in_shape: Flags) -> None:
    """Raise unless a point has a position and, in a track, a time."""
    has_position: Flags = np.asarray(np.isfinite(log.coordinates).all(axis=1))
    if not has_position.any():
        first = next(cell for cell in log.unreadable if cell.column != "time")
        raise InputError(
            "no point has a position that can be read; the first has "
            f"{first.column}={_quote(first.value)}",
            path=log.name,
            remedy="write degrees such as lat='48.1371'",
        )
    if not (has_position & (in_shape | np.isfinite(log.times))).any():
        raise InputError("no point has both a position and a time that can be read", path=log.name)


# Attributes


def _attributes(points: LogPoints, facts: LogFacts, where: str) -> dict[str, NDArray[np.generic]]:
    """Read the elements to keep, by the names that were asked for, and the heading."""
    comma = facts.decimal_comma
    attributes: dict[str, NDArray[np.generic]] = {}
    for name, field in facts.kept.items():
        texts = points.field(field)
        if field in facts.numbers:
            attributes[name] = to_floats(texts, comma)
        else:
            attributes[name] = _to_texts(texts, where, field)
    if facts.course is not None:
        attributes["heading"] = to_floats(points.field(facts.course), comma)
    return attributes


def _to_texts(texts: Any, where: str, field: str) -> NDArray[np.str_]:
    """Return texts, empty for those that are missing."""
    # Bound the memory of NumPy's texts, which are all as long as the longest one.
    letters = int(pc.max(pc.utf8_length(texts)).as_py() or 0)
    if letters * np.dtype("U1").itemsize * len(texts) > _MAX_TEXT_BYTES:
        raise InputError(
            f"texts of {letters} letters are too long to keep for {len(texts)} points",
            path=where,
            location=field,
            remedy="leave them out",
        )
    return np.array(pc.fill_null(texts, "").to_pylist(), dtype=np.str_)


def _quote(text: str) -> str:
    return repr(text if len(text) <= _MAX_SHOWN_LETTERS else text[:_MAX_SHOWN_LETTERS] + "...")
