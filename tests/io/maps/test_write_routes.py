import csv
import io
import json

import numpy as np

from gpszip.io.maps.routes import write_routes
from gpszip.matching.match import match
from gpszip.model import Network, Track


def street(names):
    """Three consecutive roads; the last one may be travelled backward only."""
    nodes = np.array([[0, 0], [100, 0], [200, 0], [300, 0]], float)
    starts, ends = np.arange(3, dtype=np.int32), np.arange(1, 4, dtype=np.int32)
    points = np.stack((nodes[:-1], nodes[1:]), axis=1).reshape(-1, 2)
    forward, both = np.array([True, True, False]), np.ones(3, bool)
    return Network(
        nodes,
        starts,
        ends,
        2 * np.arange(4),
        points,
        forward,
        both,
        np.full(3, np.nan),
        ["a", "b", "c"],
        names=names,
    )


def written(tracks, network, kind):
    stream = io.BytesIO()
    write_routes(match(tracks, network), tracks, network, stream, kind)
    return stream.getvalue().decode()


def test_routes_have_street_names():
    drive = Track("car", np.arange(0, 21.0), np.stack((10.0 * np.arange(21), np.zeros(21)), axis=1))
    (route,) = json.loads(written([drive], street(["Main St", "Main St", ""]), "geojson"))[
        "features"
    ]
    assert (route["properties"]["roads"], route["properties"]["names"]) == (["a", "b"], ["Main St"])
    rows = list(csv.DictReader(io.StringIO(written([drive], street(["Main St", "", ""]), "csv"))))
    assert (rows[0]["road"], rows[0]["name"], rows[-1]["road"], rows[-1]["name"]) == (
        "a",
        "Main St",
        "b",
        "",
    )
    (bare,) = json.loads(written([drive], street(None), "geojson"))["features"]
    assert "names" not in bare["properties"]
    assert "name" not in next(csv.DictReader(io.StringIO(written([drive], street(None), "csv"))))


def test_a_route_names_the_road_travelled_the_wrong_way_after_it():
    drive = Track("car", np.arange(0, 31.0), np.stack((10.0 * np.arange(31), np.zeros(31)), axis=1))
    found = json.loads(written([drive], street(["", "", "Back Ln"]), "geojson"))
    (route,) = found["features"]
    assert (route["properties"]["end"], route["properties"]["against"]) == ("one-way", ["Back Ln"])
    (rest,) = found["unmatched"]
    assert (rest["reason"], rest["against"], rest["t_end"]) == ("one-way", ["Back Ln"], 30.0)
    assert rest["points"] + route["properties"]["points"] == 31


def test_routes_of_untimed_tracks_have_no_times():
    shape = Track("plan", [0, 60, 150], [[0, 0], [60, 0], [150, 0]], timed=False)
    drive = Track("car", np.arange(0, 21.0), np.stack((10.0 * np.arange(21), np.zeros(21)), axis=1))
    plan, car = json.loads(written([shape, drive], street(None), "geojson"))["features"]
    assert (
        plan["properties"]["length"],
        "t_start" in plan["properties"],
        "t_end" in plan["properties"],
    ) == (150.0, False, False)
    assert car["properties"]["t_end"] == 20.0
    rows = list(csv.DictReader(io.StringIO(written([shape, drive], street(None), "csv"))))
    assert [row["t"] for row in rows[:4]] == ["", "", "", "0"]
