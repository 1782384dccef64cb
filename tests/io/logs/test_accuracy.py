"""Errors of positions that logs state, where a caller asks for them."""

import json

import numpy as np
import pytest

from gpszip.io.logs.read import read_logs


def accuracy_of(path):
    (track,) = read_logs(path, accuracy=True).tracks
    return track.attributes.get("accuracy")


@pytest.mark.parametrize(
    "name", ["accuracy", "horizontalAccuracy", "acc", "gps_accuracy", "Accuracy (m)", "h_acc"]
)
def test_columns_of_tables(tmp_path, name):
    path = tmp_path / "phone.csv"
    path.write_text(f"t,lat,lon,{name}\n0,48,11,5\n1,48,11,\n2,48,11,30.5\n")
    np.testing.assert_array_equal(accuracy_of(path), [5, np.nan, 30.5])

    # Nobody who doesn't ask gets it, and it is told as dropped.
    result = read_logs(path)
    assert not result.tracks[0].attributes
    assert result.dropped_columns == (name,)
    assert read_logs(path, accuracy=True).dropped_columns == ()


def test_a_factor_is_no_length(tmp_path):
    path = tmp_path / "phone.csv"
    path.write_text("t,lat,lon,hdop,vertical_accuracy\n0,48,11,1.2,3\n")
    assert accuracy_of(path) is None


def test_properties_of_points(tmp_path):
    features = [
        {
            "type": "Feature",
            "properties": {"timestamp": f"2024-05-01T10:00:0{i}Z", "horizontal_accuracy": 10 + i},
            "geometry": {"type": "Point", "coordinates": [11.0, 48.0]},
        }
        for i in range(2)
    ]
    path = tmp_path / "phone.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert accuracy_of(path).tolist() == [10, 11]


def test_messages_of_owntracks(tmp_path):
    path = tmp_path / "phone.rec"
    fix = '{"_type":"location","tst":1714953600,"lat":48.1,"lon":11.5,"acc":12}'
    path.write_text(f"2024-05-06T00:00:00Z\t*\t{fix}\n")
    assert accuracy_of(path).tolist() == [12]


def test_records_of_google(tmp_path):
    entry = {
        "latitudeE7": 481000000,
        "longitudeE7": 115000000,
        "accuracy": 17,
        "timestamp": "2020-05-06T00:00:00Z",
    }
    path = tmp_path / "Records.json"
    path.write_text(json.dumps({"locations": [entry]}))
    assert accuracy_of(path).tolist() == [17]


def test_a_track_of_which_one_file_states_none(tmp_path):
    (tmp_path / "a.csv").write_text("track_id,t,lat,lon,acc\np,0,48,11,5\n")
    (tmp_path / "b.csv").write_text("track_id,t,lat,lon\np,9,48,11\n")
    assert accuracy_of([tmp_path / "a.csv", tmp_path / "b.csv"]) is None
