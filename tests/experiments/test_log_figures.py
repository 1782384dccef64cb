"""Figures of chapters 1, 5, 6 and 8 that show logs, segments and maps."""

import numpy as np
import pytest

from gpszip import Track
from gpszip.drawing.layers import Label, Lines, draw_layers
from gpszip.experiments import (
    figure_1_1,
    figure_1_2,
    figure_1_3,
    figure_5_1,
    figure_6_3,
    figure_6_4,
    figure_6_5,
    figure_8_3,
    figure_8_4,
    figure_8_5,
    figure_8_6,
)
from gpszip.experiments.experiment import Setting
from gpszip.experiments.stays import find_stays, hours_near
from gpszip.experiments.table import to_records
from gpszip.testing import patrol, person_places, ring, taxis


def rows_of(outcome, table=0):
    return to_records(outcome.tables[table])


def line_counts(outcome):
    """Number of lines of each collection of each picture."""
    for picture in outcome.pictures:
        # Lines in space are projected when they are drawn.
        picture.figure.draw_without_rendering()
    return [
        [len(collection.get_paths()) for collection in picture.figure.axes[0].collections]
        for picture in outcome.pictures
    ]


def test_density_counts_the_points_of_the_picture():
    points = np.random.default_rng(1).normal(0, 100, (5000, 2))
    points[:1000] = [30.0, 40.0]
    log = Track("a", range(5000), points)
    whole, zoomed = rows_of(figure_1_1.run(Setting((log,))))
    assert 4900 < whole["points"] <= 5000
    assert whole["most"] >= zoomed["most"] >= 1000
    assert zoomed["points"] < whole["points"]
    assert zoomed["cell_m"] == pytest.approx(whole["cell_m"] / 4, rel=0.05)


def test_fewer_segments_fit_no_better():
    outcome = figure_1_2.run(Setting(quick=True))
    k, km = rows_of(outcome)
    assert (k["k"], k["m"], km["m"]) == (12, 12, 6)
    assert k["rmse_m"] <= km["rmse_m"] < 10
    assert line_counts(outcome) == [[1, 0], [1, 12], [1, 12]]
    edges = outcome.pictures[2].figure.axes[0].collections[1].get_edgecolor()
    colors = {tuple(color) for color in edges}
    assert len(colors) == 6


def test_segments_are_nearer_to_the_truth_than_the_noisy_log():
    (row,) = rows_of(figure_1_3.run(Setting()))
    assert row["segments_to_truth_m"] < row["log_to_truth_m"] / 3
    assert row["log_to_truth_m"] == pytest.approx(6 * np.sqrt(2), rel=0.1)


def test_the_truth_of_a_log_of_the_user_is_not_known():
    (row,) = rows_of(figure_1_3.run(Setting((ring(5, laps=4, samples=9).tracks[0],), rmse=2.0)))
    assert row["segments_to_log_m"] <= 2.0
    assert row["segments_to_truth_m"] is None


def test_patches_are_nearer_to_the_truth_than_straight_lines():
    outcome = figure_5_1.run(Setting(quick=True))
    (row,) = rows_of(outcome)
    assert 0 < row["filled"] < row["gaps"]
    assert row["patched_rmse_m"] < row["joined_rmse_m"]
    joined, patched = line_counts(outcome)
    assert joined == [row["gaps"]]
    assert sorted(patched) == sorted([row["filled"], row["gaps"] - row["filled"]])


def test_roads_of_the_user_patch_his_log():
    log = ring(12, laps=3, samples=20, noise=1.0)
    track = log.tracks[0]
    kept = np.ones(len(track), bool)
    kept[100:180] = False
    track = Track("a", track.times[kept], track.positions[kept])
    (row,) = rows_of(figure_5_1.run(Setting((track,), network=log.network)))
    assert (row["gaps"], row["filled"], row["patched_rmse_m"]) == (1, 1, None)


def test_the_elbow_is_farthest_below_the_line():
    outcome = figure_6_3.run(Setting(quick=True))
    rows = rows_of(outcome)
    (x0, y0), (x1, y1) = ((row["m"], row["cost_m2"]) for row in (rows[0], rows[-1]))
    # Distance of a point from a line in the unit square, by the cross product.
    chord = np.array([1.0, -1.0]) / np.sqrt(2)
    for row in rows:
        point = np.array([(row["m"] - x0) / (x1 - x0), (row["cost_m2"] - y0) / (y1 - y0)])
        point = np.array([point[0], 1 - point[1]]) - [0.0, 1.0]
        distance = chord[1] * point[0] - chord[0] * point[1]
        assert row["distance"] == pytest.approx(distance, abs=1e-9)
    elbow = max(rows, key=lambda row: row["distance"])["m"]
    assert f"The elbow is m = {elbow};" in outcome.notes[0]


def test_more_segments_fit_the_robot_better():
    outcome = figure_6_4.run(Setting((patrol(1500),), quick=True))
    errors = [row["rmse_m"] for row in rows_of(outcome)]
    assert errors == sorted(errors, reverse=True)
    assert [[row["m"]] for row in rows_of(outcome)] == line_counts(outcome)


def test_a_map_grows_from_segments_to_transitions():
    outcome = figure_6_5.run(Setting(quick=True))
    (row,) = rows_of(outcome)
    assert row["edges"] == row["m"] + row["transitions"]
    assert row["nodes"] == 2 * row["m"]
    assert line_counts(outcome) == [[row["m"]], [row["m"]], [row["m"], row["transitions"]]]


def test_the_robot_is_drawn_part_by_part():
    outcome = figure_8_3.run(Setting((patrol(1500),), rmse=0.5, quick=True))
    (row,) = rows_of(outcome)
    assert row["rmse_m"] <= 0.5
    assert line_counts(outcome) == [[1, row["k"]]]


def test_a_person_is_mostly_at_home():
    outcome = figure_8_4.run(Setting(seed=2, quick=True, rmse=200.0))
    hours = {row["place"]: row["hours"] for row in rows_of(outcome)}
    assert list(hours) == ["home", "work", "friends", "gym"]
    assert max(hours, key=hours.__getitem__) == "home"
    texts = [text.get_text() for text in outcome.pictures[0].figure.axes[0].texts]
    assert texts == list(hours)


def test_a_patched_taxi_has_more_samples_than_were_recorded():
    outcome = figure_8_5.run(Setting(quick=True, rmse=100.0))
    (row,) = rows_of(outcome)
    assert row["rmse_m"] <= 105.0
    recorded, patched = (
        int(word.replace(",", ""))
        for word in outcome.notes[0].replace(".", "").split()
        if word.replace(",", "").isdigit()
    )
    assert recorded == 400 < patched
    assert [picture.name for picture in outcome.pictures] == ["100m", "archive-100m"]


def test_a_taxi_without_roads_is_not_patched():
    track = taxis(1, points=60).tracks[0]
    outcome = figure_8_5.run(Setting((track,), rmse=300.0, quick=True))
    assert "not patched" in outcome.notes[0]
    legend = outcome.pictures[0].figure.legends[0]
    assert legend.get_texts()[0].get_text() == "60 points"


def test_a_merged_archive_is_smaller_than_both():
    outcome = figure_8_6.run(Setting(quick=True, rmse=30.0))
    first, second, both, merged = rows_of(outcome)
    assert first["bytes"] + second["bytes"] == both["bytes"] > merged["bytes"]
    assert max(first["length_m"], second["length_m"]) < merged["length_m"] < both["length_m"]


def test_the_halves_of_a_single_track_are_merged():
    outcome = figure_8_6.run(Setting((patrol(800),), rmse=0.5, quick=True))
    assert [row["archive"] for row in rows_of(outcome)][2:] == ["both, not merged", "merged"]


def test_tracks_that_stand_still_have_no_map_in_figure_8_6():
    still = [Track(name, np.arange(9.0), np.zeros((9, 2))) for name in "ab"]
    outcome = figure_8_6.run(Setting(tuple(still), rmse=1.0, quick=True))
    assert [row["edges"] for row in outcome.tables[0].rows] == [0, 0, 0, 0]


def test_stays_are_the_cells_with_the_most_time():
    rng = np.random.default_rng(3)
    centers = np.array([[50.0, 50.0], [900.0, 50.0], [50.0, 900.0]])
    owner = np.repeat([0, 1, 2, 0], [30, 20, 5, 30])
    track = Track("a", 60.0 * np.arange(85), centers[owner] + rng.normal(0, 5, (85, 2)))
    stays = find_stays(track, 2)
    assert np.abs(np.array(stays) - centers[:2]).max() < 10
    # 29 minutes twice, and 19.
    assert hours_near(track, stays[0], 60.0) == pytest.approx(58 / 60)
    assert hours_near(track, stays[1], 60.0) == pytest.approx(19 / 60)


def test_places_of_a_person_are_those_of_the_seed():
    places = person_places(seed=5)
    assert {name: len(at) for name, at in places.items()} == {
        "home": 1,
        "work": 1,
        "friends": 1,
        "gym": 1,
        "errand": 12,
    }
    assert not np.array_equal(places["home"], person_places(seed=6)["home"])


def test_layers_show_lines_unless_a_frame_is_given():
    samples, line = np.array([[0.0, 0.0], [10.0, 10.0]]), np.array([[0.0, 0.0], [500.0, 0.0]])
    lines, label = Lines("far", [line], "#000000"), Label("there", np.array([5.0, 5.0]), 2.0)
    (axes,) = draw_layers([samples], [lines], [label]).axes
    assert axes.get_xlim()[1] > 500
    assert len(axes.patches) == 1
    (axes,) = draw_layers([samples], [lines], frame=[samples]).axes
    assert axes.get_xlim()[1] < 20
    assert axes.figure.legends[0].get_texts()[1].get_text() == "far"
