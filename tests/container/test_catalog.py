import io
from dataclasses import replace

import pytest

from gpszip.container.catalog import find_group, find_groups, open_catalog, read_catalog_group
from gpszip.container.contents import Contents, Group
from gpszip.container.writer import to_bytes
from gpszip.errors import CorruptArchiveError
from oracle import archives
from oracle.archives import large, number, section

GROUPS = tuple(Group(3 * i, 3, bytes([i]) * 70_000, (1000 * i, 1000 * i + 1500)) for i in range(8))
MANY = Contents(archives.DEGREES, tuple(f"run {i}" for i in range(24)), GROUPS)


class Counting(io.BytesIO):
    read_bytes = 0

    def read(self, size=-1):
        data = super().read(size)
        self.read_bytes += len(data)
        return data


@pytest.mark.parametrize("layer", [None, "bz2"])
def test_one_group_is_read_alone(layer):
    file = Counting(to_bytes(replace(MANY, layer=layer)))
    catalog = open_catalog(file)
    assert (catalog.grid, catalog.ids, catalog.map) == (MANY.grid, MANY.ids, MANY.map)
    assert file.read_bytes < 1000
    for track in range(24):
        file.read_bytes = 0
        assert read_catalog_group(file, catalog, find_group(catalog, track)) == GROUPS[track // 3]
        assert file.read_bytes < 70_100


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [
        (0, 999, (0,)),
        (1500, 1500, (0, 1)),
        (1501, 2000, (1, 2)),
        (-9, -1, ()),
        (0, 9999, (*range(8),)),
    ],
)
def test_groups_of_a_time_range(first, last, expected):
    assert find_groups(open_catalog(io.BytesIO(to_bytes(MANY))), first, last) == expected


def test_a_group_without_time_range_may_hold_any_time():
    catalog = open_catalog(io.BytesIO(to_bytes(archives.several())))
    assert find_groups(catalog, 10_000, 20_000) == (2,)


@pytest.mark.parametrize("name", archives.small_archives())
def test_every_archive_opens(name):
    contents = archives.small_archives()[name]
    file = io.BytesIO(to_bytes(contents))
    catalog = open_catalog(file)
    assert (catalog.grid, catalog.ids, catalog.map) == (contents.grid, contents.ids, contents.map)
    assert (
        tuple(read_catalog_group(file, catalog, i) for i in range(len(contents.groups)))
        == contents.groups
    )


def test_tracks_outside_are_refused():
    catalog = open_catalog(io.BytesIO(to_bytes(MANY)))
    for track in (-1, 24):
        with pytest.raises(IndexError):
            find_group(catalog, track)


def test_damage_is_noticed_when_it_is_read():
    data = bytearray(to_bytes(MANY))
    data[200_000] ^= 1
    file = io.BytesIO(bytes(data))
    catalog = open_catalog(file)
    assert read_catalog_group(file, catalog, 0) == GROUPS[0]
    with pytest.raises(CorruptArchiveError, match="checksum"):
        read_catalog_group(file, catalog, 2)


def test_every_flipped_bit_that_is_read_is_noticed():
    data = to_bytes(archives.several())
    extras = data.index(b"\xa7SEC\x05"), data.index(b"\xa7SEC\x63"), data.index(b"\xa7SEC\x06")

    # of further sections, marker and length are read, but not kind, body and checksum
    is_read = {start + i for start in extras for i in (0, 1, 2, 3, 5)}
    for place in range(len(data)):
        damaged = data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :]
        file = io.BytesIO(damaged)
        if extras[0] <= place < extras[2] and place not in is_read:
            assert len(open_catalog(file).ids) == 6
            continue
        with pytest.raises(CorruptArchiveError):
            catalog = open_catalog(file)
            for i in range(len(catalog.entries)):
                read_catalog_group(file, catalog, i)


GRID, NAMES = section(1, b"\x10" + bytes([128, 120]) + b"\0\0\0"), section(2, b"\x08\0")
ONE, TWO = section(3, b"\0\1\0one"), section(3, b"\1\1\0two")
START = 3 + len(GRID) + len(NAMES)


def _with_index(body):
    return large([GRID, NAMES, ONE, TWO, section(6, body)])


def _entry(offset, size, tracks=1, time_range=b"\0"):
    return number(offset) + number(size) + number(tracks) + time_range


@pytest.mark.parametrize(
    "body",
    [
        b"\0",
        number(1 << 50),
        b"\2" + _entry(START, 1 << 60) + _entry(len(ONE), len(TWO)),
        b"\2" + _entry(START, len(ONE)) + _entry(1 << 60, len(TWO)),
        b"\2" + _entry(START, len(ONE)) + _entry(1, len(TWO)),
        b"\2" + _entry(START, len(ONE)) + _entry(len(ONE), len(TWO), 2),
        b"\2" + _entry(START, len(ONE)) + _entry(len(ONE), len(TWO), 1 << 62),
        b"\2" + _entry(START, len(ONE)) + _entry(len(ONE), len(TWO), 1, b"\1\0"),
        b"\2" + _entry(START, len(ONE) + 1) + _entry(len(ONE) + 1, len(TWO) - 1),
        b"\2" + _entry(START - 1, len(ONE)) + _entry(len(ONE), len(TWO)),
        b"\2" + _entry(2, len(ONE)) + _entry(len(ONE), len(TWO)),
        b"\1" + _entry(START, len(ONE) + len(TWO), 2),
    ],
)
def test_a_wrong_index_is_refused(body):
    file = io.BytesIO(_with_index(body))
    with pytest.raises(CorruptArchiveError):
        catalog = open_catalog(file)
        for i in range(len(catalog.entries)):
            read_catalog_group(file, catalog, i)


def test_a_right_index_is_read():
    file = io.BytesIO(_with_index(b"\2" + _entry(START, len(ONE)) + _entry(len(ONE), len(TWO))))
    assert read_catalog_group(file, open_catalog(file), 1).payload == b"two"
