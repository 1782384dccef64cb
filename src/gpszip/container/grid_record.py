"""The frame of an archive as bytes."""

from __future__ import annotations

from gpszip.container.layout import Cursor, encode_signed, encode_varint
from gpszip.model.grid import Plane, QuantisationGrid

__all__ = [
    "encode_grid",
    "encode_short_grid",
    "fits_head",
    "has_whole_units",
    "read_grid",
    "read_short_grid",
    "short_grid_shape",
]

#: Centres in hundredths of a degree take half the bytes; the plane's centre is free to be that coarse.
_COARSE = 100_000
_CENTER_BYTES = {1: 4, _COARSE: 2}


def has_whole_units(grid: QuantisationGrid) -> bool:
    """Whether origin and epoch are whole metres and seconds."""
    return all(value % 1000 == 0 for value in (*grid.origin, grid.epoch))


def fits_head(grid: QuantisationGrid) -> bool:
    """Whether the two bits in an archive's third byte can tell the frame's shape: x,y or x,y,z, or x,y on one plane."""
    return (
        grid.dimension in {2, 3}
        if grid.plane is None
        else grid.dimension == 2 and len(grid.plane.centers) == 1
    )


def short_grid_shape(grid: QuantisationGrid) -> int:
    """Two bits: 0 is x,y; 1 is x,y,z; 2 is a plane with a fine centre; 3 one with a coarse centre."""
    if grid.plane is None:
        return grid.dimension - 2
    return 3 if _unit(grid.plane) == _COARSE else 2


def encode_short_grid(grid: QuantisationGrid) -> bytes:
    """Frame of an archive whose head tells the shape."""
    return (b"" if grid.plane is None else _centers_bytes(grid.plane)) + _numbers_bytes(grid)


def read_short_grid(cursor: Cursor, shape: int, whole: bool) -> QuantisationGrid:
    """Undo :func:`encode_short_grid`, given the head's bits."""
    plane = _read_centers(cursor, 1, _COARSE if shape == 3 else 1) if shape >= 2 else None
    return _read_numbers(cursor, 3 if shape == 1 else 2, whole, plane)


def encode_grid(grid: QuantisationGrid) -> bytes:
    """Frame of any shape: a varint of (whole units, kind of centres, dimension), the planes, the numbers."""
    unit = 0 if grid.plane is None else (2 if _unit(grid.plane) == _COARSE else 1)
    head = encode_varint(int(has_whole_units(grid)) | unit << 1 | grid.dimension << 3)
    if grid.plane is None:
        return head + _numbers_bytes(grid)
    return (
        head
        + encode_varint(len(grid.plane.centers))
        + _centers_bytes(grid.plane)
        + _numbers_bytes(grid)
    )


def read_grid(cursor: Cursor) -> QuantisationGrid:
    """Undo :func:`encode_grid`."""
    shape = cursor.read_varint("the frame's shape")
    unit, dimension = shape >> 1 & 3, shape >> 3
    if unit == 3 or not 1 <= dimension <= 15:
        raise cursor.error(f"no frame has the shape {shape}")
    plane = (
        _read_centers(
            cursor, cursor.read_varint("the number of planes"), _COARSE if unit == 2 else 1
        )
        if unit
        else None
    )
    return _read_numbers(cursor, dimension, bool(shape & 1), plane)


def _unit(plane: Plane) -> int:
    return (
        _COARSE if all(value % _COARSE == 0 for center in plane.centers for value in center) else 1
    )


def _centers_bytes(plane: Plane) -> bytes:
    unit = _unit(plane)
    values = [value // unit for center in plane.centers for value in center]
    return b"".join(value.to_bytes(_CENTER_BYTES[unit], "little", signed=True) for value in values)


def _read_centers(cursor: Cursor, count: int, unit: int) -> Plane:
    size = _CENTER_BYTES[unit]
    raw = cursor.read_bytes(2 * size * count, "the planes' centres")
    values = [
        int.from_bytes(raw[i : i + size], "little", signed=True) * unit
        for i in range(0, len(raw), size)
    ]
    return Plane(tuple(zip(values[::2], values[1::2], strict=True)))


def _numbers_bytes(grid: QuantisationGrid) -> bytes:
    unit = 1000 if has_whole_units(grid) else 1
    numbers = (grid.epoch, *grid.origin)
    return bytes([grid.space, grid.time]) + b"".join(
        encode_signed(value // unit) for value in numbers
    )


def _read_numbers(
    cursor: Cursor, dimension: int, whole: bool, plane: Plane | None
) -> QuantisationGrid:
    space, time = cursor.read_byte("the quantum of space"), cursor.read_byte("the quantum of time")
    unit = 1000 if whole else 1
    epoch = cursor.read_signed("the epoch") * unit
    origin = tuple(cursor.read_signed("the origin") * unit for _ in range(dimension))
    return QuantisationGrid(origin, epoch, space, time, plane)
