"""Logs in FIT: activities of watches and bicycle computers.

GPSZip reads what fitdecode decodes; the extra ``fit`` brings it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.fit.parse import FitRecords, parse_fit
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, unused_name
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut, Repair
from gpszip.model.text import count_text

__all__ = ["read_fit"]

#: Degrees in a semicircle, the unit of positions.
_SEMICIRCLE = 180 / 2**31

#: Fields of one quantity, the preferred one first, and the names that ask for it.
_SYNONYMS = (
    (("enhanced_altitude", "altitude"), HEIGHT_NAMES),
    (("enhanced_speed", "speed"), ()),
    (("heart_rate",), ("hr", "heartrate")),
    (("cadence",), ("cad",)),
    (("temperature",), ("temp", "atemp")),
    (("power",), ("watts",)),
)

#: Kinds of messages that errors name.
_MAX_SHOWN_MESSAGES = 6

#: Fields that messages name.
_MAX_SHOWN_FIELDS = 20

Floats = NDArray[np.float64]


def read_fit(source: Source, request: Request) -> RawLog:
    """Read the positions of a FIT file.

    An activity is one track, and one with several sports is a track for each of them, as is each
    file of a chain. Laps make no tracks. A course is read as a shape: its times are plans.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Fields of records to keep: ``heart_rate``, ``cadence``, ``power``, ``temperature``, ``alt``
        in m, ``speed`` in m/s, fields of apps by their names; and whether to read a damaged file
        up to the damage.

    Returns
    -------
    RawLog
        Times are UTC. Records without a position have NaN.

    Raises
    ------
    InputError
        If the file is damaged, no record has a position, or none has a field to keep.
    MissingExtraError
        If fitdecode isn't installed.
    """
    # Read all records.
    names = (*request.required, *request.optional)
    wanted = {field for name in names for field in _fields_named(name)}
    records = parse_fit(source, wanted)
    _require_positions(records, request, source.name)

    # Of a chain of files, those without positions are no tracks, but their records count.
    times = np.array(records.times)
    ids, codes = _tracks(records, times)
    is_course = np.array([kind == "course" for kind in records.kinds])
    in_course = np.repeat(is_course, np.diff(records.ends, prepend=0))
    untimed = frozenset(np.unique(codes[in_course]).tolist())

    # Read the fields to keep.
    attributes, used = _attributes(records, request, source.name)
    return RawLog(
        name=source.name,
        ids=ids,
        codes=codes if ids else None,
        times=np.where(in_course, np.nan, times),
        coordinates=np.stack([records.lat, records.lon], axis=1) * _SEMICIRCLE,
        geographic=True,
        attributes=attributes,
        row_noun="point",
        ids_are_titles=True,
        dropped_columns=tuple(name for name in records.present if name not in used),
        repairs=_ignored_times(int((in_course & np.isfinite(times)).sum()), source.name),
        left_out=_left_out(records, source.name),
        untimed=untimed,
    )


def _require_positions(records: FitRecords, request: Request, where: str) -> None:
    """Raise for a damaged file, unless its start may be read, and for one without positions."""
    # As for other formats, a user decides whether the start of a damaged file will do.
    positions = np.isfinite(records.lat) & np.isfinite(records.lon)
    if records.damage and not (request.skip_bad and positions.any()):
        start = "; --skip-bad reads what comes before" if positions.any() else ""
        raise InputError(
            f"damaged FIT file: {records.damage}",
            path=where,
            location=f"after record {len(positions):,}",
            remedy=f"fetch it again{start}",
        )
    if positions.any():
        return

    # Say what is in it instead.
    found = [f"{count:,} {name}" for name, count in records.messages.most_common()]
    if len(positions):
        found.insert(0, f"{count_text(len(positions), 'record')} without one")
    kinds = " and ".join(dict.fromkeys(kind for kind in records.kinds if kind != "file")) or "FIT"
    raise NoPositionsError(
        f"no position in this {kinds} file, only messages: "
        f"{', '.join(found[:_MAX_SHOWN_MESSAGES]) or 'none'}",
        path=where,
        remedy="name files of outdoor activities",
    )


def _tracks(records: FitRecords, times: Floats) -> tuple[tuple[str, ...], NDArray[np.int32]]:
    """Find the tracks: one for each session of each file that has positions.

    Returns
    -------
    tuple of str
        Their names; empty for a single one.
    int array, shape (n,)
        Index into them for each record.
    """
    # Number the sessions by file.
    codes = np.zeros(len(times), np.int32)
    titles: list[str] = []
    start = 0
    for end, sessions, kind in zip(records.ends, records.sessions, records.kinds, strict=True):
        # A record belongs to the last session that has started.
        known = sorted((s for s in sessions if np.isfinite(s.start)), key=lambda s: s.start)
        starts = [session.start for session in known]
        session = np.searchsorted(starts, times[start:end], side="right") - 1
        codes[start:end] = len(titles) + np.clip(session, 0, max(len(known) - 1, 0))
        titles += [session.sport for session in known] or [kind]
        start = end

    # Leave out those without records, and name the others.
    used, codes_of_used = np.unique(codes, return_inverse=True)
    if len(used) == 1:
        return (), np.zeros(len(times), np.int32)
    names: dict[str, None] = {}
    for i in used.tolist():
        names[unused_name(titles[i], names)] = None
    return tuple(names), codes_of_used.astype(np.int32)


# Attributes


def _fields_named(name: str) -> tuple[str, ...]:
    """Return the fields that a name may stand for, the preferred one first."""
    lower = name.lower()
    for fields, names in _SYNONYMS:
        if lower in fields or lower in names:
            return fields
    return (name,)


def _attributes(
    records: FitRecords, request: Request, where: str
) -> tuple[dict[str, NDArray[np.generic]], set[str]]:
    """Read the fields to keep.

    Returns
    -------
    dict of str to array
        Their values, by the names that were asked for.
    set of str
        The fields that were read, with those of the same quantity.
    """
    attributes: dict[str, NDArray[np.generic]] = {}
    used: set[str] = set()
    for name in (*request.required, *request.optional):
        fields = _fields_named(name)
        found = next((field for field in fields if field in records.present), None)
        if found is None:
            if name in request.optional:
                continue
            shown = ", ".join(list(records.present)[:_MAX_SHOWN_FIELDS])
            remedy = f"its records have: {shown or 'position and time only'}"
            raise InputError(f"no {name!r} to keep", path=where, remedy=remedy)
        attributes[name] = _values(records.fields[found])
        used.update(fields)
    return attributes, used


def _values(values: list[Any]) -> NDArray[np.generic]:
    """Return floats if all values are numbers, NaN for those that are missing; else texts."""
    if all(value is None or isinstance(value, (int, float)) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    return np.array(["" if value is None else str(value) for value in values], np.str_)


# Repairs and what is left out


def _ignored_times(count: int, where: str) -> tuple[Repair, ...]:
    what = "times of course points not read, as courses are shapes"
    return (Repair(what, count, where, drops=False),) if count else ()


def _left_out(records: FitRecords, where: str) -> tuple[LeftOut, ...]:
    if not records.damage:
        return ()
    return (LeftOut(f"{where}: all after record {len(records.times):,}", records.damage),)
