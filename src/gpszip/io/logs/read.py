"""Read logs of any format into tracks on one common plane.

:func:`read_logs` reads file by file: it finds the format, lets its reader parse the columns,
cleans them, names and joins the tracks of all files, and projects them. The
:class:`gpszip.model.read_result.ReadResult` records all that was changed or dropped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.outliers import find_outliers
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.clean import CleanedLog, LogTrack, clean_log
from gpszip.io.logs.formats import format_for_reading, format_named, is_bundle
from gpszip.io.logs.losses import loss_if_large
from gpszip.io.logs.plausibility import check_plausible
from gpszip.io.logs.raw import RawLog, Request, unused_name
from gpszip.io.storage.source import Source, expand, is_stray_file
from gpszip.io.tables.roles import parse_columns
from gpszip.model import Plane, Track
from gpszip.model.read_result import LeftOut, Loss, ReadResult, Repair

__all__ = ["ReadOptions", "read_logs"]

#: Name of the tracks without a name of a log that is read alone.
_UNNAMED_TRACK = "0"


class ReadOptions(TypedDict, total=False):
    """The options of :func:`read_logs`, for functions that pass them on."""

    format: str | None
    columns: str | Sequence[str] | Mapping[str, str] | None
    time_unit: str | None
    dates: str | None
    clean: bool
    sort: bool
    split: bool
    keep: Sequence[str]
    heading: bool
    skip_bad: bool
    times: bool


class _Axes(NamedTuple):
    """The coordinates of a log; all logs that are read together have the same.

    Parameters
    ----------
    log : str
        Name of the log.
    geographic : bool
        Whether they are latitude and longitude.
    dimension : int
        Number of coordinates.
    """

    log: str
    geographic: bool
    dimension: int

    def __str__(self) -> str:
        return "lat,lon" if self.geographic else ",".join("xyz"[: self.dimension])


class _FileTracks(NamedTuple):
    """The tracks of one file.

    Parameters
    ----------
    tracks : list of LogTrack
        As cleaned.
    stem : str
        Name for tracks without one.
    in_folder : bool
        Whether the file belongs to a folder that was named, so that further files continue its
        tracks.
    """

    tracks: list[LogTrack]
    stem: str
    in_folder: bool


class _UnnamedLoss(NamedTuple):
    """A loss, and the name that its track gets if it has none and is not alone."""

    loss: Loss
    stem: str | None


@dataclass
class _CollectedLogs:
    """Everything read so far."""

    files: list[_FileTracks] = field(default_factory=list)
    axes: list[_Axes] = field(default_factory=list)
    repairs: list[Repair] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    losses: list[_UnnamedLoss] = field(default_factory=list)
    dropped_columns: dict[str, None] = field(default_factory=dict)
    errors: list[InputError] = field(default_factory=list)
    logs: set[str] = field(default_factory=set)
    points: int = 0
    bytes: int = 0

    def name_of_unnamed(self, stem: str) -> str:
        """Return the name of a track without one: that of its file, if there are several logs."""
        return _UNNAMED_TRACK if len(self.logs) == 1 else stem


def read_logs(
    sources: str | Path | BinaryIO | Iterable[str | Path | BinaryIO | Source | InputError],
    *,
    format: str | None = None,
    columns: str | Sequence[str] | Mapping[str, str] | None = None,
    time_unit: str | None = None,
    dates: str | None = None,
    clean: bool = False,
    sort: bool = False,
    split: bool = False,
    keep: Sequence[str] = (),
    heading: bool = False,
    skip_bad: bool = False,
    times: bool = True,
) -> ReadResult:
    r"""Read position logs.

    Rows without a time or a position, and rows that repeat a time of their track, are dropped and
    counted. A log that names no tracks is track ``0``; if there are several logs, it is named after
    its file. Tracks of one name in several files are joined if their times don't overlap. If they
    do, or if names are titles (GPX), the later track becomes ``NAME-2``, and a repair records it.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of Source
        Files, patterns (``walks/*.gpx``), folders of Parquet, zip archives of files, ``-`` for
        standard input. :func:`gpszip.io.storage.source.expand` yields sources.
    format : str, optional
        Name of a format that :func:`gpszip.io.logs.formats.log_formats` lists; found from the
        content if left out.
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` names the columns in their order, ``t=when,x=east,y=north`` by name.
    time_unit : str, optional
        Unit of times that are numbers: ``s``, ``ms``, ``us``, ``ns``, ``days``, ``excel`` (days
        from 1899-12-30) or ``matlab`` (days from the year 0); found from their size if left out.
    dates : str, optional
        ``dmy``, ``mdy`` or ``ymd``, the order of day, month and year in dates such as 03/04/2024;
        found from all dates of the column if left out.
    clean : bool
        Drop outliers, see :func:`gpszip.geo.outliers.find_outliers`, and positions at 0,0 if all
        others are far from there.
    sort, split : bool
        Where time goes back, sort the points, or start a new track.
    keep : sequence of str
        Further columns to keep, as attributes of the tracks.
    heading : bool
        Keep a column of headings (``heading``, ``bearing``, ``course``, ...; the course of GPX
        points), if there is one, as the attribute ``heading``: degrees clockwise from north, NaN
        where unknown.
    skip_bad : bool
        Leave out logs that can't be read, items of logs such as features of GeoJSON, and positions
        off the globe, instead of raising. Files in a zip archive that are no logs at all are left
        out in any case.
    times : bool
        Whether a table needs a column of times; without one, its tracks are read as shapes.

    Returns
    -------
    ReadResult
        Tracks on one common plane.

    Raises
    ------
    InputError
        If a log can't be read or used, or logs in degrees and in metres come together.
    OptionError
        If the format, the unit or the columns don't exist.

    Examples
    --------
    >>> import io
    >>> result = read_logs(io.BytesIO(b"track_id,t,x,y\n007,0,0,0\n007,1,1,0\n007,1,1,0\n"))
    >>> [(track.id, len(track)) for track in result.tracks], result.points, result.lost
    ([('007', 2)], 3, 1)
    """
    # State once, for all readers, what the user says of columns, units and dates.
    request = Request(
        columns=parse_columns(columns),
        time_unit=time_unit,
        keep=(keep,) if isinstance(keep, str) else tuple(keep),
        heading=heading,
        dates=dates,
        skip_bad=skip_bad,
        times=times,
    )

    # Read and clean file by file.
    logs = _CollectedLogs()
    for source in expand(sources, unzip=is_bundle):
        logs.logs.add(source.log if isinstance(source, Source) else str(source))
        try:
            raw = check_plausible(_read_source(source, format, request), request)
            cleaned = clean_log(raw, sort=sort, split=split, skip_bad=skip_bad, clean=clean)
            _add_log(logs, raw, cleaned, source)
        except InputError as error:
            if not (skip_bad or is_stray_file(source, error)):
                raise
            name = source.name if isinstance(source, Source) else "log"
            logs.errors.append(error.located_at(name))
    _report_errors(logs)

    # Join the tracks of all files and project them.
    tracks, geographic = _build_tracks(logs, clean)
    return ReadResult(
        tracks=tracks,
        points=logs.points,
        bytes=logs.bytes,
        geographic=geographic,
        repairs=tuple(logs.repairs),
        left_out=tuple(logs.left_out),
        dropped_columns=tuple(logs.dropped_columns),
        losses=_name_losses(logs),
    )


# File by file


def _read_source(source: Source | InputError, format_: str | None, request: Request) -> RawLog:
    if isinstance(source, InputError):
        raise source
    chosen = format_for_reading(source) if format_ is None else format_named(format_)
    return chosen.read(source, request)


def _add_log(
    logs: _CollectedLogs, raw: RawLog, cleaned: CleanedLog, source: Source | InputError
) -> None:
    """Add a log; raise if its coordinates are not those of the logs before it."""
    # All logs share one plane, so they agree on degrees or metres, and on the dimension.
    assert isinstance(source, Source)
    axes = _Axes(raw.name, raw.geographic, raw.coordinates.shape[1])
    if logs.axes and logs.axes[0][1:] != axes[1:]:
        first = logs.axes[0]
        raise InputError(f"{axes.log}: holds {axes}, but {first.log} {first}; read them apart")
    logs.axes.append(axes)
    logs.files.append(_FileTracks(cleaned.tracks, source.stem, source.folder is not None))

    # Rows that the reader itself dropped can't be assigned to a track.
    dropped_by_reader = sum(repair.count for repair in raw.repairs if repair.drops)
    points = len(raw.times) + dropped_by_reader
    reader_losses = loss_if_large("", raw.name, dropped_by_reader, points)
    logs.losses += [_UnnamedLoss(loss, None) for loss in reader_losses]
    stem = source.stem if raw.codes is None else None
    logs.losses += [_UnnamedLoss(loss, stem) for loss in cleaned.losses]

    # Add the counts.
    logs.repairs += [*raw.repairs, *cleaned.repairs]
    logs.left_out += [*raw.left_out, *cleaned.left_out]
    logs.dropped_columns |= dict.fromkeys(raw.dropped_columns)
    logs.points += points
    logs.bytes += source.size


def _report_errors(logs: _CollectedLogs) -> None:
    """List the logs that can't be read; raise if no log can."""
    if logs.axes:
        logs.left_out += [LeftOut(str(error.path), error.detail) for error in logs.errors]
        return
    if len(logs.errors) > 1:
        raise InputError(
            f"none of {len(logs.errors)} logs can be read; the first: {logs.errors[0]}"
        )
    if logs.errors:
        raise logs.errors[0]
    raise InputError("no log given; name a file, a pattern or - for standard input")


def _name_losses(logs: _CollectedLogs) -> tuple[Loss, ...]:
    """Return the losses, each with the name that its track got."""
    return tuple(
        loss if stem is None else replace(loss, track=logs.name_of_unnamed(stem))
        for loss, stem in logs.losses
    )


# All files together


def _build_tracks(logs: _CollectedLogs, clean: bool) -> tuple[tuple[Track, ...], bool]:
    """Name, join and project the tracks.

    Returns
    -------
    tuple of Track
        On one plane.
    bool
        Whether they came as latitude and longitude.
    """
    log_tracks = _join_tracks(_name_tracks(logs), logs.repairs)
    geographic = logs.axes[0].geographic
    positions, plane = _project(log_tracks, geographic)

    # Without its outliers, a log may fit on a better plane.
    if clean:
        log_tracks, any_dropped = _drop_outliers(log_tracks, positions, logs.repairs)
        if any_dropped:
            positions, plane = _project(log_tracks, geographic)

    tracks = tuple(
        _build_track(log_track, track_positions, plane, logs.repairs)
        for log_track, track_positions in zip(log_tracks, positions, strict=True)
    )
    return tracks, geographic


def _build_track(
    log_track: LogTrack, positions: NDArray[np.float64], plane: Plane | None, repairs: list[Repair]
) -> Track:
    """Make a Track. The "times" of a shape are distances along it, so points must differ."""
    # A track with times has its points at increasing times already.
    name = str(log_track.id)
    if log_track.timed:
        return Track(name, log_track.times, positions, attributes=log_track.attributes, plane=plane)

    # Drop points that repeat the one before.
    steps = np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))
    distance = np.append(0.0, np.cumsum(steps))
    moves = np.append(True, np.diff(distance) > 0)
    if not moves.all():
        what = "points that repeat the one before, of a track without times, dropped"
        where = f"{log_track.where}: track {log_track.id!r}"
        repairs.append(Repair(what, int((~moves).sum()), where))
    return Track(
        name,
        distance[moves],
        positions[moves],
        attributes=log_track.take(moves).attributes,
        plane=plane,
        timed=False,
    )


def _name_tracks(logs: _CollectedLogs) -> list[LogTrack]:
    """Give a name to tracks without one.

    Such a name is a title, which other files may use for another track, unless the files are those
    of one folder.
    """
    named: list[LogTrack] = []
    for file in logs.files:
        taken: set[str] = set()
        for track in file.tracks:
            is_title = track.id_is_title
            name = track.id
            if name is None:
                name = unused_name(logs.name_of_unnamed(file.stem), taken)
                is_title = is_title or not file.in_folder
            taken.add(name)
            named.append(replace(track, id=name, id_is_title=is_title))
    return named


def _join_tracks(tracks: Sequence[LogTrack], repairs: list[Repair]) -> list[LogTrack]:
    """Join tracks of one name that follow each other in time, and rename those that overlap."""
    # Group the tracks by name; if all names differ, there is nothing to join.
    by_name: dict[str, list[LogTrack]] = {}
    for track in tracks:
        by_name.setdefault(str(track.id), []).append(track)
    if len(by_name) == len(tracks):
        return list(tracks)

    # Join the tracks of a name that don't overlap; each of the others gets an unused name.
    taken, joined = set(by_name), []
    for name, group in by_name.items():
        successive, overlapping = _split_overlapping(group)
        joined.append(_concatenate(successive, repairs))
        for track in overlapping:
            new_name = unused_name(name, taken)
            taken.add(new_name)
            joined.append(replace(track, id=new_name))
            what = f"track renamed to {new_name!r}, as there is another {name!r}"
            repairs.append(Repair(what, 1, track.where, drops=False))
    return joined


def _split_overlapping(group: list[LogTrack]) -> tuple[list[LogTrack], list[LogTrack]]:
    """Split tracks of one name into those that follow each other in time, and the others."""
    if any(track.id_is_title or not track.timed for track in group):
        return group[:1], group[1:]
    successive: list[LogTrack] = []
    overlapping: list[LogTrack] = []
    for track in sorted(group, key=lambda track: float(track.times[0])):
        follows = not successive or track.times[0] >= successive[-1].times[-1]
        (successive if follows else overlapping).append(track)
    return successive, overlapping


def _concatenate(tracks: list[LogTrack], repairs: list[Repair]) -> LogTrack:
    """Concatenate tracks that follow each other, with the attributes that all of them have."""
    # A track of one file stays as it is, with all its attributes.
    if len(tracks) == 1:
        return tracks[0]

    # One track may end at the time at which the next begins.
    times = np.concatenate([track.times for track in tracks])
    increases = np.append(True, np.diff(times) > 0)
    if not increases.all():
        what = "points at a time that another file has, too, dropped"
        repairs.append(Repair(what, int((~increases).sum()), tracks[0].where))

    # Attributes that some files lack can't be filled, so only common ones stay.
    coordinates = np.concatenate([track.coordinates for track in tracks])
    attributes = {
        name: np.concatenate([track.attributes[name] for track in tracks])
        for name in tracks[0].attributes
        if all(name in track.attributes for track in tracks)
    }
    joined = replace(tracks[0], times=times, coordinates=coordinates, attributes=attributes)
    return joined.take(increases)


def _project(
    tracks: Sequence[LogTrack], geographic: bool
) -> tuple[list[NDArray[np.float64]], Plane | None]:
    """Project tracks onto one plane chosen for them; metres stay as they are."""
    if not geographic:
        return [track.coordinates for track in tracks], None
    degrees = np.concatenate([track.coordinates for track in tracks])
    plane = choose_plane(degrees[:, 0], degrees[:, 1])
    positions = to_plane(degrees[:, 0], degrees[:, 1], plane)
    ends = np.cumsum([len(track.times) for track in tracks])[:-1]
    return np.split(positions, ends), plane


def _drop_outliers(
    tracks: Sequence[LogTrack], positions: Sequence[NDArray[np.float64]], repairs: list[Repair]
) -> tuple[list[LogTrack], bool]:
    """Drop the outliers of tracks with times.

    Returns
    -------
    list of LogTrack
        The tracks.
    bool
        Whether any point was dropped.
    """
    cleaned = []
    any_dropped = False
    for track, track_positions in zip(tracks, positions, strict=True):
        outliers = find_outliers(track.times, track_positions) if track.timed else np.zeros(0, bool)
        if outliers.any():
            where = f"{track.where}: track {track.id!r}"
            repairs.append(Repair("outliers dropped", int(outliers.sum()), where))
            cleaned.append(track.take(~outliers))
            any_dropped = True
        else:
            cleaned.append(track)
    return cleaned, any_dropped
