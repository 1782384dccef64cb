import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.feature_tables import line_geometry, write_features, write_json, write_table
from gpszip.io.history_tables import write_edge_table
from gpszip.model import Network


def network(plane):
    none = np.zeros(0, np.int32)
    points = np.zeros((0, 2))
    flags = np.zeros(0, np.bool_)
    offsets = np.zeros(1, np.int64)
    return Network(points, none, none, offsets, points, flags, flags, np.zeros(0), plane)


@pytest.mark.parametrize("name", ["T.csv", "T.json", "T.parquet", "T.geojson"])
def test_degrees_and_probabilities_keep_their_decimals(tmp_path, name):
    plane = choose_plane([52.5], [13.4])
    columns = {"lat": np.array([52.5012345]), "probability": np.array([0.000123])}
    line = to_plane([52.5, 52.51], [13.4, 13.41], plane)
    path = tmp_path / name
    write_edge_table(columns, str(path), "changes", lines=[line], network=network(plane))
    if name == "T.parquet":
        (row,) = pq.read_table(path).to_pylist()
    elif name == "T.csv":
        head, cells = path.read_text().split()
        row = dict(zip(head.split(","), map(float, cells.split(",")), strict=True))
    else:
        document = json.loads(path.read_text())
        row = document["rows"][0] if name == "T.json" else document["features"][0]["properties"]
    assert row == {"lat": 52.5012345, "probability": 0.000123}


def test_missing_values_and_odd_texts(tmp_path):
    rows = [{"name": 'a "b", c\nd', "t": None}, {"name": "#1", "t": 2.5}]
    write_table(rows, {"name": "U", "t": "f"}, str(tmp_path / "T.csv"), "csv")
    assert (tmp_path / "T.csv").read_text() == 'name,t\n"a ""b"", c\nd",\n"#1",2.5\n'
    write_json({"rows": [{"t": np.nan}, {"t": [np.inf, 1]}]}, str(tmp_path / "T.json"))
    found = json.loads((tmp_path / "T.json").read_text())
    assert found == {"rows": [{"t": None}, {"t": [None, 1]}]}


def test_metres_are_marked_and_have_two_coordinates(tmp_path):
    line = line_geometry(np.array([[1.0], [2.00049]]), 3, geographic=False)
    assert line["coordinates"] == [[1, 0], [2, 0]]
    write_features([{"n": np.inf}], [line], str(tmp_path / "T.geojson"), geographic=False)
    document = json.loads((tmp_path / "T.geojson").read_text())
    assert document["features"][0]["properties"] == {"n": None}
    assert "gpszip" in document
