"""Logs of points in batches, for formats that know the meaning of their columns.

A format yields a :class:`PointBatch` for each part of a file, and notes in :class:`Findings` what
it drops or passes over. :func:`read_points` makes one log of all batches, and
:func:`open_points` a log that is read batch by batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, join_batches
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair
from gpszip.model.text import count_phrase

__all__ = ["Findings", "Parser", "PointBatch", "open_points", "read_points"]

#: Names that stand for each other in requests to keep an attribute.
_SYNONYMS = (
    HEIGHT_NAMES,
    ("speed", "velocity", "sog", "ground_speed"),
    ("course", "cog", "track", "bearing"),
    ("heading", "hdg"),
    ("accuracy", "acc"),
)

#: Attributes that are headings, the preferred one first.
_HEADINGS = ("heading", "course")

#: Attributes that messages name.
_MAX_SHOWN_NAMES = 20

Floats = NDArray[np.float64]


class PointBatch(NamedTuple):
    """Points of a file, in its order.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds; NaN for those that can't be read.
    coordinates : float64 array, shape (n, d)
        Latitude and longitude in degrees, or metres; NaN for those that can't be read.
    attributes : mapping of str to array, shape (n,)
        All that the points have besides; all batches of a file have the same.
    tracks : sequence of str, optional
        Name of the track of each point; an empty one means the name of the file. None if the file
        holds one track.
    geographic : bool
        Whether coordinates are degrees.
    """

    times: Floats
    coordinates: Floats
    attributes: Mapping[str, NDArray[np.generic]]
    tracks: Any = None
    geographic: bool = True


@dataclass
class _Count:
    """How often something was found, and its first value."""

    number: int
    drops: bool
    value: str


@dataclass
class Findings:
    """What was repaired and left out in a file, counted while it is read.

    Parameters
    ----------
    name : str
        Name of the file.
    empty : str
        What messages say about a file without points.
    remedy : str
        What a user can do about it.

    Examples
    --------
    >>> findings = Findings("a.igc")
    >>> findings.count("lines ignored", 2, value="x")
    >>> findings.count("lines ignored", 1)
    >>> findings.repairs()
    (Repair(what='lines ignored', count=3, where='a.igc', drops=False, value='x'),)
    """

    name: str
    empty: str = "no position in this file"
    remedy: str = "name a file that holds a log"
    left_out: list[LeftOut] = field(default_factory=list)
    _counts: dict[str, _Count] = field(default_factory=dict)

    def count(self, what: str, number: int, *, drops: bool = False, value: str = "") -> None:
        """Add to the number of times that something was found.

        Parameters
        ----------
        what : str
            What was found, and what was done about it.
        number : int
            How often.
        drops : bool
            Whether so many points were dropped.
        value : str
            The first value concerned.
        """
        if number:
            found = self._counts.setdefault(what, _Count(0, drops, value))
            found.number += int(number)

    def repairs(self) -> tuple[Repair, ...]:
        """Return all that was counted."""
        return tuple(
            Repair(what, found.number, self.name, drops=found.drops, value=found.value)
            for what, found in self._counts.items()
        )

    def no_point_error(self) -> InputError:
        """Return the error for a file without points, which names what it holds instead."""
        found = ", ".join(count_phrase(count.number, what) for what, count in self._counts.items())
        return NoPositionsError(
            f"{self.empty}{f': {found}' if found else ''}", path=self.name, remedy=self.remedy
        )


#: Yields the points of a file.
Parser: TypeAlias = Callable[[Source, Request, Findings], Iterator[PointBatch]]


def read_points(source: Source, request: Request, parse: Parser) -> RawLog:
    """Read all points of a file.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep.
    parse : callable
        Yields its points.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the file has no point, or no attribute of a name to keep.

    Examples
    --------
    >>> def parse(source, request, findings):
    ...     for start in (0, 2):
    ...         times = np.arange(2.0) + start
    ...         yield PointBatch(times, np.zeros((2, 2)), {"alt": times}, ["a", "b"])
    >>> log = read_points(Source("a"), Request(keep=("ele",)), parse)
    >>> log.ids, log.codes.tolist(), log.attributes["ele"].tolist()
    (('a', 'b'), [0, 1, 0, 1], [0.0, 1.0, 2.0, 3.0])
    """
    return join_batches(list(_read_batches(source, request, parse)))


def open_points(
    source: Source, request: Request, parse: Parser, kind: CoordinateKind | None
) -> LogBatches:
    """Open a file whose points are read batch by batch; see :func:`read_points`.

    Parameters
    ----------
    source, request, parse
        As for :func:`read_points`.
    kind : CoordinateKind or None
        What its coordinates are; None if only the points show that.
    """
    return LogBatches(_read_batches(source, request, parse), kind)


def _read_batches(source: Source, request: Request, parse: Parser) -> Iterator[RawLog]:
    # What was repaired is complete at the end of the file, so an empty batch tells it.
    findings = Findings(source.name)
    assembler = _Assembler(source, request)
    last: PointBatch | None = None
    for batch in _without_warnings(parse(source, request, findings)):
        if len(batch.times):
            yield assembler.log(batch)
            last = batch
    if last is None:
        raise findings.no_point_error()
    empty = replace(
        assembler.log(_without_points(last)),
        repairs=findings.repairs(),
        left_out=tuple(findings.left_out),
    )
    yield empty


def _without_warnings(batches: Iterator[PointBatch]) -> Iterator[PointBatch]:
    """Yield batches; numbers of damaged files that are too large become infinite."""
    while True:
        with np.errstate(all="ignore"):
            batch = next(batches, None)
        if batch is None:
            return
        yield batch


def _without_points(batch: PointBatch) -> PointBatch:
    return batch._replace(
        times=batch.times[:0],
        coordinates=batch.coordinates[:0],
        attributes={name: values[:0] for name, values in batch.attributes.items()},
        tracks=None if batch.tracks is None else batch.tracks[:0],
    )


class _Assembler:
    """Makes logs of the batches of one file."""

    def __init__(self, source: Source, request: Request) -> None:
        self._source, self._request = source, request
        self._codes: dict[str, int] = {}  # of tracks, by name
        self._first = 1

    def log(self, batch: PointBatch) -> RawLog:
        """Return a batch as a log."""
        # Attributes that are there, but not asked for, are named.
        found = {name: self._find(name, batch) for name in self._request.keep}
        kept = {name: column for name, column in found.items() if column is not None}
        if self._request.heading:
            headings = [name for name in _HEADINGS if name in batch.attributes]
            kept |= {"heading": headings[0]} if headings else {}
        if self._request.accuracy and "accuracy" in batch.attributes:
            kept["accuracy"] = "accuracy"
        unused = [name for name in batch.attributes if name not in kept.values()]

        # Tracks are numbered in the order of the file.
        ids, codes = self._number_tracks(batch.tracks)
        first = self._first
        self._first += len(batch.times)
        return RawLog(
            name=self._source.name,
            ids=ids,
            codes=codes,
            times=batch.times,
            coordinates=batch.coordinates,
            geographic=batch.geographic,
            attributes={name: batch.attributes[column] for name, column in kept.items()},
            first=first,
            row_noun="point",
            dropped_columns=tuple(name for name in unused if _has_value(batch.attributes[name])),
        )

    def _find(self, name: str, batch: PointBatch) -> str | None:
        """Return the attribute that a name asks for; None if it may be missing."""
        lower = name.lower()
        names: tuple[str, ...] = next((names for names in _SYNONYMS if lower in names), ())
        for other in (name, lower, *names):
            if other in batch.attributes:
                return other
        if name in self._request.optional:
            return None
        shown = ", ".join(list(batch.attributes)[:_MAX_SHOWN_NAMES]) or "position and time only"
        raise InputError(
            f"no {name!r} to keep", path=self._source.name, remedy=f"its points have: {shown}"
        )

    def _number_tracks(self, tracks: Any) -> tuple[tuple[str, ...], NDArray[np.int32] | None]:
        """Return the names of all tracks so far, and an index into them for each point."""
        if tracks is None:
            return (), None
        column = pa.array(tracks, pa.string()).dictionary_encode()
        names = [name or self._source.stem for name in column.dictionary.to_pylist()]
        for name in names:
            self._codes.setdefault(name, len(self._codes))
        code_of_name = np.array([self._codes[name] for name in names], np.int32)
        index = column.indices.to_numpy(zero_copy_only=False)
        return tuple(self._codes), code_of_name[index]


def _has_value(values: NDArray[np.generic]) -> bool:
    return bool((np.isfinite(values) if values.dtype.kind == "f" else values != "").any())
