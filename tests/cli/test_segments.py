import csv
import json
from pathlib import Path

import numpy as np
import pytest

import gpszip as package
from gpszip.geo.planes import choose_plane, to_plane


@pytest.fixture
def learned(gpszip, log):
    done = gpszip("segments walk.csv -o walk.json --k 8 --m 4 --json")
    assert done.code == 0, done.err
    return done.json


def test_a_user_gets_lines_for_a_map(log, gpszip):
    done = gpszip("segments walk.csv -o walk.geojson --rmse 50cm")
    assert done.code == 0, done.err
    assert done.out == ""
    assert done.err.startswith("walk.geojson: 200 points in k = 8 parts on m = ")
    collection = json.loads(log.with_name("walk.geojson").read_text())
    assert collection["gpszip"] == {"coordinates": "metres"}
    kinds = [feature["properties"]["kind"] for feature in collection["features"]]
    assert set(kinds) == {"segment", "transition", "part"}
    assert kinds.count("part") == 8


def test_the_json_equals_python(learned):
    value = json.loads(Path("walk.json").read_text())
    track = package.read("walk.csv").tracks[0]
    mean = package.segment_mean(track, 8, 4)
    model = package.markov_model(mean, track)
    assert (value["k"], value["m"], value["runs"]) == (8, 4, 1)
    assert [part["first"] for part in value["parts"]] == mean.boundaries[:-1].tolist()
    assert [part["last"] + 1 for part in value["parts"]] == mean.boundaries[1:].tolist()
    assert [part["segment"] for part in value["parts"]] == mean.labels.tolist()
    assert sum(part["cost"] for part in value["parts"]) == pytest.approx(mean.cost, rel=1e-6)
    assert [row["count"] for row in value["transitions"]] == model.counts.tolist()
    assert [row["probability"] for row in value["transitions"]] == model.probabilities.tolist()
    starts = [segment["start"] for segment in value["segments"]]
    assert np.array(starts) == pytest.approx(mean.starts, abs=1e-4)
    assert learned["log_likelihood"] == value["log_likelihood"]


def test_a_table_has_a_row_for_each_part(log, gpszip):
    assert gpszip("segments walk.csv -o parts.csv --k 8 --m 4 --quiet").err == ""
    rows = list(csv.DictReader(Path("parts.csv").read_text().splitlines()))
    assert len(rows) == 8
    assert list(rows[0]) == [
        *("part", "track_id", "segment", "first", "last", "t_start", "t_end", "cost"),
        *("start_x", "start_y", "end_x", "end_y"),
    ]
    assert [row["first"] for row in rows[1:]] == [str(int(row["last"]) + 1) for row in rows[:-1]]


@pytest.mark.parametrize("name", ["walk.png", "walk.svg"])
def test_a_picture_is_drawn(log, gpszip, name):
    done = gpszip("segments walk.csv --k 8 --m 4 -o", name)
    assert done.code == 0, done.err
    data = Path(name).read_bytes()
    assert data.startswith(b"\x89PNG") or b">8 parts on 4 segments</text>" in data


def test_another_log_follows_a_given_model(learned, gpszip, log):
    rows = log.read_text().splitlines()
    Path("again.csv").write_text("\n".join(rows[:101]) + "\n")
    texts = [row.split(",", 1)[1] for row in rows[100:0:-1]]
    turned = [f"{number},{text}" for number, text in enumerate(texts)]
    Path("turned.csv").write_text("\n".join([rows[0], *turned]) + "\n")
    found = {}
    for name in ("again", "turned"):
        done = gpszip(f"segments {name}.csv -o {name}.json --given walk.json --json")
        assert done.code == 0, done.err
        found[name] = done.json
    assert (found["again"]["m"], found["again"]["points"]) == (4, 100)
    assert found["again"]["log_likelihood"] > found["turned"]["log_likelihood"]
    assert [part["segment"] for part in json.loads(Path("again.json").read_text())["parts"]] == [
        part["segment"] for part in json.loads(Path("walk.json").read_text())["parts"][:4]
    ]


def test_several_tracks_and_gaps_begin_parts(gpszip):
    rows = [f"{name},{t},{t % 50},{0}" for name in ("a", "b") for t in range(100)]
    rows += [f"b,{t},{t % 50},{0}" for t in range(5000, 5050)]
    Path("two.csv").write_text("\n".join(["track,t,x,y", *rows]) + "\n")
    done = gpszip("segments two.csv -o two.json --k 5 --m 1 --json")
    assert done.code == 0, done.err
    assert (done.json["tracks"], done.json["runs"]) == (2, 3)
    assert done.json["rmse"] < 0.01
    parts = json.loads(Path("two.json").read_text())["parts"]
    assert [(part["track_id"], part["first"]) for part in parts] == [
        *(("a", 0), ("a", 50)),
        *(("b", 0), ("b", 50), ("b", 100)),
    ]
    done = gpszip("segments two.csv -o few.json --k 2 --m 1")
    assert done.code == 2
    assert "choose k >= 3, or a longer gap" in done.err
    assert gpszip("segments two.csv -o few.json --k 2 --m 1 --gap none").code == 0


def test_degrees_are_written_and_read_back(gpszip):
    plane = choose_plane([52.5], [13.4])
    degrees = [(52.5 + min(i, 60 - i) / 3000, 13.4 + i % 2 / 1e5) for i in range(60)]
    rows = [f"{1.7e9 + 5 * i},{lat},{lon}" for i, (lat, lon) in enumerate(degrees)]
    Path("home.csv").write_text("\n".join(["t,lat,lon", *rows]) + "\n")
    for name in ("home.json", "home.geojson"):
        assert gpszip("segments home.csv --k 2 --m 2 -o", name).code == 0
    value = json.loads(Path("home.json").read_text())
    assert value["coordinates"] == ["lat", "lon"]
    start, first = value["segments"][0]["start"], to_plane([52.5], [13.4], plane)
    assert to_plane([start[0]], [start[1]], plane) == pytest.approx(first, abs=2)
    line = json.loads(Path("home.geojson").read_text())["features"][0]["geometry"]["coordinates"]
    assert line[0] == start[::-1]
    done = gpszip("segments home.csv -o same.json --given home.json --json")
    assert done.json["cost"] == pytest.approx(value["cost"], rel=1e-3)


def test_a_search_goes_on_where_its_memo_ends(log, gpszip):
    first = gpszip("segments walk.csv -o a.json --k 2..12 --m 1..5 --memo memo --json")
    solved = {path.name: path.stat().st_mtime_ns for path in Path("memo").iterdir()}
    again = gpszip("segments walk.csv -o b.json --k 2..12 --m 1..5 --memo memo --json")
    assert {path.name: path.stat().st_mtime_ns for path in Path("memo").iterdir()} == solved
    assert {**first.json, "output": ""} == {**again.json, "output": ""}
    assert 2 <= first.json["k"] <= 12
    assert first.json["m"] <= 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("-o a.json --k 3 --m 4", "m = 4"),
        ("-o a.json --k 9..3", "the least, at least 1"),
        ("-o a.json --k x", "neither a number"),
        ("-o a.xyz --k 3", "end it with .json"),
        ("-o a.json --k 3..9 --rmse 1m", "range"),
        ("-o a.json --rmse 1m --memo memo", "--memo"),
        ("-o a.json --given walk.csv", "walk.csv"),
        ("-o a.json --given walk.json --k 3", "--k and --given"),
    ],
)
def test_mistakes_are_explained(log, gpszip, arguments, words):
    done = gpszip("segments walk.csv", *arguments.split())
    assert done.code in {1, 2}
    assert words in done.err
    assert not Path("a.json").exists()


def test_a_bound_that_k_cannot_hold_has_its_exit_code(log, gpszip):
    done = gpszip("segments walk.csv -o a.json --k 2 --rmse 1cm")
    assert (done.code, "allow more intervals" in done.err) == (6, True)


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "map"},
        {"segments": []},
        {"segments": [{"start": [0], "end": [1], "begins": 1}]},
        {"transitions": [{"from": 0, "to": 9, "count": 1}]},
        {"transitions": [{"from": 0, "to": 1, "count": -1}]},
        {"sigma": 0},
        {"sigma": None},
        {"planes": [[1]]},
    ],
)
def test_damaged_models_are_refused(learned, gpszip, change):
    value = {**json.loads(Path("walk.json").read_text()), **change}
    Path("bad.json").write_text(json.dumps(value))
    done = gpszip("segments walk.csv -o out.json --given bad.json")
    assert done.code == 1
    assert done.err.startswith("gpszip: bad.json: ")
    assert "segments LOG -o FILE.json" in done.err
