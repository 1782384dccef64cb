"""Telemetry logs of ground stations (.tlog): MAVLink frames with the time of receipt.

Each frame follows its time, microseconds since 1970 in eight bytes, the highest one first. Frames
of version 1 and 2 may be mixed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.point_batches import Findings, PointBatch, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["read_tlog", "starts_with_frames"]

#: Bytes of the time before a frame.
_TIME_BYTES = 8

#: First bytes of frames of version 1 and 2, bytes before their payload, and of a checksum.
_V1, _V2 = 0xFE, 0xFD
_HEADERS = {_V1: 6, _V2: 10}
_CHECKSUM_BYTES = 2

#: What begins a frame.
_MARK = re.compile(rb"[\xfd\xfe]")

#: The flag of a frame of version 2 that is signed, and the bytes of a signature.
_SIGNED, _SIGNATURE_BYTES = 1, 13

#: Numbers of the messages with positions, as measured and as estimated.
_GPS, _GLOBAL = 24, 33

#: What the checksum of each adds, so that other versions of a message don't pass for it.
_EXTRA = {_GPS: 24, _GLOBAL: 104}

#: Fields of the messages, without those that were added later.
_PAYLOADS = {
    _GPS: np.dtype(
        [
            ("time_usec", "<u8"),
            ("lat", "<i4"),
            ("lon", "<i4"),
            ("alt", "<i4"),
            ("eph", "<u2"),
            ("epv", "<u2"),
            ("speed", "<u2"),
            ("course", "<u2"),
            ("fix_type", "u1"),
            ("satellites", "u1"),
        ]
    ),
    _GLOBAL: np.dtype(
        [
            ("time_boot_ms", "<u4"),
            ("lat", "<i4"),
            ("lon", "<i4"),
            ("alt", "<i4"),
            ("relative_alt", "<i4"),
            ("vx", "<i2"),
            ("vy", "<i2"),
            ("vz", "<i2"),
            ("heading", "<u2"),
        ]
    ),
}

#: Names of the messages.
_NAMES = {_GPS: "GPS_RAW_INT", _GLOBAL: "GLOBAL_POSITION_INT"}

#: Bytes of a frame, at most, with the time before it.
_MAX_BYTES = 8 + 10 + 255 + 2 + 13

#: Times of frames: from 2000 to 2100, in microseconds.
_TIMES = (946_684_800_000_000, 4_102_444_800_000_000)

#: Frames by which a file is recognised.
_SNIFFED_FRAMES = 3

#: Bytes that are read at a time.
_CHUNK_BYTES = 1 << 22

#: Smallest type of a fix with a position: 2-D.
_FIX = 2

#: Numbers of 16 bits that stand for no value.
_NO_VALUE = 65_535

#: Decimals of degrees and metres.
_E7_DECIMALS = 7
_MM_DECIMALS = 3

Floats = NDArray[np.float64]
Rows = NDArray[np.void]


def starts_with_frames(head: bytes) -> bool:
    r"""Whether a file that starts like this is a telemetry log.

    Examples
    --------
    >>> frame = (1_700_000_000_000_000).to_bytes(8, "big") + b"\xfe\x00\x00\x01\x01\x00\x00\x00"
    >>> starts_with_frames(3 * frame), starts_with_frames(b"t,x,y\n0,1,2\n")
    (True, False)
    """
    position = 0
    for _ in range(_SNIFFED_FRAMES):
        size = _size(head, position)
        if size is None:
            return False
        position += size
        if position == len(head):
            break
    return position > 0


def read_tlog(source: Source, request: Request) -> RawLog:
    """Read the positions of a telemetry log.

    They come from GPS_RAW_INT messages, else from GLOBAL_POSITION_INT; the two are never mixed.
    Each vehicle is a track. Times are those of receipt. Messages with a wrong checksum and
    positions without a fix are dropped and counted.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt in metres, speed in m/s, course and heading in degrees, satellites.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If there is no position.
    """
    return read_points(source, request, _parse)


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no position with a fix in this telemetry log"
    findings.remedy = "choose a log of a flight with GPS"
    # Collect frames. The last ones in memory may go on in the next chunk.
    walker = _Walker()
    rest = b""
    with source.open() as stream:
        while chunk := read_chunk(stream, _CHUNK_BYTES):
            data = rest + chunk
            rest = data[walker.walk(data, is_last=False) :]
    rest = rest[walker.walk(rest, is_last=True) :]
    findings.count("bytes that are no message passed over", walker.skipped + len(rest))

    # The two kinds of messages repeat each other.
    batches = {number: _batch(number, frames, findings) for number, frames in walker.frames.items()}
    chosen = next((n for n in (_GPS, _GLOBAL) if n in batches and len(batches[n].times)), None)
    for number, batch in batches.items():
        if number == chosen:
            yield batch
        elif chosen is not None:
            what = f"positions of {_NAMES[number]} ignored beside {_NAMES[chosen]}"
            findings.count(what, len(batch.times))


# Frames


def _size(data: bytes, position: int) -> int | None:
    """Return the bytes of a frame with its time, as far as it is there; None if it is no frame."""
    start = position + _TIME_BYTES
    if start + 3 > len(data) or data[start] not in _HEADERS:
        return None
    if not _TIMES[0] <= int.from_bytes(data[position:start], "big") < _TIMES[1]:
        return None
    is_signed = data[start] == _V2 and data[start + 2] & _SIGNED
    size = _TIME_BYTES + _HEADERS[data[start]] + data[start + 1] + _CHECKSUM_BYTES
    return size + (_SIGNATURE_BYTES if is_signed else 0)


@dataclass
class _Walker:
    """Finds frames in the bytes of a file.

    Parameters
    ----------
    frames : dict of int to list of bytes
        Frames with positions, with their times, by the number of the message.
    skipped : int
        Bytes that are no frame.
    """

    frames: dict[int, list[bytes]] = field(default_factory=dict)
    skipped: int = 0

    def walk(self, data: bytes, *, is_last: bool) -> int:
        """Read the frames in some bytes, and return where those begin that need more of the file.

        Parameters
        ----------
        data : bytes
            The bytes.
        is_last : bool
            Whether the file ends with them.
        """
        position = 0
        end = len(data) if is_last else len(data) - _MAX_BYTES
        while position < end:
            size = _size(data, position)
            if size is None or position + size > len(data):
                # Go on where the next frame may begin.
                start = _MARK.search(data, position + _TIME_BYTES + 1)
                following = start.start() - _TIME_BYTES if start else end
                self.skipped += following - position
                position = following
                continue

            # Keep those with positions.
            frame = data[position : position + size]
            number = _number(frame)
            if number in _EXTRA:
                self.frames.setdefault(number, []).append(frame)
            position += size
        return position


def _number(frame: bytes) -> int:
    """Return the number of the message in a frame."""
    if frame[_TIME_BYTES] == _V1:
        return frame[_TIME_BYTES + 5]
    return int.from_bytes(frame[_TIME_BYTES + 7 : _TIME_BYTES + 10], "little")


def _batch(number: int, frames: list[bytes], findings: Findings) -> PointBatch:
    """Return the positions in the frames of one message."""
    # Leave out damaged frames.
    right = _have_right_checksums(frames, _EXTRA[number])
    findings.count("messages with a wrong checksum dropped", (~right).sum(), drops=True)
    frames = [frame for frame, is_right in zip(frames, right.tolist(), strict=True) if is_right]

    # Version 2 leaves out zeros at the end of a payload, and may add fields.
    kind = _PAYLOADS[number]
    payloads = b"".join(
        _payload(frame)[: kind.itemsize].ljust(kind.itemsize, b"\0") for frame in frames
    )
    rows = np.frombuffer(payloads, kind)
    times = np.frombuffer(b"".join(frame[:_TIME_BYTES] for frame in frames), ">u8") / 1e6
    systems = [frame[_TIME_BYTES + (3 if frame[_TIME_BYTES] == _V1 else 5)] for frame in frames]

    # Positions before a fix are zeros.
    coordinates = np.stack([rows["lat"], rows["lon"]], axis=1)
    is_fix = (coordinates != 0).any(axis=1)
    if number == _GPS:
        is_fix &= rows["fix_type"] >= _FIX
    findings.count("positions without a fix dropped", (~is_fix).sum(), drops=True)
    names = np.array([f"vehicle {system}" for system in systems], object)
    return PointBatch(
        times[is_fix],
        np.round(coordinates[is_fix] / 1e7, _E7_DECIMALS),
        {name: values[is_fix] for name, values in _attributes(rows).items()},
        names[is_fix] if len(set(systems)) > 1 else None,
    )


def _payload(frame: bytes) -> bytes:
    start = _TIME_BYTES + _HEADERS[frame[_TIME_BYTES]]
    return frame[start : start + frame[_TIME_BYTES + 1]]


def _attributes(rows: Rows) -> dict[str, NDArray[np.generic]]:
    """Return what the messages say besides the position; all kinds have the same names."""
    # Directions and speeds are in hundredths.
    names = rows.dtype.names or ()
    missing = np.full(len(rows), np.nan)

    def hundredths(name: str) -> Floats:
        if name not in names:
            return missing
        return np.where(rows[name] == _NO_VALUE, np.nan, rows[name] / 100)

    # Estimates have speeds to north and east.
    is_global = "vx" in names
    east, north = (rows["vy"], rows["vx"]) if is_global else (missing, missing)
    velocity = np.hypot(east.astype(np.float64), north.astype(np.float64))
    return {
        "alt": np.round(rows["alt"] / 1e3, _MM_DECIMALS),
        "speed": np.round(velocity / 100, _MM_DECIMALS) if is_global else hundredths("speed"),
        "course": hundredths("course"),
        "heading": hundredths("heading"),
        "satellites": rows["satellites"].astype(np.float64) if "satellites" in names else missing,
    }


def _have_right_checksums(frames: list[bytes], extra: int) -> NDArray[np.bool_]:
    r"""Whether the checksum of each frame is right.

    The checksum is CRC-16/MCRF4XX over all but the first byte, and the extra byte of the message:
    for each byte b, t = (b ^ crc) & 255, t ^= t << 4 (mod 256), and
    crc = (crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4).
    """
    # All frames are checked together, byte by byte.
    sizes = [_HEADERS[frame[_TIME_BYTES]] + frame[_TIME_BYTES + 1] for frame in frames]
    longest = max(sizes, default=0)
    checked = [
        (frame[_TIME_BYTES + 1 : _TIME_BYTES + size] + bytes([extra])).ljust(longest, b"\0")
        for frame, size in zip(frames, sizes, strict=True)
    ]
    table = np.frombuffer(b"".join(checked), np.uint8).reshape(len(frames), longest)
    lengths = np.array(sizes, np.int64)
    crc = np.full(len(frames), 0xFFFF, np.uint16)
    for i in range(longest):
        t = (table[:, i] ^ crc) & 0xFF
        t = (t ^ (t << 4)) & 0xFF
        crc = np.where(i < lengths, (crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4), crc)

    # It follows the payload, the low byte first.
    ends = [_TIME_BYTES + size for size in sizes]
    stated = [
        int.from_bytes(frame[end : end + 2], "little")
        for frame, end in zip(frames, ends, strict=True)
    ]
    return np.asarray(crc == np.array(stated, np.uint16))
