"""Checks of tracks, maps and column names before any work starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import InputError, OptionError
from gpszip.model import Options, Plane, Track
from gpszip.model.log import Log, MemoryLog

__all__ = [
    "as_log",
    "check_map",
    "check_names",
    "check_thesis_in_memory",
    "check_tracks",
    "on_plane_of",
]

#: Metres and seconds from zero that positions and times may have; float64 still tells their tenths.
_MAX_MAGNITUDE = 1e14


def as_log(tracks: Sequence[Track] | Track | Log) -> Log:
    """Return tracks in memory as a checked log; other logs as they are.

    Raises
    ------
    InputError
        If there are no tracks, or a number is too far from zero.
    OptionError
        If tracks differ in plane or coordinates, or two have one id.
    """
    if isinstance(tracks, MemoryLog):
        return MemoryLog(check_tracks(tracks.tracks), tracks.read_result)
    if isinstance(tracks, Track | Sequence):
        return MemoryLog(check_tracks(tracks))
    return tracks


def check_tracks(tracks: Sequence[Track] | Track) -> tuple[Track, ...]:
    """Return tracks that go together: at least one, on one plane, each with an id of its own."""
    # At least one track.
    checked = (tracks,) if isinstance(tracks, Track) else tuple(tracks)
    if not checked:
        raise InputError("no tracks: there is nothing to compress")

    # Coordinates and plane must be those of the first track, as all share one map.
    first, ids = checked[0], set[str]()
    for track in checked:
        if track.dimension != first.dimension:
            raise OptionError(
                f"track {track.id!r} has {track.dimension} coordinates, {first.id!r} "
                f"{first.dimension}",
                remedy="compress them apart",
            )
        if track.plane != first.plane:
            raise OptionError(
                f"tracks {first.id!r} and {track.id!r} lie on different planes",
                remedy="read them together",
            )
        _check_range(track)

        # Names tell tracks apart.
        if track.id in ids:
            raise OptionError(f"two tracks are called {track.id!r}", remedy="give each its own id")
        ids.add(track.id)
    return checked


def _check_range(track: Track) -> None:
    """Refuse numbers that no grid reaches."""
    if max(_largest(track.positions), _largest(track.times)) <= _MAX_MAGNITUDE:
        return
    magnitudes = {
        "position": np.abs(track.positions).max(axis=1),
        "time": np.abs(track.times),
    }
    for name, values in magnitudes.items():
        far = values > _MAX_MAGNITUDE
        if far.any():
            sample = int(far.argmax())
            raise InputError(
                f"a {name} of {values[sample]:.3g} is too far from zero",
                location=f"track {track.id!r}: sample {sample}",
                remedy="drop such samples, or name other columns",
            )


def _largest(values: NDArray[np.float64]) -> float:
    """Largest absolute value."""
    return max(float(values.max()), -float(values.min()))


def on_plane_of(map: Archive, log: Log, options: Options) -> Log:
    """Return a log on the plane of a map, which it and the options must fit.

    A log on disk was put on that plane when it was read.
    """
    from gpszip.geo.planes import reproject_track

    check_map(map, log.dimension, log.plane, options)
    plane = map.grid.plane
    if plane is None or not isinstance(log, MemoryLog):
        return log
    tracks = tuple(reproject_track(track, plane) for track in log.tracks)
    return MemoryLog(tracks, log.read_result)


def check_map(map: Archive, dimension: int, plane: Plane | None, options: Options) -> None:
    """Refuse a map that doesn't fit the coordinates of a log, or the options."""
    if options.thesis or options.layer or not options.times:
        raise OptionError(
            "a known map (--map, --append) doesn't go with --k, --m, --layer or --no-times",
            remedy="leave these out",
        )
    if map.contents.map is not None:
        raise OptionError(
            "the map lies on another map itself",
            remedy="give an archive that holds its own map",
        )
    if not map.timed:
        raise OptionError("the map was written without times", remedy="compress its log with them")
    grid = map.grid
    if grid.dimension != dimension or (grid.plane is None) != (plane is None):
        of_map, of_log = _axes(grid.dimension, grid.plane), _axes(dimension, plane)
        raise OptionError(
            f"the map has {of_map}, the log {of_log}", remedy="give a map of the same place"
        )


def _axes(dimension: int, plane: Plane | None) -> str:
    if plane is None:
        return f"{dimension} coordinates on a plane of its own"
    return "latitude and longitude"


def check_thesis_in_memory(*, thesis: bool, in_memory: bool) -> None:
    """Refuse the thesis's model, Algorithm 1, for a log on disk."""
    if thesis and not in_memory:
        raise OptionError(
            "k and m segment a track that is in memory as a whole, and the logs are larger than "
            "the memory given; allow more with --memory, leave it out, or give --rmse "
            "instead of k and m"
        )


def check_names(names: Sequence[str], *, geographic: bool) -> None:
    """Refuse columns with the names that decompressed tracks have anyway."""
    taken = {"track_id", "t"} | ({"lat", "lon"} if geographic else {"x", "y", "z"})
    wrong = next((name for name in names if name in taken), None)
    if wrong is not None:
        raise OptionError(
            f"column {wrong!r} can't be kept: positions have a column of that name",
            remedy="rename it",
        )
