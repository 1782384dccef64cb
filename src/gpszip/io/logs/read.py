"""Reading logs: several files of several formats become tracks on one plane, with an account of what was mended."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.outliers import find_outliers
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.clean import CleanedLog, LogTrack, clean_log
from gpszip.io.logs.formats import format_for_reading, format_named
from gpszip.io.logs.losses import loss_if_large
from gpszip.io.logs.plausibility import check_plausible
from gpszip.io.logs.raw import RawLog, Request, unused_name
from gpszip.io.storage.source import Source, expand, is_stray_file
from gpszip.io.tables.roles import parse_columns
from gpszip.model import Plane, Track
from gpszip.model.read_result import LeftOut, Loss, ReadResult, Repair

__all__ = ["read_logs"]


@dataclass
class _CollectedLogs:
    """What has been read so far."""

    tracks: list[list[LogTrack]] = field(default_factory=list)
    stems: list[tuple[str, bool]] = field(
        default_factory=list
    )  # name of the log, and whether more files may go on with it
    raws: list[tuple[str, bool, int]] = field(default_factory=list)
    repairs: list[Repair] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    losses: list[tuple[Loss, str | None]] = field(
        default_factory=list
    )  # with the name of the log, of tracks without a name
    dropped_columns: dict[str, None] = field(default_factory=dict)
    errors: list[InputError] = field(default_factory=list)
    logs: set[str] = field(default_factory=set)
    points: int = 0
    bytes: int = 0


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

    Rows without a time or a position, and rows at a time that the track already has, are dropped and counted. A log that
    names no tracks is track ``0``; of several logs, each such is named after its file. Tracks of the same name in
    several files are one track where their times don't overlap; otherwise, and where names are titles (GPX), the later
    one becomes ``NAME-2``, which is counted.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of what :func:`gpszip.io.storage.source.expand` gives
        Files, patterns (``walks/*.gpx``), folders of Parquet, zip archives of files, ``-`` for standard input.
    format : str, optional
        ``csv``, ``parquet``, ``gpx`` or ``geojson``; told from the content where left out.
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` names the columns by position, ``t=when,x=east,y=north`` by name.
    time_unit : str, optional
        ``s``, ``ms``, ``us``, ``ns``, ``days``, ``excel`` (days from 1899-12-30) or ``matlab`` (days from the year 0) of times that
        are numbers; told from their size where left out.
    dates : str, optional
        ``dmy``, ``mdy`` or ``ymd``, the order of day, month and year in dates such as 03/04/2024; told from the whole column where
        left out.
    clean : bool
        Drop spikes, see :func:`gpszip.geo.outliers.find_outliers`, and positions at 0,0 where all others are far from there.
    sort, split : bool
        What to do where time goes back: put the points in order, or start a new track.
    keep : sequence of str
        Further columns to keep, as attributes of the tracks.
    heading : bool
        Keep a column of headings (``heading``, ``bearing``, ``course``, ...; the course of GPX points), where there is one, as the
        attribute ``heading``: degrees clockwise from north, NaN where not known.
    skip_bad : bool
        Leave out logs that can't be read, parts of logs such as features of GeoJSON, and positions off the globe, instead of raising.
        Files in a zip archive that are no logs at all are left out in any case.

    Returns
    -------
    Reading
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
    >>> reading = read_logs(io.BytesIO(b"track_id,t,x,y\n007,0,0,0\n007,1,1,0\n007,1,1,0\n"))
    >>> [(track.id, len(track)) for track in reading.tracks], reading.points, reading.lost
    ([('007', 2)], 3, 1)
    """
    kept = (keep,) if isinstance(keep, str) else tuple(keep)
    request = Request(
        parse_columns(columns), time_unit, kept, heading, dates, skip_bad=skip_bad, times=times
    )
    account = _CollectedLogs()
    for source in expand(sources):
        account.logs.add(source.log if isinstance(source, Source) else str(source))
        try:
            raw = check_plausible(_read_source(source, format, request), request)
            _add_log(
                account,
                raw,
                clean_log(raw, sort=sort, split=split, skip_bad=skip_bad, clean=clean),
                source,
            )
        except InputError as error:
            if not (skip_bad or is_stray_file(source, error)):
                raise
            account.errors.append(error)
    _report_errors(account)
    tracks, plane_known = _build_tracks(account, clean)
    return ReadResult(
        tracks=tracks,
        points=account.points,
        bytes=account.bytes,
        geographic=plane_known,
        repairs=tuple(account.repairs),
        left_out=tuple(account.left_out),
        dropped_columns=tuple(account.dropped_columns),
        losses=_name_losses(account),
    )


def _read_source(source: Source | InputError, format_: str | None, request: Request) -> RawLog:
    if isinstance(source, InputError):
        raise source
    found = format_named(format_) if format_ is not None else format_for_reading(source)
    return found.read(source, request)


def _add_log(
    account: _CollectedLogs, raw: RawLog, mended: CleanedLog, source: Source | InputError
) -> None:
    assert isinstance(source, Source)
    own = (raw.name, raw.geographic, raw.coordinates.shape[1])
    if account.raws and account.raws[0][1:] != own[1:]:
        raise InputError(
            f"{own[0]}: holds {_describe_axes(own)}, but {account.raws[0][0]} {_describe_axes(account.raws[0])}; read them apart"
        )
    account.raws.append(own)
    dropped_before = sum(repair.count for repair in raw.repairs if repair.drops)
    points = len(raw.times) + dropped_before
    account.tracks.append(mended.tracks)
    account.stems.append((source.stem, source.folder is not None))
    account.repairs += [*raw.repairs, *mended.repairs]
    account.losses += [(loss, None) for loss in loss_if_large("", raw.name, dropped_before, points)]
    account.losses += [(loss, source.stem if raw.codes is None else None) for loss in mended.losses]
    account.left_out += [*raw.left_out, *mended.left_out]
    account.dropped_columns |= dict.fromkeys(raw.dropped_columns)
    account.points += points
    account.bytes += source.size


def _describe_axes(raw: tuple[str, bool, int]) -> str:
    return "lat,lon" if raw[1] else ",".join("xyz"[: raw[2]])


def _report_errors(account: _CollectedLogs) -> None:
    if not account.raws:
        if len(account.errors) > 1:
            raise InputError(
                f"none of {len(account.errors)} logs can be read; the first: {account.errors[0]}"
            )
        raise (
            account.errors[0]
            if account.errors
            else InputError("no log given; name a file, a pattern or - for standard input")
        )
    for error in account.errors:
        name, _, reason = str(error).partition(": ")
        account.left_out.append(LeftOut(name, reason))


def _build_tracks(account: _CollectedLogs, clean: bool) -> tuple[tuple[Track, ...], bool]:
    pieces = _join_tracks(_name_tracks(account), account.repairs)
    geographic = account.raws[0][1]
    positions, plane = _project(pieces, geographic)
    if clean:
        pieces, cleaned = _drop_outliers(pieces, positions, account.repairs)
        positions, plane = _project(pieces, geographic) if cleaned else (positions, plane)
    return tuple(
        _build_track(piece, own, plane, account.repairs)
        for piece, own in zip(pieces, positions, strict=True)
    ), geographic


def _build_track(
    piece: LogTrack, positions: NDArray[np.float64], plane: Plane | None, repairs: list[Repair]
) -> Track:
    """A track of a piece; the times of a shape are the distances along it, at which no two points may be the same."""
    if piece.timed:
        return Track(
            str(piece.id), piece.times, positions, attributes=piece.attributes, plane=plane
        )
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))))
    fresh = np.append(True, np.diff(along) > 0)
    if not fresh.all():
        where = f"{piece.where}: track {piece.id!r}"
        repairs.append(
            Repair(
                "points that repeat the one before, of a track without times, dropped",
                int((~fresh).sum()),
                where,
            )
        )
    kept = piece.take(fresh)
    return Track(
        str(kept.id),
        along[fresh],
        positions[fresh],
        attributes=kept.attributes,
        plane=plane,
        timed=False,
    )


def _name_losses(account: _CollectedLogs) -> tuple[Loss, ...]:
    """Losses, with the names that tracks without a name get."""
    alone = len(account.logs) == 1
    return tuple(
        loss if stem is None else replace(loss, track="0" if alone else stem)
        for loss, stem in account.losses
    )


def _name_tracks(account: _CollectedLogs) -> list[LogTrack]:
    """Give tracks without a name the file's, where there are several files."""
    alone = len(account.logs) == 1
    named: list[LogTrack] = []
    for pieces, (stem, goes_on) in zip(account.tracks, account.stems, strict=True):
        taken: set[str] = set()
        for piece in pieces:
            name = piece.id if piece.id is not None else unused_name("0" if alone else stem, taken)
            taken.add(name)
            named.append(
                replace(
                    piece,
                    id=name,
                    id_is_title=piece.id_is_title or (piece.id is None and not goes_on),
                )
            )
    return named


def _join_tracks(pieces: Sequence[LogTrack], repairs: list[Repair]) -> list[LogTrack]:
    same: dict[str, list[LogTrack]] = {}
    for piece in pieces:
        same.setdefault(str(piece.id), []).append(piece)
    if len(same) == len(pieces):
        return list(pieces)
    taken, result = set(same), []
    for name, group in same.items():
        whole, others = _split_overlapping(group)
        result.append(_concatenate(whole, repairs))
        for other in others:
            new = unused_name(name, taken)
            taken.add(new)
            result.append(replace(other, id=new))
            repairs.append(
                Repair(
                    f"track renamed to {new!r}, as there is another {name!r}",
                    1,
                    other.where,
                    drops=False,
                )
            )
    return result


def _split_overlapping(group: list[LogTrack]) -> tuple[list[LogTrack], list[LogTrack]]:
    """Split pieces of one name in those that follow each other in time and the others."""
    if any(piece.id_is_title or not piece.timed for piece in group):
        return group[:1], group[1:]
    chain: list[LogTrack] = []
    others: list[LogTrack] = []
    for piece in sorted(group, key=lambda piece: float(piece.times[0])):
        free = not chain or piece.times[0] >= chain[-1].times[-1]
        (chain if free else others).append(piece)
    return chain, others


def _concatenate(chain: list[LogTrack], repairs: list[Repair]) -> LogTrack:
    if len(chain) == 1:
        return chain[0]
    times = np.concatenate([piece.times for piece in chain])
    keep = np.append(True, np.diff(times) > 0)
    if not keep.all():
        repairs.append(
            Repair(
                "points at a time that another file has, too, dropped",
                int((~keep).sum()),
                chain[0].where,
            )
        )
    shared = [
        name for name in chain[0].attributes if all(name in piece.attributes for piece in chain)
    ]
    attributes = {
        name: np.concatenate([piece.attributes[name] for piece in chain]) for name in shared
    }
    coordinates = np.concatenate([piece.coordinates for piece in chain])
    return replace(chain[0], times=times, coordinates=coordinates, attributes=attributes).take(keep)


def _project(
    pieces: Sequence[LogTrack], geographic: bool
) -> tuple[list[NDArray[np.float64]], Plane | None]:
    if not geographic:
        return [piece.coordinates for piece in pieces], None
    degrees = np.concatenate([piece.coordinates for piece in pieces])
    plane = choose_plane(degrees[:, 0], degrees[:, 1])
    positions = to_plane(degrees[:, 0], degrees[:, 1], plane)
    return np.split(positions, np.cumsum([len(piece.times) for piece in pieces])[:-1]), plane


def _drop_outliers(
    pieces: Sequence[LogTrack], positions: Sequence[NDArray[np.float64]], repairs: list[Repair]
) -> tuple[list[LogTrack], bool]:
    cleaned = []
    for piece, own in zip(pieces, positions, strict=True):
        spikes = find_outliers(piece.times, own) if piece.timed else np.zeros(len(own), np.bool_)
        if spikes.any():
            repairs.append(
                Repair("outliers dropped", int(spikes.sum()), f"{piece.where}: track {piece.id!r}")
            )
        cleaned.append(piece.take(~spikes) if spikes.any() else piece)
    return cleaned, any(old is not new for old, new in zip(pieces, cleaned, strict=True))
