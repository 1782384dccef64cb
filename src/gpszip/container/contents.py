"""What an archive holds, before any of it is understood as map or walk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

from gpszip.container.layout import OLDEST_VERSION, VERSION
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

#: Bytes of the hash that stands for a map kept elsewhere.
MAP_HASH_BYTES = 4

#: Bytes of a temporary file that are read at a time.
_PIECE = 1 << 20

_LARGEST = 1 << 62
_DIMENSIONS = 15
_CENTERS = 4096
_RESERVED_KINDS = (0, 1, 2, 3, 4, 6, 7, 8)


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
        First and last time cell of the group's knots. An archive of a single group does not keep it.
    """

    first_track: int
    tracks: int
    payload: bytes
    time_range: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class SpooledBytes:
    """Bytes too many for memory, in a temporary file that goes when nobody holds it any more.

    Parameters
    ----------
    file : binary file
        Holds them from its start on.
    size : int
        How many there are.
    """

    file: BinaryIO
    size: int

    def __len__(self) -> int:
        return self.size

    def __bytes__(self) -> bytes:
        return b"".join(self.chunks())

    def chunks(self) -> Iterator[bytes]:
        """Yield them one after the other."""
        self.file.seek(0)
        for first in range(0, self.size, _PIECE):
            yield self.file.read(min(_PIECE, self.size - first))


@dataclass(frozen=True, eq=False)
class StoredBytes:
    """Bytes in the file of an archive, which are read, and checked, when they are asked for.

    Parameters
    ----------
    read : callable
        Reads them.
    size : int
        Bytes that they take in the file, with all framing.
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
    """Bytes of a kind that the container does not look into: kept attributes, or what a later version added."""

    kind: int
    body: bytes | SpooledBytes | StoredBytes


@dataclass(frozen=True)
class MapReference:
    """A map that is kept elsewhere, after whose walks those of an archive are coded.

    Parameters
    ----------
    hash : bytes of length 4
        Names the map, see :func:`gpszip.container.map_record.map_hash`.
    refinements : int
        How often the map's quanta are halved, 0 to 3.
    """

    hash: bytes
    refinements: int = 0


@dataclass(frozen=True)
class Contents:
    """Everything in an archive.

    Parameters
    ----------
    grid : Frame or None
        Where positions and times lie; None where a map kept elsewhere tells.
    ids : tuple of str or None
        Names of the tracks in the order in which the walks are coded; None for one track that is called as the first of the
        map kept elsewhere.
    groups : sequence of Group
        At least one; together they hold each track once, in order.
    map : MapReference, optional
        The map, where it is kept elsewhere.
    extras : tuple of Section, optional
        Further sections in their order.
    layer : {None, "bz2"}, default None
        What the payloads are wrapped in inside the file; in ``groups`` they are unwrapped.
    error_bound : Promise, optional
        The error that the walks keep.
    sampling : int, optional
        Index of the quantum that is about the time between two samples of the log.
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
    def ends(self) -> bool:
        """Whether walks with times tell where their pieces begin and end."""
        return self.version > OLDEST_VERSION

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return 1 if self.ids is None else len(self.ids)

    @property
    def is_single_group(self) -> bool:
        """Whether there is but one group with nothing around or beside it."""
        return len(self.groups) == 1 and not self.extras and self.layer is None


def single_group_contents(
    grid: QuantisationGrid, ids: tuple[str, ...], payload: bytes, layer: str | None = None
) -> Contents:
    """Contents of an archive whose walks are all coded together.

    Examples
    --------
    >>> from gpszip.model.grid import QuantisationGrid, Plane
    >>> single_group_contents(QuantisationGrid((0, 0), 0, 128, 128), ("0",), b"walks").groups[0].tracks
    1
    """
    return Contents(grid, ids, (Group(0, len(ids), payload),), layer=layer)


def find_contradiction(contents: Contents) -> str | None:
    """What keeps the contents from being an archive; None if nothing does."""
    return (
        _place_complaint(contents)
        or _groups_complaint(contents.groups, contents.tracks)
        or _rest_complaint(contents)
    )


def _place_complaint(contents: Contents) -> str | None:
    if (contents.grid is None) == (contents.map is None):
        return "neither a frame nor a map" if contents.grid is None else "both a frame and a map"
    if contents.grid is not None:
        return "no names" if contents.ids is None else _frame_complaint(contents.grid)
    if contents.map is not None and len(contents.map.hash) != MAP_HASH_BYTES:
        return f"the map's hash has {len(contents.map.hash)} bytes, not {MAP_HASH_BYTES}"
    if contents.map is not None and not 0 <= contents.map.refinements <= MAX_REFINEMENTS:
        return f"quanta halved {contents.map.refinements} times; at most {MAX_REFINEMENTS} are"
    return "no names" if contents.ids is None and not contents.is_single_group else None


def _frame_complaint(grid: QuantisationGrid) -> str | None:
    if not 1 <= grid.dimension <= _DIMENSIONS:
        return f"{grid.dimension} axes; an archive has 1 to {_DIMENSIONS}"
    if any(abs(value) >= _LARGEST for value in (*grid.origin, grid.epoch)):
        return "origin or epoch beyond 2^62 thousandths"
    if not (0 <= grid.space < 256 and 0 <= grid.time < 256):
        return f"quanta {grid.space} and {grid.time}; an archive can name 0 to 255"
    return None if grid.plane is None else _plane_complaint(grid.plane)


def _plane_complaint(plane: Plane) -> str | None:
    centers = plane.centers
    if not 1 <= len(centers) <= _CENTERS:
        return f"{len(centers)} planes; an archive has 1 to {_CENTERS}"
    if any(abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000 for lat, lon in centers):
        return "the centre of a plane is not on the earth"
    return None


def _groups_complaint(groups: Sequence[Group], tracks: int) -> str | None:
    if not groups:
        return "no walks"
    following = 0
    for number, group in enumerate(groups):
        if group.first_track != following or group.tracks < (1 if len(groups) > 1 else 0):
            return f"group {number} holds {group.tracks} tracks from {group.first_track}; track {following} is next"
        following += group.tracks
        if (
            group.time_range is not None
            and not -_LARGEST < group.time_range[0] <= group.time_range[1] < _LARGEST
        ):
            return f"group {number} spans the cells {group.time_range[0]} to {group.time_range[1]}"
    return None if following == tracks else f"walks of {following} tracks, names of {tracks}"


def _can_be_said(error_bound: ErrorBound, version: int) -> bool:
    digits = (
        error_bound.digits in DIGITS
        if error_bound.growth == 0
        else error_bound.digits in GROWN_DIGITS and error_bound.growth in GROWTH_STEPS
    )
    exponent = error_bound.exponent in EXPONENTS or (
        version == OLDEST_VERSION and error_bound.exponent == LAST_OF_VERSION_2
    )
    return digits and exponent and (error_bound.max_digits == 0 or _both_can_be_said(error_bound))


def _both_can_be_said(error_bound: ErrorBound) -> bool:
    over = error_bound.max_exponent - error_bound.exponent
    return (
        error_bound.max_digits in DIGITS
        and over in MAXIMUM_EXPONENTS_ABOVE
        and not error_bound.maximum
        and error_bound.growth == 0
    )


def _rest_complaint(contents: Contents) -> str | None:
    wrong = [
        section.kind
        for section in contents.extras
        if section.kind in _RESERVED_KINDS or not 0 <= section.kind < 256
    ]
    if wrong:
        return f"further sections can't be of kind {wrong[0]}"
    error_bound = contents.error_bound
    if error_bound is not None and not _can_be_said(error_bound, contents.version):
        return f"a promise of {error_bound.digits} * 10^{error_bound.exponent} m, grown by {error_bound.growth} steps"
    if contents.sampling is not None and not 0 <= contents.sampling < STEP_SIZES:
        return f"sampling {contents.sampling}; an archive can name 0 to {STEP_SIZES - 1}"
    return (
        None
        if contents.layer in {None, "bz2"}
        else f"no layer is called {contents.layer!r}; there is 'bz2'"
    )
