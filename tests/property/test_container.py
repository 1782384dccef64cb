import io
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from gpszip.container.catalog import open_catalog, read_catalog_group
from gpszip.container.contents import Contents, Group, MapReference, Section
from gpszip.container.names import encode_names
from gpszip.container.reader import from_bytes
from gpszip.container.recover import recover_bytes
from gpszip.container.verify import verify_bytes
from gpszip.container.writer import to_bytes
from gpszip.errors import CorruptArchiveError
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import Plane, QuantisationGrid
from oracle import archives
from random_tests import examples

numbers = st.one_of(
    st.integers(-3, 3),
    st.integers(1 - (1 << 62), (1 << 62) - 1),
    st.integers(-(10**7), 10**7).map(lambda n: n * 1000),
)
centers = st.tuples(
    st.integers(-900, 900), st.integers(-1800, 1800), st.sampled_from([10**6, 10**5, 999_999])
).map(lambda c: (c[0] * c[2], c[1] * c[2]))
planes = st.one_of(
    st.none(), st.lists(centers, min_size=1, max_size=4).map(lambda found: Plane(tuple(found)))
)
indices = st.integers(0, 255)
grids = st.builds(
    QuantisationGrid,
    st.lists(numbers, min_size=1, max_size=15).map(tuple),
    numbers,
    indices,
    indices,
    planes,
)
short_grids = st.builds(
    QuantisationGrid,
    st.tuples(numbers, numbers),
    numbers,
    indices,
    indices,
    st.one_of(st.none(), centers.map(lambda c: Plane((c,)))),
)
ids = st.one_of(
    st.lists(st.text(max_size=8), max_size=12),
    st.lists(st.integers(0, 30).map(str), max_size=12),
    st.tuples(st.integers(0, 10**19), st.integers(0, 20), st.integers(0, 22)).map(
        lambda t: [str(t[0] + i).zfill(t[2]) for i in range(t[1])],
    ),
).map(tuple)
time_ranges = st.one_of(
    st.none(),
    st.tuples(st.integers(-(10**12), 10**12), st.integers(0, 10**9)).map(
        lambda s: (s[0], s[0] + s[1])
    ),
)
extras = st.lists(
    st.builds(Section, st.sampled_from([5, 9, 90, 255]), st.binary(max_size=40)), max_size=3
).map(tuple)
layers = st.sampled_from([None, "bz2"])
maps = st.builds(MapReference, st.binary(min_size=4, max_size=4), st.integers(0, 3))
plain = st.builds(ErrorBound, st.integers(1, 999), st.integers(-8, 6), st.booleans())
grown = st.builds(
    ErrorBound, st.integers(1, 99), st.integers(-8, 6), st.booleans(), st.integers(1, 62)
)
two_bounds = st.builds(
    lambda digits, exponent, more, over: ErrorBound(
        digits, exponent, False, 0, more, exponent + over
    ),
    *(st.integers(1, 999), st.integers(-8, 6), st.integers(1, 999), st.integers(0, 3)),
)
error_bounds = st.one_of(st.none(), plain, grown, two_bounds)
samplings = st.one_of(st.none(), indices)


@st.composite
def contents(draw):
    names = draw(ids)
    groups, first = [], 0
    while first < len(names) or not groups:
        count = draw(st.integers(min(1, len(names)), len(names) - first))
        groups.append(Group(first, count, draw(st.binary(max_size=60)), draw(time_ranges)))
        first += count
    if len(groups) == 1:
        groups = [replace(groups[0], time_range=None)]
    reference = draw(st.one_of(st.none(), maps))
    grid = draw(st.one_of(grids, short_grids)) if reference is None else None
    return Contents(
        grid,
        names,
        tuple(groups),
        reference,
        draw(extras),
        draw(layers),
        draw(error_bounds),
        draw(samplings),
    )


@given(contents())
@examples(80)
def test_contents_round_trip_and_equal_contents_have_equal_bytes(original):
    data = to_bytes(original)
    assert from_bytes(data) == original
    assert to_bytes(from_bytes(data)) == data
    assert verify_bytes(data).ok
    assert recover_bytes(data).contents == original
    file = io.BytesIO(data)
    catalog = open_catalog(file)
    assert (
        tuple(read_catalog_group(file, catalog, i) for i in range(len(original.groups)))
        == original.groups
    )


@given(st.lists(st.text(), max_size=30).map(tuple))
@examples(40)
def test_names_take_at_most_two_bytes_beside_their_text(names):
    text = sum(len(name.encode()) for name in names)
    assert len(encode_names(names)) <= text + 2 * len(names) + 2


def _assert_refused_or_read(data):
    for read in (from_bytes, recover_bytes, lambda raw: _read_all_groups(io.BytesIO(raw))):
        try:
            read(data)
        except CorruptArchiveError as error:
            assert str(error)
    verify_bytes(data)


def _read_all_groups(file):
    catalog = open_catalog(file)
    for i in range(len(catalog.entries)):
        read_catalog_group(file, catalog, i)


@given(
    st.binary(max_size=300),
    st.sampled_from([b"", b"\xa7Z", b"\xa7Z\x02", b"\xa7Z\x1a", b"\xa7Z\x3a"]),
)
@examples(120)
def test_random_bytes_are_refused(tail, head):
    with pytest.raises(CorruptArchiveError):
        from_bytes(head + tail)
    _assert_refused_or_read(head + tail)


@given(st.binary(max_size=120), indices)
@examples(200)
def test_random_bytes_with_a_right_checksum(body, third):
    _assert_refused_or_read(archives.compact(third & 0xF8 | 1, body))


@given(
    st.lists(st.tuples(st.integers(0, 9), st.binary(max_size=30)), max_size=6),
    st.integers(0, 7),
    st.one_of(st.none(), st.integers(0, 200)),
)
@examples(200)
def test_random_sections_with_right_checksums(original, high, index_offset):
    sections = [archives.section(1, b"\x10\1\1\0\0\0"), archives.section(2, b"\x08\0")][: high & 3]
    sections += [archives.section(kind, body) for kind, body in original]
    _assert_refused_or_read(archives.large(sections, index_offset, 0x1A | high >> 2 << 7))


INTACT = [to_bytes(original) for original in archives.small_archives().values()]


@given(
    st.sampled_from(INTACT),
    st.lists(
        st.tuples(st.integers(0, 10**6), st.integers(0, 3), st.binary(max_size=6)),
        min_size=1,
        max_size=4,
    ),
)
@examples(80, suppress_health_check=[HealthCheck.too_slow])
def test_mutated_archives_are_refused(data, edits):
    damaged = data
    for place, deleted, inserted in edits:
        start = place % (len(damaged) + 1)
        damaged = damaged[:start] + inserted + damaged[start + deleted :]
    assert verify_bytes(damaged).ok == (damaged in INTACT)
    _assert_refused_or_read(damaged)
    # the same edits past the checksum
    if damaged[:2] == b"\xa7Z" and len(damaged) > 7:
        _assert_refused_or_read(archives.compact(damaged[2], damaged[3:-4]))
