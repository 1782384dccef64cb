import numpy as np
import pytest

from gpszip.experiments.experiment import Setting
from gpszip.experiments.memory import measured_memory
from gpszip.experiments.scaling import embedded, run, waypoints_of
from gpszip.experiments.table import to_records
from gpszip.testing import complete_graph, patrol, ring


@pytest.fixture(scope="module")
def tables():
    outcome = run(Setting((patrol(700),), rmse=0.5, quick=True))
    return {table.name: to_records(table) for table in outcome.tables}, outcome.pictures


def test_points_end_with_the_whole_log(tables):
    points = {row["points"] for row in tables[0]["points"]}
    assert points == {500, 700}
    for row in tables[0]["points"]:
        assert row["seconds"] >= 0
        assert (row["bytes"] is None) == (row["what"] != "archive")


def test_one_of_k_and_m_is_varied(tables):
    rows = tables[0]["parameters"]
    assert {row["m"] for row in rows if row["varied"] == "k"} == {8}
    assert {row["k"] for row in rows if row["varied"] == "m"} == {20}
    errors = [row["rmse_m"] for row in rows if row["varied"] == "m"]
    assert errors[-1] < errors[0] / 3


def test_the_number_of_workers_changes_no_byte(tables):
    rows = tables[0]["workers"]
    assert [row["workers"] for row in rows] == [1, 2]
    assert rows[0]["bytes"] == rows[1]["bytes"]


def test_dimensions_are_those_that_are_stated(tables):
    assert [row["dimensions"] for row in tables[0]["dimensions"]] == [2, 2, 2, 5, 5, 5]


def test_a_complete_graph_takes_more_than_a_ring(tables):
    circle, complete = tables[0]["graphs"]
    assert circle["waypoints"] < complete["waypoints"] == complete["steps"] + 1
    assert circle["bytes"] < complete["bytes"] / 2
    # A step on 24 nodes leads to one of 23 others: 4.5 bits, if nothing tells which.
    assert complete["shape_bits_per_step"] > np.log2(23)


def test_pictures_show_the_tables(tables):
    names = [picture.name for picture in tables[1]]
    assert {"points-seconds", "parameters-seconds", "graphs-bytes"} <= set(names)
    (axes,) = next(p for p in tables[1] if p.name == "graphs-bytes").figure.axes
    assert [line.get_label() for line in axes.lines] == ["ring", "complete"]


@pytest.mark.parametrize("dimension", [2, 3, 16])
def test_embedding_keeps_distances(dimension):
    track = patrol(60)
    turned = embedded(track, dimension)
    assert turned.positions.shape == (60, dimension)
    expected = np.linalg.norm(track.positions[:, None] - track.positions, axis=2)
    found = np.linalg.norm(turned.positions[:, None] - turned.positions, axis=2)
    assert found == pytest.approx(expected)


def test_waypoints_are_fewest_on_a_ring_and_all_on_a_complete_graph():
    # A shortest path leads at most half around: two for each lap, and the last node.
    assert waypoints_of(ring(9, laps=7)) <= 3 * 7 + 1
    assert waypoints_of(complete_graph(9, steps=63)) == 64


def test_memory_is_measured_beyond_what_was_there():
    with measured_memory() as memory:
        np.ones(20_000_000)
    # Other threads may give some of theirs back meanwhile.
    assert memory.bytes is None or 120e6 < memory.bytes < 400e6
    with measured_memory() as small:
        sum(range(10))
    assert small.bytes is None or small.bytes < 20e6
