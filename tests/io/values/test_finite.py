"""Rows of finite numbers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gpszip.io.values.finite import finite_rows


@given(hnp.arrays(np.float64, st.tuples(st.integers(0, 20), st.integers(1, 4))))
def test_a_row_is_finite_if_all_its_numbers_are(values: np.ndarray) -> None:
    assert finite_rows(values).tolist() == np.isfinite(values).all(axis=1).tolist()
