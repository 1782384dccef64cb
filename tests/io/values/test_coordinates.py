"""Latitudes and longitudes: cells are read completely, or not at all."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.io.logs.raw import UnreadableCell
from gpszip.io.values.coordinates import (
    first_unreadable_cell,
    has_decimal_comma,
    has_packed_minutes,
    parse_degrees,
)


def column(*cells):
    return pa.chunked_array([list(cells)])


def degrees_of(cell, axis="lat", **options):
    """Degrees of a column with a single cell."""
    return parse_degrees(pa.chunked_array([[cell]], pa.string()), axis, **options).tolist()[0]


DMS = 48 + 8 / 60 + 13.5 / 3600


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ("48.137", 48.137),
        ("  48.137\t", 48.137),
        ("+48.137", 48.137),
        ("-.5", -0.5),
        ("4.8137e1", 48.137),
        ("33.8561S", -33.8561),
        ("33.8561 s", -33.8561),
        ("N48.137", 48.137),
        ("s 33.8561", -33.8561),
        ("48.137°", 48.137),
        ("48.137° N", 48.137),
        ("−33.8561", -33.8561),
        ("48°08'13.5\"N", DMS),
        ("48° 08' 13.5'' S", -DMS),
        ("48º08′13.5″ N", DMS),
        ("48\u00a08’13.5” N", DMS),
        ("48 8 13.5 N", DMS),
        ("-48 8 13.5", -DMS),
        ("48:08:13.5", DMS),
        ("48d8m13.5s", DMS),
        ("48d8m13.5sS", -DMS),
        ("48deg 8min 13.5sec N", DMS),
        ("48d8'13.5\"N", DMS),
        ("N48°08.225'", DMS),
        ("N 48 08.225", DMS),
        ("48 8.225 s", -DMS),
    ],
)
def test_common_forms_are_read(cell, expected):
    assert degrees_of(cell) == pytest.approx(expected, abs=1e-9)


# fmt: off
NO_NUMBERS = [
    "", " ", "undefined", "nan", "NaN", "inf", "-Infinity", "0x30", "1_000", "1,234.5", "48,137",
    "٤٨",
]
BAD_SIGNS = [
    "48.137E", "-48.137N", "N48.137N", "N-48.137", "48.137 X", "48.137abc", "abc48", "--48",
    "48.1.3", "- 48",
]
BAD_MINUTES = [
    "48°60'00\"N", "48°08'60\"N", "48.5°08'N", "48°08.5'13\"N", "48 8 13 5", "48.1 11.5",
    "48:08:13:01", "48 137",
]
OTHERS = [
    "48d8m13.5S", "48.137\n11.575", "48.137\x00", "9" * 400, "1e999", "N", "°", "2024-05-04",
]
# fmt: on


@pytest.mark.parametrize("cell", NO_NUMBERS + BAD_SIGNS + BAD_MINUTES + OTHERS)
def test_other_text_is_not_read(cell):
    assert math.isnan(degrees_of(cell))


def test_hemispheres_must_fit_the_axis():
    assert degrees_of("70.2152W", "lon") == -70.2152
    assert math.isnan(degrees_of("70.2152N", "lon"))
    assert degrees_of("11:34:30E", "lon") == pytest.approx(11.575)


def test_hemispheres_in_a_separate_column():
    cells = column("33.8", "33.8", "-33.8", "-33.8", "33.8", "33.8", "33.8S", "33.8N")
    sides = column("S", " north ", "S", "N", "E", None, "s", "S")
    np.testing.assert_array_equal(
        parse_degrees(cells, "lat", hemisphere=sides),
        [-33.8, 33.8, -33.8, *[np.nan] * 3, -33.8, np.nan],
    )
    np.testing.assert_array_equal(
        parse_degrees(column(70.2, 70.2), "lon", hemisphere=column("west", "5")), [-70.2, np.nan]
    )
    assert math.isnan(parse_degrees(column(70.2), "lon", hemisphere=column(1))[0])


@pytest.mark.parametrize(
    "kind",
    [
        pa.int8(),
        pa.uint64(),
        pa.float16(),
        pa.float32(),
        pa.decimal128(9, 2),
        pa.dictionary(pa.int8(), pa.int16()),
    ],
)
def test_numbers_of_any_type(kind):
    values = (
        np.array([48, 11], np.float16)
        if kind == pa.float16()
        else pa.array([48, 11]).cast(pa.int16()).to_numpy()
    )
    cells = (
        pa.array(values).dictionary_encode()
        if pa.types.is_dictionary(kind)
        else pa.array(values).cast(kind)
    )
    assert parse_degrees(pa.chunked_array([cells]), "lat").tolist() == [48, 11]


@pytest.mark.parametrize(
    "kind", [pa.large_string(), pa.string_view(), pa.dictionary(pa.int8(), pa.string())]
)
def test_text_of_any_type(kind):
    cells = pa.array(["48.1", "x", None])
    cells = cells.dictionary_encode() if pa.types.is_dictionary(kind) else cells.cast(kind)
    np.testing.assert_array_equal(
        parse_degrees(pa.chunked_array([cells]), "lat"), [48.1, np.nan, np.nan]
    )


@pytest.mark.parametrize("cells", [[True], [b"48.1"], [[48.1]], [{"lat": 48.1}], [None]])
def test_other_types_are_no_degrees(cells):
    assert np.isnan(parse_degrees(pa.chunked_array([cells]), "lat")).all()


def test_decimal_commas_must_fit_all_columns():
    commas, mixed = column("48,1371", "48", "48,2"), column("48,1371", "48.2")
    assert has_decimal_comma([commas, column("11,5", "11,5", "11")])
    assert not has_decimal_comma([commas, mixed])
    assert not has_decimal_comma([column(48.1), column("n/a, sorry")])
    assert parse_degrees(commas, "lat", decimal_comma=True).tolist() == [48.1371, 48, 48.2]
    np.testing.assert_array_equal(parse_degrees(mixed, "lat"), [np.nan, 48.2])
    np.testing.assert_array_equal(
        parse_degrees(mixed, "lat", decimal_comma=True), [48.1371, np.nan]
    )
    assert degrees_of("48°08'13,5\"N", decimal_comma=True) == pytest.approx(DMS)
    assert math.isnan(degrees_of("1.048,5", decimal_comma=True))


def test_packed_minutes_must_fit_all_cells():
    lat, lon = column("4808.225", "4808.226"), column("00007.500", "00007.501")
    assert has_packed_minutes(lat, lon)
    assert parse_degrees(lat, "lat", packed_minutes=True)[0] == pytest.approx(DMS)
    assert parse_degrees(lon, "lon", packed_minutes=True, hemisphere=column("W", "W"))[
        0
    ] == pytest.approx(-0.125)
    assert has_packed_minutes(column(4808.225), column(7.5))
    assert not has_packed_minutes(column(4808.225, 48.1), column(1134.5, 1134.6))
    assert not has_packed_minutes(column(4868.225), column(1134.5))
    assert not has_packed_minutes(column(48.137), column(11.575))
    assert not has_packed_minutes(column("x"), column("y"))


def test_first_unreadable_cell():
    cells = column("48.1", " ", None, "undefined", "x")
    assert first_unreadable_cell(cells, parse_degrees(cells, "lat"), "LAT") == UnreadableCell(
        "LAT", 3, "undefined"
    )
    assert first_unreadable_cell(column("48.1", ""), np.array([48.1, np.nan]), "lat") is None
    assert first_unreadable_cell(
        column(1.0, float("nan")), np.array([1.0, np.nan]), "x"
    ) == UnreadableCell("x", 1, "nan")


@given(st.text(max_size=30))
def test_any_text_with_a_value_has_a_digit(text):
    value = degrees_of(text)
    assert math.isnan(value) or any(letter.isdigit() for letter in text)
    assert not math.isinf(value)


@given(
    st.integers(-90 * 36000 + 1, 90 * 36000 - 1),
    st.sampled_from(["{d}°{m}'{s}\"{h}", "{h} {d} {m} {s}", "{d}d{m}m{s}s{h}", "{d}:{m}:{s} {h}"]),
)
def test_degrees_minutes_and_seconds_survive_a_round_trip(tenths, form):
    size, side = abs(tenths), "S" if tenths < 0 else "N"
    text = form.format(d=size // 36000, m=size // 600 % 60, s=f"{size % 600 / 10:.1f}", h=side)
    assert degrees_of(text) == pytest.approx(tenths / 36000, abs=1e-9)
