import io
import json

import pytest

from gpszip.errors import InputError
from gpszip.io.reading import read_logs


def read(data, **options):
    return read_logs(io.BytesIO((data if isinstance(data, str) else json.dumps(data)).encode()), **options)


def line(coordinates, kind="LineString", **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features, **members):
    return {"type": "FeatureCollection", **members, "features": list(features)}


def ids(reading):
    return [(track.id, track.times.tolist()) for track in reading.tracks]


@pytest.mark.parametrize(
    "feature",
    [
        line([[8, 50], [8, 50.1]], times=[1700000000.5, 1700000001]),
        line([[8, 50], [8, 50.1]], coordTimes=["2023-11-14T22:13:20.5Z", "2023-11-14T22:13:21Z"]),
        line([[8, 50], [8, 50.1]], coordTimes=[1700000000500, 1700000001000]),
        line([[8, 50], [8, 50.1]], coordinateProperties={"times": [1700000000.5, 1700000001]}),
        line([[8, 50, 0, 1700000000.5], [8, 50.1, 0, 1700000001]]),
        line([[[8, 50]], [[8, 50.1]]], kind="MultiLineString", coordTimes=[[1700000000.5], [1700000001]]),
    ],
)
def test_the_places_where_lines_keep_their_times(feature):
    for data in (collection(feature), feature):
        reading = read(data)
        assert ids(reading) == [("0", [1700000000.5, 1700000001.0])]
        assert reading.tracks[0].positions[1, 1] > reading.tracks[0].positions[0, 1]


def test_lines_have_names_and_features_of_one_name_are_one_track():
    data = collection(
        line([[8, 50], [8, 51]], track_id="007", times=[0, 1]),
        line([[8, 50]], id=12, times=[5]),
        line([[8, 52]], track_id="007", times=[2]),
    )
    assert ids(read(data)) == [("007", [0, 1, 2]), ("12", [5])]


def test_height_is_an_attribute():
    data = collection(line([[8, 50, 300], [8, 51, 301]], times=[0, 1]))
    assert read(data).dropped == ("alt",)
    assert read(data, keep=["ele"]).tracks[0].attributes["ele"].tolist() == [300, 301]


def test_points_have_their_time_and_name_among_their_properties():
    features = [line([8, 50 + i / 1000], "Point", vehicle=str(i % 2), timestamp=f"2023-11-14T22:13:2{i}Z", speed=i) for i in range(4)]
    reading = read(collection(*features))
    assert ids(reading) == [("0", [1700000000, 1700000002]), ("1", [1700000001, 1700000003])]
    assert reading.dropped == ("speed",)


def test_what_is_no_line_is_named_as_left_out():
    data = collection(line([[8, 50]], times=[0]), line([8, 50], "Point"), line([[[8, 50]]], "Polygon"))
    assert sorted(left.name for left in read(data).left_out) == ["stream: 1 Point", "stream: 1 Polygon"]


def test_metres_are_marked():
    data = collection(line([[1e6, 5, 2], [2, 3, 4]], times=[0, 1]), gpszip={"coordinates": "metres"})
    reading = read(data)
    assert not reading.geographic
    assert reading.tracks[0].positions.tolist() == [[1e6, 5, 2], [2, 3, 4]]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (collection(line([[8, 50], [8, 51]])), "feature 1: no times; a LineString needs the property 'coordTimes' or 'times'"),
        (collection(line([[8, 50], [8, 51]], times=[0])), "feature 1: has 2 positions, but 1 times"),
        (collection(line([8, 50], "Point", speed=1)), "no time; columns found: lon, lat, speed"),
        (collection(), "no LineString and no Point"),
        ("{", "damaged JSON"),
        ("{" + '"a":[' * 100_000, "damaged JSON"),
        (collection(line([["a", 50], [8, 51]], times=[0, 1])), "not as GeoJSON should be"),
        (collection(line([[8], [8, 51]], times=[0, 1])), "not as GeoJSON should be"),
        (collection(line(5, times=[0, 1])), "not as GeoJSON should be"),
        (collection(line([8], "Point", time=1)), "not as GeoJSON should be"),
        ({"type": "FeatureCollection", "features": 7}, "not as GeoJSON should be"),
        (collection(5, None), "no LineString and no Point"),
    ],
)
def test_mistakes_are_named_in_one_line(data, says):
    with pytest.raises(InputError) as caught:
        read(data)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
