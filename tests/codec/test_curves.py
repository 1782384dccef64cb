import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.archive.curves import curves_section, read_curve_heads, read_curves
from gpszip.codec import curves
from gpszip.codec.curves import CurveColumn, fit_column
from gpszip.errors import CorruptArchiveError, OptionError
from oracle.curves import fewest_knots
from random_tests import examples

numbers = st.floats(-1e5, 1e5, width=32) | st.just(float("nan"))
bounds = st.sampled_from([0.01, 0.3048, 1.0, 7.0, 1e4])


@st.composite
def tracks(draw, max_tracks=3):
    """Times and values of some tracks; times on any grid, or on none."""
    unit, size = draw(st.sampled_from([(1, 1.0), (10, 1.0), (50, 1.0), (3, 1e-4)]))
    start = draw(st.sampled_from([0.0, 1_714_557_600.0, -5000.0]))
    times, values = [], []
    for _ in range(draw(st.integers(1, max_tracks))):
        steps = draw(st.lists(st.integers(1, 400), max_size=25))
        times.append((start * unit + np.cumsum(np.array(steps, dtype=float))) / unit)
        own = draw(st.lists(numbers, min_size=len(steps), max_size=len(steps)))
        values.append(np.array(own, dtype=float) * size)
    return times, values


@examples(150)
@given(tracks(), bounds)
def test_the_bound_holds_at_every_sample_after_decoding(log, bound):
    times, values = log
    section = curves_section({"ele": fit_column(times, values, bound, "ele")})
    column = read_curves(section.kind, section.body, len(times))["ele"]
    assert read_curve_heads(section.kind, section.body)["ele"][0] == column.bound == bound
    for track, (when, own) in enumerate(zip(times, values, strict=True)):
        found = column.curve(track).at(when)
        present = ~np.isnan(own)
        assert (np.abs(found - own)[present] <= bound).all()


@examples(60)
@given(
    st.lists(st.integers(-6, 6), min_size=1, max_size=9),
    st.lists(st.integers(1, 4), min_size=9, max_size=9),
)
def test_knots_are_the_fewest(values, steps):
    times = np.cumsum(steps)[: len(values)].astype(float)
    # Away from the bound by rounding, lines touch samples.
    samples = np.array(values, dtype=float) * 0.7 + 0.01
    column = fit_column([times], [samples], 1.0)
    assert len(column.knots[0]) == fewest_knots(times, samples, 1.0, column.step)


def test_holes_come_back_as_nan():
    values = np.array([1.0, 2, np.nan, np.nan, 5, np.nan])
    curve = fit_column([np.arange(6.0)], [values], 0.5).curve(0)
    found = curve.at([0, 1, 1.5, 2, 3.5, 4, 4.5, 9])
    assert np.isnan(found).tolist() == [False, False, True, True, True, False, True, True]
    assert np.isnan(fit_column([np.arange(2.0)], [np.full(2, np.nan)], 1.0).curve(0).at(0.0))


def test_a_long_run_is_cut_in_slices(monkeypatch):
    rng = np.random.default_rng(0)
    times, values = np.arange(5000.0), np.cumsum(rng.normal(size=5000))
    whole = fit_column([times], [values], 2.0)
    monkeypatch.setattr(curves, "_SLICE_SAMPLES", 700)
    cut = fit_column([times], [values], 2.0)
    assert len(whole.knots[0]) <= len(cut.knots[0]) <= len(whole.knots[0]) + 2 * 8
    assert np.abs(cut.curve(0).at(times) - values).max() <= 2.0


def test_coding_beats_deflate_of_the_same_numbers():
    rng = np.random.default_rng(1)
    times = 1.7e9 + np.arange(20_000.0)
    values = 100 + 30 * np.sin(times / 300) + np.cumsum(rng.normal(size=20_000) * 0.15)
    column = fit_column([times], [np.round(values + rng.normal(size=20_000) * 0.5, 1)], 1.0)
    steps = np.diff(column.knots[0][:, 1:], axis=0, prepend=column.knots[0][:1, 1:])
    plain = [
        zlib.compress(np.ascontiguousarray(table).astype(kind).tobytes(), 9)
        for table in (steps, steps.T)
        for kind in ("<i2", "i1")
    ]
    assert len(curves_section({"ele": column}).body) < 0.9 * min(map(len, plain))


def test_texts_and_what_no_grid_holds_are_refused():
    with pytest.raises(OptionError, match="texts"):
        fit_column([np.arange(2.0)], [np.array(["a", "b"])], 1.0, "note")
    with pytest.raises(OptionError, match="too many for a bound"):
        fit_column([np.arange(2.0)], [np.array([0.0, 1e300])], 1e-3, "x")
    with pytest.raises(OptionError, match="too close"):
        fit_column([np.array([0.0, 1e-9])], [np.array([0.0, 100.0])], 1.0, "x")


def _section(bound):
    times, values = np.arange(50.0), np.sin(np.arange(50.0))
    return curves_section({"ele": fit_column([times, times], [values, values[::-1]], bound)})


@pytest.mark.parametrize("bound", [0.1, 0.1234])
def test_hostile_bodies_raise_one_error(bound):
    kind, body = (section := _section(bound)).kind, section.body
    refused = 0
    for at in range(len(body)):
        for change in (0x01, 0x80, 0xFF):
            forged = body[:at] + bytes([body[at] ^ change]) + body[at + 1 :]
            try:
                column = next(iter(read_curves(kind, forged, 2).values()), None)
            except CorruptArchiveError:
                refused += 1
                continue
            if column is not None:
                for track in range(2):
                    assert (np.diff(column.curve(track).times) > 0).all()
    assert refused > len(body)
    for end in range(len(body)):
        with pytest.raises(CorruptArchiveError):
            read_curves(kind, body[:end], 2)


def test_short_bounds_take_two_bytes():
    kinds = []
    for bound in (3.0, 0.3048, 0.05, 999e7, 1e-8, 999e8, 1e-9, 1 / 3):
        section = _section(bound)
        kinds.append(section.kind)
        assert read_curves(section.kind, section.body, 2)["ele"].bound == bound
    assert kinds == [12, 11, 12, 12, 12, 11, 11, 11]
    # Other steps, as of joined curves, need the long form.
    column = fit_column([np.arange(3.0)], [np.zeros(3)], 1.0)
    other = curves_section({"x": replace(column, step=0.25)})
    assert other.kind == 11
    assert len(other.body) == len(curves_section({"x": column}).body) + 14
    for code in (0, 1023, 1 << 14):
        with pytest.raises(CorruptArchiveError, match="none of two bytes"):
            read_curves(12, b"\x01\x01e" + struct.pack("<H", code) + bytes(20), 1)


def test_forged_counts_do_not_ask_for_memory():
    head = b"\x01\x01e" + struct.pack("<dd", 1.0, 0.5) + b"\x01"
    with pytest.raises(CorruptArchiveError, match="knots can't lie"):
        read_curves(11, head + b"\x00\xff\xff\xff\xff\x7f" + b"\x01\x00", 1)
    with pytest.raises(CorruptArchiveError, match="no curve has"):
        read_curves(11, b"\x01\x01e" + struct.pack("<dd", float("nan"), 0.5) + b"\x01\x01\x00", 1)


def test_a_constant_of_many_tracks_keeps_within_the_limit_of_knots():
    one = np.array([[2, 0, 0]], np.int64)
    column = CurveColumn(1.0, 0.5, 1, (one,) * 200_000)
    section = curves_section({"e": column})
    back = read_curves(section.kind, section.body, 200_000)["e"]
    assert len(back.knots) == 200_000
