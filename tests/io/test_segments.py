from __future__ import annotations

import json

import numpy as np
import pytest

from gpszip.errors import InputError, OutputError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.segments import read_model, segment_format, write_segments
from gpszip.model import MarkovModel, SegmentMean


def written(tmp_path, starts, ends, plane=None, name="out.json"):
    """Write two segments that follow each other in turn, five parts in all."""
    starts, ends = np.array(starts, float), np.array(ends, float)
    labels = np.array([0, 1, 0, 1, 0], np.int32)
    mean = SegmentMean(np.arange(0, 11, 2), labels, starts, ends, 2.5)
    pairs = np.array([[0, 1], [1, 0]], np.int32)
    model = MarkovModel(starts, ends, np.array([1, 0]), pairs, np.array([2, 2]), 0.25, plane)
    parts = [
        {"part": j, "track_id": "bus", "segment": int(label)} for j, label in enumerate(labels)
    ]
    path = tmp_path / name
    write_segments(str(path), mean, model, parts, {"cost": mean.cost, "gap": np.inf})
    return path, model


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
def test_a_model_comes_back(tmp_path, dimension):
    starts = np.arange(2 * dimension).reshape(2, dimension) / 8
    path, model = written(tmp_path, starts, starts + 3)
    back = read_model(str(path))
    assert back.starts.tolist() == model.starts.tolist()
    assert back.ends.tolist() == model.ends.tolist()
    assert back.transitions.tolist() == model.transitions.tolist()
    assert (back.counts.tolist(), back.firsts.tolist(), back.sigma) == ([2, 2], [1, 0], 0.25)
    assert json.loads(path.read_text())["gap"] is None


def test_degrees_come_back_to_a_millimetre(tmp_path):
    plane = choose_plane([52.5], [13.4])
    starts = to_plane([52.5, 52.501], [13.4, 13.41], plane)
    path, model = written(tmp_path, starts, starts + 50.0, plane)
    back = read_model(str(path))
    assert back.plane == plane
    assert np.abs(back.ends - model.ends).max() < 1e-3


def test_lines_are_cut_at_the_antimeridian(tmp_path):
    plane = choose_plane([0.0], [180.0])
    starts = to_plane([0.0, 0.0], [179.99, -179.99], plane)
    path, _ = written(tmp_path, starts, starts[::-1], plane, "out.geojson")
    features = json.loads(path.read_text())["features"]
    segments = [each for each in features if each["properties"]["kind"] == "segment"]
    for feature, side in zip(segments, (1, -1), strict=True):
        first, second = feature["geometry"]["coordinates"]
        assert feature["geometry"]["type"] == "MultiLineString"
        assert first[0][0] == pytest.approx(side * 179.99, abs=1e-6)
        assert (abs(first[-1][0]), abs(second[0][0])) == (180, 180)


def test_kinds_of_features_are_counted(tmp_path):
    path, _ = written(tmp_path, [[0.0], [1.0]], [[1.0], [0.0]], name="out.geojson")
    features = json.loads(path.read_text())["features"]
    kinds = [each["properties"]["kind"] for each in features]
    assert [kinds.count(kind) for kind in ("segment", "transition", "part")] == [2, 2, 5]
    # GeoJSON has two coordinates at least
    assert features[0]["geometry"]["coordinates"] == [[0.0, 0.0], [1.0, 0.0]]
    assert features[0]["properties"]["parts"] == 3


def test_names_that_say_no_format_are_refused():
    with pytest.raises(OutputError, match="end it with"):
        segment_format("segments.txt")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"kind": "segment mean"}', "[" * 100_000])
def test_what_holds_no_model_is_refused(tmp_path, text):
    path = tmp_path / "no.json"
    path.write_text(text)
    with pytest.raises(InputError, match="gpszip segments LOG"):
        read_model(str(path))
