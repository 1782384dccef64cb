import json

import numpy as np
import pytest

from gpszip.io.networks.read import read_network


@pytest.fixture
def roads(tmp_path):
    lines = [[[0, 0], [40, 0]], [[40, 0], [40, 30]], [[40, 0], [0, 0]], [[9, 9], [9, 9]]]
    features = [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for line in lines
    ]
    path = tmp_path / "roads.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_a_network_is_prepared_and_repairs_are_printed(gpszip, roads, tmp_path):
    run = gpszip("network", roads, "-o", "ready.gpsz", "--metres")
    assert (run.code, run.out) == (0, "")
    assert "1 road without a length dropped" in run.err
    assert "1 road merged with another one of the same shape" in run.err
    assert "ready.gpsz: 2 roads between 3 nodes, 70 m" in run.err
    assert read_network(tmp_path / "ready.gpsz").lengths.tolist() == [40, 30]


def test_json(gpszip, roads):
    run = gpszip("network", roads, "-o", "ready.gpsz", "--json", "--metres")
    assert run.code == 0
    assert run.json["roads"] == 2
    assert run.json["components"] == 1
    assert {repair["count"] for repair in run.json["repairs"]} == {1}


def test_refuses_to_overwrite_and_names_what_is_wrong(gpszip, roads, log):
    assert gpszip("network", roads, "-o", roads).code == 1
    assert "no network" in gpszip("network", log, "-o", "ready.gpsz").err
    assert "no such file" in gpszip("network", "nowhere.geojson", "-o", "ready.gpsz").err


def test_a_prepared_network_is_no_archive(gpszip, roads):
    gpszip("network", roads, "-o", "ready.gpsz", "--metres")
    run = gpszip("decompress", "ready.gpsz", "-o", "out.csv")
    assert run.code == 4
    assert "road network" in run.err
    assert "--network" in run.err


def test_the_map_of_an_archive_is_a_network(gpszip, log, tmp_path):
    assert gpszip("compress", log, "-o", "walks.gpsz", "--rmse", "0.1m").code == 0
    run = gpszip("network", "walks.gpsz", "-o", "ready.gpsz")
    assert run.code == 0
    network = read_network(tmp_path / "ready.gpsz")
    assert network.lengths.sum() == pytest.approx(140, rel=0.05)
    assert network.forward.all()
    assert network.backward.all()
    assert np.isfinite(network.speeds).all()


def test_the_direction_of_lines_can_be_chosen(gpszip, roads, tmp_path):
    for option, both in (("--directed", [True, False]), ("--undirected", [True, True])):
        assert gpszip("network", roads, "-o", "ready.gpsz", "--metres", option, "--force").code == 0
        assert read_network(tmp_path / "ready.gpsz").backward.tolist() == both
