"""What an archive holds, before the walks are decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

from gpszip.container.layout import OLDEST_VERSION, VERSION, SectionKind
from gpszip.model.error_bound import (
    DIGITS,
    EXPONENTS,
    GROWN_DIGITS,
    GROWTH_STEPS,
    LAST_OF_VERSION_2,
    MAXIMUM_EXPONENTS_ABOVE,
    ErrorBound,
)
from gpszip.model.grid import MAX_REFINEMENTS, STEP_SIZES, Plane, QuantisationGrid

__all__ = [
    "DEFAULT_ID",
    "MAP_HASH_BYTES",
    "Contents",
    "Group",
    "MapReference",
    "Section",
    "SpooledBytes",
    "StoredBytes",
    "find_contradiction",
    "single_group_contents",
]

#: Name of the track of a log that names none.
DEFAULT_ID = "0"

#: Bytes of the hash that identifies a known map.
MAP_HASH_BYTES = 4

#: Bytes of a temporary file that are read at a time.
_CHUNK = 1 << 20

#: Origins (in millimetres), epochs (in milliseconds) and time steps have absolute values below
#: this.
_MAX_SIZE = 1 << 62

#: Most coordinates, and most planes, of a grid.
_MAX_DIMENSION = 15
_MAX_CENTERS = 4096

#: Largest latitude and longitude in units of 1e-7 degrees.
_MAX_LATITUDE = 900_000_000
_MAX_LONGITUDE = 1_800_000_000

#: Kinds of sections that are written by themselves, and can't be further ones.
_RESERVED_KINDS = frozenset(
    {
        0,
        SectionKind.GRID,
        SectionKind.NAMES,
        SectionKind.WALKS,
        SectionKind.MAP,
        SectionKind.INDEX,
        SectionKind.END,
        SectionKind.ERROR_BOUND,
    }
)


@dataclass(frozen=True)
class Group:
    """Walks that are decoded together and without any others.

    Parameters
    ----------
    first_track : int
        Number of the first track, counted from 0.
    tracks : int
        Number of tracks.
    payload : bytes
        The coded walks, opaque to the container.
    time_range : (int, int), optional
        First and last time step of the group's knots; not stored in an archive of a single group.
    """

    first_track: int
    tracks: int
    payload: bytes
    time_range: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class SpooledBytes:
    """Bytes too many for memory, in a temporary file that is deleted with the last reference.

    Parameters
    ----------
    file : binary file
        Holds them from its start on.
    size : int
        Number of bytes.
    """

    file: BinaryIO
    size: int

    def __len__(self) -> int:
        return self.size

    def __bytes__(self) -> bytes:
        return b"".join(self.chunks())

    def chunks(self) -> Iterator[bytes]:
        """Yield the bytes in chunks."""
        self.file.seek(0)
        for first in range(0, self.size, _CHUNK):
            yield self.file.read(min(_CHUNK, self.size - first))


@dataclass(frozen=True, eq=False)
class StoredBytes:
    """Bytes in the file of an archive, which are read, and checked, when they are asked for.

    Parameters
    ----------
    read : callable
        Reads them.
    size : int
        Bytes that they take in the file, with marker, kind, length and checksum.
    """

    read: Callable[[], bytes]
    size: int

    def __len__(self) -> int:
        return len(self.read())

    def __bytes__(self) -> bytes:
        return self.read()

    def __reduce__(self) -> tuple[type[bytes], tuple[bytes]]:
        # Another process or machine may not have the file.
        return bytes, (self.read(),)

    def chunks(self) -> Iterator[bytes]:
        """Yield them all at once."""
        yield self.read()


@dataclass(frozen=True)
class Section:
    """Further bytes of some kind: kept attributes, or what a later version adds.

    Parameters
    ----------
    kind : int
        A :class:`gpszip.container.layout.SectionKind`, or a number below 256 that has no name yet.
    body : bytes, SpooledBytes or StoredBytes
        Opaque to the container.
    """

    kind: int
    body: bytes | SpooledBytes | StoredBytes


@dataclass(frozen=True)
class MapReference:
    """A known map, whose walks are the prior of those of an archive.

    Parameters
    ----------
    hash : bytes of length 4
        Identifies the map, see :func:`gpszip.container.map_record.map_hash`.
    refinements : int
        How often the steps of the map's grid are halved, 0 to 3.
    """

    hash: bytes
    refinements: int = 0


@dataclass(frozen=True)
class Contents:
    """Everything in an archive.

    Parameters
    ----------
    grid : QuantisationGrid or None
        Grid of positions and times; None where it is that of a known map.
    ids : tuple of str or None
        Ids of the tracks in the order in which the walks are coded; None for one track with the id
        of the first track of a known map.
    groups : sequence of Group
        At least one; together they hold each track once, in order.
    map : MapReference, optional
        The known map, where the walks lie on one.
    extras : tuple of Section, optional
        Further sections in their order.
    layer : {None, "bz2"}, default None
        Compression of the payloads inside the file; in ``groups`` they are not compressed.
    error_bound : ErrorBound, optional
        Bound of the walks' error.
    sampling : int, optional
        Index of the step that is about the time between two samples of the log, see
        :func:`gpszip.model.grid.step_size`.
    version : int
        Version of the format in which the walks are coded.
    """

    grid: QuantisationGrid | None
    ids: tuple[str, ...] | None
    groups: Sequence[Group]
    map: MapReference | None = None
    extras: tuple[Section, ...] = ()
    layer: str | None = None
    error_bound: ErrorBound | None = None
    sampling: int | None = None
    version: int = VERSION

    @property
    def has_piece_ends(self) -> bool:
        """Whether walks with times have the ends of their pieces."""
        return self.version > OLDEST_VERSION

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return 1 if self.ids is None else len(self.ids)

    @property
    def is_single_group(self) -> bool:
        """Whether there is only one group, with no further section and no compression."""
        return len(self.groups) == 1 and not self.extras and self.layer is None


def single_group_contents(
    grid: QuantisationGrid, ids: tuple[str, ...], payload: bytes, layer: str | None = None
) -> Contents:
    """Return the contents of an archive whose walks are all coded together.

    Examples
    --------
    >>> from gpszip.model.grid import QuantisationGrid
    >>> grid = QuantisationGrid((0, 0), 0, 128, 128)
    >>> single_group_contents(grid, ("0",), b"walks").groups[0].tracks
    1
    """
    return Contents(grid, ids, (Group(0, len(ids), payload),), layer=layer)


def find_contradiction(contents: Contents) -> str | None:
    """Say why the contents can't be an archive; None if they can."""
    return (
        _check_grid_or_map(contents)
        or _check_groups(contents.groups, contents.tracks)
        or _check_others(contents)
    )


def _check_grid_or_map(contents: Contents) -> str | None:
    """Say what is wrong with grid, map and names."""
    grid, reference = contents.grid, contents.map
    if grid is not None and reference is not None:
        return "both a grid and a map"
    if grid is not None:
        return "no names" if contents.ids is None else _check_grid(grid)
    if reference is None:
        return "neither a grid nor a map"
    if len(reference.hash) != MAP_HASH_BYTES:
        return f"the map's hash has {len(reference.hash)} bytes, not {MAP_HASH_BYTES}"
    if not 0 <= reference.refinements <= MAX_REFINEMENTS:
        return f"a grid refined {reference.refinements} times; at most {MAX_REFINEMENTS} are"
    # Only the compact form can leave out the name of a track.
    return "no names" if contents.ids is None and not contents.is_single_group else None


def _check_grid(grid: QuantisationGrid) -> str | None:
    """Say what is wrong with a grid."""
    if not 1 <= grid.dimension <= _MAX_DIMENSION:
        return f"{grid.dimension} axes; an archive has 1 to {_MAX_DIMENSION}"
    if any(abs(value) >= _MAX_SIZE for value in (*grid.origin, grid.epoch)):
        return "origin or epoch beyond 2^62 thousandths"
    if not (0 <= grid.space < STEP_SIZES and 0 <= grid.time < STEP_SIZES):
        return f"steps {grid.space} and {grid.time}; an archive can name 0 to {STEP_SIZES - 1}"
    return None if grid.plane is None else _check_plane(grid.plane)


def _check_plane(plane: Plane) -> str | None:
    """Say what is wrong with the planes of a grid."""
    centers = plane.centers
    if not 1 <= len(centers) <= _MAX_CENTERS:
        return f"{len(centers)} planes; an archive has 1 to {_MAX_CENTERS}"
    if any(abs(lat) > _MAX_LATITUDE or abs(lon) > _MAX_LONGITUDE for lat, lon in centers):
        return "the centre of a plane is not on the earth"
    return None


def _check_groups(groups: Sequence[Group], tracks: int) -> str | None:
    """Say what is wrong with the groups of so many tracks."""
    # Check that track numbers run on from group to group, and the range of time steps.
    if not groups:
        return "no walks"
    next_track = 0
    for number, group in enumerate(groups):
        # The groups hold all tracks in order; a single one may be empty.
        if group.first_track != next_track or group.tracks < (1 if len(groups) > 1 else 0):
            return (
                f"group {number} holds {group.tracks} tracks from {group.first_track};"
                f" track {next_track} is next"
            )
        next_track += group.tracks
        if group.time_range is not None:
            first, last = group.time_range
            if not -_MAX_SIZE < first <= last < _MAX_SIZE:
                return f"group {number} spans the time steps {first} to {last}"
    return None if next_track == tracks else f"walks of {next_track} tracks, names of {tracks}"


def _is_encodable(error_bound: ErrorBound, version: int) -> bool:
    """Whether an archive can hold an error bound."""
    if error_bound.growth == 0:
        digits = error_bound.digits in DIGITS
    else:
        digits = error_bound.digits in GROWN_DIGITS and error_bound.growth in GROWTH_STEPS
    # Version 2 has one exponent more; since version 3, its four bits mark two bounds.
    exponent = error_bound.exponent in EXPONENTS or (
        version == OLDEST_VERSION and error_bound.exponent == LAST_OF_VERSION_2
    )
    return digits and exponent and _is_maximum_encodable(error_bound)


def _is_maximum_encodable(error_bound: ErrorBound) -> bool:
    """Whether an archive can hold the second bound, of the largest distance, if there is one."""
    if error_bound.max_digits == 0:
        return True
    over = error_bound.max_exponent - error_bound.exponent
    # A second bound stands beside a root mean square that no merge has extended.
    return (
        error_bound.max_digits in DIGITS
        and over in MAXIMUM_EXPONENTS_ABOVE
        and not error_bound.maximum
        and error_bound.growth == 0
    )


def _check_others(contents: Contents) -> str | None:
    """Say what is wrong with further sections, error bound, sampling and compression."""
    # A kind takes one byte.
    for section in contents.extras:
        if section.kind in _RESERVED_KINDS or not 0 <= section.kind < 256:
            return f"further sections can't be of kind {section.kind}"
    error_bound = contents.error_bound
    if error_bound is not None and not _is_encodable(error_bound, contents.version):
        return (
            f"an error bound of {error_bound.digits} * 10^{error_bound.exponent} m,"
            f" grown by {error_bound.growth} steps"
        )
    if contents.sampling is not None and not 0 <= contents.sampling < STEP_SIZES:
        return f"sampling {contents.sampling}; an archive can name 0 to {STEP_SIZES - 1}"
    if contents.layer not in {None, "bz2"}:
        return f"no layer is called {contents.layer!r}; there is 'bz2'"
    return None
