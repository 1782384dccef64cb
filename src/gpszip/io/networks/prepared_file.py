"""A prepared network: roads in blocks by where they are, so that the part near a log is read without the rest.

docs/format.md describes the file byte by byte.
"""

from __future__ import annotations

import json
import mmap
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import CorruptArchiveError, InputError
from gpszip.io.networks.joining import RoadGraph
from gpszip.io.networks.lines import vertex_rows, within_globe

__all__ = ["PREPARED_MAGIC", "read_prepared_file", "write_prepared_file"]

#: First bytes of a prepared network.
PREPARED_MAGIC = b"\xa7ROADS\n\0"

#: Version 1 has no street names.
_VERSION = 2
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
_GEOGRAPHIC = 1
_ROADS_IN_BLOCK = 2048
_UNITS_PER_DEGREE = 1e7  # of a degree


def write_prepared_file(roads: RoadGraph, stream: BinaryIO) -> int:
    """Write a prepared network.

    Parameters
    ----------
    roads : JoinedRoads
        The graph.
    stream : binary file
        Where to.

    Returns
    -------
    int
        Number of bytes.
    """
    order = _morton_order(roads)
    blocks = [order[i : i + _ROADS_IN_BLOCK] for i in range(0, len(order), _ROADS_IN_BLOCK)]
    metadata = json.dumps({"name": roads.name}).encode()
    header = np.zeros((), _HEADER)
    header["magic"], header["version"], header["flags"] = (
        np.void(PREPARED_MAGIC),
        _VERSION,
        _GEOGRAPHIC * roads.geographic,
    )
    header["nodes"], header["roads"], header["blocks"], header["name"] = (
        len(roads.nodes),
        len(roads),
        len(blocks),
        len(metadata),
    )
    index = np.zeros(len(blocks), _INDEX_ENTRY)
    at = _HEADER.itemsize + len(metadata) + index.nbytes + 4
    bodies = []
    for entry, chosen in zip(index, blocks, strict=True):
        body, points, streets, box = _encode_block(roads, chosen)
        entry["offset"], entry["size"], entry["roads"], entry["points"] = (
            at,
            len(body),
            len(chosen),
            points,
        )
        entry["crc"], entry["streets"], entry["box"] = zlib.crc32(body), streets, box
        at += len(body)
        bodies.append(body)
    front = header.tobytes() + metadata + index.tobytes()
    stream.write(front + zlib.crc32(front).to_bytes(4, "little"))
    for body in bodies:
        stream.write(body)
    return at


def _morton_order(roads: RoadGraph) -> NDArray[np.intp]:
    """Roads in the order of a curve that visits neighbours one after the other (Morton's)."""
    first = roads.coordinates[roads.offsets[:-1]]
    low, size = first.min(axis=0), np.maximum(np.ptp(first, axis=0).max(), 1e-9)
    cells = np.minimum((first - low) / size * 65536, 65535).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    return np.argsort(cells[:, 0] | (cells[:, 1] << np.uint64(1)), kind="stable")


def _encode_block(
    roads: RoadGraph, chosen: NDArray[np.intp]
) -> tuple[bytes, int, int, NDArray[np.float64]]:
    """Bytes of a block, its numbers of vertices and of street names, and the box of its vertices."""
    counts = np.diff(roads.offsets)[chosen]
    points = roads.coordinates[vertex_rows(roads.offsets, chosen)]
    stored = (
        np.rint(points * _UNITS_PER_DEGREE).astype("<i4")
        if roads.geographic
        else points.astype("<f8")
    )
    texts = [text.encode() for text in roads.ids.take(pa.array(chosen)).fill_null("").to_pylist()]
    names = roads.names.take(pa.array(chosen)).dictionary_encode()
    streets = [text.encode() for text in names.dictionary.to_pylist()]
    columns = (
        stored,
        roads.starts[chosen].astype("<i4"),
        roads.ends[chosen].astype("<i4"),
        counts.astype("<i4"),
        roads.speeds[chosen].astype("<f4"),
        np.array([len(text) for text in texts], "<i4"),
        names.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype("<i4"),
        np.array([len(street) for street in streets], "<i4"),
        (
            roads.forward[chosen]
            | roads.backward[chosen].astype(np.uint8) << 1
            | roads.users[chosen] << 2
        ).astype("u1"),
    )
    body = b"".join(column.tobytes() for column in columns) + b"".join(texts + streets)
    return (
        body + bytes(-len(body) % 8),
        len(points),
        len(streets),
        np.concatenate((points.min(axis=0), points.max(axis=0))),
    )


def read_prepared_file(path: str | Path, name: str, wanted: Any = None) -> RoadGraph:
    """Read a prepared network, or the blocks of it that are wanted.

    Parameters
    ----------
    path : str or Path
        The file; it is mapped to memory.
    name : str
        What to call it in messages.
    wanted : callable, optional
        Given the boxes of all blocks as float64 array of shape (b, 4) (west, south, east, north) and whether they are degrees,
        answers which are wanted, as a bool array.

    Returns
    -------
    JoinedRoads
        May be empty where nothing is wanted.

    Raises
    ------
    CorruptArchiveError
        If it is not whole.
    InputError
        If it can't be opened.
    """
    try:
        with (
            Path(path).open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            return _read(data, name, wanted)
    except OSError as error:
        raise InputError(f"{name}: can't be read: {error.strerror or error}") from error


def _read(data: mmap.mmap, name: str, wanted: Any) -> RoadGraph:
    header, index = _read_header(data, name)
    geographic = bool(header["flags"] & _GEOGRAPHIC)
    boxes = index["box"].copy()
    chosen = np.ones(len(index), np.bool_) if wanted is None else wanted(boxes, geographic)
    blocks = list(_read_blocks(data, index[chosen], geographic, int(header["version"]), name))
    width = 2 if not blocks else blocks[0][0].shape[1]
    columns = (
        [np.concatenate(column) for column in zip(*(block[:7] for block in blocks), strict=True)]
        if blocks
        else _empty_columns(width)
    )
    points, starts, ends, counts, speeds, flags = (
        columns[0],
        columns[1],
        columns[2],
        columns[3],
        columns[4],
        columns[6],
    )
    if not _is_valid(points, speeds, geographic):
        raise CorruptArchiveError(
            f"{name}: a road lies nowhere, or nobody can travel it; prepare it again"
        )
    offsets = np.append(0, np.cumsum(counts, dtype=np.int64))
    nodes, at = np.unique(np.concatenate((starts, ends)), return_inverse=True)
    if len(nodes) and (nodes[0] < 0 or nodes[-1] >= header["nodes"]):
        raise CorruptArchiveError(f"{name}: a road leads to a node that doesn't exist")
    places = np.empty((len(nodes), 2))
    places[at[: len(starts)]], places[at[len(starts) :]] = (
        points[offsets[:-1]],
        points[offsets[1:] - 1],
    )
    return RoadGraph(
        name=name,
        nodes=places,
        starts=at[: len(starts)].astype(np.int32),
        ends=at[len(starts) :].astype(np.int32),
        offsets=offsets,
        coordinates=points,
        geographic=geographic,
        forward=(flags & 1) > 0,
        backward=(flags & 2) > 0,
        speeds=speeds.astype(np.float64),
        users=(flags >> 2).astype(np.uint8),
        ids=pa.concat_arrays([block[7] for block in blocks])
        if blocks
        else pa.array([], pa.string()),
        names=pa.concat_arrays([block[8] for block in blocks])
        if blocks
        else pa.array([], pa.string()),
    )


def _is_valid(points: NDArray[np.float64], speeds: NDArray[np.float32], geographic: bool) -> bool:
    """Whether vertices are places, and speeds are speeds or unknown."""
    places = within_globe(points) if geographic else bool(np.isfinite(points).all())
    return places and not (speeds < 0).any() and not np.isinf(speeds).any()


def _empty_columns(width: int) -> list[NDArray[Any]]:
    empty = np.empty(0, np.int32)
    return [np.empty((0, width)), empty, empty, empty, np.empty(0), empty, np.empty(0, np.uint8)]


def _read_header(data: mmap.mmap, name: str) -> tuple[Any, Any]:
    if len(data) < _HEADER.itemsize or data[:8] != PREPARED_MAGIC:
        raise CorruptArchiveError(f"{name}: no prepared network: it does not begin like one", 0)
    header = np.frombuffer(data, _HEADER, 1)[0].copy()
    if header["version"] > _VERSION:
        raise CorruptArchiveError(
            f"{name}: version {header['version']} of prepared networks; update GPSZip, or prepare it again",
            8,
        )
    at = _HEADER.itemsize + int(header["name"])
    end = at + int(header["blocks"]) * _INDEX_ENTRY.itemsize
    if end + 4 > len(data):
        raise CorruptArchiveError(
            f"{name}: torn: it ends within its index; prepare it again", len(data)
        )
    if zlib.crc32(data[:end]) != int.from_bytes(data[end : end + 4], "little"):
        raise CorruptArchiveError(f"{name}: its index is damaged; prepare it again", 0)
    return header, np.frombuffer(data[at:end], _INDEX_ENTRY)


def _read_blocks(
    data: mmap.mmap, index: Any, geographic: bool, version: int, name: str
) -> Iterator[tuple[Any, ...]]:
    """Columns of each block, then the ids and the street names of its roads."""
    for entry in index:
        at, size, roads, points, streets = (
            int(entry[key]) for key in ("offset", "size", "roads", "points", "streets")
        )
        body = data[at : at + size]
        if len(body) != size or zlib.crc32(body) != entry["crc"]:
            raise CorruptArchiveError(f"{name}: damaged block of roads; prepare it again", at)
        try:
            yield _decode_block(body, roads, points, streets if version > 1 else None, geographic)
        except (ValueError, IndexError) as error:
            raise CorruptArchiveError(
                f"{name}: a block of roads contradicts itself; prepare it again", at
            ) from error


def _decode_block(
    body: bytes, roads: int, points: int, streets: int | None, geographic: bool
) -> tuple[Any, ...]:
    # the columns, one after the other
    kinds = [
        ("<i4" if geographic else "<f8", 2 * points),
        *((kind, roads) for kind in ("<i4", "<i4", "<i4", "<f4", "<i4")),
    ]
    kinds += [] if streets is None else [("<i4", roads), ("<i4", streets)]
    columns: list[Any] = []
    at = 0
    for kind, count in [*kinds, ("u1", roads)]:
        columns.append(np.frombuffer(body, kind, count, at))
        at += columns[-1].nbytes
    flat, starts, ends, counts, speeds, lengths = columns[:6]
    if (counts < 2).any() or counts.sum(dtype=np.int64) != points:
        raise ValueError("numbers of vertices")

    # the texts behind them
    ids = _decode_texts(body, at, lengths)
    names = pa.nulls(roads, pa.string())
    if streets is not None:
        numbers = pa.array(columns[6], mask=columns[6] < 0)
        names = pa.DictionaryArray.from_arrays(
            numbers, _decode_texts(body, at + int(lengths.sum()), columns[7])
        ).cast(pa.string())
    return (
        flat.reshape(-1, 2) / (_UNITS_PER_DEGREE if geographic else 1.0),
        starts,
        ends,
        counts,
        speeds,
        lengths,
        columns[-1],
        ids,
        names,
    )


def _decode_texts(body: bytes, at: int, lengths: NDArray[np.int32]) -> Any:
    """Texts of known lengths that begin at a byte."""
    offsets = np.append(0, np.cumsum(lengths, dtype=np.int64))
    if (lengths < 0).any() or at + offsets[-1] > len(body) or offsets[-1] > np.iinfo(np.int32).max:
        raise ValueError("lengths of texts")
    array = pa.StringArray.from_buffers(
        len(lengths),
        pa.py_buffer(offsets.astype(np.int32).tobytes()),
        pa.py_buffer(body[at : at + int(offsets[-1])]),
    )
    array.validate(full=True)  # pa.ArrowInvalid is a ValueError
    return array
