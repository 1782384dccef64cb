import pytest

from gpszip.container.contents import Contents, Group, MapReference, Section, single_group_contents
from gpszip.container.reader import from_bytes
from gpszip.container.verify import verify_bytes
from gpszip.container.writer import to_bytes
from gpszip.errors import InputError, OptionError
from gpszip.model.grid import Plane, QuantisationGrid
from oracle import archives

ARCHIVES = archives.small_archives() | archives.archives_with_bounds()


@pytest.mark.parametrize("name", ARCHIVES)
def test_contents_round_trip(name):
    contents = ARCHIVES[name]
    data = to_bytes(contents)
    assert from_bytes(data) == contents
    assert to_bytes(from_bytes(data)) == data
    assert verify_bytes(data).ok


@pytest.mark.parametrize(
    ("grid", "limit"),
    [
        (archives.FAR, 24),
        (archives.FAR_ODD, 27),
        (archives.DEGREES, 24),
        (archives.DEGREES_ODD, 27),
        (archives.DEGREES_FINE, 30),
    ],
)
def test_overhead_of_one_track(grid, limit):
    payload = b"x" * 100
    assert len(to_bytes(single_group_contents(grid, ("0",), payload))) - len(payload) <= limit


def test_shift_changes_only_origin_epoch_and_checksum():
    ours = QuantisationGrid((1_000, 2_000), 3_000, 128, 128)
    moved = QuantisationGrid((10_000_001_000, 10_000_002_000), 1_000_000_003_000, 128, 128)
    data, moved_data = (
        to_bytes(single_group_contents(grid, ("a", "b"), b"payload")) for grid in (ours, moved)
    )
    assert data[:7] == moved_data[:7]
    assert data[10:-4] == moved_data[20:-4]


def test_a_single_group_has_no_time_range():
    contents = Contents(archives.FLAT, ("0",), (Group(0, 1, b"p", (3, 4)),))
    assert from_bytes(to_bytes(contents)).groups[0].time_range is None


def test_a_large_single_group_with_further_sections():
    contents = Contents(
        archives.FLAT, ("0",), (Group(0, 1, bytes(range(256)) * 300),), None, (Section(5, b"kept"),)
    )
    data = to_bytes(contents)
    assert from_bytes(data) == contents
    assert verify_bytes(data).form == "large"


@pytest.mark.parametrize(
    "contents",
    [
        single_group_contents(QuantisationGrid((), 0, 0, 0), ("0",), b""),
        single_group_contents(QuantisationGrid((0,) * 16, 0, 0, 0), ("0",), b""),
        single_group_contents(QuantisationGrid((1 << 62, 0), 0, 0, 0), ("0",), b""),
        single_group_contents(QuantisationGrid((0, 0), -(1 << 62), 0, 0), ("0",), b""),
        single_group_contents(QuantisationGrid((0, 0), 0, 256, 0), ("0",), b""),
        single_group_contents(QuantisationGrid((0, 0), 0, 0, -1), ("0",), b""),
        single_group_contents(QuantisationGrid((0, 0), 0, 0, 0, Plane(())), ("0",), b""),
        single_group_contents(
            QuantisationGrid((0, 0), 0, 0, 0, Plane(((900_000_001, 0),))), ("0",), b""
        ),
        single_group_contents(archives.FLAT, ("0",), b"", "zip"),
        Contents(archives.FLAT, ("0",), ()),
        Contents(archives.FLAT, ("0", "1"), (Group(0, 1, b""),)),
        Contents(archives.FLAT, ("0", "1"), (Group(0, 1, b""), Group(0, 1, b""))),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b""), Group(1, 0, b""))),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b"", (2, 1)),)),
        Contents(None, ("0",), (Group(0, 1, b""),), MapReference(b"four bytes")),
        Contents(None, ("0",), (Group(0, 1, b""),), MapReference(b"four", 4)),
        Contents(None, ("0",), (Group(0, 1, b""),)),
        Contents(archives.FLAT, None, (Group(0, 1, b""),)),
        Contents(None, None, (Group(0, 1, b""),), MapReference(b"four"), (Section(5, b""),)),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b""),), MapReference(b"four")),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b""),), None, (Section(8, b""),)),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b""),), None, (Section(3, b""),)),
        Contents(archives.FLAT, ("0",), (Group(0, 1, b""),), None, (Section(256, b""),)),
    ],
)
def test_contradictions_are_refused(contents):
    with pytest.raises(OptionError, match="can't be written"):
        to_bytes(contents)


def test_a_payload_that_no_reader_would_expand_is_refused():
    with pytest.raises(OptionError, match="leave it out"):
        to_bytes(single_group_contents(archives.FLAT, ("0",), bytes((1 << 26) + 100_000), "bz2"))


def test_more_than_readers_accept_is_refused():
    with pytest.raises(OptionError, match="split the archive"):
        to_bytes(single_group_contents(archives.FLAT, tuple(map(str, range(100_000))), b""))
    with pytest.raises(OptionError, match="make them larger"):
        to_bytes(
            Contents(
                archives.FLAT,
                tuple(map(str, range(5000))),
                tuple(Group(i, 1, b"") for i in range(5000)),
            )
        )
    many = single_group_contents(archives.FLAT, tuple(map(str, range(100_000))), bytes(100_000))
    assert from_bytes(to_bytes(many)) == many


def test_surrogates_are_refused():
    with pytest.raises(InputError, match="surrogate"):
        to_bytes(single_group_contents(archives.FLAT, ("\ud800",), b""))
