import math

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.cli.units import (
    DURATION,
    LENGTH,
    SIZE,
    Quantity,
    format_bytes,
    format_duration,
    format_length,
)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("5", 5),
        ("5m", 5),
        ("5 m", 5),
        (" 2km ", 2000),
        (".5m", 0.5),
        ("24cm", 0.24),
        ("5.", 5),
        ("1e3mm", 1),
        ("10ft", 3.048),
        ("1mi", 1609.344),
    ],
)
def test_lengths(text, metres):
    assert LENGTH.parse(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("30", 30), ("30s", 30), ("250ms", 0.25), ("10min", 600), ("2h", 7200), ("1.5d", 129600)],
)
def test_durations(text, seconds):
    assert DURATION.parse(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("text", "count"), [("64MiB", 64 << 20), ("1kB", 1000), ("7", 7), ("2GiB", 2 << 30)]
)
def test_sizes(text, count):
    assert SIZE.parse(text) == count


@pytest.mark.parametrize("text", ["", "m", "five", "5 5", "5mm5", "--5", "5,5m", "0x10"])
def test_texts_that_are_no_quantity_get_an_example(text):
    with pytest.raises(ValueError, match=r"write a number and a unit, such as 5m or 2km"):
        LENGTH.parse(text)


@pytest.mark.parametrize("text", ["0", "-5m", "1e400", "0km"])
def test_zero_negative_and_infinite_values_are_refused(text):
    with pytest.raises(ValueError, match="greater than 0 and finite"):
        LENGTH.parse(text)


def test_unknown_unit_names_the_known_ones():
    with pytest.raises(ValueError, match="'yards' is no unit of length; use m, mm, cm, ft, mi, km"):
        LENGTH.parse("5yards")


def test_minutes_are_not_metres():
    with pytest.raises(ValueError, match="write min for minutes"):
        DURATION.parse("30m")


def test_words_stand_for_values():
    gap = Quantity("gap", DURATION.units, words={"none": math.inf})
    assert gap.parse("none") == math.inf
    with pytest.raises(ValueError, match="such as 5s or 2min or none"):
        gap.parse("never")


def test_click_gets_its_own_error():
    with pytest.raises(click.BadParameter):
        LENGTH.convert("5yards", None, None)


@given(st.floats(1e-3, 1e9))
def test_every_unit_has_its_value(value):
    for kind in (LENGTH, DURATION, SIZE):
        for unit, worth in kind.units.items():
            assert kind.parse(f"{value!r}{unit}") == pytest.approx(value * worth)


@given(st.floats(1e-3, 1e8))
def test_formatted_values_read_back(value):
    assert LENGTH.parse(format_length(value)) == pytest.approx(value, rel=0.006)
    assert DURATION.parse(format_duration(value)) == pytest.approx(value, rel=0.006)


@given(st.integers(1, 99_999))
def test_bytes_of_small_files_are_exact(count):
    assert SIZE.parse(format_bytes(count).replace(",", "")) == count
