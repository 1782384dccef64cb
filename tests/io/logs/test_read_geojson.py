import io
import json

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.io.logs.geojson.read import read_geojson
from gpszip.io.logs.raw import Request, UnreadableCell
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.sniff.json import sniff_geojson
from gpszip.io.storage.source import Source


def read(data, **options):
    return read_logs(
        io.BytesIO((data if isinstance(data, str) else json.dumps(data)).encode()), **options
    )


def line(coordinates, kind="LineString", **properties):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


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
        line(
            [[[8, 50]], [[8, 50.1]]],
            kind="MultiLineString",
            coordTimes=[[1700000000.5], [1700000001]],
        ),
    ],
)
def test_times_are_read_from_all_properties_that_hold_them(feature):
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
    assert read(data).dropped_columns == ("alt",)
    assert read(data, keep=["ele"]).tracks[0].attributes["ele"].tolist() == [300, 301]


def test_points_have_their_time_and_name_among_their_properties():
    features = [
        line(
            [8, 50 + i / 1000],
            "Point",
            vehicle=str(i % 2),
            timestamp=f"2023-11-14T22:13:2{i}Z",
            speed=i,
        )
        for i in range(4)
    ]
    reading = read(collection(*features))
    assert ids(reading) == [("0", [1700000000, 1700000002]), ("1", [1700000001, 1700000003])]
    assert reading.dropped_columns == ("speed",)


def test_what_is_no_line_is_named_as_left_out():
    data = collection(
        line([[8, 50]], times=[0]), line([8, 50], "Point"), line([[[8, 50]]], "Polygon")
    )
    assert sorted(left.name for left in read(data).left_out) == [
        "stream: 1 Point",
        "stream: 1 Polygon",
    ]


def test_metres_are_marked():
    data = collection(
        line([[1e6, 5, 2], [2, 3, 4]], times=[0, 1]), gpszip={"coordinates": "metres"}
    )
    reading = read(data)
    assert not reading.geographic
    assert reading.tracks[0].positions.tolist() == [[1e6, 5, 2], [2, 3, 4]]


def raw(data, **request):
    data = data if isinstance(data, (str, bytes)) else json.dumps(data)
    return read_geojson(
        Source("log", data=data if isinstance(data, bytes) else data.encode()), Request(**request)
    )


def tracks(log):
    """Name, times and latitudes of each track; None for the times of a shape."""
    codes = np.zeros(len(log.times), int) if log.codes is None else log.codes
    found = {}
    for code in dict.fromkeys(codes.tolist()):
        times = log.times[codes == code]
        assert np.isnan(times).all() or code not in log.untimed
        found[log.ids[code] if log.ids else None] = (
            None if code in log.untimed else times.tolist(),
            log.coordinates[codes == code, 0].tolist(),
        )
    return found


def two(lat=50, **properties):
    return line([[8, lat], [8, lat + 1]], **properties)


@pytest.mark.parametrize(
    ("position", "shown"),
    [
        ("[null, 48.1]", "[null, 48.1]"),
        ('["8.5", 48.1]', '["8.5", 48.1]'),
        ("[true, 48.1]", "[true, 48.1]"),
        ("[NaN, 48.1]", '["NaN", 48.1]'),
        ("[8, -Infinity]", '[8, "-Infinity"]'),
        ("[8, 1e999]", "[8, Infinity]"),
        ("[8]", "[8]"),
        ("[]", "[]"),
        ("null", "null"),
        ("7", "7"),
        ("{}", "{}"),
        ("[[8, 50], [8, 51]]", "[[8, 50], [8, 51]]"),
        ("[8, " + "9" * 400 + "]", "[8, " + "9" * 53 + "..."),
        ("[8, " + "9" * 5000 + "]", '[8, "' + "9" * 52 + "..."),
    ],
)
def test_a_position_that_is_no_two_numbers_is_dropped_counted_and_named(position, shown):
    good = json.dumps(
        collection(
            two(times=[0, 1]), line([[8, 40], ["here"], [8, 41], ["here"]], times=[2, 3, 4, 5])
        )
    )
    log = raw(good.replace('["here"]', position))
    assert tracks(log) == {"0": ([0, 1], [50, 51]), "1": ([2, 4], [40, 41])}
    (repair,) = log.repairs
    assert (repair.count, repair.drops, repair.where, repair.value) == (
        2,
        True,
        "log: feature 2, position 2",
        shown,
    )


@pytest.mark.parametrize(
    ("feature", "reason"),
    [
        (two(times=[0]), "has 2 positions, but 1 times"),
        (
            line([[[8, 50]], [[8, 51]]], "MultiLineString", times=[[0], [1], [2]]),
            "has 2 lines, but 3 lists of times",
        ),
        (
            line([[[8, 50]], [[8, 51]]], "MultiLineString", times=[[0], [1, 2]]),
            "line 2 has 1 positions, but 2 times",
        ),
        (
            line([[[8, 50]], [[8, 51]]], "MultiLineString", times=[0, 1, 2]),
            "has 2 positions, but 3 times",
        ),
        (two(times="2024-05-04T08:00:00Z"), "its 'times' is \"2024-05-04T08:00:00Z\", not a list"),
        (two(times=["yesterday", "today"]), 'no time of it can be read, such as "yesterday"'),
        (two(times=[[1], {"a": 2}]), "no time of it can be read, such as"),
        (
            line([[8, 50, 0, None], [8, 51, 0, "now"]]),
            "no fourth number of its positions is a time, such as [8, 50, 0, null]",
        ),
        (
            line([["a", 50], [8, None]]),
            'none of its 2 positions is a longitude and a latitude, such as ["a", 50]',
        ),
        (
            line([[[8, 50], [8, 51]]], times=[0]),
            "none of its 1 positions is a longitude and a latitude",
        ),
        (line([8, 50]), "none of its 2 positions is a longitude and a latitude, such as 8"),
        (line(5), "its LineString holds 5, not a list"),
        (
            line([[8, 50], 5], "MultiLineString", times=[0]),
            "its MultiLineString's line holds 5, not a list",
        ),
        ({"type": "Feature", "geometry": "here"}, 'its geometry is "here", not an object'),
        (
            {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": [7]}},
            "its GeometryCollection holds 7",
        ),
        (
            {
                "type": "Feature",
                "geometry": {**two()["geometry"], "crs": {"properties": {"name": "EPSG:25832"}}},
            },
            "in 'EPSG:25832'",
        ),
        (
            {"locations": [], "semanticSegments": []},
            'neither a feature nor a geometry; it has: "locations", "semanticSegments"',
        ),
        (7, "is 7, not a feature"),
        (None, "is null, not a feature"),
    ],
)
def test_a_feature_that_cannot_be_used_is_named_and_may_be_left_out(feature, reason):
    good = two(times=["2024-05-04T08:00:00Z", "2024-05-04T08:00:01Z"])
    with pytest.raises(InputError) as caught:
        raw(collection(good, feature, good))
    assert str(caught.value).startswith("log: feature 2: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    log = raw(collection(good, feature, good), skip_bad=True)
    (left,) = log.left_out
    assert (left.name, len(log.times)) == ("log: feature 2", 4)
    assert reason in left.reason
    with pytest.raises(InputError, match="log: feature 1: "):
        raw(collection(feature), skip_bad=True)


def test_of_many_bad_features_the_first_are_named_and_the_others_counted():
    log = raw(collection(two(times=[0, 1]), *[7] * 25), skip_bad=True)
    assert [left.name for left in log.left_out] == [
        *(f"log: feature {i}" for i in range(2, 12)),
        "log: 15 more features",
    ]


def test_single_times_that_cannot_be_read_are_no_times():
    log = raw(
        collection(
            two(times=[0, 1]),
            line([[8, 50], [8, 51], [8, 52]], times=[None, "2024-05-04T08:00:00Z", "?"]),
        )
    )
    assert np.isnan(log.times).tolist() == [False, False, True, False, True]
    assert log.unreadable == (UnreadableCell("times", 4, "?"),)


def test_shapes_and_tracks_with_times_are_kept_side_by_side():
    reading = read(collection(two(id="plan"), two(lat=40, id="ride", times=[5, 6])))
    assert [(track.id, track.timed, len(track)) for track in reading.tracks] == [
        ("plan", False, 2),
        ("ride", True, 2),
    ]


@pytest.mark.parametrize(
    "times",
    [{}, {"times": None}, {"time": "2024-05-04T08:00:00Z"}, {"coordTimes": [None, None]}, {"t": 5}],
)
def test_a_line_without_times_is_a_shape(times):
    assert tracks(raw(two(**times))) == {None: (None, [50, 51])}
    log = raw(
        collection(
            two(lat=40, id="ride", times=[5, 6]), two(id="plan", **times), two(lat=60, **times)
        )
    )
    assert tracks(log) == {
        "ride": ([5, 6], [40, 41]),
        "plan": (None, [50, 51]),
        "2": (None, [60, 61]),
    }
    assert log.untimed == {1, 2}
    assert not log.repairs


def test_each_shape_is_a_separate_track():
    several = line([[[8, 50], [8, 51]], [], [[8, 60], [8, 61]]], "MultiLineString", id="plan")
    log = raw(
        collection(
            several, two(70, id="plan"), two(80, id="plan", times=[0, 1]), two(20, id="plan-3")
        )
    )
    assert tracks(log) == {
        "plan-2": (None, [50, 51]),
        "plan-4": (None, [60, 61]),
        "plan-5": (None, [70, 71]),
        "plan": ([0, 1], [80, 81]),
        "plan-3": (None, [20, 21]),
    }
    assert [(repair.count, repair.drops) for repair in log.repairs] == [(2, False)]
    assert list(tracks(raw(several))) == ["plan", "plan-2"]


def test_a_number_that_stands_for_a_name_is_not_another_name():
    log = raw(collection(two(40, times=[0, 1]), two(60, id="0", times=[2, 3])))
    assert tracks(log) == {"0-2": ([0, 1], [40, 41]), "0": ([2, 3], [60, 61])}


def test_lines_of_a_collection_of_geometries_share_the_feature():
    geometry = {
        "type": "GeometryCollection",
        "geometries": [
            two()["geometry"],
            {
                "type": "GeometryCollection",
                "geometries": [two(60)["geometry"], {"type": "Point", "coordinates": [0, 0]}, None],
            },
        ],
    }
    for times in ([0, 1, 2, 3], [[0, 1], [2, 3]]):
        log = raw(
            {"type": "Feature", "properties": {"times": times, "id": 7}, "geometry": geometry}
        )
        assert tracks(log) == {"7": ([0, 1, 2, 3], [50, 51, 60, 61])}
        assert [left.name for left in log.left_out] == ["log: 1 Point"]


def test_geometries_without_a_line_are_counted():
    nothing = [line(None), line([], coordTimes=[]), line([[], []], "MultiLineString")]
    shapes = [
        line([[8, 50]]),
        line([[[8, 50]]], "MultiPolygon"),
        line([[8, 50]], "MultiPoint"),
        line([[8, 50]], "Circle"),
    ]
    log = raw(
        collection(two(times=[0, 1]), {"type": "Feature", "geometry": None}, *nothing, *shapes)
    )
    assert [left.name for left in log.left_out] == [
        "log: 1 MultiPoint",
        "log: 1 MultiPolygon",
        "log: 1 feature without a geometry",
        "log: 3 feature without a position",
        'log: 1 geometry of type "Circle"',
        "log: 1 line of one position without a time",
    ]
    with pytest.raises(InputError, match="no LineString and no Point in it, only 1 MultiPolygon"):
        raw(shapes[1])


@pytest.mark.parametrize(
    "text",
    [
        "{0}\n{1}\n",
        "{0}\r\n\r\n{1}",
        "\x1e{0}\n\x1e{1}\n",
        "[{0}, {1}]",
        '{{"features": [{0}]}}\n{{"type": "FeatureCollection", "name": "b", "features": [{1}]}}',
        '{{"features": [{0}, {1}], "type": "FeatureCollection", "bbox": [1, 2, 3, 4], '
        '"foreign": {{"features": []}}}}',
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_features_on_lines_in_lists_and_in_collections(text, encoding):
    features = (json.dumps(two(times=[0, 1])), json.dumps(two(60, times=[2, 3])))
    data = text.format(*features).encode(encoding)
    assert sniff_geojson(data)
    assert tracks(raw(data)) == {"0": ([0, 1], [50, 51]), "1": ([2, 3], [60, 61])}


def test_a_bare_geometry_is_a_feature():
    assert tracks(raw(line([[8, 50, 0, 5], [8, 51, 0, 6]])["geometry"])) == {
        None: ([5, 6], [50, 51])
    }
    assert tracks(raw([two()["geometry"], two(60)["geometry"]])) == {
        "0": (None, [50, 51]),
        "1": (None, [60, 61]),
    }


def test_of_a_damaged_file_what_comes_before_may_be_kept():
    text = json.dumps(collection(two(times=[0, 1]), two(60, times=[2, 3]), two(70, times=[4, 5])))
    cut = text[: text.index("70")]
    with pytest.raises(InputError, match="log: damaged JSON file: it is cut short"):
        raw(cut)
    log = raw(cut, skip_bad=True)
    assert list(tracks(log).values()) == [([0, 1], [50, 51]), ([2, 3], [60, 61])]
    assert log.left_out[0].name == "log: all after feature 2"
    assert log.left_out[0].reason.startswith("damaged JSON file: it is cut short")
    with pytest.raises(InputError, match="damaged JSON file"):
        raw("{", skip_bad=True)


@pytest.mark.parametrize(
    "name",
    [
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "urn:ogc:def:crs:OGC::CRS84",
        "OGC:CRS84",
        "EPSG:4326",
        "urn:ogc:def:crs:EPSG::4326",
        "WGS 84",
    ],
)
def test_wgs84_may_be_named(name):
    assert (
        len(
            raw(
                collection(two(times=[0, 1]), crs={"type": "name", "properties": {"name": name}})
            ).times
        )
        == 2
    )


@pytest.mark.parametrize(
    ("crs", "says"),
    [
        (
            {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
            "are in 'urn:ogc:def:crs:EPSG::3857'; bring them to",
        ),
        ({"type": "EPSG", "properties": {"code": 31467}}, "are in '31467'"),
        ({"type": "name", "properties": {"name": "a\nb"}}, r"are in 'a\nb'"),
        (
            {"type": "link", "properties": {"href": "x"}},
            "names a coordinate system in a way that isn't known",
        ),
        ("EPSG:3857", "names a coordinate system in a way that isn't known"),
    ],
)
def test_other_coordinate_systems_are_refused_wherever_they_are_named(crs, says):
    feature = two(times=[0, 1])
    for data in (
        collection(feature, crs=crs),
        {"crs": crs, **feature},
        {"features": [feature], "crs": crs},
    ):
        with pytest.raises(InputError) as caught:
            raw(data)
        assert says in str(caught.value)


def test_metres_and_degrees_are_not_read_together():
    metres = json.dumps(collection(two(times=[0, 1]), gpszip={"coordinates": "metres"}))
    with pytest.raises(InputError, match="holds features in metres and others in degrees"):
        raw(metres + json.dumps(collection(two(times=[0, 1]))))


def test_heights_are_kept_where_there_are_some():
    data = collection(
        line(
            [[8, 50, 300], [8, 51], [8, 52, None], [8, 53, "high"], [8, 54, 304]],
            times=[0, 1, 2, 3, 4],
        )
    )
    log = raw(data, keep=("alt",))
    assert np.array_equal(log.attributes["alt"], [300, np.nan, np.nan, np.nan, 304], equal_nan=True)
    assert [(repair.count, repair.drops, repair.where) for repair in log.repairs] == [
        (3, False, "log: position 2")
    ]
    assert raw(data).dropped_columns == ("alt",)
    with pytest.raises(InputError, match="its positions have no 'alt'"):
        raw(two(times=[0, 1]), keep=("alt",))


def test_texts_and_numbers_in_one_file_are_each_read_as_what_they_are():
    data = collection(
        two(times=[1700000000000, 1700000001000]),
        two(60, times=["2023-11-14T22:13:20Z", "2023-11-14T22:13:21Z"]),
    )
    assert [times for times, _ in tracks(raw(data)).values()] == [[1700000000, 1700000001]] * 2


def test_the_properties_of_times_and_names_can_be_named():
    data = collection(two(when=[5, 6], boat="Ida", times="many", id="no"))
    assert tracks(raw(data, columns={"t": "when", "id": "boat"})) == {"Ida": ([5, 6], [50, 51])}


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "<script>alert(1)</script>",
        "a\0b\x1b[2J",
        "a\nb",
        "",
        "ü😀",
        12,
        12.5,
        -(10**30),
        "x" * 10_000,
    ],
)
def test_names_stay_as_they_are(name):
    assert list(tracks(raw(collection(two(40, times=[0, 1]), two(id=name, times=[0, 1])))))[
        1
    ] == str(name)


@pytest.mark.parametrize("odd", [None, True, [1], {"a": 1}])
def test_what_is_no_name_is_passed_over(odd):
    feature = two(track_id=odd, id=odd, name="Ida", times=[0, 1])
    assert list(tracks(raw(collection(feature)))) == ["Ida"]


def test_half_surrogate_pairs_are_written_out():
    text = json.dumps(collection(two(id="half", times=[0, 1]), two(60, id="other", times=[0, 1])))
    log = raw(text.replace("half", r"\ud800").replace("other", r"\ud801"))
    assert log.ids == (r"\ud800", r"\ud801")


def test_points_without_a_position_are_dropped_counted_and_named():
    features = [line([8, 50 + i / 1000], "Point", vehicle="v", time=i) for i in range(4)]
    features[1]["geometry"]["coordinates"] = [None, 50]
    features[3]["geometry"] = {"type": "Point"}
    log = raw(collection(line([[8, 50]], "MultiPoint"), *features))
    assert tracks(log) == {"v": ([0, 2], [50, 50.002])}
    (repair,) = log.repairs
    assert (repair.count, repair.where, repair.value) == (2, "log: feature 3", "[null, 50]")
    assert [left.name for left in log.left_out] == ["log: 1 MultiPoint"]
    with pytest.raises(
        InputError, match=r"no Point is at a longitude and a latitude; the first is at \[null, 50\]"
    ):
        raw(features[1])


@pytest.mark.parametrize("name", ["time", "timestamps", "t", "timestamp"])
def test_points_have_their_times_under_many_names(name):
    log = raw(
        collection(
            *(
                line([8, 50], "Point", times=3, **{name: f"2023-11-14T22:13:2{i}Z"})
                for i in range(2)
            )
        )
    )
    assert log.times.tolist() == [1700000000, 1700000001]


def test_properties_of_points_may_be_anything():
    values = [1, 2.5, "three", None, True, [1], {"a": None}, 10**30]
    features = [
        line([8, 50, 7], "Point", time=i, vehicle={"a": i % 2}, note=value)
        for i, value in enumerate(values)
    ]
    log = raw(collection(*features), keep=("note", "alt"))
    assert log.attributes["note"].tolist() == [
        "1",
        "2.5",
        "three",
        "",
        "true",
        "[1]",
        '{"a": null}',
        str(10**30),
    ]
    assert log.attributes["alt"].tolist() == [7] * 8
    assert log.ids == ('{"a": 0}', '{"a": 1}')


def test_columns_may_change_between_batches_of_points(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.geojson.points._BATCH_POINTS", 1000)
    count = 3500
    features = [
        line([8, 50 + i / count], "Point", time=i, **({"late": i} if i > count - 5 else {}))
        for i in range(count)
    ]
    features[2000]["properties"]["time"] = 2000.5
    log = raw("\n".join(map(json.dumps, features)), keep=("late",))
    assert log.times[[0, 1999, 2000, -1]].tolist() == [0, 1999, 2000.5, count - 1]
    assert np.isnan(log.attributes["late"]).sum() == count - 4
    assert log.coordinates[:, 0].tolist() == [50 + i / count for i in range(count)]


def test_points_with_different_properties_each_are_refused():
    features = [line([8, 50], "Point", time=i, **{f"p{i}": 1}) for i in range(8000)]
    with pytest.raises(InputError, match="its points have 8,001 different properties"):
        raw(collection(*features))


def test_points_with_times_come_before_lines_without():
    points = [line([8, 50 + i], "Point", time=i) for i in range(3)]
    log = raw(collection(*points, two()))
    assert tracks(log) == {None: ([0, 1, 2], [50, 51, 52])}
    assert [left.name for left in log.left_out] == ["log: 1 line without times"]
    log = raw(collection(*points, two(times=[0, 1])))
    assert list(tracks(log).values()) == [([0, 1], [50, 51])]
    assert [left.name for left in log.left_out] == ["log: 3 Point"]
    log = raw(collection(line([8, 50], "Point", name="start"), two()))
    assert list(tracks(log).values()) == [(None, [50, 51])]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (collection(line([8, 50], "Point", speed=1)), "no time; columns found: lon, lat, speed"),
        (collection(), "no LineString and no Point"),
        ("[]", "no LineString and no Point"),
        ("{", "damaged JSON"),
        ("{" + '"a":[' * 100_000, "damaged JSON"),
        (
            line([8], "Point", time=1),
            "no Point is at a longitude and a latitude; the first is at [8]",
        ),
        ({"type": "FeatureCollection", "features": 7}, "its 'features' is 7, not a list"),
        ({"type": "FeatureCollection", "features": None}, "its 'features' is null, not a list"),
        ({"type": "FeatureCollection"}, "it has no 'features'"),
        (
            {"type": "Topology", "objects": {}},
            'neither a feature nor a geometry; it has: "type", "objects"',
        ),
        ("7", "damaged JSON file: an object or a list is expected"),
    ],
)
def test_mistakes_are_named_in_one_line(data, says):
    with pytest.raises(InputError) as caught:
        raw(data)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "head", [b"[t],x,y", b"t,x,y", b"<gpx>", b"", b"[1, 2", "t,x,y".encode("utf-16")]
)
def test_other_texts_are_not_taken_for_geojson(head):
    assert not sniff_geojson(head)
