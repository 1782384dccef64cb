"""Files of lines, and the search for the smallest one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gpszip import Track
from gpszip.experiments.compare_peers import run
from gpszip.experiments.experiment import Setting
from gpszip.experiments.peers.coders import CODERS, missing_coders
from gpszip.experiments.peers.knots import Knots, Steps, decode_file, encode_file, on_grid
from gpszip.experiments.peers.methods import SAMPLES, SIMPLIFIERS
from gpszip.experiments.peers.search import Search, maximum, root_mean_square
from gpszip.experiments.table import to_records
from gpszip.testing import patrol

INSTALLED = sorted(CODERS.keys() - set(missing_coders()))


@pytest.mark.parametrize("coder", INSTALLED)
@given(
    arrays(
        np.int64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.integers(-(2**40), 2**40)
    )
)
def test_coders_give_tables_back(coder, table):
    data = CODERS[coder].encode(table)
    assert np.array_equal(CODERS[coder].decode(data, len(table), 3), table)


@pytest.mark.parametrize("coder", INSTALLED)
def test_files_give_lines_back(coder):
    rng = np.random.default_rng(2)
    lines = [
        Knots(1.7e9 + np.cumsum(rng.uniform(1, 9, count)), rng.normal(0, 500, (count, 3)))
        for count in (1, 2, 40)
    ]
    steps = Steps(0.25, 0.1)
    for line, back in zip(lines, decode_file(encode_file(lines, steps, coder), coder), strict=True):
        assert np.array_equal(back.times, on_grid(line, steps).times)
        assert back.times[:-1] == pytest.approx(line.times[:-1], abs=0.126)
        assert line.times[-1] - 1e-6 <= back.times[-1] < line.times[-1] + 0.25
        assert back.positions == pytest.approx(line.positions, abs=0.051)


def test_knots_on_one_tick_become_one():
    line = Knots(np.array([0.0, 0.1, 0.2, 3.0]), np.arange(8.0).reshape(4, 2))
    back = on_grid(line, Steps(1.0, 0.5))
    assert back.times.tolist() == [0.0, 3.0]
    assert back.positions.tolist() == [[0.0, 1.0], [6.0, 7.0]]


@pytest.fixture(scope="module")
def search():
    return Search([patrol(600), patrol(300, seed=2)])


@pytest.mark.parametrize("criterion", [root_mean_square, maximum])
@pytest.mark.parametrize("method", [m for m in SIMPLIFIERS if not m.package], ids=lambda m: m.name)
def test_files_are_within_the_error_and_use_most_of_it(search, method, criterion):
    encoded = search.simplified(method, "arithmetic", 0.4, criterion)
    reached = encoded.rmse if criterion is root_mean_square else encoded.max_error
    assert 0.1 < reached <= 0.4
    finer = search.simplified(method, "arithmetic", 0.05, criterion)
    assert finer is None or finer.bytes > encoded.bytes


def test_samples_on_a_grid_are_within_the_error(search):
    encoded = search.on_samples("bzip2", 0.3, maximum)
    assert 0.15 < encoded.max_error <= 0.3
    assert encoded.parameter is None


def test_all_samples_are_kept_whatever_the_parameter():
    track = patrol(50)
    (line,) = SAMPLES.prepare([track])(1e9)
    assert np.array_equal(line.positions, track.positions)


def test_every_file_holds_the_error_that_its_row_states():
    outcome = run(Setting((patrol(1_010),), rmse=0.3, quick=True))
    by_rmse, by_maximum = map(to_records, outcome.tables)
    expected = {"GPSZip", "samples + xz"} | ({"TD-TR + pco"} if "pco" in INSTALLED else set())
    assert {row["method"] for row in by_rmse} >= expected
    assert all(row["rmse_m"] <= row["allowed_m"] * (1 + 1e-9) for row in by_rmse)
    assert all(row["max_m"] <= row["allowed_m"] * (1 + 1e-9) for row in by_maximum)
    for row in by_rmse:
        assert row["bits_per_point"] == pytest.approx(8 * row["bytes"] / 1_010)
    (axes,) = outcome.pictures[0].figure.axes
    assert len(axes.lines) == len(axes.get_legend().get_texts())


def test_a_still_log_has_rows():
    track = Track("a", range(50), [[5.0, 5.0]] * 50)
    outcome = run(Setting((track,), rmse=1.0, quick=True))
    assert to_records(outcome.tables[0])[0]["method"] == "GPSZip"
