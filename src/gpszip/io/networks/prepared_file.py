"""Prepared network files: roads in blocks by position, so that those near a log are read alone.

docs/format.md describes the file byte by byte.
"""

from __future__ import annotations

import json
import mmap
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import CorruptArchiveError, InputError
from gpszip.io.networks.joining import RoadGraph
from gpszip.io.networks.lines import vertex_rows, within_globe

__all__ = ["PREPARED_MAGIC", "BoxFilter", "read_prepared_file", "write_prepared_file"]

#: First bytes of a prepared network.
PREPARED_MAGIC = b"\xa7ROADS\n\0"

#: Version of the format that is written. Version 1 has no street names.
_VERSION = 2

#: The header: sizes of the file. ``name`` is the length of the metadata, which are JSON.
_HEADER = np.dtype(
    [
        ("magic", "V8"),
        ("version", "<u4"),
        ("flags", "<u4"),
        ("nodes", "<u8"),
        ("roads", "<u8"),
        ("blocks", "<u8"),
        ("name", "<u8"),
    ]
)

#: An entry of the index of blocks. ``box`` is west, south, east, north.
_INDEX_ENTRY = np.dtype(
    [
        ("offset", "<u8"),
        ("size", "<u8"),
        ("roads", "<u4"),
        ("points", "<u4"),
        ("crc", "<u4"),
        ("streets", "<u4"),
        ("box", "<f8", (4,)),
    ]
)

#: Flag of the header: coordinates are degrees.
_GEOGRAPHIC = 1

#: Flag of a road: may be travelled along its line.
_FORWARD = 1

#: Flag of a road: may be travelled against its line.
_BACKWARD = 2

#: Bits of a road's flags below its users.
_USERS_SHIFT = 2

#: Roads in a block: about 100 kB.
_ROADS_IN_BLOCK = 2048

#: Degrees are stored as multiples of 1e-7, about a centimetre.
_UNITS_PER_DEGREE = 1e7

#: The length of a block is a multiple of this many bytes; its start need not be.
_ALIGNMENT = 8

#: Cells along each axis of the curve that orders roads.
_MORTON_CELLS = 65536

#: Given the boxes of blocks, shape (b, 4), and whether they are degrees: which blocks to read.
BoxFilter: TypeAlias = Callable[[NDArray[np.float64], bool], NDArray[np.bool_]]


class _EncodedBlock(NamedTuple):
    """Bytes of a block, its numbers of vertices and street names, and the box of its vertices."""

    body: bytes
    points: int
    streets: int
    box: NDArray[np.float64]


class _Block(NamedTuple):
    """Roads of one or more blocks.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        Vertices of all roads.
    starts, ends : int32 array, shape (e,)
        Nodes of each road, numbered in the full network.
    counts : int32 array, shape (e,)
        Number of vertices of each road.
    speeds : float32 array, shape (e,)
        Expected speeds in m/s, NaN if unknown.
    flags : uint8 array, shape (e,)
        Directions and users.
    ids, names : pyarrow string array of length e
        Ids, and street names or null.
    """

    points: NDArray[np.float64]
    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    counts: NDArray[np.int32]
    speeds: NDArray[np.float32]
    flags: NDArray[np.uint8]
    ids: Any
    names: Any


def write_prepared_file(roads: RoadGraph, stream: BinaryIO) -> int:
    """Write a prepared network.

    Parameters
    ----------
    roads : RoadGraph
        The graph.
    stream : binary file
        Where to write.

    Returns
    -------
    int
        Number of bytes.
    """
    # Neighbours share a block, so that few blocks are read for a small area.
    order = _morton_order(roads)
    blocks = [order[i : i + _ROADS_IN_BLOCK] for i in range(0, len(order), _ROADS_IN_BLOCK)]
    metadata = json.dumps({"name": roads.name}).encode()

    # Header.
    header = np.zeros((), _HEADER)
    header["magic"] = np.void(PREPARED_MAGIC)
    header["version"] = _VERSION
    header["flags"] = _GEOGRAPHIC * roads.geographic
    header["nodes"] = len(roads.nodes)
    header["roads"] = len(roads)
    header["blocks"] = len(blocks)
    header["name"] = len(metadata)

    # Blocks, and the index of them. The first block starts behind the index and its checksum, which
    # has 4 bytes.
    index = np.zeros(len(blocks), _INDEX_ENTRY)
    offset = _HEADER.itemsize + len(metadata) + index.nbytes + 4
    bodies = []
    for entry, chosen in zip(index, blocks, strict=True):
        block = _encode_block(roads, chosen)
        entry["offset"] = offset
        entry["size"] = len(block.body)
        entry["roads"] = len(chosen)
        entry["points"] = block.points
        entry["crc"] = zlib.crc32(block.body)
        entry["streets"] = block.streets
        entry["box"] = block.box
        offset += len(block.body)
        bodies.append(block.body)

    # One checksum covers all that comes before the blocks, which have their own.
    front = header.tobytes() + metadata + index.tobytes()
    stream.write(front + zlib.crc32(front).to_bytes(4, "little"))
    for body in bodies:
        stream.write(body)
    return offset


def _morton_order(roads: RoadGraph) -> NDArray[np.intp]:
    """Order roads along Morton's curve, on which neighbours follow each other.

    The key of a road is the interleaved bits of the cell of its first vertex (Morton 1966). Bits
    are spread by masks, 16 to 32 in four steps.
    """
    # Place the first vertices on a square grid of 65,536 cells a side. The least size avoids a
    # division by zero where all roads start at one position.
    first = roads.coordinates[roads.offsets[:-1]]
    low, size = first.min(axis=0), np.maximum(np.ptp(first, axis=0).max(), 1e-9)
    cells = np.minimum((first - low) / size * _MORTON_CELLS, _MORTON_CELLS - 1).astype(np.uint64)

    # Spread the 16 bits of each cell number to every second bit; then y takes the bits between
    # those of x.
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    return np.argsort(cells[:, 0] | (cells[:, 1] << np.uint64(1)), kind="stable")


def _encode_block(roads: RoadGraph, chosen: NDArray[np.intp]) -> _EncodedBlock:
    # Coordinates and texts.
    counts = np.diff(roads.offsets)[chosen]
    points = roads.coordinates[vertex_rows(roads.offsets, chosen)]
    if roads.geographic:
        stored = np.rint(points * _UNITS_PER_DEGREE).astype("<i4")
    else:
        stored = points.astype("<f8")
    ids = [text.encode() for text in roads.ids.take(pa.array(chosen)).fill_null("").to_pylist()]
    # Street names repeat: a block stores each name once, and the number of its name for each road.
    names = roads.names.take(pa.array(chosen)).dictionary_encode()
    streets = [text.encode() for text in names.dictionary.to_pylist()]

    # Bit 0 is forward, bit 1 backward; the users follow above.
    flags = (
        roads.forward[chosen]
        | roads.backward[chosen].astype(np.uint8) << 1
        | roads.users[chosen] << _USERS_SHIFT
    )

    # Columns, then texts.
    columns = (
        stored,
        roads.starts[chosen].astype("<i4"),
        roads.ends[chosen].astype("<i4"),
        counts.astype("<i4"),
        roads.speeds[chosen].astype("<f4"),
        np.array([len(text) for text in ids], "<i4"),
        names.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype("<i4"),
        np.array([len(street) for street in streets], "<i4"),
        flags.astype("u1"),
    )
    body = b"".join(column.tobytes() for column in columns) + b"".join(ids + streets)
    padding = bytes(-len(body) % _ALIGNMENT)
    box = np.concatenate((points.min(axis=0), points.max(axis=0)))
    return _EncodedBlock(body + padding, len(points), len(streets), box)


def read_prepared_file(
    path: str | Path, name: str, box_filter: BoxFilter | None = None
) -> RoadGraph:
    """Read a prepared network, or chosen blocks of it.

    Parameters
    ----------
    path : str or Path
        The file; it is mapped to memory.
    name : str
        Name of the file in messages.
    box_filter : callable, optional
        Gets the boxes of all blocks, a float64 array of shape (b, 4) with west, south, east and
        north, and whether they are degrees. It returns a bool array: the blocks to read.

    Returns
    -------
    RoadGraph
        Empty if no block is chosen.

    Raises
    ------
    CorruptArchiveError
        If it is damaged or incomplete.
    InputError
        If it can't be opened.
    """
    try:
        with (
            Path(path).open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            return _read(data, name, box_filter)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", path=name) from error


def _read(data: mmap.mmap, name: str, box_filter: BoxFilter | None) -> RoadGraph:
    # Read the blocks.
    header, index = _read_header(data, name)
    geographic = bool(header["flags"] & _GEOGRAPHIC)
    chosen = np.ones(len(index), np.bool_)
    if box_filter is not None:
        chosen = box_filter(index["box"].copy(), geographic)
    blocks = _read_blocks(data, index[chosen], geographic, int(header["version"]), name)
    roads = _concatenate(list(blocks))
    if not _is_valid(roads, geographic):
        raise CorruptArchiveError(
            "a road has no valid position or speed", path=name, remedy="prepare it again"
        )

    # Number the nodes that these blocks use.
    offsets = np.append(0, np.cumsum(roads.counts, dtype=np.int64))
    nodes, ends = np.unique(np.concatenate((roads.starts, roads.ends)), return_inverse=True)
    if len(nodes) and (nodes[0] < 0 or nodes[-1] >= header["nodes"]):
        raise CorruptArchiveError("a road leads to a node that doesn't exist", path=name)
    # The file stores no positions of nodes: a node lies where its roads begin or end.
    count = len(roads.starts)
    positions = np.empty((len(nodes), 2))
    positions[ends[:count]] = roads.points[offsets[:-1]]
    positions[ends[count:]] = roads.points[offsets[1:] - 1]
    return RoadGraph(
        name=name,
        nodes=positions,
        starts=ends[:count].astype(np.int32),
        ends=ends[count:].astype(np.int32),
        offsets=offsets,
        coordinates=roads.points,
        geographic=geographic,
        forward=(roads.flags & _FORWARD) > 0,
        backward=(roads.flags & _BACKWARD) > 0,
        speeds=roads.speeds.astype(np.float64),
        users=(roads.flags >> _USERS_SHIFT).astype(np.uint8),
        ids=roads.ids,
        names=roads.names,
    )


def _is_valid(roads: _Block, geographic: bool) -> bool:
    """Whether vertices are positions, and speeds are speeds or unknown."""
    if geographic:
        has_positions = within_globe(roads.points)
    else:
        has_positions = bool(np.isfinite(roads.points).all())
    return has_positions and not (roads.speeds < 0).any() and not np.isinf(roads.speeds).any()


def _read_header(data: mmap.mmap, name: str) -> tuple[Any, Any]:
    """Return the header and the index, once they are checked."""
    # Check the magic bytes and the version before any other field is interpreted.
    if len(data) < _HEADER.itemsize or data[:8] != PREPARED_MAGIC:
        raise CorruptArchiveError("no prepared network: it does not begin like one", 0, path=name)
    header = np.frombuffer(data, _HEADER, 1)[0].copy()
    if header["version"] > _VERSION:
        raise CorruptArchiveError(
            f"version {header['version']} of prepared networks",
            8,
            path=name,
            remedy="update GPSZip, or prepare it again",
        )

    # Check that the index is complete and intact: the sizes in the header may be damaged.
    start = _HEADER.itemsize + int(header["name"])
    end = start + int(header["blocks"]) * _INDEX_ENTRY.itemsize
    if end + 4 > len(data):
        raise CorruptArchiveError(
            "incomplete: it ends within its index",
            len(data),
            path=name,
            remedy="prepare it again",
        )
    if zlib.crc32(data[:end]) != int.from_bytes(data[end : end + 4], "little"):
        raise CorruptArchiveError("its index is damaged", 0, path=name, remedy="prepare it again")
    return header, np.frombuffer(data[start:end], _INDEX_ENTRY)


def _read_blocks(
    data: mmap.mmap, index: Any, geographic: bool, version: int, name: str
) -> Iterator[_Block]:
    """Yield the blocks of these index entries, once they are checked."""
    # Read each block at the offset in its index entry.
    for entry in index:
        offset, size, roads, points, streets = (
            int(entry[key]) for key in ("offset", "size", "roads", "points", "streets")
        )

        # Check.
        body = data[offset : offset + size]
        if len(body) != size or zlib.crc32(body) != entry["crc"]:
            raise CorruptArchiveError(
                "damaged block of roads", offset, path=name, remedy="prepare it again"
            )

        # Decode. A block with a valid checksum can still contradict itself.
        try:
            yield _decode_block(body, roads, points, streets if version > 1 else None, geographic)
        except (ValueError, IndexError) as error:
            raise CorruptArchiveError(
                "a block of roads contradicts itself",
                offset,
                path=name,
                remedy="prepare it again",
            ) from error


def _decode_block(
    body: bytes, roads: int, points: int, streets: int | None, geographic: bool
) -> _Block:
    """Decode a block with these numbers of roads, vertices and street names.

    Raises
    ------
    ValueError
        If the block contradicts itself.
    """
    # Columns, which follow each other.
    dtypes = [("<i4" if geographic else "<f8", 2 * points)]
    dtypes += [(dtype, roads) for dtype in ("<i4", "<i4", "<i4", "<f4", "<i4")]
    if streets is not None:
        dtypes += [("<i4", roads), ("<i4", streets)]
    dtypes.append(("u1", roads))
    columns: list[Any] = []
    position = 0
    for dtype, count in dtypes:
        columns.append(np.frombuffer(body, dtype, count, position))
        position += columns[-1].nbytes
    flat, starts, ends, counts, speeds, id_lengths = columns[:6]
    # Counts that don't add up would give a road the vertices of others.
    if (counts < 2).any() or counts.sum(dtype=np.int64) != points:
        raise ValueError("numbers of vertices")

    # Texts, which follow the columns.
    ids = _decode_texts(body, position, id_lengths)
    names = pa.nulls(roads, pa.string())
    if streets is not None:
        street_index, street_lengths = columns[6:8]
        street_names = _decode_texts(body, position + int(id_lengths.sum()), street_lengths)
        names = pa.DictionaryArray.from_arrays(
            pa.array(street_index, mask=street_index < 0), street_names
        ).cast(pa.string())
    unit = _UNITS_PER_DEGREE if geographic else 1.0
    vertices = flat.reshape(-1, 2) / unit
    return _Block(vertices, starts, ends, counts, speeds, columns[-1], ids, names)


def _decode_texts(body: bytes, position: int, lengths: NDArray[np.int32]) -> Any:
    """Decode texts of these lengths that start at a byte.

    Raises
    ------
    ValueError
        If they don't fit in the block, or aren't UTF-8.
    """
    offsets = np.append(0, np.cumsum(lengths, dtype=np.int64))
    last = position + offsets[-1]
    # Negative lengths would make texts overlap, and long ones exceed the 32-bit offsets of Arrow.
    if (lengths < 0).any() or last > len(body) or offsets[-1] > np.iinfo(np.int32).max:
        raise ValueError("lengths of texts")
    array = pa.StringArray.from_buffers(
        len(lengths),
        pa.py_buffer(offsets.astype(np.int32).tobytes()),
        pa.py_buffer(body[position : position + int(offsets[-1])]),
    )
    array.validate(full=True)  # pa.ArrowInvalid is a ValueError
    return array


def _concatenate(blocks: list[_Block]) -> _Block:
    """Return the roads of all blocks."""
    # Join column by column; the last two, ids and names, are Arrow arrays.
    if blocks:
        arrays = [
            np.concatenate(columns) for columns in zip(*(b[:-2] for b in blocks), strict=True)
        ]
        ids = pa.concat_arrays([block.ids for block in blocks])
        names = pa.concat_arrays([block.names for block in blocks])
        return _Block._make([*arrays, ids, names])

    # Without a block, there is no road.
    no_numbers, no_texts = np.empty(0, np.int32), pa.array([], pa.string())
    return _Block(
        points=np.empty((0, 2)),
        starts=no_numbers,
        ends=no_numbers,
        counts=no_numbers,
        speeds=np.empty(0, np.float32),
        flags=np.empty(0, np.uint8),
        ids=no_texts,
        names=no_texts,
    )
