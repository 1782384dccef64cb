"""gpszip diff, as a user runs it."""

import json

import numpy as np
import pytest


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


def test_archive_against_its_log(shell, logs):
    assert shell("compress a.csv -o a.gpsz --max-error 2m --effort 1").returncode == 0
    done = shell("diff a.gpsz a.csv --json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["total"]["maximum"] <= 2
    assert [track["id"] for track in facts["tracks"]] == ["bus 1", "bus 2"]
    # standard input is known by its content
    for first, data in (("a.gpsz", "a.csv"), ("a.csv", "a.gpsz")):
        piped = shell(f"diff {first} - --json", data=(logs / data).read_bytes())
        assert json.loads(piped.stdout)["total"]["rmse"] == facts["total"]["rmse"]


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
