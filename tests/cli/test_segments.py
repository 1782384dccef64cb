import csv
import json
from pathlib import Path

import numpy as np
import pytest

import gpszip as package
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.segmentation.evaluate import rmse


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
    assert (done.code, "intervals (k), or a larger error" in done.err) == (6, True)


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
        {"planes": []},
        {"planes": [[95.0, 0.0]]},
    ],
)
def test_damaged_models_are_refused(learned, gpszip, change):
    value = {**json.loads(Path("walk.json").read_text()), **change}
    Path("bad.json").write_text(json.dumps(value))
    done = gpszip("segments walk.csv -o out.json --given bad.json")
    assert done.code == 1
    assert done.err.startswith("gpszip: bad.json: ")
    assert "segments LOG -o FILE.json" in done.err


@pytest.fixture
def four_axes(gpszip):
    """A log of four coordinates with weights, on a triangle that is travelled twice."""
    corners = np.array([[0, 0, 0, 0], [50, 0, 5, 9], [50, 40, 0, 3], [0, 0, 0, 0]], dtype=float)
    along = np.linspace(0, 3, 60, endpoint=False)
    lap = np.stack([np.interp(along, range(4), axis) for axis in corners.T], axis=1)
    positions = np.concatenate([lap, lap]).round(3)
    weights = 1 + np.arange(120) % 3
    rows = np.column_stack([np.arange(120), positions, weights]).tolist()
    text = "\n".join(",".join(map(str, row)) for row in rows)
    Path("four.csv").write_text(f"t,x0,x1,x2,x3,w\n{text}\n")
    return package.Track("0", np.arange(120.0), positions, weights)


def test_weights_and_further_axes_are_used(gpszip, four_axes):
    done = gpszip("segments four.csv -o four.json --k 5 --m 2 --weight w --json")
    assert done.code == 0, done.err
    value = json.loads(Path("four.json").read_text())
    assert value["coordinates"] == ["x", "y", "z", "x4"]
    mean = package.segment_mean(four_axes, 5, 2)
    assert value["cost"] == pytest.approx(mean.cost)
    assert np.array([row["end"] for row in value["segments"]]) == pytest.approx(mean.ends, abs=1e-4)
    light = package.Track("0", four_axes.times, four_axes.positions)
    assert package.segment_mean(light, 5, 2).cost < 0.9 * mean.cost
    done = gpszip("segments four.csv -o four.geojson --k 5 --m 2")
    assert "GeoJSON holds up to 3 coordinates" in done.err


def test_what_is_written_with_more_axes_is_read_again(gpszip, four_axes):
    assert gpszip("compress four.csv -o four.gpsz --max-error 1 --effort 1").code == 0
    assert gpszip("decompress four.gpsz -o back.csv --every 1s").code == 0
    assert Path("back.csv").read_text().startswith("track_id,t,x,y,z,x4\n")
    back = package.read("back.csv").tracks[0]
    assert np.abs(back.positions - four_axes.positions).max() <= 1
    named = package.read("four.csv", columns="t=t,x0=x3,x1=x1").tracks[0]
    assert named.positions.tolist() == four_axes.positions[:, [3, 1]].tolist()


@pytest.mark.parametrize("weight", ["0", "-1", "nan", "", "heavy"])
def test_weights_that_are_none_are_refused(gpszip, weight):
    rows = [f"{t},{t},0,{weight if t == 3 else 2}" for t in range(9)]
    Path("w.csv").write_text("\n".join(["t,x,y,w", *rows]) + "\n")
    done = gpszip("segments w.csv -o out.json --k 2 --m 1 --weight w")
    assert done.code == 1
    assert "track '0': point 3: column 'w': 1 of 9 weights are not above 0" in done.err
    assert not Path("out.json").exists()


def test_a_weight_is_no_attribute(gpszip, four_axes):
    track = package.read("four.csv", weight="w", keep=("w",)).tracks[0]
    assert track.weights.tolist() == four_axes.weights.tolist()
    assert not track.attributes


def test_a_coreset_stands_for_its_log(log, gpszip):
    assert gpszip("coreset walk.csv -o walk.parquet --size 40").code == 0
    done = gpszip("segments walk.parquet -o small.json --k 8 --rmse 1m --json")
    assert done.code == 0, done.err
    value = json.loads(Path("small.json").read_text())
    assert (value["points"], value["max_error"]) == (200, None)
    assert value["cost_bounds"][0] <= value["cost"] <= value["cost_bounds"][1]
    assert value["rmse"] <= 1
    track = package.read("walk.csv").tracks[0]
    parts = value["parts"]
    boundaries = np.array([part["first"] for part in parts] + [200])
    labels = np.array([part["segment"] for part in parts], np.int32)
    starts, ends = (
        np.array([segment[side] for segment in value["segments"]]) for side in ("start", "end")
    )
    mean = package.SegmentMean(boundaries, labels, starts, ends, value["cost"])
    assert rmse(mean, track) <= 1
    assert parts[3]["t_start"] == pytest.approx(track.times[parts[3]["first"]])

    done = gpszip("segments walk.parquet -o small.png --k 8 --m 4")
    assert "RMSE at most" in done.err
    done = gpszip("segments walk.parquet -o no.json --k 8 --max-error 1m")
    assert (done.code, "no samples whose maximum" in done.err) == (2, True)
    done = gpszip("segments walk.parquet -o no.json --given small.json")
    assert (done.code, "--given takes a log" in done.err) == (2, True)


def test_a_long_log_is_learned_from_a_coreset(log, gpszip):
    done = gpszip(
        "segments walk.csv -o walk.json --coreset 40 --k 8 --rmse 1m --max-error 3m --json"
    )
    assert done.code == 0, done.err
    assert done.json["rmse"] <= 1
    assert done.json["max_error"] <= 3
    assert done.json["least_cost"] <= done.json["cost_bounds"][0]


def test_a_single_point_is_a_segment(gpszip):
    Path("one.csv").write_text("t,x,y\n0,1,2\n")
    for name in ("one.json", "one.geojson", "one.csv", "one.png"):
        done = gpszip("segments one.csv --force -o", f"out-{name}")
        assert done.code == 0, done.err
    value = json.loads(Path("out-one.json").read_text())
    assert value["segments"][0]["start"] == value["segments"][0]["end"] == [1.0, 2.0]


@pytest.mark.parametrize("given", ["--m 4", "--k 8", "--m 2..5 --k 8"])
def test_what_is_left_out_is_searched(log, gpszip, given):
    done = gpszip("segments walk.csv -o out.json --json", *given.split())
    assert done.code == 0, done.err
    numbers = {"k": done.json["k"], "m": done.json["m"]}
    assert f"--k {numbers['k']}" in given or f"--m {numbers['m']}" in given
