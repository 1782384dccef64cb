import csv
import json

import numpy as np
import pytest


@pytest.fixture
def streets(tmp_path):
    """A town of 5 by 5 crossings, 100 m apart, in x and y."""
    lines = [[[100 * x, 100 * y], [100 * x + 100, 100 * y]] for x in range(4) for y in range(5)]
    lines += [[[100 * x, 100 * y], [100 * x, 100 * y + 100]] for x in range(5) for y in range(4)]
    features = [
        {
            "type": "Feature",
            "properties": {"id": f"s{i}"},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for i, line in enumerate(lines)
    ]
    path = tmp_path / "streets.geojson"
    path.write_text(
        json.dumps(
            {"type": "FeatureCollection", "gpszip": {"coordinates": "metres"}, "features": features}
        )
    )
    return path


@pytest.fixture
def drive(tmp_path):
    """Two vehicles on the streets, with names that are no numbers."""
    rng = np.random.default_rng(1)
    corners = np.array([[0, 0], [200, 0], [200, 300], [400, 300]], float)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    rows = ["track_id,t,x,y"]
    for name in ("007", "bus, red"):
        for t in range(70):
            x, y = (np.interp(10.0 * t, along, axis) + rng.normal(0, 2) for axis in corners.T)
            rows.append(f'"{name}",{t},{x:.3f},{y:.3f}')
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_lines_have_times_roads_and_confidence(gpszip, drive, streets, tmp_path):
    done = gpszip("match", drive, "--network", streets, "-o", "routes.geojson")
    assert done.code == 0, done.err
    assert "matched 100 % of 140 points in 2 tracks on 2 routes of 13" in done.err
    assert "sigma" in done.err
    assert "breaks: none" in done.err
    found = json.loads((tmp_path / "routes.geojson").read_text())
    assert "gpszip" in found
    first, second = (one["properties"] for one in found["features"])
    assert (first["track_id"], second["track_id"]) == ("007", "bus, red")
    assert (first["t_start"], first["t_end"], first["points"], first["matched"], first["end"]) == (
        0.0,
        69.0,
        70,
        1.0,
        "end of track",
    )
    assert first["length"] == pytest.approx(690, abs=15)
    assert 0.5 < first["confidence"] <= 1
    assert all(road.startswith("s") for road in first["roads"])
    line = np.array(found["features"][0]["geometry"]["coordinates"])
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(
        first["length"], abs=0.1
    )
    assert {(200.0, 0.0), (200.0, 300.0)} <= {tuple(one) for one in line.tolist()}


def test_rows_have_the_position_of_every_point_on_its_road(gpszip, drive, streets, tmp_path):
    assert gpszip("match", drive, "--network", streets, "-o", "routes.csv").code == 0
    with open(tmp_path / "routes.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    names = "track_id t x y road_x road_y distance piece road forward offset along confidence"
    assert list(rows[0]) == [*names.split(), "reason", "against"]
    assert len(rows) == 140
    assert rows[70]["track_id"] == "bus, red"
    off = [
        np.hypot(float(row["x"]) - float(row["road_x"]), float(row["y"]) - float(row["road_y"]))
        for row in rows
    ]
    np.testing.assert_allclose(off, [float(row["distance"]) for row in rows], atol=2e-3)
    assert all(min(float(row["road_x"]) % 100, float(row["road_y"]) % 100) == 0 for row in rows)


def test_json_has_the_numbers(gpszip, drive, streets):
    done = gpszip(
        f"match {drive} --network {streets} -o routes.geojson --json --sigma 5m --beta 7m"
    )
    assert done.code == 0
    expected = {
        "points": 140,
        "tracks": 2,
        "pieces": 2,
        "matched": 1.0,
        "sigma": 5.0,
        "beta": 7.0,
        "breaks": {},
        "unmatched": {},
        "one_way": [],
    }
    assert {key: done.json[key] for key in expected} == expected


@pytest.fixture
def headed(drive, tmp_path):
    """The drive with a column of headings."""
    rows = [
        line.split(",") for line in drive.read_text().replace("bus, red", "red").splitlines()[1:]
    ]
    course = [90 if float(t) < 20 or float(t) >= 50 else 0 for _, t, *_ in rows]
    path = tmp_path / "headed.csv"
    path.write_text(
        "track_id,t,x,y,Course (deg)\n"
        + "".join(",".join(row) + f",{one}\n" for row, one in zip(rows, course, strict=True))
    )
    return path


def test_headings_are_used_and_their_spread_printed(gpszip, headed, streets):
    run = ("match", headed, "--network", streets, "-o", "routes.geojson", "--force")
    assert "heading " in gpszip(*run).err
    assert 1 < gpszip(*run, "--json").json["heading"] < 20
    assert gpszip(*run, "--json", "--heading", "12deg").json["heading"] == 12
    assert (
        gpszip(*run, "--json", "--heading", "none").json["heading"],
        "heading" in gpszip(*run, "--heading", "none").err,
    ) == (
        None,
        False,
    )


def test_headings_that_are_ignored_are_named(gpszip, headed, streets):
    run = ("match", headed, "--network", streets, "-o", "routes.geojson", "--columns", "heading=y")
    assert "no position" in gpszip(*run).err
    headed.write_text(headed.read_text().replace(",90\n", ",0\n"))
    done = gpszip(*run[:-2])
    assert "headings of 2 tracks ignored, as they don't follow the roads travelled" in done.err


def test_standard_output_carries_the_routes(shell, drive, streets):
    done = shell("match", drive, "--network", streets, "-o", "-", "--format", "csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"track_id,t,x,y")
    assert len(done.stdout.splitlines()) == 141
    assert done.stderr.startswith(b"standard output: matched 100 % of 140 points")


def test_a_break_is_counted(gpszip, drive, streets, tmp_path):
    rows = drive.read_text().splitlines()
    (tmp_path / "torn.csv").write_text("\n".join(rows[:21] + rows[51:71]) + "\n")
    done = gpszip("match", "torn.csv", "--network", streets, "-o", "routes.geojson", "--gap", "10s")
    assert done.code == 0
    assert "breaks: gap 1" in done.err
    ends = [
        one["properties"]["end"]
        for one in json.loads((tmp_path / "routes.geojson").read_text())["features"]
    ]
    assert ends == ["gap", "end of track"]


def test_an_archive_is_a_network(gpszip, drive, tmp_path):
    assert gpszip("compress", drive, "-o", "map.gpsz", "--rmse", "3m").code == 0
    done = gpszip("match", drive, "--network", "map.gpsz", "-o", "routes.geojson", "--json")
    assert done.code == 0
    assert done.json["matched"] > 0.95


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["-o", "routes.geojson"], 2, "--network"),
        (["-", "--network", "streets.geojson"], 2, "no output was named"),
        (
            ["--network", "streets.geojson", "-o", "routes.gpx"],
            1,
            "routes are written as geojson or csv",
        ),
        (["--network", "nowhere.geojson", "-o", "routes.geojson"], 1, "nowhere.geojson"),
        (["--network", "streets.geojson", "-o", "routes.geojson", "--sigma", "0m"], 2, "sigma"),
        (["--network", "drive.csv", "-o", "routes.geojson"], 1, "no network"),
    ],
)
def test_mistakes_are_named(gpszip, drive, streets, arguments, code, words):
    done = gpszip("match", drive, *arguments)
    assert done.code == code
    assert words in done.err


def test_a_network_elsewhere_is_refused(gpszip, drive, tmp_path):
    line = {"type": "LineString", "coordinates": [[90000, 90000], [90100, 90000]]}
    (tmp_path / "far.geojson").write_text(
        json.dumps(
            {
                "type": "Feature",
                "gpszip": {"coordinates": "metres"},
                "properties": {},
                "geometry": line,
            }
        )
    )
    done = gpszip("match", drive, "--network", "far.geojson", "-o", "routes.geojson")
    assert done.code == 1
    assert "elsewhere" in done.err
    assert not (tmp_path / "routes.geojson").exists()


def test_an_output_is_replaced_only_with_force(gpszip, drive, streets, tmp_path):
    (tmp_path / "routes.geojson").write_text("mine")
    assert gpszip("match", drive, "--network", streets, "-o", "routes.geojson").code == 1
    assert (tmp_path / "routes.geojson").read_text() == "mine"
    assert gpszip("match", drive, "--network", streets, "-o", "routes.geojson", "--force").code == 0


def test_degrees_come_back_as_degrees(gpszip, tmp_path):
    line = {"type": "LineString", "coordinates": [[11.0, 48.0], [11.01, 48.0]]}
    (tmp_path / "road.geojson").write_text(
        json.dumps({"type": "Feature", "properties": {}, "geometry": line})
    )
    rows = [f"{t},{48.00001 if t < 20 else 49.0},{11.0 + 2e-4 * t:.7f}" for t in range(40)]
    (tmp_path / "log.csv").write_text("\n".join(["t,lat,lon", *rows]) + "\n")
    assert gpszip("match", "log.csv", "--network", "road.geojson", "-o", "routes.csv").code == 0
    with open(tmp_path / "routes.csv", newline="") as file:
        found = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row["road_lat"]) for row in found[:20]], 48.0, atol=1e-6)
    np.testing.assert_allclose(
        [float(row["road_lon"]) for row in found[:20]],
        [11.0 + 2e-4 * t for t in range(20)],
        atol=1e-6,
    )
    assert {
        (row["road_lat"], row["road"], row["offset"], row["confidence"]) for row in found[20:]
    } == {("", "", "", "0")}
    assert gpszip("match", "log.csv", "--network", "road.geojson", "-o", "routes.geojson").code == 0
    (feature,) = json.loads((tmp_path / "routes.geojson").read_text())["features"]
    np.testing.assert_allclose(
        feature["geometry"]["coordinates"], [[11.0, 48.0], [11.0038, 48.0]], atol=1e-6
    )


def test_roads_travelled_the_wrong_way_are_named_in_all_outputs(gpszip, tmp_path):
    line = {"type": "LineString", "coordinates": [[11.0, 48.0], [11.01, 48.0]]}
    feature = {
        "type": "Feature",
        "properties": {"name": "Main St", "oneway": "yes"},
        "geometry": line,
    }
    (tmp_path / "road.geojson").write_text(json.dumps(feature))
    rows = [f"{t},48.0,{11.01 - 1e-4 * t:.7f}" for t in range(100)]
    (tmp_path / "log.csv").write_text("\n".join(["t,lat,lon", *rows]) + "\n")
    run = ("match", "log.csv", "--network", "road.geojson", "--force", "-o")
    done = gpszip(*run, "routes.geojson")
    assert (
        done.code,
        "matched 0 % of 100 points" in done.err,
        "unmatched: 100 one-way (Main St)" in done.err,
    ) == (0, True, True)
    found = json.loads((tmp_path / "routes.geojson").read_text())
    assert (found["features"], found["unmatched"]) == (
        [],
        [
            {
                "track_id": "0",
                "t_start": 0.0,
                "t_end": 99.0,
                "points": 100,
                "reason": "one-way",
                "against": ["Main St"],
            }
        ],
    )
    facts = gpszip(*run, "routes.csv", "--json").json
    assert (facts["matched"], facts["unmatched"], facts["one_way"]) == (
        0.0,
        {"one-way": 100},
        ["Main St"],
    )
    with open(tmp_path / "routes.csv", newline="") as file:
        assert {
            (row["road"], row["name"], row["reason"], row["against"])
            for row in csv.DictReader(file)
        } == {("", "", "one-way", "Main St")}
    assert gpszip("network", "road.geojson", "-o", "roads.gpsz").code == 0
    walked = ("match", "log.csv", "--network", "roads.gpsz", "--force", "-o", "routes.geojson")
    assert "100 one-way (Main St)" in gpszip(*walked).err
    assert "matched 100 % of 100 points" in gpszip(*walked, "--ignore-oneway").err
    (route,) = json.loads((tmp_path / "routes.geojson").read_text())["features"]
    assert (route["properties"]["names"], "against" in route["properties"]) == (["Main St"], False)
