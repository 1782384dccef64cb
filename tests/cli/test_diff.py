"""gpszip diff, as a user runs it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gpszip.cli.diff import _describe_alone
from gpszip.pipeline.diff import Curve, Side, diff


@pytest.fixture
def logs(tmp_path):
    rng = np.random.default_rng(5)
    for name, noise in (("a", 0.0), ("b", 1e-5)):
        rows = ["track_id,t,lat,lon"]
        for track in ("bus 1", "bus 2"):
            for t in range(60):
                lat = 52.5 + 1e-4 * t + noise * rng.normal()
                rows.append(f"{track},{1_700_000_000 + 5 * t},{lat:.7f},13.4")
        (tmp_path / f"{name}.csv").write_text("\n".join(rows))
    return tmp_path


def test_archive_against_its_log(gpszip, logs):
    assert gpszip("compress a.csv -o a.gpsz --max-error 2m --effort 1").code == 0
    facts = gpszip("diff a.gpsz a.csv --json").json
    assert facts["total"]["maximum"] <= 2
    assert [track["id"] for track in facts["tracks"]] == ["bus 1", "bus 2"]

    # standard input is known by its content
    piped = gpszip("diff a.gpsz - --json", data=(logs / "a.csv").read_bytes())
    assert piped.json["total"]["rmse"] == facts["total"]["rmse"]
    piped = gpszip("diff a.csv - --json", data=(logs / "a.gpsz").read_bytes())
    assert piped.json["total"]["rmse"] == facts["total"]["rmse"]


def test_ranges_of_one_alone_are_told_in_words(gpszip, tmp_path):
    rows = [f"{t},{t},0\n" for t in range(100)]
    (tmp_path / "all.csv").write_text("t,x,y\n" + "".join(rows))
    (tmp_path / "part.csv").write_text("t,x,y\n" + "".join(rows[10:60] + rows[70:]))
    lines = gpszip("diff all.csv part.csv --gap 5s").out.splitlines()
    assert lines[2:] == [
        "0: only all.csv travels in 2 time ranges, 21 s in all",
        "0: at 20 samples of all.csv, part.csv has no position",
    ]


def test_an_archive_that_begins_before_its_log_says_why(gpszip, tmp_path):
    side = Side({}, None, 2, sampled=False, time_step=0.25)
    first = Curve("a", np.array([0.0, 9.2]), np.zeros((2, 2)), np.array([False]), timed=True)
    second = Curve("a", np.array([0.0, 9.0]), np.zeros((2, 2)), np.array([False]), timed=True)
    archive, log = replace(side, curves={"a": first}), replace(side, curves={"a": second})
    found = diff(archive, log).tracks[0]
    (line,) = _describe_alone(found, ("a.gpsz", "a.csv"), archive.time_step)
    assert line == (
        "a: only a.gpsz travels in 1 time range, 0.2 s in all; archives round times, here to 0.25 s"
    )


def test_table_and_worst_places(gpszip, logs):
    done = gpszip("diff a.csv b.csv -o worst.geojson --worst 5")
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].split()[:3] == ["track", "compared", "mean"]
    assert [line.split("  ")[0] for line in lines[1:4]] == ["bus 1", "bus 2", "all"]
    features = json.loads((logs / "worst.geojson").read_text())["features"]
    assert len(features) == 5
    distances = [feature["properties"]["distance_m"] for feature in features]
    assert distances == sorted(distances, reverse=True)
    (lon, _), (other, _) = features[0]["geometry"]["coordinates"]
    assert (lon, other) == pytest.approx((13.4, 13.4))


def test_places_on_standard_output_leave_the_table_to_standard_error(gpszip, logs):
    done = gpszip("diff a.csv b.csv -o -")
    assert json.loads(done.out)["type"] == "FeatureCollection"
    assert "bus 1" in done.err


def test_selection_holds_for_both(gpszip, logs):
    assert gpszip("compress a.csv -o a.gpsz --max-error 2m --effort 1").code == 0
    options = ["--track", "bus 2", "--since", "1700000100", "--json"]
    facts = gpszip("diff a.gpsz b.csv", *options).json
    assert [track["id"] for track in facts["tracks"]] == ["bus 2"]
    assert facts["total"]["compared"] == 40


def test_mistakes(gpszip, logs):
    assert gpszip("diff - -").code == 2
    assert "only one" in gpszip("diff - -").err
    assert gpszip("diff a.csv none.csv").code == 1
    assert "none.csv" in gpszip("diff a.csv none.csv").err
    (logs / "bad.gpsz").write_bytes(b"\xa7Z\x03")
    assert gpszip("diff bad.gpsz a.csv").code == 4
