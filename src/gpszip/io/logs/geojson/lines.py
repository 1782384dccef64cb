"""A log of the lines of features: times, names, and a record of what is left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.geojson.attributes import join_attributes
from gpszip.io.logs.geojson.features import BadPosition, Line
from gpszip.io.logs.geojson.points import PointTable, dropped_positions_repair
from gpszip.io.logs.geojson.times import has_text_times, read_times
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, UnreadableCell, unused_name
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["Contents", "list_left_out", "log_from_lines", "no_tracks_error"]

#: Features that are left out and listed one by one; further ones are counted.
_MAX_NAMED_FEATURES = 10

Floats = NDArray[np.float64]


@dataclass
class Contents:
    """What a file holds, collected feature by feature.

    Parameters
    ----------
    name : str
        Name of the log.
    skip_bad : bool
        Whether features that can't be used are left out.
    points : PointTable
        Its points.
    lines : list of Line
        Its lines.
    has_times : bool
        Whether a line has times.
    features : int
        Number of features.
    others : Counter of str
        Kinds of geometries that are left out.
    skipped : list of InputError
        Why the first features are left out.
    more_skipped : int
        Number of further ones.
    bad : int
        Number of positions that are dropped.
    first_bad : BadPosition, optional
        The first of them.
    metric : set of bool
        Whether the collections in the file are in metres.
    crs_problem : str
        What is wrong with the coordinate system that it names; empty if it is WGS 84.
    """

    name: str
    skip_bad: bool
    points: PointTable
    lines: list[Line] = field(default_factory=list)
    has_times: bool = False
    features: int = 0
    others: Counter[str] = field(default_factory=Counter)
    skipped: list[InputError] = field(default_factory=list)
    more_skipped: int = 0
    bad: int = 0
    first_bad: BadPosition | None = None
    metric: set[bool] = field(default_factory=set)
    crs_problem: str = ""

    def skip(self, feature: int, reason: str, kind: type[InputError] = InputError) -> None:
        """Leave out a feature, or raise."""
        location = f"feature {feature}"
        if not self.skip_bad:
            raise kind(reason, path=self.name, location=location, remedy="--skip-bad leaves it out")
        if len(self.skipped) < _MAX_NAMED_FEATURES:
            self.skipped.append(kind(reason, path=self.name, location=location))
        else:
            self.more_skipped += 1


def no_tracks_error(contents: Contents) -> InputError:
    """Return the error for a file without a line or point that can be used."""
    # Why the first feature was left out says more than that nothing is left.
    if contents.skipped:
        return contents.skipped[0]
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(contents.others.items()))
    only = f", only {kinds}" if kinds else ""
    return NoPositionsError(f"no LineString and no Point in it{only}", path=contents.name)


def list_left_out(contents: Contents, reason: str) -> tuple[LeftOut, ...]:
    """Return what is left out for this reason, and the features that can't be used."""
    left_out = [
        LeftOut(f"{contents.name}: {count} {kind}", reason)
        for kind, count in sorted(contents.others.items())
        if count
    ]
    left_out += [
        LeftOut(f"{error.path}: {error.location}", error.advice) for error in contents.skipped
    ]
    if contents.more_skipped:
        where = f"{contents.name}: {contents.more_skipped} more features"
        left_out.append(LeftOut(where, "can't be used"))
    return tuple(left_out)


def log_from_lines(contents: Contents, request: Request, *, metric: bool) -> RawLog:
    """Make a log of the lines, and leave out the points."""
    # Leave out the points, and find the lines that can be used.
    if len(contents.points):
        contents.others["Point"] += len(contents.points)
    lines, times, unreadable = _lines_with_times(contents, request)
    if not lines:
        raise no_tracks_error(contents)

    # A third number is a coordinate of metres, else a height that may be kept.
    table = np.concatenate([line.table for line in lines])
    has_heights = bool(np.isfinite(table[:, 2]).any())
    kept = join_attributes(lines, request.keep)
    takes_heights = False
    for name in request.keep:
        if name not in kept and name in HEIGHT_NAMES and has_heights:
            kept[name], takes_heights = table[:, 2], True
    if missing := [name for name in request.keep if name not in {*kept, *request.optional}]:
        raise InputError(
            f"its positions have no {missing[0]!r}",
            path=contents.name,
            remedy="a third number, alt, or a property with a value for each position can be kept",
        )
    # Positions are x, y[, z] in metres, but longitude and latitude in degrees, which a log has
    # the other way round.
    dimension = 3 if has_heights else 2
    coordinates = (table[:, :dimension] if metric else table[:, 1::-1]).copy()
    drops_heights = has_heights and not metric and not takes_heights

    # A file with one line and no name has no ids.
    tracks = _name_lines(lines)
    codes = np.repeat(tracks.codes, [len(line.table) for line in lines]).astype(np.int32)
    is_unnamed = len(tracks.ids) == 1 and lines[0].name is None
    return RawLog(
        name=contents.name,
        ids=() if is_unnamed else tracks.ids,
        codes=None if is_unnamed else codes,
        times=np.concatenate(times),
        coordinates=coordinates,
        geographic=not metric,
        attributes=kept,
        row_noun="position",
        dropped_columns=("alt",) if drops_heights else (),
        repairs=_list_repairs(contents, tracks.renamed, table[:, 2] if takes_heights else None),
        left_out=list_left_out(contents, "no line"),
        unreadable=unreadable,
        untimed=tracks.untimed,
    )


def _lines_with_times(
    contents: Contents, request: Request
) -> tuple[list[Line], list[Floats], tuple[UnreadableCell, ...]]:
    """Find the lines that can be used.

    Returns
    -------
    list of Line
        The lines.
    list of float64 array
        Their times in seconds.
    tuple of UnreadableCell
        The first time that can't be read, if there is one.
    """
    # A single position without a time is neither a track nor a shape.
    lines = _drop_single_positions(contents)

    # Leave out features whose times are texts, but no times at all.
    try:
        times = read_times(lines, request, contents.name)
    except InputError as error:
        if not contents.skip_bad:
            raise
        for feature in dict.fromkeys(line.feature for line in lines if has_text_times(line)):
            contents.skip(feature, error.advice)
        lines = [line for line in lines if not has_text_times(line)]
        times = read_times(lines, request, contents.name)

    # Leave out features none of whose times can be read.
    if times.faults:
        for feature, fault in times.faults.items():
            contents.skip(feature, fault)
        lines = [line for line in lines if line.feature not in times.faults]
        times = read_times(lines, request, contents.name)

    # Report the first time that can't be read among the lines that are left.
    if times.unreadable is None:
        return lines, times.seconds, ()
    return lines, times.seconds, (UnreadableCell("times", *times.unreadable),)


def _drop_single_positions(contents: Contents) -> list[Line]:
    """Return the lines except those of one position without a time."""
    lines = [line for line in contents.lines if line.times is not None or len(line.table) > 1]
    dropped = len(contents.lines) - len(lines)
    if dropped:
        contents.others["line of one position without a time"] += dropped
    return lines


@dataclass(frozen=True)
class _NamedLines:
    """The tracks that lines belong to.

    Parameters
    ----------
    ids : tuple of str
        Names of the tracks.
    codes : list of int
        Index of its track for each line.
    untimed : frozenset of int
        Codes of the tracks that are shapes.
    renamed : int
        Number of features whose tracks have another name than the feature.
    """

    ids: tuple[str, ...]
    codes: list[int]
    untimed: frozenset[int]
    renamed: int


def _name_lines(lines: Sequence[Line]) -> _NamedLines:
    """Assign lines to tracks.

    Lines of one name are one track if they have times. Each line without times is a shape, with a
    name that no other track has.
    """
    # A feature without a name is named by its number.
    # Numbers count from 0 here, as the only track of a log without names is 0.
    given = {line.name for line in lines if line.name is not None}
    names = [
        line.name if line.name is not None else unused_name(str(line.feature - 1), given)
        for line in lines
    ]

    # Rename shapes whose name is taken.
    reserved = set(names)
    taken = {name for name, line in zip(names, lines, strict=True) if line.times is not None}
    last_numbers: Counter[str] = Counter()
    track_names = []
    for name, line in zip(names, lines, strict=True):
        is_shape = line.times is None
        track_name = _free_name(name, taken, reserved, last_numbers) if is_shape else name
        track_names.append(track_name)
        taken.add(track_name)

    # Number tracks in the order in which they appear.
    index = {name: code for code, name in enumerate(dict.fromkeys(track_names))}
    codes = [index[name] for name in track_names]
    untimed = frozenset(code for code, line in zip(codes, lines, strict=True) if line.times is None)

    # Count features whose first line was renamed.
    is_first = [i == 0 or lines[i - 1].feature != line.feature for i, line in enumerate(lines)]
    renamed = sum(
        new != old and first for new, old, first in zip(track_names, names, is_first, strict=True)
    )
    return _NamedLines(tuple(index), codes, untimed, renamed)


def _free_name(name: str, taken: set[str], reserved: set[str], last_numbers: Counter[str]) -> str:
    """Return the name, or the first of ``name-2``, ``name-3``, ... that is free.

    Such a name is free if no track has it and no feature states it. ``last_numbers`` keeps the
    search short if many shapes have the same name.
    """
    free = name
    while free in taken or (free != name and free in reserved):
        last_numbers[name] += 1
        free = f"{name}-{last_numbers[name] + 1}"
    return free


def _list_repairs(contents: Contents, renamed: int, heights: Floats | None) -> tuple[Repair, ...]:
    repairs = []
    if contents.first_bad is not None:
        repairs.append(dropped_positions_repair(contents.bad, contents.first_bad, contents.name))

    if renamed:
        what = "lines without times renamed, as another track has their name"
        repairs.append(Repair(what, renamed, contents.name, drops=False))

    if heights is not None and (is_missing := np.isnan(heights)).any():
        what = "positions without a height, which is unknown there"
        where = f"{contents.name}: position {int(is_missing.argmax()) + 1}"
        repairs.append(Repair(what, int(is_missing.sum()), where, drops=False))
    return tuple(repairs)
