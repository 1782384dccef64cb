import csv
import io
import json

import numpy as np
import pytest


@pytest.fixture
def roads(tmp_path):
    lines = [[[0, 0], [300, 0]], [[300, 0], [300, 300]], [[0, 0], [0, 300]], [[0, 300], [300, 300]]]
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


@pytest.fixture
def log_with_gap(tmp_path):
    """East, then north at 5 m/s, without the corner; with a column of the user."""
    times = np.r_[0:40, 80:110]
    x, y = np.minimum(5.0 * times, 300.0), np.maximum(5.0 * times - 300.0, 0.0)
    path = tmp_path / "log_with_gap.csv"
    path.write_text(
        "t,x,y,fuel\n"
        + "".join(f"{t},{a:.1f},{b:.1f},{t % 7}\n" for t, a, b in zip(times, x, y, strict=True))
    )
    return path


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_fills_the_corner_and_keeps_every_row(gpszip, log_with_gap, roads, tmp_path):
    run = gpszip("patch", log_with_gap, "--network", roads, "-o", "out.csv", "--gap", "20s")
    assert (run.code, run.out) == (0, "")
    assert "40 points added in 1 of 1 gaps" in run.err
    text = (tmp_path / "out.csv").read_text()
    own = [line.removesuffix(",log,1") for line in text.splitlines()[1:] if line.endswith(",log,1")]
    assert own == log_with_gap.read_text().splitlines()[1:]
    added = [row for row in rows_of(text) if row["source"] == "patched"]
    assert [float(row["t"]) for row in added] == list(range(40, 80))
    assert max(min(300 - float(row["x"]), float(row["y"])) for row in added) < 0.1
    assert all(0 < float(row["confidence"]) <= 1 for row in added)
    assert [row["fuel"] for row in added] == [""] * 40


def test_rows_that_are_no_samples_are_kept_and_counted(gpszip, log_with_gap, roads, tmp_path):
    log_with_gap.write_text(log_with_gap.read_text() + "200,,,1\n,5,5,2\n109,9,9,3\n")
    run = gpszip("patch", log_with_gap, "--network", roads, "-o", "out.csv", "--gap", "20s")
    assert "dropped" not in run.err
    for what in (
        "1 row without a position",
        "1 row without a time",
        "1 row at another position, but the same time",
    ):
        assert f"{what} kept, but not used" in run.err
    assert (tmp_path / "out.csv").read_text().splitlines()[-3:] == [
        "200,,,1,log,1",
        ",5,5,2,log,1",
        "109,9,9,3,log,1",
    ]
    run = gpszip(
        "patch", log_with_gap, "--network", roads, "-o", "out.geojson", "--gap", "20s", "--json"
    )
    assert [one["what"] for one in run.json["repairs"] if one["drops"]] != []


def test_standard_output_and_json(gpszip, log_with_gap, roads):
    run = gpszip("patch", log_with_gap, "--network", roads, "-o", "-", "--gap", "20s", "--json")
    assert run.code == 0
    assert len(rows_of(run.out)) == 110
    facts = json.loads(run.err)
    assert (facts["gaps"], facts["filled"], facts["added"], facts["open"]) == (1, 1, 40, [])


def test_gaps_left_open_are_named(gpszip, log_with_gap, roads, tmp_path):
    far = tmp_path / "far.csv"
    rows = log_with_gap.read_text().splitlines(keepends=True)
    far.write_text("".join(rows[:41]) + "".join(rows[41:]).replace(",300.0,", ",99300.0,"))
    run = gpszip("patch", far, "--network", roads, "-o", "out.csv", "--gap", "20s")
    assert run.code == 0
    assert "left open: track '0' at 39, 41 s: it would take" in run.err
    assert all(row["source"] == "log" for row in rows_of((tmp_path / "out.csv").read_text()))


def test_a_log_without_gaps_gets_no_points(gpszip, log_with_gap, roads):
    run = gpszip("patch", log_with_gap, "--network", roads, "-o", "out.csv", "--gap", "1h")
    assert "no gaps longer than 60 min, no points added" in run.err
    short = "".join(log_with_gap.read_text().splitlines(keepends=True)[:30])
    log_with_gap.write_text(short)
    assert (
        "no gaps, no points added"
        in gpszip("patch", log_with_gap, "--network", roads, "-o", "short.csv").err
    )


def test_other_formats_come_out_as_tracks(gpszip, log_with_gap, roads, tmp_path):
    run = gpszip("patch", log_with_gap, "--network", roads, "-o", "out.parquet", "--gap", "20s")
    assert run.code == 0
    assert gpszip("patch", "out.parquet", "--network", roads, "-o", "again.csv").code == 0
    assert len(rows_of((tmp_path / "again.csv").read_text())) == 110


def test_mistakes(gpszip, log_with_gap, roads, tmp_path):
    assert gpszip("patch", log_with_gap, "-o", "out.csv").code == 2
    elsewhere = tmp_path / "elsewhere.geojson"
    elsewhere.write_text(roads.read_text().replace("300", "90300").replace("[0, ", "[90000, "))
    run = gpszip("patch", log_with_gap, "--network", elsewhere, "-o", "out.csv")
    assert run.code == 1
    assert "lies elsewhere than the log" in run.err
    assert not (tmp_path / "out.csv").exists()
    (tmp_path / "out.csv").write_text("mine")
    assert "add --force" in gpszip("patch", log_with_gap, "--network", roads, "-o", "out.csv").err
