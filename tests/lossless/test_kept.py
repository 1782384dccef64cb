"""Kept columns by the coder of lossless columns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gpszip
from gpszip.container.attributes import KeptColumns, encode_attributes, read_attributes
from gpszip.container.layout import Cursor, SectionKind, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless import kept as module
from gpszip.lossless.kept import read_kept, read_kept_names, smaller_section

NUMBERS = st.integers(-(10**15), 10**15).map(lambda value: value / 1000) | st.just(np.nan)
FLOATS = st.floats(allow_infinity=True) | NUMBERS


@st.composite
def kept_columns(draw):
    counts = tuple(draw(st.lists(st.integers(0, 12), min_size=1, max_size=4)))
    rows = sum(counts)
    steps = draw(st.lists(st.floats(0.001, 1e4), min_size=rows, max_size=rows))
    times = np.round(np.cumsum(steps), 3)
    if (np.diff(times) <= 0).any():
        times = np.arange(rows, dtype=float)

    def column(values):
        return np.array(draw(st.lists(values, min_size=rows, max_size=rows)))

    columns = {
        "integers": column(st.integers(-(2**63), 2**63 - 1)).astype(np.int64),
        "speed": column(NUMBERS).astype(np.float64),
        "floats": column(FLOATS).astype(np.float64),
        "note": column(st.sampled_from(["", "a", "bc"])).astype(str),
    }
    chosen = draw(st.sets(st.sampled_from(sorted(columns))))
    return KeptColumns(counts, times, {name: columns[name] for name in sorted(chosen)})


def assert_same(a, b):
    assert a.counts == b.counts
    assert np.array_equal(a.times, b.times)
    assert list(a.columns) == list(b.columns)
    for name, values in a.columns.items():
        other = b.columns[name]
        assert values.dtype.kind == other.dtype.kind
        assert np.array_equal(values, other, equal_nan=values.dtype.kind == "f"), name


@given(kept_columns())
@settings(deadline=None)
def test_any_columns_come_back(columns):
    body = encode_attributes(columns)
    tracks = len(columns.counts)
    plain = read_attributes(body, tracks)
    coded = module._encode(plain)
    assert_same(read_kept(SectionKind.CODED_ATTRIBUTES, coded, tracks), plain)
    names = read_kept_names(SectionKind.CODED_ATTRIBUTES, coded, tracks)
    assert names == tuple(columns.columns)
    kind, smaller = smaller_section(body, tracks)
    assert len(smaller) <= len(body)
    assert_same(read_kept(kind, smaller, tracks), plain)


def drive(rows=4000):
    random = np.random.default_rng(1)
    times = np.round(np.cumsum(random.normal(1, 0.02, rows)), 3)
    speed = np.round(np.cumsum(np.cumsum(random.normal(0, 0.3, rows))), 1)
    return KeptColumns((rows,), times, {"speed": speed})


def test_noisy_columns_take_fewer_bytes():
    body = encode_attributes(drive())
    kind, smaller = smaller_section(body, 1)
    assert kind == SectionKind.CODED_ATTRIBUTES
    assert len(smaller) < 0.96 * len(body)


def test_small_sections_stay_as_they_are():
    body = encode_attributes(drive(20))
    assert smaller_section(body, 1) == (SectionKind.ATTRIBUTES, body)


def test_archives_hold_coded_columns(tmp_path):
    columns = drive(1000)
    positions = np.column_stack([columns.times, np.zeros(len(columns.times))])
    track = gpszip.Track("a", columns.times, positions, attributes=columns.columns)
    archive = gpszip.compress(track, rmse=1, keep=["speed"], effort=1)
    kinds = [extra.kind for extra in archive.contents.extras]
    assert kinds == [SectionKind.CODED_ATTRIBUTES]
    archive.save(tmp_path / "a.gpsz")
    opened = gpszip.open(tmp_path / "a.gpsz")
    assert opened.kept_columns == ("speed",)
    assert np.array_equal(opened.sample_times("a"), columns.times)
    assert np.array_equal(opened.attributes("a")["speed"], columns.columns["speed"])

    # Growing and merging keep them.
    later = gpszip.Track(
        "b", columns.times + 1e5, positions, attributes={"speed": columns.columns["speed"][::-1]}
    )
    grown = gpszip.append(archive, later, effort=1)
    assert np.array_equal(grown.attributes("a")["speed"], columns.columns["speed"])
    assert np.array_equal(grown.attributes("b")["speed"], columns.columns["speed"][::-1])
    other = gpszip.compress(later, rmse=1, keep=["speed"], effort=1)
    merged = gpszip.merge([archive, other])
    assert np.array_equal(merged.attributes("b")["speed"], columns.columns["speed"][::-1])
    assert len(merged.contents.extras) == 1


def test_two_sections_of_columns_are_refused():
    columns = drive(1000)
    positions = np.column_stack([columns.times, np.zeros(len(columns.times))])
    track = gpszip.Track("a", columns.times, positions, attributes=columns.columns)
    archive = gpszip.compress(track, rmse=1, keep=["speed"], effort=1)
    twice = replace(archive, contents=replace(archive.contents, extras=2 * archive.contents.extras))
    with pytest.raises(CorruptArchiveError, match="two sections of kept columns"):
        twice.attributes("a")


def forged(digits, table=b""):
    frame = encode_attributes(KeptColumns((2,), np.arange(2.0), {"x": np.array(["a", "b"])}))
    return encode_varint(len(frame)) + frame + bytes(digits) + table


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (forged([0, 11]), "too many digits"),
        (forged([0, 0], b"\x09"), "times in column 9 of 0"),
        (forged([0, 0], b"\x00\x07"), "1 bytes after the end"),
        (forged([0, 1], b"\x00\x01\x01\x00\x00\x00\x02"), "a column of texts holds numbers"),
        (forged([1, 0], b"\x00\x01\x01\x00\x00\x00\x02"), "kept times of samples go back"),
        (b"\x7f\x00", "the frame takes 127 bytes"),
    ],
)
def test_a_forged_section_is_refused(body, message):
    with pytest.raises(CorruptArchiveError, match=message):
        read_kept(SectionKind.CODED_ATTRIBUTES, body, 1)


def test_damage_is_an_error_or_other_numbers():
    body = smaller_section(encode_attributes(drive(600)), 1)[1]
    for position in range(0, len(body), 7):
        damaged = bytearray(body)
        damaged[position] ^= 0x55
        try:
            assert len(read_kept(SectionKind.CODED_ATTRIBUTES, bytes(damaged), 1).times) >= 0
        except CorruptArchiveError as error:
            assert str(error)


def test_reading_moves_the_cursor_over_the_whole_body():
    body = smaller_section(encode_attributes(drive()), 1)[1]
    assert Cursor(body).remaining == len(body)
    with pytest.raises(CorruptArchiveError):
        read_kept(SectionKind.CODED_ATTRIBUTES, body + b"\0", 1)
