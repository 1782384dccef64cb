"""Archives to damage, and means to forge them with right checksums."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

from gpszip.container.contents import Contents, Group, MapReference, Section, single_group_contents
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import Plane, QuantisationGrid

FLAT = QuantisationGrid((0, -5), 7, 128, 120)
FAR = QuantisationGrid((10_000_000_000, -9_999_999_000), 1_200_000_000_000, 128, 120)
FAR_ODD = QuantisationGrid((10_000_000_001, -9_999_999_999), 1_200_000_000_001, 128, 120)
DEGREES = QuantisationGrid(
    (431_000, -262_000), 1_200_000_000_000, 150, 130, Plane(((476_200_000, -1_223_500_000),))
)
DEGREES_ODD = QuantisationGrid(
    (431_123, -262_045), 1_200_000_000_123, 150, 130, Plane(((476_200_000, -1_223_500_000),))
)
DEGREES_FINE = QuantisationGrid(
    (31_000, -262_000), 1_200_000_000_000, 150, 130, Plane(((476_212_345, -1_223_512_345),))
)
WIDE = QuantisationGrid((0, 0), 0, 1, 2, Plane(((1, 2), (-900_000_000, 1_800_000_000))))
TALL = QuantisationGrid((1, 2, 3), 0, 255, 0)


def several(layer: str | None = None) -> Contents:
    groups = (
        Group(0, 2, b"first group", (-5, 100)),
        Group(2, 1, b"second group", (50, 50)),
        Group(3, 3, b"third\xa7SECgroup", None),
    )
    ids = ("a", "b", "c", "00", "01", "ü\n\0")
    return Contents(DEGREES, ids, groups, None, (Section(5, b"kept"), Section(99, b"")), layer)


def small_archives() -> dict[str, Contents]:
    """One archive of every form."""
    return {
        "lone": single_group_contents(FLAT, ("0",), b"walks of one track"),
        "named": single_group_contents(FAR_ODD, ("walk", "bike\n"), b"walks"),
        "numbered": single_group_contents(TALL, ("000", "001"), b""),
        "degrees": single_group_contents(DEGREES, ("u005",), b"\0\0\0"),
        "layered": single_group_contents(FLAT, ("0",), b"walks " * 20, "bz2"),
        "small": Contents(WIDE, ("0",), (Group(0, 1, b"walks"),), None, (Section(5, b"kept"),)),
        "small layered": Contents(
            FLAT, ("0",), (Group(0, 1, b"walks"),), None, (Section(200, b"new"),), "bz2"
        ),
        "no tracks": single_group_contents(FLAT, (), b"a map alone"),
        "large": several(),
        "large layered": several("bz2"),
    }


def archives_with_bounds() -> dict[str, Contents]:
    """Archives with an error bound or on a known map."""
    reference, same_grid = MapReference(b"ABCD", 2), MapReference(b"\0\xff\0\xff")
    group = (Group(0, 1, b"walks"),)
    return {
        "rmse": replace(
            single_group_contents(DEGREES, ("0",), b"walks"), error_bound=ErrorBound(240, -3, False)
        ),
        "maximum": replace(
            single_group_contents(TALL, ("a", "b"), b"walks"), error_bound=ErrorBound(1, 6, True)
        ),
        "small with bound": Contents(
            WIDE, ("0",), group, None, (), None, ErrorBound(999, -8, False)
        ),
        "large with bound": replace(several(), error_bound=ErrorBound(41, 0, False)),
        "both": replace(
            single_group_contents(DEGREES, ("0",), b"walks"),
            error_bound=ErrorBound(300, -2, False, 0, 120, -1),
        ),
        "both and sampling": replace(
            several(), error_bound=ErrorBound(999, 3, False, 0, 1, 6), sampling=7
        ),
        "sampling": replace(single_group_contents(FLAT, ("0",), b"walks"), sampling=255),
        "rmse and sampling": replace(
            single_group_contents(DEGREES, ("0",), b"walks"),
            error_bound=ErrorBound(240, -3, False),
            sampling=0,
        ),
        "large with sampling": replace(several(), sampling=130),
        "extended bound": replace(
            single_group_contents(TALL, ("a", "b"), b"walks"),
            error_bound=ErrorBound(50, -1, False, 16),
        ),
        "extended bound and sampling": replace(
            single_group_contents(FLAT, ("a", "b"), b"walks"),
            error_bound=ErrorBound(99, 6, True, 62),
            sampling=9,
        ),
        "on map": Contents(
            None, None, group, same_grid, error_bound=ErrorBound(5, -1, False), sampling=150
        ),
        "on map, named": Contents(None, ("walk", "bike"), (Group(0, 2, b"walks"),), reference),
        "on map, small": Contents(
            None, ("0",), group, reference, (Section(5, b"kept"),), None, ErrorBound(5, -1, True)
        ),
        "on map, layered": Contents(None, ("0",), group, reference, (), "bz2"),
        "on map, large": replace(several(), grid=None, map=reference),
    }


def crc(data: bytes) -> bytes:
    return struct.pack("<I", zlib.crc32(data))


def number(value: int) -> bytes:
    """Varint of any size, also too large a one."""
    return bytes([value & 127 | 128]) + number(value >> 7) if value > 127 else bytes([value])


def compact(third: int, body: bytes) -> bytes:
    """Archive with one checksum, which is right whatever the body is."""
    data = b"\xa7Z" + bytes([third]) + body
    return data + crc(data)


def section(kind: int, body: bytes, length: int | None = None) -> bytes:
    content = bytes([kind]) + number(len(body) if length is None else length) + body
    return b"\xa7SEC" + content + crc(content)


def large(sections: list[bytes], index_offset: int | None = None, third: int = 0x1A) -> bytes:
    """Archive of sections with the right digest, whatever the sections are."""
    head = b"\xa7Z" + bytes([third])
    offset = 0
    if index_offset is None:
        start = 3
        for section_bytes in sections:
            offset = start if section_bytes[4] == 6 else offset
            start += len(section_bytes)
    else:
        offset = index_offset
    digest = crc(head + b"".join(section_bytes[-4:] for section_bytes in sections))
    return head + b"".join(sections) + section(7, offset.to_bytes(6, "little") + digest)
