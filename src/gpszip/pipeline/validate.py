"""What tracks, names and maps must be before any work starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.archive import Archive
from gpszip.errors import InputError, OptionError
from gpszip.model import Options, Plane, Track

__all__ = ["check_map", "check_names", "checked", "laid_on"]

#: Metres and seconds from zero that positions and times may have; a float64 still tells their tenths.
_FARTHEST = 1e14


def checked(tracks: Sequence[Track] | Track) -> tuple[Track, ...]:
    """Tracks that go together: at least one, on one plane, each with a name of its own."""
    whole = (tracks,) if isinstance(tracks, Track) else tuple(tracks)
    if not whole:
        raise InputError("no tracks: there is nothing to compress")
    first, seen = whole[0], set[str]()
    for track in whole:
        if track.dimension != first.dimension:
            raise OptionError(
                f"track {track.id!r} has {track.dimension} coordinates, {first.id!r} {first.dimension}; compress them apart"
            )
        if track.plane != first.plane:
            raise OptionError(
                f"tracks {first.id!r} and {track.id!r} lie on different planes; read them together"
            )
        _check_range(track)
        if track.id in seen:
            raise OptionError(f"two tracks are called {track.id!r}; give each its own id")
        seen.add(track.id)
    return whole


def _check_range(track: Track) -> None:
    """Refuse numbers that no lattice reaches."""
    for what, values in (
        ("position", np.abs(track.positions).max(axis=1)),
        ("time", np.abs(track.times)),
    ):
        far = values > _FARTHEST
        if far.any():
            where = f"track {track.id!r}: sample {int(far.argmax())}"
            raise InputError(
                f"{where}: a {what} of {values[far.argmax()]:.3g} is too far from zero; drop such samples, or name other columns"
            )


def laid_on(map: Archive, tracks: Sequence[Track], options: Options) -> tuple[Track, ...]:
    """Tracks on the plane of a map, which they and the options must fit."""
    from gpszip.geo.planes import reproject_track

    check_map(map, tracks[0].dimension, tracks[0].plane, options)
    plane = map.grid.plane
    return (
        tuple(tracks) if plane is None else tuple(reproject_track(track, plane) for track in tracks)
    )


def check_map(map: Archive, dimension: int, plane: Plane | None, options: Options) -> None:
    """Refuse a map that doesn't fit tracks of so many coordinates, or that options don't go with."""
    if options.thesis or options.layer or not options.times:
        raise OptionError(
            "k, m, layer and leaving out times don't go with a map that is there already; leave them out"
        )
    if map.contents.map is not None:
        raise OptionError("the map lies on another map itself; give one that holds its own walks")
    if not map.timed:
        raise OptionError("the map was written without times; compress its log with them")
    grid = map.grid
    if grid.dimension != dimension or (grid.plane is None) != (plane is None):
        theirs, ours = _axes(grid.dimension, grid.plane), _axes(dimension, plane)
        raise OptionError(f"the map has {theirs}, the log {ours}; give a map of the same place")


def _axes(dimension: int, plane: Plane | None) -> str:
    return (
        f"{dimension} coordinates on a plane of its own"
        if plane is None
        else "latitude and longitude"
    )


def check_names(names: Sequence[str], *, geographic: bool) -> None:
    """Refuse to keep columns that are called as what decompressed tracks have anyway."""
    own = {"track_id", "t"} | ({"lat", "lon"} if geographic else {"x", "y", "z"})
    wrong = next((name for name in names if name in own), None)
    if wrong is not None:
        raise OptionError(
            f"column {wrong!r} can't be kept besides: each position has one of that name; rename the column"
        )
