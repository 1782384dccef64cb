"""Rows that go back in time, and clocks that do."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.live.stream.order import order_rows, sort_rows
from random_tests import examples

TIMES = st.lists(st.integers(0, 8).map(float), max_size=12).map(np.array)


def plain_order(times, end, split):
    """The same, row by row."""
    runs, repeated, late = [[]], [], []
    for row, time in enumerate(times):
        if time > end:
            runs[-1].append(row)
            end = time
        elif time == end:
            repeated.append(row)
        elif split or (max(times[row:]) <= end and sum(times[row:] < end) > 1):
            runs.append([row])
            end = time
        else:
            late.append(row)
    return runs, repeated, late


@given(TIMES, st.sampled_from([-math.inf, 3.0]), st.booleans())
@examples(300)
def test_rows_are_divided_as_row_by_row(times, end, split):
    ordered = order_rows(times, end, split=split)
    runs, repeated, late = plain_order(times, end, split)
    assert [run.tolist() for run in ordered.runs] == runs
    assert ordered.repeated.tolist() == repeated
    assert ordered.late.tolist() == late


@given(TIMES, TIMES, st.sampled_from([-math.inf, 3.0]))
@examples(200)
def test_sorted_rows_are_new_times_in_order(times, known, end):
    known = np.unique(known)
    ordered, back = sort_rows(times, known, end)
    [run] = ordered.runs
    wanted = {time for time in times.tolist() if time > end} - set(known.tolist())
    assert times[run].tolist() == sorted(wanted)
    assert [times.tolist().index(time) for time in times[run]] == run.tolist()
    assert sorted(ordered.late) == np.flatnonzero(times <= end).tolist()
    assert len(run) + len(ordered.repeated) + len(ordered.late) == len(times)
    assert 0 <= back <= len(run)


def test_a_single_row_that_goes_back_at_the_end_of_a_batch_is_late():
    ordered = order_rows(np.array([5.0, 6.0, 2.0]), 4.0)
    assert [run.tolist() for run in ordered.runs] == [[0, 1]]
    assert ordered.late.tolist() == [2]
