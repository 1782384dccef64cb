import numpy as np
import pytest

from gpszip.experiments.experiment import Setting
from gpszip.experiments.figure_8_2 import run as run_8_2
from gpszip.experiments.figure_8_7 import run as run_8_7
from gpszip.experiments.generators import run as run_generators
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import rmse
from gpszip.testing import patrol


@pytest.fixture(scope="module")
def figure_8_7():
    return run_8_7(Setting(logs=(patrol(2000),), quick=True))


def test_rmse_over_m_is_that_of_the_segment_mean(figure_8_7):
    track, rows = patrol(2000), figure_8_7.tables[0].rows
    assert rows[-1]["m"] == 40
    for row in rows:
        # Between two intervals the walk goes on, where the segment mean jumps.
        expected = rmse(segment_mean(track, 40, row["m"]), track)
        assert row["rmse_m"] == pytest.approx(expected, rel=0.05)
    assert rows[0]["rmse_m"] > 2 * rows[-1]["rmse_m"]


def test_curves_show_the_numbers_of_the_tables(figure_8_7):
    left, right = (picture.figure.axes[0] for picture in figure_8_7.pictures)
    rows = figure_8_7.tables[0].rows
    (line,) = left.lines
    assert line.get_xdata() == pytest.approx(np.array([row["m"] for row in rows]))
    assert line.get_ydata() == pytest.approx(np.array([row["rmse_m"] for row in rows]))
    shown = sum(len(line.get_xdata()) for line in right.lines)
    assert shown == len(figure_8_7.tables[1].rows)
    assert len(right.get_legend().get_texts()) == len(right.lines)


def test_generators_are_counted_and_drawn():
    outcome = run_generators(Setting(seed=2))
    names = [row["log"] for row in outcome.tables[0].rows]
    assert names == [picture.name for picture in outcome.pictures]
    for row in outcome.tables[0].rows:
        assert 0 < row["travelled"] <= row["edges"]
        assert row["travelled"] <= row["traversals"]


def test_maps_of_the_quadrotor_keep_their_errors():
    outcome = run_8_2(Setting(quick=True))
    rows = outcome.tables[0].rows
    for row, bound in zip(rows, (10, 3), strict=True):
        assert row["rmse_m"] <= 1.05 * bound
    assert rows[0]["nodes"] < rows[1]["nodes"]
    collections = [picture.figure.axes[0].collections for picture in outcome.pictures]
    assert [len(each) for each in collections] == [0, 1, 1]
