"""The quantisation grid of an archive as bytes."""

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

#: Units of the centres of planes, in 1e-7 degrees. Hundredths of a degree take half the bytes, and
#: the centre of a plane may be that coarse.
_FINE = 1
_COARSE = 100_000

#: Bytes of a coordinate of a centre in each unit.
_CENTER_BYTES = {_FINE: 4, _COARSE: 2}

#: Two bits that tell the shape of a grid, see :func:`short_grid_shape`.
_SHAPE_XYZ = 1
_SHAPE_FINE_PLANE = 2
_SHAPE_COARSE_PLANE = 3

#: Kinds of centres in the first number of a grid of any shape.
_NO_CENTERS = 0
_FINE_CENTERS = 1
_COARSE_CENTERS = 2

#: Most coordinates of a grid.
_MAX_DIMENSION = 15

#: Thousandths in a whole metre or second.
_THOUSAND = 1000


def has_whole_units(grid: QuantisationGrid) -> bool:
    """Whether origin and epoch are whole metres and seconds."""
    return all(value % _THOUSAND == 0 for value in (*grid.origin, grid.epoch))


def fits_head(grid: QuantisationGrid) -> bool:
    """Whether two bits can tell the grid's shape: x, y; x, y, z; or x, y on one plane."""
    if grid.plane is None:
        return grid.dimension in {2, 3}
    return grid.dimension == 2 and len(grid.plane.centers) == 1


def short_grid_shape(grid: QuantisationGrid) -> int:
    """Two bits: 0 is x, y; 1 is x, y, z; 2 is a plane with a fine centre; 3 one with a coarse."""
    if grid.plane is None:
        # The shape 0 is x, y and 1 is x, y, z.
        return grid.dimension - 2
    return _SHAPE_COARSE_PLANE if _center_unit(grid.plane) == _COARSE else _SHAPE_FINE_PLANE


def encode_short_grid(grid: QuantisationGrid) -> bytes:
    """Grid of an archive whose head tells the shape: the centre of the plane, the numbers."""
    centers = b"" if grid.plane is None else _encode_centers(grid.plane)
    return centers + _encode_numbers(grid)


def read_short_grid(cursor: Cursor, shape: int, whole_units: bool) -> QuantisationGrid:
    """Undo :func:`encode_short_grid`, given the bits of the head."""
    plane = None
    if shape >= _SHAPE_FINE_PLANE:
        plane = _read_centers(cursor, 1, _COARSE if shape == _SHAPE_COARSE_PLANE else _FINE)
    return _read_numbers(cursor, 3 if shape == _SHAPE_XYZ else 2, whole_units, plane)


def encode_grid(grid: QuantisationGrid) -> bytes:
    """Grid of any shape: a varint of whole units, kind of centres, dimension; planes; numbers."""
    kind = _NO_CENTERS
    if grid.plane is not None:
        kind = _COARSE_CENTERS if _center_unit(grid.plane) == _COARSE else _FINE_CENTERS
    # Bit 0 tells whole units, bits 1 and 2 the kind of centres, and the rest is the dimension.
    shape = encode_varint(int(has_whole_units(grid)) | kind << 1 | grid.dimension << 3)
    if grid.plane is None:
        return shape + _encode_numbers(grid)
    count = encode_varint(len(grid.plane.centers))
    return shape + count + _encode_centers(grid.plane) + _encode_numbers(grid)


def read_grid(cursor: Cursor) -> QuantisationGrid:
    """Undo :func:`encode_grid`."""
    shape = cursor.read_varint("the grid's shape")
    whole_units, kind, dimension = bool(shape & 1), shape >> 1 & 3, shape >> 3
    if kind > _COARSE_CENTERS or not 1 <= dimension <= _MAX_DIMENSION:
        raise cursor.error(f"no grid has the shape {shape}")
    plane = None
    if kind != _NO_CENTERS:
        count = cursor.read_varint("the number of planes")
        plane = _read_centers(cursor, count, _COARSE if kind == _COARSE_CENTERS else _FINE)
    return _read_numbers(cursor, dimension, whole_units, plane)


def _center_unit(plane: Plane) -> int:
    """Unit in which the centres of a plane are stored."""
    values = [value for center in plane.centers for value in center]
    return _COARSE if all(value % _COARSE == 0 for value in values) else _FINE


def _encode_centers(plane: Plane) -> bytes:
    """Latitude and longitude of each centre."""
    unit = _center_unit(plane)
    values = [value // unit for center in plane.centers for value in center]
    # 180 degrees are 18,000 hundredths or 1.8e9 fine units, which fit 16 and 32 signed bits.
    return b"".join(value.to_bytes(_CENTER_BYTES[unit], "little", signed=True) for value in values)


def _read_centers(cursor: Cursor, count: int, unit: int) -> Plane:
    """Undo :func:`_encode_centers`."""
    size = _CENTER_BYTES[unit]
    data = cursor.read_bytes(2 * size * count, "the planes' centres")
    values = [
        int.from_bytes(data[i : i + size], "little", signed=True) * unit
        for i in range(0, len(data), size)
    ]
    return Plane(tuple(zip(values[::2], values[1::2], strict=True)))


def _encode_numbers(grid: QuantisationGrid) -> bytes:
    """Indices of the steps of space and time, epoch, origin."""
    # Whole metres and seconds are smaller numbers, which take fewer bytes.
    unit = _THOUSAND if has_whole_units(grid) else 1
    steps = bytes([grid.space, grid.time])
    return steps + b"".join(encode_signed(value // unit) for value in (grid.epoch, *grid.origin))


def _read_numbers(
    cursor: Cursor, dimension: int, whole_units: bool, plane: Plane | None
) -> QuantisationGrid:
    """Undo :func:`_encode_numbers`."""
    unit = _THOUSAND if whole_units else 1
    space = cursor.read_byte("the index of the space step")
    time = cursor.read_byte("the index of the time step")
    epoch = cursor.read_signed("the epoch") * unit
    origin = tuple(cursor.read_signed("the origin") * unit for _ in range(dimension))
    return QuantisationGrid(origin, epoch, space, time, plane)
