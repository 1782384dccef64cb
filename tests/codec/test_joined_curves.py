import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.archive.curves import curves_section, read_curves
from gpszip.codec.curves import CurveColumn, CurveSlice, fit_column, fit_slices
from gpszip.codec.joined_curves import CurvePart, join_columns
from gpszip.codec.kernels.curves import BEGINS_TRACK
from gpszip.errors import OptionError
from random_tests import examples

numbers = st.floats(-300, 300, width=32) | st.just(float("nan"))


@st.composite
def logs(draw):
    """Times and values of the parts of a track; a part may begin where another one ends."""
    start, parts = draw(st.sampled_from([0.0, 1_714_557_600.0])), []
    for _ in range(draw(st.integers(1, 3))):
        unit = draw(st.sampled_from([1, 10, 1000]))
        steps = draw(st.lists(st.integers(1, 9), min_size=1, max_size=12))
        shift = draw(st.sampled_from([0.0, 1.0, 500.0])) if parts else 1.0
        times = start + shift + (np.cumsum([0, *steps[1:]]) / unit)
        values = np.array(draw(st.lists(numbers, min_size=len(steps), max_size=len(steps))))
        parts.append((times, values, draw(st.sampled_from([0.3048, 0.95, 1.0, 4.0]))))
        start = float(times[-1])
    return parts


@examples(80)
@given(logs())
def test_the_bound_holds_at_the_samples_of_all_parts(parts):
    fitted = [fit_column([times], [values], bound) for times, values, bound in parts]
    own = [
        CurvePart(column, 0, times[0], times[-1])
        for column, (times, _, _) in zip(fitted, parts, strict=True)
    ]
    joined = join_columns([own])
    section = curves_section({"x": joined})
    column = read_curves(section.kind, section.body, 1)["x"]
    largest = max(bound for _, _, bound in parts)
    assert largest <= column.bound <= 1.003 * largest
    last = -math.inf
    for times, values, _ in parts:
        # One track has one value at a time: that of the earlier part.
        checked = (times > last) & ~np.isnan(values)
        assert (np.abs(column.curve(0).at(times) - values)[checked] <= column.bound).all()
        last = times[-1]


def _cut(column, begin, end):
    """The knots about a time range, as selecting keeps them."""
    own = column.knots[0]
    seconds = own[:, 1] / column.unit
    first = int(np.searchsorted(seconds, begin, side="right")) - 1
    knots = own[max(first, 0) : int(np.searchsorted(seconds, end)) + 1].copy()
    knots[:1, 0] = BEGINS_TRACK
    return CurvePart(CurveColumn(column.bound, column.step, column.unit, (knots,)), 0, begin, end)


@examples(60)
@given(st.integers(0, 2**32 - 1), st.lists(st.floats(0, 200), max_size=3))
def test_parts_of_one_curve_become_that_curve(seed, cuts):
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(size=200))
    values[rng.integers(200, size=20)] = np.nan
    whole = fit_column([np.arange(200.0)], [values], 1.0)
    ends = [0.0, *sorted(cuts), 199.0]
    parts = [_cut(whole, *span) for span in zip(ends[:-1], ends[1:], strict=True)]
    joined = join_columns([parts])
    assert (joined.bound, joined.step, joined.unit) == (whole.bound, whole.step, whole.unit)
    assert joined.knots[0].tolist() == whole.knots[0].tolist()


def test_a_selected_curve_is_cut_where_another_log_goes_on():
    times = np.arange(40.0)
    line = fit_column([times], [times.copy()], 1.0)
    late = fit_column([times[20:]], [100.0 + times[20:]], 1.0)
    joined = join_columns([[_cut(line, 0.0, 19.0), CurvePart(late, 0, 20.0, 39.0)]])
    found = joined.curve(0).at(times)
    assert np.abs(found[:20] - times[:20]).max() <= joined.bound <= 1.001
    assert np.abs(found[20:] - 100 - times[20:]).max() <= joined.bound

    # A second cut needs no finer step.
    last = fit_column([times[30:]], [times[30:]], joined.bound, "x")
    again = join_columns([[_cut(joined, 0.0, 29.0), CurvePart(last, 0, 30.0, 39.0)]])
    assert again.bound <= 1.003
    assert again.step >= joined.step / 2**10


def test_holes_stay_and_parts_without_a_column_leave_one():
    times = np.arange(10.0)
    first = fit_column([times], [np.where(times < 8, 5.0, np.nan)], 1.0)
    second = fit_column([times + 10], [np.full(10, 5.0)], 1.0)
    ends = CurvePart(first, 0, 0.0, 9.0), CurvePart(second, 0, 10.0, 19.0)
    found = join_columns([ends]).curve(0).at([7.0, 8.5, 9.5, 10.0])
    assert np.isnan(found).tolist() == [False, True, True, False]

    whole = fit_column([times], [np.full(10, 5.0)], 1.0)
    without = CurvePart(None, 0, 10.0, 19.0)
    third = fit_column([times + 20], [np.full(10, 5.0)], 1.0)
    parts = [CurvePart(whole, 0, 0.0, 9.0), without, CurvePart(third, 0, 20.0, 29.0)]
    assert np.isnan(join_columns([parts]).curve(0).at(15.0))
    assert join_columns([[parts[0], parts[2]]]).curve(0).at(15.0) == 5.0
    assert len(join_columns([[without]]).knots[0]) == 0


def test_curves_too_far_apart_are_refused():
    fine = fit_column([np.array([0.0, 1e-6])], [np.zeros(2)], 1.0)
    late = fit_column([np.array([4e9])], [np.zeros(1)], 1.0)
    assert fine.unit == 1_000_000
    with pytest.raises(OptionError, match="too far apart"):
        join_columns([[CurvePart(fine, 0, 0.0, 1e-6)], [CurvePart(late, 0, 4e9, 4e9)]], "x")
    # Forged grids, too.
    for bound, step in ((1e-320, 1e300), (5e-324, 5e-324), (1e300, 1e-300)):
        forged = CurveColumn(bound, step, 1, late.knots)
        with pytest.raises(OptionError, match="too far apart"):
            join_columns([[CurvePart(fine, 0, 0, 1)], [CurvePart(forged, 0, 4e9, 4e9)]], "x")


@examples(60)
@given(st.lists(st.lists(numbers, max_size=20), min_size=1, max_size=3), st.integers(1, 7))
def test_slices_hold_the_bound_like_whole_tracks(tracks, length):
    values = [np.array(own, dtype=float) for own in tracks]
    times = [np.arange(len(own)) * 0.7 for own in tracks]
    slices = [
        CurveSlice(track, times[track][first : first + length], own[first : first + length])
        for track, own in enumerate(values)
        for first in range(0, len(own), length)
    ]
    column = fit_slices(lambda: iter(slices), len(tracks), 1.0)
    whole = fit_column(times, values, 1.0)
    for track, (when, own) in enumerate(zip(times, values, strict=True)):
        found = column.curve(track).at(when)
        assert (np.abs(found - own)[~np.isnan(own)] <= 1).all()
        # Holes are the same, also between samples.
        between = (when[:-1] + when[1:]) / 2
        holes = [np.isnan(each.curve(track).at(between)) for each in (column, whole)]
        assert np.array_equal(*holes)


def test_knots_beyond_the_memory_are_refused():
    slices = [CurveSlice(0, np.arange(100.0), np.arange(100.0) % 7 * 50)]
    with pytest.raises(OptionError, match="more than 20 knots within 1"):
        fit_slices(lambda: slices, 1, 1.0, "x", max_knots=20)
