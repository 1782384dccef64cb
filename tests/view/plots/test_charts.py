import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.drawing.elapsed import time_unit
from gpszip.view.plot import plot
from gpszip.view.plots.rate import _round_numbers
from view_logs import LAPS, laps_archive


def errors_one_by_one(archive, track):
    """Distance of each sample to the line between the knots about its time."""
    (piece,) = archive.decompress(track.id)
    decoded = [np.interp(track.times, piece.times, axis) for axis in piece.positions.T]
    return [
        math.dist(one, other)
        for one, other in zip(np.transpose(decoded).tolist(), track.positions.tolist(), strict=True)
    ]


def texts_of(axes):
    return [text.get_text() for text in axes.texts]


def test_errors_are_those_of_each_sample():
    axes = plot(laps_archive(), kind="error", raw=LAPS).axes[0]
    (dots,) = [line for line in axes.lines if line.get_gid() == "samples"]
    expected = errors_one_by_one(laps_archive(), LAPS)
    assert dots.get_ydata() == pytest.approx(np.array(expected), abs=1e-9)
    assert dots.get_xdata() == pytest.approx((LAPS.times - 100.0) / 60)
    assert axes.get_xlabel() == "minutes since the start"


def test_rmse_and_maximum_are_drawn_and_written():
    axes = plot(laps_archive(), kind="error", raw=LAPS).axes[0]
    errors = np.array(errors_one_by_one(laps_archive(), LAPS))
    rmse, largest = math.sqrt(np.mean(errors**2)), errors.max()
    (line,) = [line for line in axes.lines if line.get_gid() == "rmse"]
    assert line.get_ydata() == pytest.approx([rmse, rmse])
    assert texts_of(axes) == [f"RMSE\n{rmse:.3g} m", f"maximum\n{largest:.3g} m"]
    assert axes.get_ylim()[1] > largest


def test_labels_of_near_errors_do_not_overlap():
    along = np.column_stack([np.linspace(0, 60, 60), np.zeros(60)])
    archive = gpszip.compress(gpszip.Track("a", np.arange(60.0), along), max_error=0.1, effort=1)
    beside = gpszip.Track("a", np.arange(60.0), along + np.array([0.0, 5.0]))
    figure = plot(archive, kind="error", raw=beside, width=60.0)
    figure.draw_without_rendering()
    low, high = (text.get_window_extent() for text in figure.axes[0].texts)
    assert low.y1 <= high.y0


@pytest.mark.parametrize(
    ("span", "unit"),
    [(0, "seconds"), (179, "seconds"), (180, "minutes"), (10_800, "hours"), (3e5, "days")],
)
def test_times_have_units_that_suit_them(span, unit):
    assert time_unit(7.0, 7.0 + span)[1] == f"{unit} since the start"


def test_dates_are_named_while_the_calendar_lasts():
    assert time_unit(1.7e9, 1.7e9 + 9)[1] == "seconds since 2023-11-14 22:13 UTC"
    assert time_unit(1e15, 1e15 + 9)[1] == "seconds since the start"


def curves_of(axes):
    return {text.get_text() for text in axes.texts} & {"RMSE", "maximum"}


def test_rates_are_the_bytes_over_the_measured_errors():
    archives = [laps_archive(bound) for bound in (0.5, 2.0, 8.0)]
    axes = plot(archives, kind="rate", raw=LAPS).axes[0]
    rmse, maximum = (line.get_xydata() for line in axes.lines)
    errors = [np.array(errors_one_by_one(archive, LAPS)) for archive in archives]
    by_error = sorted(
        (math.sqrt(np.mean(e**2)), a.size) for e, a in zip(errors, archives, strict=True)
    )
    assert rmse == pytest.approx(np.array(by_error))
    assert sorted(maximum[:, 0]) == pytest.approx(sorted(e.max() for e in errors))
    assert curves_of(axes) == {"RMSE", "maximum"}
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_xlabel() == "error in metres"


def test_without_the_log_rates_are_over_the_stated_bounds():
    archives = [laps_archive(0.5), laps_archive(2.0)]
    axes = plot(archives, kind="rate").axes[0]
    assert sorted(axes.lines[1].get_xdata()) == [0.5, 2.0]
    assert len(axes.lines[0].get_xdata()) == 0
    assert curves_of(axes) == {"maximum"}
    assert axes.get_xlabel() == "bound on the error in metres"


def test_archives_of_files_are_named(tmp_path):
    for bound in (0.5, 2.0):
        laps_archive(bound).save(tmp_path / f"laps-{bound:g}.gpsz")
    axes = plot(sorted(tmp_path.iterdir()), kind="rate").axes[0]
    assert {"laps-0.5", "laps-2"} <= set(texts_of(axes))


@given(st.floats(1e-6, 1e6), st.floats(1.69, 1e9))
def test_axes_have_some_round_numbers(low, factor):
    ticks = _round_numbers(low, low * factor)
    assert len(ticks) >= 1
    assert all(low <= tick <= low * factor for tick in ticks)
    assert ticks == sorted(set(ticks))
    assert all(f"{tick:.1e}" == f"{tick:.6e}".replace("00000e", "e") for tick in ticks)


def test_space_and_time_rise_from_the_ground():
    figure = plot(laps_archive(), kind="space-time")
    axes = figure.axes[0]
    by_name = {item.get_gid(): item for item in axes.collections}
    (piece,) = laps_archive().decompress()
    low = piece.positions.min(axis=0)
    expected = np.column_stack([piece.positions - low, (piece.times - piece.times[0]) / 60])
    (line,) = by_name["tracks"]._segments3d
    (shadow,) = by_name["ground"]._segments3d
    assert np.asarray(line) == pytest.approx(expected)
    assert np.asarray(shadow) == pytest.approx(expected * [1, 1, 0])
    assert axes.get_zlabel() == "minutes since the start"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x in m", "y in m")


def test_both_axes_of_the_ground_have_one_scale():
    axes = plot(laps_archive(), kind="space-time").axes[0]
    box = axes._box_aspect
    assert np.ptp(axes.get_xlim()) / np.ptp(axes.get_ylim()) == pytest.approx(box[0] / box[1])


def test_few_tracks_are_named_at_their_ends():
    tracks = [gpszip.Track(name, LAPS.times, LAPS.positions) for name in ("red", "blue")]
    axes = plot(gpszip.compress(tracks, max_error=0.5, effort=1), kind="space-time").axes[0]
    assert [text.strip() for text in texts_of(axes)] == ["red", "blue"]
