import bz2
import io
import lzma
import tracemalloc
import zlib
from functools import cache

import pytest

from gpszip.container.catalog import open_catalog, read_catalog_group
from gpszip.container.reader import from_bytes
from gpszip.container.recover import recover_bytes
from gpszip.container.verify import verify_bytes
from gpszip.container.writer import to_bytes
from gpszip.errors import CorruptArchiveError
from oracle import archives
from oracle.archives import compact, large, number, section

ARCHIVES = {
    name: to_bytes(contents)
    for name, contents in (archives.small_archives() | archives.archives_with_bounds()).items()
}


@pytest.mark.parametrize("name", ARCHIVES)
def test_every_truncation_is_noticed(name):
    data = ARCHIVES[name]
    for length in range(len(data)):
        verdict = verify_bytes(data[:length])
        assert not verdict.ok, length
        assert verdict.offset is not None and 0 <= verdict.offset <= length


@pytest.mark.parametrize("name", ARCHIVES)
def test_every_flipped_bit_is_noticed(name):
    data = ARCHIVES[name]
    for place in range(len(data)):
        for bit in range(8):
            damaged = bytearray(data)
            damaged[place] ^= 1 << bit
            with pytest.raises(CorruptArchiveError):
                from_bytes(bytes(damaged))


@pytest.mark.parametrize("name", ARCHIVES)
def test_every_changed_byte_is_noticed(name):
    data = ARCHIVES[name]
    for place in range(len(data)):
        for value in {0, 1, 0x7F, 0x80, 0xFF, data[place] ^ 0xFF, (data[place] + 1) % 256} - {
            data[place]
        }:
            assert not verify_bytes(data[:place] + bytes([value]) + data[place + 1 :]).ok


@pytest.mark.parametrize("name", ARCHIVES)
def test_missing_and_surplus_bytes_are_noticed(name):
    data = ARCHIVES[name]
    for place in range(len(data)):
        assert not verify_bytes(data[:place] + data[place + 1 :]).ok
        assert not verify_bytes(data[:place] + b"\0" + data[place:]).ok
    for surplus in (b"\0", b"\n", data, b"\0" * 100):
        assert not verify_bytes(data + surplus).ok


def test_missing_repeated_and_swapped_sections_are_noticed():
    data = ARCHIVES["large"]
    reports = verify_bytes(data).sections
    cut = [data[report.offset : report.offset + report.size] for report in reports]
    tail = data[reports[-1].offset + reports[-1].size :]
    assert data == data[:3] + b"".join(cut) + tail
    for at in range(len(cut)):
        for other in (
            cut[:at] + cut[at + 1 :],
            [*cut[:at], cut[at], *cut[at:]],
            [*cut[:at], *reversed(cut[at : at + 2]), *cut[at + 2 :]],
        ):
            if other != cut:
                assert not verify_bytes(data[:3] + b"".join(other) + tail).ok


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b"t,x,y\n0,1,2\n", "not a .gpsz archive"),
        (b"PK\x03\x04", "not a .gpsz archive"),
        (b"\xa7", "within its head"),
        (b"\xa7Z", "within its head"),
        (b"\xa7Z\x04rest", "version 4.*upgrade"),
        (b"\xa7Z\x07", "version 7.*upgrade"),
        (b"\xa7Z\x01rest", "version 1, which no release"),
        (b"\xa7Z\x00", "version 0, which no release"),
    ],
)
def test_strangers_get_a_plain_answer(data, says):
    with pytest.raises(CorruptArchiveError, match=says):
        from_bytes(data)


GRID = b"\x10" + bytes([128, 120]) + b"\0\0\0"
NAMES = b"\x04\x00"  # one track, from number 0
WALKS = b"\x00\x01\x00walks"
SMALL = b"\x01\x06" + GRID + b"\x02\x02" + NAMES + b"\x03\x08" + WALKS
OPENING = [section(1, GRID), section(2, NAMES)]
TWO = [section(1, GRID), section(2, b"\x08\0"), section(3, WALKS), section(3, b"\1" + WALKS[1:])]
HERE = 3 + sum(map(len, OPENING))
NONE = b"\0\0"  # no error bound
DEEP = bytes([128, 120]) + b"\0\0\0"


@cache
def bomb(size):
    """Few bytes that expand to so many."""
    return bz2.compress(bytes(size))


def layered(payload):
    """A small archive with a payload that is said to be compressed."""
    return compact(
        0xBA,
        b"\x01\x06"
        + GRID
        + b"\x02\x02"
        + NAMES
        + b"\x03"
        + number(len(payload) + 3)
        + WALKS[:3]
        + payload,
    )


FORGED = {
    "compact: nothing": compact(2, b""),
    "compact: half a grid": compact(2, NONE + b"\x80"),
    "compact: long varint": compact(2, NONE + bytes([1, 1]) + b"\x80\x00\x00\x00"),
    "compact: endless varint": compact(2, NONE + bytes([1, 1]) + b"\x80" * 30),
    "compact: origin past 2^62": compact(2, NONE + bytes([1, 1]) + b"\0\0" + number((1 << 64) - 1)),
    "compact: whole origin past 2^62": compact(
        0x82, NONE + bytes([1, 1]) + b"\0\0" + number(1 << 62)
    ),
    "compact: latitude": compact(
        2 | 2 << 5, NONE + (900_000_001).to_bytes(4, "little") + b"\0" * 4 + DEEP
    ),
    "compact: longitude": compact(
        2 | 3 << 5, NONE + b"\0\0" + (-18_001).to_bytes(2, "little", signed=True) + DEEP
    ),
    "compact: a trillion names": compact(2 | 1 << 3, NONE + DEEP + number((1 << 42) | 0) + b"\0"),
    "layer: no bz2": layered(b"walks"),
    "layer: empty": layered(b""),
    "layer: half": layered(bz2.compress(b"walks")[:-1]),
    "layer: twice": layered(bz2.compress(b"walks") * 2),
    "layer: bomb": lambda: layered(bomb(70_000_000)),
    "small: nothing": compact(0x3A, b""),
    "small: length past the end": compact(0x3A, b"\x01" + number(1 << 50) + GRID),
    "small: grid of no axes": compact(
        0x3A, b"\x01\x03\x00\x01\x01" + b"\x02\x02" + NAMES + b"\x03\x03" + WALKS[:3]
    ),
    "small: too large": compact(
        0x3A,
        b"\x01\x06"
        + GRID
        + b"\x02\x02"
        + NAMES
        + b"\x03\x08"
        + WALKS
        + b"\x05"
        + number(70_000)
        + bytes(70_000),
    ),
    "large: nothing": large([]),
    "large: no walks": large(OPENING),
    "large: no names": large([section(1, GRID), section(3, WALKS)]),
    "large: names first": large([section(2, NAMES), section(1, GRID), section(3, WALKS)]),
    "large: two grids": large([*OPENING, section(1, GRID), section(3, WALKS)]),
    "large: grid goes on": large([section(1, GRID + b"\0"), section(2, NAMES), section(3, WALKS)]),
    "large: names go on": large([section(1, GRID), section(2, NAMES + b"\0"), section(3, WALKS)]),
    "large: length past the end": large([*OPENING, section(3, WALKS, 1 << 60)]),
    "large: million planes": large(
        [section(1, b"\x12" + number(1_000_000) + bytes(100)), section(2, NAMES), section(3, WALKS)]
    ),
    "large: 2^60 planes": large(
        [section(1, b"\x12" + number(1 << 60) + bytes(100)), section(2, NAMES), section(3, WALKS)]
    ),
    "large: no planes": large(
        [section(1, b"\x12\x00" + GRID[1:]), section(2, NAMES), section(3, WALKS)]
    ),
    "large: third kind of centre": large(
        [section(1, b"\x16\x01" + bytes(30)), section(2, NAMES), section(3, WALKS)]
    ),
    "large: dimension 2^50": large(
        [section(1, number(1 << 53) + GRID[1:]), section(2, NAMES), section(3, WALKS)]
    ),
    "large: hash of 3 bytes": large([section(4, bytes(3)), section(2, NAMES), section(3, WALKS)]),
    "large: map goes on": large([section(4, bytes(6)), section(2, NAMES), section(3, WALKS)]),
    "large: map refined 4 times": large(
        [section(4, bytes(4) + b"\4"), section(2, NAMES), section(3, WALKS)]
    ),
    "large: grid and map": large([*OPENING, section(4, bytes(5)), section(3, WALKS)]),
    "large: error bound after walks": large([*OPENING, section(3, WALKS), section(8, b"\1\0")]),
    "large: two error bounds": large(
        [*OPENING, section(8, b"\1\0"), section(8, b"\1\0"), section(3, WALKS)]
    ),
    "large: error bound goes on": large([*OPENING, section(8, b"\1\0\0"), section(3, WALKS)]),
    "large: sampling is missing": large([*OPENING, section(8, b"\1\x40"), section(3, WALKS)]),
    "compact: error bound of no digits": compact(2, b"\0\4" + DEEP),
    "compact: error bound of 1023 digits": compact(2, b"\xff\3" + DEEP),
    "compact: error bound grown too much": compact(2, b"\xff\3\xfa" + DEEP),
    "compact: half a map": compact(0x12, b"\0\0\1\2\3"),
    "large: group of 2^63 tracks": large([*OPENING, section(3, b"\0" + number(1 << 63) + b"\0")]),
    "large: group too far": large([*OPENING, section(3, b"\x01\x01\0")]),
    "large: two groups, no index": large(TWO),
    "large: wrong index": large([*TWO, section(6, b"\x02" * 7)]),
    "large: index of 2^60": large([*TWO, section(6, number(1 << 60))]),
    "large: empty index": large([*TWO, section(6, b"\0")]),
    "large: index past the end": large([*OPENING, section(3, WALKS)], 1 << 47),
    "large: index in the head": large([*OPENING, section(3, WALKS)], 1),
    "large: index in a section": large([*OPENING, section(3, WALKS)], 3),
    "large: index too early": large(
        [
            *OPENING,
            section(3, WALKS),
            section(6, b"\1" + number(HERE) + b"\x12\1\0"),
            section(9, b""),
        ]
    ),
    "large: low 2": large([*OPENING, section(3, WALKS)], third=0x5A),
    "large: kind 0": large([*OPENING, section(3, WALKS), section(0, b"")]),
    "large: time range past 64 bits": large(
        [*OPENING, section(3, b"\0\1" + number((1 << 64) - 1) + number((1 << 64) - 2))]
    ),
    "large: many sections": large([*OPENING, section(3, WALKS)] + [section(9, b"")] * 5_000),
    "large: layer bombs": lambda: large(
        [section(1, GRID), section(2, number(400 << 2) + b"\0")]
        + [section(3, number(i) + b"\1\0" + bomb(30_000_000)) for i in range(400)],
        third=0x9A,
    ),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_archives_with_right_checksums_are_refused(name):
    data = FORGED[name]
    data = data() if callable(data) else data  # bombs take a second to make
    tracemalloc.start()
    for read in (from_bytes, recover_bytes, _all_groups):
        try:
            read(data)
            assert read is recover_bytes, read
        except CorruptArchiveError:
            pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300_000_000
    assert not verify_bytes(data).ok


def _all_groups(data):
    file = io.BytesIO(data)
    catalog = open_catalog(file)
    for number_ in range(len(catalog.entries)):
        read_catalog_group(file, catalog, number_)


def test_their_valid_counterparts_are_read():
    assert from_bytes(compact(2, NONE + DEEP)).groups[0].payload == b""
    assert from_bytes(layered(bz2.compress(b"walks"))).groups[0].payload == b"walks"
    assert from_bytes(compact(0x3A, SMALL)).ids == ("0",)
    assert from_bytes(large([*OPENING, section(3, WALKS)])).groups[0].payload == b"walks"
    index = section(6, b"\1" + number(HERE) + b"\x12\1\0")
    assert (
        from_bytes(large([*OPENING, section(3, WALKS), section(9, b""), index])).groups[0].payload
        == b"walks"
    )


@pytest.mark.parametrize("packing", ["deflate", "lzma"])
def test_names_that_would_fill_the_memory_are_refused(packing):
    if packing == "deflate":
        packer = zlib.compressobj(9, zlib.DEFLATED, -15)
        packed = packer.compress(b"\n" * 100_000_000) + packer.flush()
    else:
        packed = lzma.compress(
            b"\n" * 100_000_000,
            format=lzma.FORMAT_RAW,
            filters=[{"id": lzma.FILTER_LZMA2, "preset": 0}],
        )
    names = number(100_000_001 << 2 | 3), number(60_000 << 2 | 3)
    for head in names:
        with pytest.raises(CorruptArchiveError):
            from_bytes(
                compact(
                    2 | 1 << 3,
                    NONE + DEEP + head + number(len(packed) << 2 | (packing == "lzma")) + packed,
                )
            )
