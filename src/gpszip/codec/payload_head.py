"""The head of a walks payload: modes, flags and the number of knots, before the range coder."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.errors import CorruptArchiveError

__all__ = [
    "FREE_KNOTS",
    "KNOTS_PER_BYTE",
    "MAX_SORTED_TRACKS",
    "SHORTEST_PATHS",
    "SORTED_STARTS",
    "TIME_FIRST",
    "PayloadHead",
    "encode_head",
    "has_times",
    "read_head",
]

#: Modes; any of them may be on.
SORTED_STARTS = 1  # starts of all tracks come first, in the order of time
TIME_FIRST = 2  # the duration of a step to a new node comes before its position
SHORTEST_PATHS = 4  # walks may name a target, to which they take the shortest path

#: Starts of at most this many tracks are sorted: taking one counts those passed over.
MAX_SORTED_TRACKS = 4096

#: Flags in the first number, below the number of knots: there are times, there are gaps.
_TIMED = 1
_GAPPED = 2
_FLAG_BITS = 2

#: The first number is at least this, since there is a knot: a first byte below it names modes
#: (docs/format.md); after a zero, one more byte does.
_FIRST_VARINT = 4

#: A number takes at most this many bytes.
_VARINT_BYTES = 9

#: A payload holds at most this many knots for each byte, and some more, so that forged counts
#: cannot ask for memory.
KNOTS_PER_BYTE = 512
FREE_KNOTS = 4096


@dataclass(frozen=True)
class PayloadHead:
    """What a walks payload says before its first knot.

    Parameters
    ----------
    modes : int
        A sum of ``SORTED_STARTS``, ``TIME_FIRST`` and ``SHORTEST_PATHS``.
    knots : int
        Number of knots of all tracks.
    timed, gapped : bool
        Whether times are kept, and whether there is any gap.
    """

    modes: int
    knots: int
    timed: bool
    gapped: bool


def encode_head(head: PayloadHead) -> bytes:
    """Bytes of a head: modes if there are any, then a varint of the knots times 4 plus flags.

    Examples
    --------
    >>> encode_head(PayloadHead(0, 1, True, False)).hex()
    '05'
    """
    flags = _TIMED * head.timed + _GAPPED * head.gapped
    return _mode_bytes(head.modes) + _encode_varint((head.knots << _FLAG_BITS) + flags)


def read_head(data: bytes, tracks: int) -> tuple[PayloadHead, bytes]:
    """Undo :func:`encode_head`.

    Parameters
    ----------
    data : bytes
        A payload, not trusted.
    tracks : int
        Number of its tracks.

    Returns
    -------
    PayloadHead
        With a number of knots that so many bytes may hold.
    bytes
        What follows: the bytes of the range coder.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no head of so many tracks.

    Examples
    --------
    >>> head, rest = read_head(bytes.fromhex("05efbdc0"), tracks=1)
    >>> head.knots, head.timed, rest.hex()
    (1, True, 'efbdc0')
    """
    # Without tracks, the first number is the flags alone, which would pass for modes.
    modes, data = _read_modes(data) if tracks else (0, data)
    number, size = _read_varint(data)
    payload, knots = data[size:], number >> _FLAG_BITS
    head = PayloadHead(modes, knots, bool(number & _TIMED), bool(number & _GAPPED))

    # The number of knots must be plausible.
    if (
        knots > FREE_KNOTS + KNOTS_PER_BYTE * len(payload)
        or knots < tracks
        or (tracks == 0) != (knots == 0)
    ):
        raise CorruptArchiveError(
            f"{knots} knots of {tracks} tracks can't lie in {len(payload)} bytes of walks"
        )
    if modes & SORTED_STARTS and not (head.timed and tracks <= MAX_SORTED_TRACKS):
        raise CorruptArchiveError("starts of tracks can't be sorted here")
    return head, payload


def has_times(payload: bytes) -> bool:
    """Whether a payload keeps times of any track.

    Examples
    --------
    >>> has_times(bytes.fromhex("05efbdc0")), has_times(bytes([4]))
    (True, False)
    """
    # Skip the modes.
    skipped = 0
    if payload and payload[0] < _FIRST_VARINT:
        skipped = 1 if payload[0] else 2

    # a payload without knots is one byte, which is the varint
    head = 0
    if payload:
        head = payload[skipped] if skipped < len(payload) else payload[0]
    return bool(head & _TIMED)


def _mode_bytes(modes: int) -> bytes:
    """Bytes before the first number where modes are on: the modes, with a zero ahead from 4 on."""
    if modes == 0:
        return b""
    return bytes([modes]) if modes < _FIRST_VARINT else bytes([0, modes])


def _read_modes(data: bytes) -> tuple[int, bytes]:
    """Undo :func:`_mode_bytes`; return the modes, and the bytes after them."""
    if not data or data[0] >= _FIRST_VARINT:
        return 0, data

    # One byte, or a zero and one more; no writer makes the longer form of the shorter.
    if data[0]:
        modes, rest = data[0], data[1:]
    else:
        modes, rest = data[1] if len(data) > 1 else 0, data[2:]
    if (
        _mode_bytes(modes) != data[: len(data) - len(rest)]
        or modes > SORTED_STARTS | TIME_FIRST | SHORTEST_PATHS
    ):
        raise CorruptArchiveError("the walks are coded in a way that this version doesn't know")
    return modes, rest


def _encode_varint(value: int) -> bytes:
    """Seven bits in each byte, the lowest first; all bytes but the last have the eighth bit set."""
    out = bytearray()
    while value >= 128:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: bytes) -> tuple[int, int]:
    """Undo :func:`_encode_varint`; return the number, and how many bytes it takes."""
    # Nine bytes hold 63 bits. Without a limit, forged bytes would make an integer of any size.
    value = 0
    for i, byte in enumerate(data[:_VARINT_BYTES]):
        value |= (byte & 127) << (7 * i)
        if byte < 128:
            return value, i + 1
    raise CorruptArchiveError("the walks have no count")
