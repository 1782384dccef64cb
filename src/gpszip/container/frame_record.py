"""The frame of an archive as bytes."""

from __future__ import annotations

from gpszip.container.layout import Cursor, signed, varint
from gpszip.model.frame import Frame, Plane

__all__ = ["fits_head", "frame_bytes", "is_whole", "read_frame", "read_short_frame", "short_frame_bytes", "short_shape"]

#: Centres in hundredths of a degree take half the bytes; the plane's centre is free to be that coarse.
_COARSE = 100_000
_CENTER_BYTES = {1: 4, _COARSE: 2}


def is_whole(frame: Frame) -> bool:
    """Whether origin and epoch are whole metres and seconds."""
    return all(value % 1000 == 0 for value in (*frame.origin, frame.epoch))


def fits_head(frame: Frame) -> bool:
    """Whether the two bits in an archive's third byte can tell the frame's shape: x,y or x,y,z, or x,y on one plane."""
    return frame.dimension in {2, 3} if frame.plane is None else frame.dimension == 2 and len(frame.plane.centers) == 1


def short_shape(frame: Frame) -> int:
    """Two bits: 0 is x,y; 1 is x,y,z; 2 is a plane with a fine centre; 3 one with a coarse centre."""
    if frame.plane is None:
        return frame.dimension - 2
    return 3 if _unit(frame.plane) == _COARSE else 2


def short_frame_bytes(frame: Frame) -> bytes:
    """Frame of an archive whose head tells the shape."""
    return (b"" if frame.plane is None else _centers_bytes(frame.plane)) + _numbers_bytes(frame)


def read_short_frame(cursor: Cursor, shape: int, whole: bool) -> Frame:
    """Undo :func:`short_frame_bytes`, given the head's bits."""
    plane = _read_centers(cursor, 1, _COARSE if shape == 3 else 1) if shape >= 2 else None
    return _read_numbers(cursor, 3 if shape == 1 else 2, whole, plane)


def frame_bytes(frame: Frame) -> bytes:
    """Frame of any shape: a varint of (whole units, kind of centres, dimension), the planes, the numbers."""
    unit = 0 if frame.plane is None else (2 if _unit(frame.plane) == _COARSE else 1)
    head = varint(int(is_whole(frame)) | unit << 1 | frame.dimension << 3)
    if frame.plane is None:
        return head + _numbers_bytes(frame)
    return head + varint(len(frame.plane.centers)) + _centers_bytes(frame.plane) + _numbers_bytes(frame)


def read_frame(cursor: Cursor) -> Frame:
    """Undo :func:`frame_bytes`."""
    shape = cursor.varint("the frame's shape")
    unit, dimension = shape >> 1 & 3, shape >> 3
    if unit == 3 or not 1 <= dimension <= 15:
        raise cursor.fail(f"no frame has the shape {shape}")
    plane = _read_centers(cursor, cursor.varint("the number of planes"), _COARSE if unit == 2 else 1) if unit else None
    return _read_numbers(cursor, dimension, bool(shape & 1), plane)


def _unit(plane: Plane) -> int:
    return _COARSE if all(value % _COARSE == 0 for center in plane.centers for value in center) else 1


def _centers_bytes(plane: Plane) -> bytes:
    unit = _unit(plane)
    values = [value // unit for center in plane.centers for value in center]
    return b"".join(value.to_bytes(_CENTER_BYTES[unit], "little", signed=True) for value in values)


def _read_centers(cursor: Cursor, count: int, unit: int) -> Plane:
    size = _CENTER_BYTES[unit]
    raw = cursor.take(2 * size * count, "the planes' centres")
    values = [int.from_bytes(raw[i : i + size], "little", signed=True) * unit for i in range(0, len(raw), size)]
    return Plane(tuple(zip(values[::2], values[1::2], strict=True)))


def _numbers_bytes(frame: Frame) -> bytes:
    unit = 1000 if is_whole(frame) else 1
    numbers = (frame.epoch, *frame.origin)
    return bytes([frame.space, frame.time]) + b"".join(signed(value // unit) for value in numbers)


def _read_numbers(cursor: Cursor, dimension: int, whole: bool, plane: Plane | None) -> Frame:
    space, time = cursor.byte("the quantum of space"), cursor.byte("the quantum of time")
    unit = 1000 if whole else 1
    epoch = cursor.signed("the epoch") * unit
    origin = tuple(cursor.signed("the origin") * unit for _ in range(dimension))
    return Frame(origin, epoch, space, time, plane)
