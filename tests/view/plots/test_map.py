import numpy as np
import pytest
from matplotlib.colors import LogNorm

import gpszip
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.view.plot import plot
from view_logs import CORNERS, HOME, LAPS, laps_archive


def streets_of(figure):
    """The collection of the lines of a map."""
    (streets,) = [item for item in figure.axes[0].collections if item.get_gid() == "map"]
    return streets


def dots_of(figure):
    return [item for item in figure.axes[0].lines if item.get_gid() == "samples"]


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_map_lies_over_all_samples():
    figure = plot(laps_archive(), raw=LAPS)
    (dots,) = dots_of(figure)
    assert np.array_equal(dots.get_xydata(), LAPS.positions)
    streets = streets_of(figure)
    assert dots.get_zorder() < streets.get_zorder()
    vertices = np.vstack(streets.get_segments())
    for corner in (*CORNERS[1:], HOME[1]):
        assert np.linalg.norm(vertices - corner, axis=1).min() < 3.0


def test_the_legend_has_the_numbers_of_points_and_traversals():
    assert legend_of(plot(laps_archive(), raw=LAPS)) == [
        f"{len(LAPS):,} points",
        "1",
        "4 traversals",
    ]


def test_without_the_log_the_map_stands_alone():
    figure = plot(laps_archive())
    assert not dots_of(figure)
    assert legend_of(figure) == ["1", "4 traversals"]


def test_heat_colors_each_street_by_its_traversals():
    figure = plot(laps_archive(), kind="heat")
    clean = laps_archive().clean_map()
    streets = streets_of(figure)
    assert sorted(streets.get_array()) == sorted(clean.forward + clean.backward)
    assert isinstance(streets.norm, LogNorm)
    assert (streets.norm.vmin, streets.norm.vmax) == (1, 4)
    (bar,) = [axes for axes in figure.axes if axes.get_gid() == "color-bar"]
    assert [text.get_text() for text in bar.texts] == ["1", "4 traversals"]


def test_heat_of_streets_travelled_once_needs_no_colors():
    once = gpszip.Track("a", np.arange(60.0), np.column_stack([np.arange(60.0), np.zeros(60)]))
    figure = plot(gpszip.compress(once, max_error=0.5, effort=1), kind="heat")
    assert len(figure.axes) == 1
    assert "each street travelled once" in [text.get_text() for text in figure.texts]


def test_more_traversals_are_darker():
    streets = streets_of(plot(laps_archive(), kind="heat"))
    colors = streets.to_rgba(np.array([1.0, 2.0, 3.0, 4.0]))[:, :3]
    assert (np.diff(colors @ [0.2126, 0.7152, 0.0722]) < 0).all()


def test_of_several_areas_the_largest_is_shown_and_the_picture_says_so():
    lat, lon = np.full(60, 52.5), 13.4 + np.arange(60) * 1e-4
    plane = choose_plane([52.5, 52.5, -33.9], [13.4, 13.4, 151.2])
    berlin = gpszip.Track("berlin", np.arange(60.0), to_plane(lat, lon, plane), plane=plane)
    sydney = gpszip.Track(
        "sydney", np.arange(9.0), to_plane(np.full(9, -33.9), lon[:9] + 137.8, plane), plane=plane
    )
    archive = gpszip.compress([berlin, sydney], max_error=2.0, effort=1)
    for kind in ("map", "segments", "heat"):
        figure = plot(archive, kind=kind, raw=[berlin, sydney])
        (dots,) = dots_of(figure)
        assert len(dots.get_xdata()) == 60
        assert np.ptp(figure.axes[0].get_xlim()) < 1000
        assert "the largest of 2 areas" in [text.get_text() for text in figure.texts]
    axes = plot(archive, kind="space-time").axes[0]
    assert np.ptp(axes.get_xlim()) < 1000


@pytest.mark.parametrize("dimension", [1, 3])
def test_flights_are_shown_from_above_and_lines_as_lines(dimension):
    columns = [np.abs(np.arange(80.0) % 40 - 20), np.zeros(80), np.arange(80.0) / 9]
    track = gpszip.Track("a", np.arange(80.0), np.column_stack(columns[:dimension]))
    archive = gpszip.compress(track, max_error=0.5, effort=1)
    for kind in ("map", "heat", "segments"):
        figure = plot(archive, kind=kind, raw=track)
        (dots,) = dots_of(figure)
        assert np.ptp(dots.get_ydata()) == 0
        assert np.ptp(dots.get_xdata()) == 20


@pytest.mark.parametrize("kind", ["map", "heat", "segments", "space-time", "error"])
def test_a_parked_vehicle_is_drawn(kind):
    parked = gpszip.Track("a", np.arange(9.0), np.full((9, 2), 5.0))
    assert plot(gpszip.compress(parked, max_error=0.5, effort=1), kind=kind, raw=parked).axes
