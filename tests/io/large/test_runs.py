"""Sorted runs on disk give the rows of a stable sort in memory, whatever is merged."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.io.large.columns import ColumnEncoder, EncodedBatch
from gpszip.io.large.runs import SortedRuns

MAX_ROWS = 4


def read_back(batches):
    """Rows of each track, of which each row is a code and a time, numbered in their order."""
    with tempfile.TemporaryDirectory() as folder:
        runs = SortedRuns(Path(folder), MAX_ROWS, ColumnEncoder((), 1000))
        count = 0
        for batch in batches:
            codes, times = np.array(batch, np.int64).reshape(-1, 2).T
            numbers = np.column_stack([times, np.arange(count, count + len(batch))])
            columns = EncodedBatch(np.empty((len(batch), 0)), ())
            runs.add(codes.astype(np.int32), numbers.astype(np.float64), columns)
            count += len(batch)
        runs.flush()
        codes = sorted({code for batch in batches for code, _ in batch})
        found = {code: list(runs.blocks(code)) for code in codes}
    # Of each run, at least one row is in memory.
    limit = max(MAX_ROWS, len(batches))
    assert all(0 < len(block) <= limit for blocks in found.values() for block in blocks)
    return {code: np.concatenate(blocks).tolist() for code, blocks in found.items()}


def plain_sort(batches):
    """The twin: all rows at once, by a stable sort."""
    rows = [row for batch in batches for row in batch]
    return {
        code: sorted(
            ([time, number] for number, (other, time) in enumerate(rows) if other == code),
            key=lambda row: row[0],
        )
        for code in sorted({code for code, _ in rows})
    }


def test_rows_at_one_time_at_the_end_of_a_head_come_in_the_order_in_which_they_were_added():
    batches = [[(0, 1), (0, 5), (0, 5), (0, 5)], [(0, 0), (0, 5), (0, 5), (0, 6)]]
    assert [number for time, number in read_back(batches)[0] if time == 5] == [1, 2, 3, 5, 6]


@given(
    st.lists(
        st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3)), min_size=1, max_size=5),
        min_size=1,
        max_size=8,
    )
)
def test_runs_are_merged_like_a_stable_sort(batches):
    assert read_back(batches) == plain_sort(batches)
