"""The archives that a journal is appended to: one, and further ones where that can't take all.

``A.gpsz`` takes all fixes that it can. ``A-2.gpsz`` takes those too far from its map (400 km),
those for which its grid is too coarse, and those without a height if it has heights; ``A-3.gpsz``
takes what that can't take, and so on.

The track of an agent has its name. Fixes from before the end of that track, which come late, go to
a track ``NAME (2)``, in the order of time again; if they are before the end of that one, too, to
``NAME (3)``, and so on. Where a fix is marked as a break, a further track begins, too, which later
fixes continue.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, open_archive
from gpszip.errors import GPSZipError, OptionError
from gpszip.geo.planes import PLANE_RADIUS, choose_plane, to_plane
from gpszip.live.rolling.fixes import AgentFixes
from gpszip.model import Plane, Track
from gpszip.model.error_bound import ErrorBound
from gpszip.pipeline.continue_tracks import track_end
from gpszip.walks.error import TIME_SLACK, positions_at

__all__ = [
    "archive_names",
    "assign_parts",
    "check_archive",
    "distances_to",
    "divide_at_breaks",
    "largest_error",
    "open_archives",
    "parts_of",
    "plane_of",
    "reachable",
    "tracks_on",
]

#: Metres; mean radius of the earth.
_EARTH_RADIUS = 6_371_000.0

#: Centres have degrees in these units.
_UNITS_PER_DEGREE = 1e7

#: Tracks of one agent at most; an agent whose clock goes back all the time has so many.
_MAX_PARTS = 10_000

#: Tracks of one agent from which on breaks begin no further ones: its SLAM is lost all the time.
_MAX_BROKEN_PARTS = 1_000

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def archive_names(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the names of the archives: that which is given, and those beside it.

    Examples
    --------
    >>> names = archive_names("city.gpsz")
    >>> [str(next(names)) for _ in range(2)]
    ['city.gpsz', 'city-2.gpsz']
    """
    first = Path(path)
    yield first
    number = 2
    while True:
        yield first.with_name(f"{first.stem}-{number}{first.suffix}")
        number += 1


def open_archives(path: str | os.PathLike[str]) -> list[tuple[Path, Archive]]:
    """Open the archives that are there, up to the first name without one.

    Raises
    ------
    OptionError
        If nothing can be appended to one of them.
    """
    opened = []
    for name in archive_names(path):
        if not name.exists():
            break
        try:
            archive = open_archive(name.read_bytes())
        except GPSZipError as error:
            raise error.located_at(str(name)) from error
        check_archive(archive, name)
        opened.append((name, archive))
    return opened


def check_archive(
    archive: Archive, path: Path, *, needs_maximum: bool = True, option: str = "--archive"
) -> None:
    """Refuse an archive to which no fixes can be appended.

    Parameters
    ----------
    archive : Archive
        The archive.
    path : Path
        Where it is.
    needs_maximum : bool
        Whether it has to state a maximum error.
    option : str
        The option that names it.

    Raises
    ------
    OptionError
        If it states no maximum error, has no times, keeps columns, or lies on another map.
    """
    reasons = {
        "lies on a known map": archive.contents.grid is None,
        "has tracks without times": not archive.timed or bool(archive.untimed),
        "states no maximum error": needs_maximum and largest_error(archive.error_bound) is None,
        "keeps columns, which fixes don't have": archive.kept_columns is not None
        or bool(archive.curve_sizes),
    }
    for reason, holds in reasons.items():
        if holds:
            raise OptionError(reason, path=str(path), remedy=f"name another archive with {option}")


def largest_error(bound: ErrorBound | None) -> float | None:
    """Metres that a sample may be off; None where that is not bounded."""
    if bound is None:
        return None
    return bound.metres if bound.maximum else bound.max_error


def parts_of(agent: str) -> Iterator[str]:
    """Yield the names of the tracks of an agent.

    Examples
    --------
    >>> parts = parts_of("bus")
    >>> next(parts), next(parts)
    ('bus', 'bus (2)')
    """
    yield agent
    for number in range(2, _MAX_PARTS + 1):
        yield f"{agent} ({number})"


def distances_to(archive: Archive, agent: str, fixes: AgentFixes) -> Floats:
    """Metres from each fix to the nearest track of its agent at that time; infinite without one.

    Parameters
    ----------
    archive : Archive
        One of the archives.
    agent : str
        Name of the agent.
    fixes : AgentFixes
        n fixes.

    Returns
    -------
    float64 array, shape (n,)
    """
    distances = np.full(len(fixes), np.inf)
    if not _has_all_coordinates(archive, fixes):
        return distances
    known, nodes = set(archive.ids), None
    for name in parts_of(agent):
        if name not in known:
            break
        nodes = archive.road_map.nodes if nodes is None else nodes
        at = positions_at(archive.walk(name), nodes, fixes.times)
        own = _on_plane(fixes.coordinates, archive.grid.plane)[:, : at.shape[1]]
        found = np.linalg.norm(at - own, axis=1)
        distances = np.fmin(distances, np.where(np.isnan(found), np.inf, found))
    return distances


def reachable(archive: Archive, coordinates: Floats) -> Flags:
    """Whether each position of shape (n, d) has its place on an archive's map, shape (n,)."""
    plane = archive.grid.plane
    if plane is None:
        has_all = coordinates.shape[1] >= archive.grid.dimension
        return np.full(len(coordinates), has_all)
    lat, lon = np.radians(coordinates[:, :2].T)
    near = np.zeros(len(coordinates), np.bool_)
    for center in plane.centers:
        center_lat, center_lon = np.radians(np.array(center) / _UNITS_PER_DEGREE)
        cosine = np.sin(lat) * np.sin(center_lat) + np.cos(lat) * np.cos(center_lat) * np.cos(
            lon - center_lon
        )
        near |= cosine > np.cos(PLANE_RADIUS / _EARTH_RADIUS)
    return near


def _has_all_coordinates(archive: Archive, fixes: AgentFixes) -> bool:
    """Whether fixes have a height, where the archive's walks have one."""
    return bool(fixes.coordinates.shape[1] >= archive.grid.dimension)


def assign_parts(
    archive: Archive, agent: str, fixes: AgentFixes, margin: float, taken: set[str]
) -> dict[str, AgentFixes]:
    """Divide the fixes of an agent among its tracks: each gets those after its end.

    Parameters
    ----------
    archive : Archive
        The archive that the fixes are appended to.
    agent : str
        Name of the agent.
    fixes : AgentFixes
        What the archive doesn't hold yet.
    margin : float
        Seconds that must lie between the end of a track and what continues it; infinite for new
        tracks only.
    taken : set of str
        Names that other fixes got; grows by those that these get.

    Returns
    -------
    dict of str to AgentFixes
    """
    # Track by track, the one that ends last first: those after its end. A new track takes all left.
    parts: dict[str, AgentFixes] = {}
    ends = _ends(archive, agent, is_exact=margin == 0)
    first, *broken = fixes.runs(_MAX_BROKEN_PARTS - len(ends))
    if first.breaks[0] and len(ends) < _MAX_BROKEN_PARTS:
        first, broken = first.take(slice(0)), [first, *broken]
    order = sorted(ends, key=lambda name: -ends[name])
    if archive.grid.plane is None:
        # In metres, breaks may lie between the end of an earlier track and a late fix.
        order = order[:1]
    for name in order:
        after = first.times > ends[name] + max(margin, 2 * TIME_SLACK)
        if after.any() and name not in taken:
            parts[name] = first.take(after)
            first = first.take(~after)
    taken |= parts.keys()

    # What nothing can be continued by.
    new = [run for run in (first, *broken) if len(run)]
    parts |= _name_new(agent, new, taken | ends.keys())
    taken |= parts.keys()
    return parts


def divide_at_breaks(fixes: Mapping[str, AgentFixes]) -> dict[str, AgentFixes]:
    """Divide the fixes of agents that no archive has among tracks, a new one from each break on."""
    parts: dict[str, AgentFixes] = {}
    for agent, each in fixes.items():
        parts |= _name_new(agent, each.runs(_MAX_BROKEN_PARTS), parts.keys())
    return parts


def _ends(archive: Archive, agent: str, *, is_exact: bool) -> dict[str, float]:
    """When each track of an agent ends, or the last knot of its walk is, if that is later."""
    ends: dict[str, float] = {}
    known = set(archive.ids)
    for name in parts_of(agent):
        if name not in known:
            break
        ends[name] = track_end(archive, name)
        if not is_exact:
            ends[name] = max(ends[name], _last_knot_time(archive, name))
    return ends


def _name_new(
    agent: str, runs: Sequence[AgentFixes], taken: Collection[str]
) -> dict[str, AgentFixes]:
    """Give each run the first name of the agent's tracks that is not taken."""
    free = (name for name in parts_of(agent) if name not in taken)
    named = dict(zip(free, runs, strict=False))
    if len(named) < len(runs):
        raise OptionError(
            f"track {agent!r} has more than {_MAX_PARTS:,} parts",
            remedy="name another archive with --archive",
        )
    return named


def tracks_on(parts: Mapping[str, AgentFixes], plane: Plane | None, dimension: int) -> list[Track]:
    """Return fixes as tracks on a plane, or in metres with so many coordinates."""
    return [
        Track(name, fixes.times, _on_plane(fixes.coordinates, plane)[:, :dimension], plane=plane)
        for name, fixes in parts.items()
    ]


def plane_of(fixes: Mapping[str, AgentFixes]) -> Plane:
    """Choose a plane for fixes in degrees."""
    degrees = np.concatenate([each.coordinates[:, :2] for each in fixes.values()])
    return choose_plane(degrees[:, 0], degrees[:, 1])


def _on_plane(coordinates: Floats, plane: Plane | None) -> Floats:
    return coordinates if plane is None else to_plane(coordinates[:, 0], coordinates[:, 1], plane)


def _last_knot_time(archive: Archive, name: str) -> float:
    times = archive.walk(name).times
    return 0.0 if times is None else float(times[-1])
