"""What an archive holds, before any of it is understood as map or walk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from gpszip.container.layout import OLDEST, VERSION
from gpszip.model.frame import MOST_HALVINGS, QUANTUM_STEPS, Frame, Plane
from gpszip.model.promise import DIGITS, EXPONENTS, FEW_DIGITS, GROWN, LAST_OF_VERSION_2, MOST_OVER, Promise

__all__ = ["LONE_ID", "MAP_HASH_BYTES", "Contents", "Group", "MapReference", "Section", "Spooled", "complaint", "one_group"]

#: Name of the track of a log that names none.
LONE_ID = "0"

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
    span : (int, int), optional
        First and last time cell of the group's knots. An archive of a single group does not keep it.
    """

    first_track: int
    tracks: int
    payload: bytes
    span: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Spooled:
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
        return b"".join(self.pieces())

    def pieces(self) -> Iterator[bytes]:
        """Yield them one after the other."""
        self.file.seek(0)
        for first in range(0, self.size, _PIECE):
            yield self.file.read(min(_PIECE, self.size - first))


@dataclass(frozen=True)
class Section:
    """Bytes of a kind that the container does not look into: kept attributes, or what a later version added."""

    kind: int
    body: bytes | Spooled


@dataclass(frozen=True)
class MapReference:
    """A map that is kept elsewhere, after whose walks those of an archive are coded.

    Parameters
    ----------
    hash : bytes of length 4
        Names the map, see :func:`gpszip.container.map_record.map_hash`.
    halvings : int
        How often the map's quanta are halved, 0 to 3.
    """

    hash: bytes
    halvings: int = 0


@dataclass(frozen=True)
class Contents:
    """Everything in an archive.

    Parameters
    ----------
    frame : Frame or None
        Where positions and times lie; None where a map kept elsewhere tells.
    ids : tuple of str or None
        Names of the tracks in the order in which the walks are coded; None for one track that is called as the first of the
        map kept elsewhere.
    groups : tuple of Group
        At least one; together they hold each track once, in order.
    map : MapReference, optional
        The map, where it is kept elsewhere.
    extras : tuple of Section, optional
        Further sections in their order.
    layer : {None, "bz2"}, default None
        What the payloads are wrapped in inside the file; in ``groups`` they are unwrapped.
    promise : Promise, optional
        The error that the walks keep.
    sampling : int, optional
        Index of the quantum that is about the time between two samples of the log.
    version : int
        Version of the format in which the walks are coded.
    """

    frame: Frame | None
    ids: tuple[str, ...] | None
    groups: tuple[Group, ...]
    map: MapReference | None = None
    extras: tuple[Section, ...] = ()
    layer: str | None = None
    promise: Promise | None = None
    sampling: int | None = None
    version: int = VERSION

    @property
    def ends(self) -> bool:
        """Whether walks with times tell where their pieces begin and end."""
        return self.version > OLDEST

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return 1 if self.ids is None else len(self.ids)

    @property
    def plain(self) -> bool:
        """Whether there is but one group with nothing around or beside it."""
        return len(self.groups) == 1 and not self.extras and self.layer is None


def one_group(frame: Frame, ids: tuple[str, ...], payload: bytes, layer: str | None = None) -> Contents:
    """Contents of an archive whose walks are all coded together.

    Examples
    --------
    >>> from gpszip.model.frame import Frame, Plane
    >>> one_group(Frame((0, 0), 0, 128, 128), ("0",), b"walks").groups[0].tracks
    1
    """
    return Contents(frame, ids, (Group(0, len(ids), payload),), layer=layer)


def complaint(contents: Contents) -> str | None:
    """What keeps the contents from being an archive; None if nothing does."""
    return _place_complaint(contents) or _groups_complaint(contents.groups, contents.tracks) or _rest_complaint(contents)


def _place_complaint(contents: Contents) -> str | None:
    if (contents.frame is None) == (contents.map is None):
        return "neither a frame nor a map" if contents.frame is None else "both a frame and a map"
    if contents.frame is not None:
        return "no names" if contents.ids is None else _frame_complaint(contents.frame)
    if contents.map is not None and len(contents.map.hash) != MAP_HASH_BYTES:
        return f"the map's hash has {len(contents.map.hash)} bytes, not {MAP_HASH_BYTES}"
    if contents.map is not None and not 0 <= contents.map.halvings <= MOST_HALVINGS:
        return f"quanta halved {contents.map.halvings} times; at most {MOST_HALVINGS} are"
    return "no names" if contents.ids is None and not contents.plain else None


def _frame_complaint(frame: Frame) -> str | None:
    if not 1 <= frame.dimension <= _DIMENSIONS:
        return f"{frame.dimension} axes; an archive has 1 to {_DIMENSIONS}"
    if any(abs(value) >= _LARGEST for value in (*frame.origin, frame.epoch)):
        return "origin or epoch beyond 2^62 thousandths"
    if not (0 <= frame.space < 256 and 0 <= frame.time < 256):
        return f"quanta {frame.space} and {frame.time}; an archive can name 0 to 255"
    return None if frame.plane is None else _plane_complaint(frame.plane)


def _plane_complaint(plane: Plane) -> str | None:
    centers = plane.centers
    if not 1 <= len(centers) <= _CENTERS:
        return f"{len(centers)} planes; an archive has 1 to {_CENTERS}"
    if any(abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000 for lat, lon in centers):
        return "the centre of a plane is not on the earth"
    return None


def _groups_complaint(groups: tuple[Group, ...], tracks: int) -> str | None:
    if not groups:
        return "no walks"
    following = 0
    for number, group in enumerate(groups):
        if group.first_track != following or group.tracks < (1 if len(groups) > 1 else 0):
            return f"group {number} holds {group.tracks} tracks from {group.first_track}; track {following} is next"
        following += group.tracks
        if group.span is not None and not -_LARGEST < group.span[0] <= group.span[1] < _LARGEST:
            return f"group {number} spans the cells {group.span[0]} to {group.span[1]}"
    return None if following == tracks else f"walks of {following} tracks, names of {tracks}"


def _can_be_said(promise: Promise, version: int) -> bool:
    digits = promise.digits in DIGITS if promise.grown == 0 else promise.digits in FEW_DIGITS and promise.grown in GROWN
    exponent = promise.exponent in EXPONENTS or (version == OLDEST and promise.exponent == LAST_OF_VERSION_2)
    return digits and exponent and (promise.most_digits == 0 or _both_can_be_said(promise))


def _both_can_be_said(promise: Promise) -> bool:
    over = promise.most_exponent - promise.exponent
    return promise.most_digits in DIGITS and over in MOST_OVER and not promise.maximum and promise.grown == 0


def _rest_complaint(contents: Contents) -> str | None:
    wrong = [section.kind for section in contents.extras if section.kind in _RESERVED_KINDS or not 0 <= section.kind < 256]
    if wrong:
        return f"further sections can't be of kind {wrong[0]}"
    promise = contents.promise
    if promise is not None and not _can_be_said(promise, contents.version):
        return f"a promise of {promise.digits} * 10^{promise.exponent} m, grown by {promise.grown} steps"
    if contents.sampling is not None and not 0 <= contents.sampling < QUANTUM_STEPS:
        return f"sampling {contents.sampling}; an archive can name 0 to {QUANTUM_STEPS - 1}"
    return None if contents.layer in {None, "bz2"} else f"no layer is called {contents.layer!r}; there is 'bz2'"
