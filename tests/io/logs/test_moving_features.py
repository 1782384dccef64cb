"""MF-JSON: the three ways to write moving features, and what GPSZip writes."""

import io
import json

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.model import Track

#: Seconds from 1970 to 2018-12-31.
START = 1_546_214_400
TEXTS = ["2018-12-31T00:00:00Z", "2018-12-31 00:01:00", "2018-12-31T02:02:00+02"]
MILLISECONDS = [1000 * (START + 60 * i) for i in range(3)]
POSITIONS = [[8.0, 50.0], [8.0, 50.1], [8.0, 50.2]]


def read(value, **options):
    return read_logs(io.BytesIO(json.dumps(value).encode()), **options)


def moving(coordinates=POSITIONS, datetimes=TEXTS, **members):
    return {
        "type": "MovingPoint",
        "coordinates": coordinates,
        "datetimes": datetimes,
        "interpolation": "Linear",
        **members,
    }


def prism(geometry, **members):
    return {"type": "Feature", "properties": {"id": 7}, "temporalGeometry": geometry, **members}


def trajectory(datetimes=TEXTS, **properties):
    line = {"type": "LineString", "coordinates": POSITIONS}
    properties = {"id": 7, "datetimes": datetimes, **properties}
    return {"type": "Feature", "properties": properties, "geometry": line}


def collection(*features, **members):
    return {"type": "FeatureCollection", **members, "features": list(features)}


@pytest.mark.parametrize("datetimes", [TEXTS, MILLISECONDS])
@pytest.mark.parametrize(
    "dialect",
    [
        trajectory,
        lambda times: prism(moving(datetimes=times)),
        lambda times: prism(
            {"type": "MovingGeometryCollection", "prisms": [moving(datetimes=times)]}
        ),
        lambda times: collection(prism(moving(datetimes=times)), crs=None),
        lambda times: moving(datetimes=times),
        lambda times: {
            "type": "MovingGeogPoint",
            "sequences": [
                {"coordinates": POSITIONS[:2], "datetimes": times[:2], "lower_inc": True},
                {"coordinates": POSITIONS[2:], "datetimes": times[2:], "lower_inc": True},
            ],
        },
    ],
)
def test_all_dialects_are_one_track(dialect, datetimes):
    [track] = read(dialect(datetimes)).tracks
    assert track.times.tolist() == [START, START + 60, START + 120]
    lat, lon = to_geographic(track.positions, track.plane)
    np.testing.assert_allclose(np.column_stack([lon, lat]), POSITIONS, atol=1e-9)


def test_an_instant_is_a_track_of_one_point():
    [track] = read(moving([8, 50], "2018-12-31T00:00:00Z")).tracks
    assert track.times.tolist() == [START]


def test_names_are_properties():
    reading = read(collection(prism(moving()), prism(moving(), properties={"traj_id": "b"})))
    assert [track.id for track in reading.tracks] == ["7", "b"]


def test_temporal_properties_belong_to_their_times():
    groups = [
        {"datetimes": TEXTS[::-1], "speed": {"type": "Measure", "values": [3, 2, 1]}},
        {"datetimes": TEXTS[1:2], "crew": {"values": ["B"]}},
    ]
    reading = read(prism(moving(), temporalProperties=groups), keep=("speed", "crew"))
    [track] = reading.tracks
    assert track.attributes["speed"].tolist() == [1, 2, 3]
    assert track.attributes["crew"].tolist() == ["", "B", ""]


def test_lists_of_a_trajectory_are_attributes():
    [track] = read(trajectory(wind=[1.5, None, 2], crew="B"), keep=("wind", "crew")).tracks
    np.testing.assert_array_equal(track.attributes["wind"], [1.5, np.nan, 2])
    assert track.attributes["crew"].tolist() == ["B"] * 3
    with pytest.raises(InputError, match="its positions have no 'wind'"):
        read(trajectory(wind=[1, 2]), keep=("wind",))


def test_heights_are_third_numbers():
    [track] = read(prism(moving([[8, 50, 5], [8, 51, 6], [8, 52, 7]])), keep=("ele",)).tracks
    assert track.attributes["ele"].tolist() == [5, 6, 7]


@pytest.mark.parametrize(
    ("feature", "message"),
    [
        (prism(moving(datetimes=TEXTS[:2])), "feature 1: .*3 positions, but 2 times"),
        (prism(moving(datetimes=None)), "feature 1: its MovingPoint has no 'datetimes'"),
        (prism(moving(coordinates=7)), "feature 1: its MovingPoint holds 7, not a list"),
        (
            moving(crs={"type": "Name", "properties": {"name": "EPSG:25832"}}),
            "coordinates are in 'EPSG:25832'.*transform",
        ),
        (
            prism({"type": "MovingPolygon"}),
            "no LineString and no Point in it, only 1 MovingPolygon",
        ),
        (prism({}), "only 1 moving geometry of unknown type"),
        (prism([]), "only 1 feature without a position"),
    ],
)
def test_what_cannot_be_read_is_named(feature, message):
    with pytest.raises(InputError, match=message):
        read(feature)


def test_other_moving_geometries_are_counted():
    reading = read(collection(prism({"type": "MovingPolygon"}), prism(moving())))
    assert [item.name.split(": ")[1] for item in reading.left_out] == ["1 MovingPolygon"]


def test_deep_collections_are_read():
    geometry = moving()
    for _ in range(200):
        geometry = {"type": "MovingGeometryCollection", "prisms": [geometry]}
    assert read(prism(geometry)).kept == 3


# Writing


def tracks_on_earth():
    rows = "".join(
        f"{'ab'[i % 2]},{START + i}.25,{48 + i / 1000},{11 + i / 1000},{500 + i},n{i}\n"
        for i in range(20)
    )
    log = io.BytesIO(f"track_id,t,lat,lon,ele,name\n{rows}".encode())
    return read_logs(log, keep=("ele", "name")).tracks


def test_what_is_written_comes_back(tmp_path):
    tracks = tracks_on_earth()
    write_tracks(tracks, tmp_path / "a.mfjson")
    back = read_logs(tmp_path / "a.mfjson", keep=("ele", "name")).tracks
    for track, other in zip(tracks, back, strict=True):
        assert (track.id, track.times.tolist()) == (other.id, other.times.tolist())
        assert track.attributes["name"].tolist() == other.attributes["name"].tolist()
        assert track.attributes["ele"].tolist() == other.attributes["ele"].tolist()
        np.testing.assert_allclose(
            to_geographic(track.positions, track.plane),
            to_geographic(other.positions, other.plane),
            atol=1e-8,
        )


def test_metres_and_shapes_come_back(tmp_path):
    shape = Track("plan", [0, 1], [[5, 5, 0], [6, 7, 0]], timed=False)
    write_tracks([Track("hall", [0, 1.5], [[0, 0, 1], [1, 2, 3]]), shape], tmp_path / "a.mfjson")
    hall, plan = read_logs(tmp_path / "a.mfjson").tracks
    assert hall.positions.tolist() == [[0, 0, 1], [1, 2, 3]]
    assert (plan.timed, plan.positions.tolist()) == (False, [[5, 5, 0], [6, 7, 0]])


@pytest.mark.filterwarnings("ignore")
def test_movingpandas_reads_it(tmp_path):
    movingpandas = pytest.importorskip("movingpandas", reason="needs movingpandas")
    write_tracks(tracks_on_earth(), tmp_path / "a.mfjson")
    read_back = movingpandas.read_mf_json(tmp_path / "a.mfjson", traj_id_property="track_id")
    assert [trajectory.id for trajectory in read_back.trajectories] == ["a", "b"]
    frame = read_back.trajectories[0].df
    assert frame["ele"].tolist() == [500 + i for i in range(0, 20, 2)]
    assert frame.geometry.x.tolist() == [11 + i / 1000 for i in range(0, 20, 2)]


@pytest.mark.filterwarnings("ignore")
def test_what_movingpandas_writes_is_read():
    movingpandas = pytest.importorskip("movingpandas", reason="needs movingpandas")
    geopandas = pytest.importorskip("geopandas", reason="needs geopandas")
    import pandas

    x, y = np.array(POSITIONS).T
    frame = geopandas.GeoDataFrame(
        {"name": "a", "t": pandas.to_datetime(MILLISECONDS, unit="ms"), "speed": [1.5, 2, 3]},
        geometry=geopandas.points_from_xy(x, y),
        crs=4326,
    )
    written = movingpandas.gdf_to_mf_json(
        frame, "name", "t", temporal_columns=["speed"], datetime_to_str=True
    )
    [track] = read(written, keep=("speed",)).tracks
    assert (track.id, track.times.tolist()) == ("a", [START, START + 60, START + 120])
    assert track.attributes["speed"].tolist() == [1.5, 2, 3]
