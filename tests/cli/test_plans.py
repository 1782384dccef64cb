"""merge, match and patch --dry-run say what would be done, and write nothing."""

import json
import re

import numpy as np
import pytest

from cli.test_dry_run import files_in
from cli.test_schemas import check


@pytest.fixture
def on_road(tmp_path):
    """A road, and a log on it with one interval of 61 s."""
    feature = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "LineString", "coordinates": [[0, 0], [900, 0]]},
    }
    roads = {"type": "FeatureCollection", "features": [feature]}
    (tmp_path / "roads.geojson").write_text(json.dumps(roads))
    times = np.r_[0:60, 120:150]
    rows = "".join(f"{t},{5.0 * t:.1f},{0.5 * (t % 3)}\n" for t in times)
    (tmp_path / "log.csv").write_text("t,x,y\n" + rows)


def facts_of(run):
    """Labels and texts of what a person reads; of several texts of a label, the last."""
    assert run.code == 0, run.err
    return dict(re.split(" {2,}", line, maxsplit=1) for line in run.out.splitlines())


def test_a_merge_names_archives_deviation_and_bound(gpszip, walk_archive, made_once, tmp_path):
    (tmp_path / "coarse.gpsz").write_bytes(made_once("--rmse 3 --effort 1"))
    command = "merge walk.gpsz coarse.gpsz --same-id prefix -o city.gpsz"
    before = files_in(tmp_path)
    planned = gpszip(f"{command} --dry-run --json").json
    told = facts_of(gpszip(f"{command} --dry-run"))
    assert files_in(tmp_path) == before
    assert told["bound"] == "RMSE 4 m at most, about"
    assert (planned["allowed"], planned["allowed_kind"]) == (1.0, "rms")

    # What the merge does is within what was said.
    done = gpszip(f"{command} --json").json
    assert done["bytes_in"] == planned["bytes_in"]
    assert done["error_bound_m"] <= planned["bound_at_most_m"]
    check(planned, "merge --dry-run")


def test_a_merge_that_is_refused_is_refused_before(gpszip, walk_archive, made_once, tmp_path):
    (tmp_path / "coarse.gpsz").write_bytes(made_once("--rmse 3 --effort 1"))
    run = gpszip("merge walk.gpsz coarse.gpsz -o city.gpsz --dry-run")
    assert run.code == 2
    assert "is in walk and in coarse" in run.err


def test_a_match_tries_the_starts_of_tracks(gpszip, on_road, tmp_path):
    before = files_in(tmp_path)
    command = "match log.csv --network roads.geojson -o routes.geojson"
    run = gpszip(f"{command} --dry-run")
    assert run.code == 0, run.err
    assert "90 of 90 points at the starts of tracks are on roads" in run.out
    assert "1 of 1 near the log, 900 m" in run.out
    planned = gpszip(f"{command} --dry-run --json").json
    assert files_in(tmp_path) == before
    done = gpszip(f"{command} --json").json
    assert planned["error"] == done["error"]
    assert planned["matched"] == done["matched"] * done["points"]
    check(planned, "match --dry-run")


def test_a_patch_counts_gaps(gpszip, on_road, tmp_path):
    before = files_in(tmp_path)
    command = "patch log.csv --network roads.geojson -o patched.csv"
    assert facts_of(gpszip(f"{command} --dry-run"))["gaps"] == "1 over 30 s, 61 s in all"
    planned = gpszip(f"{command} --dry-run --json").json
    assert files_in(tmp_path) == before
    done = gpszip(f"{command} --json").json
    assert (planned["gap"], planned["gaps"]) == (done["gap"], done["gaps"])
    assert planned["seconds"] == 61.0
    check(planned, "patch --dry-run")


def test_only_the_first_points_are_matched(gpszip, on_road, tmp_path):
    times = np.arange(2500) / 10
    rows = "".join(f"{k % 2},{t:.1f},{3.6 * t:.2f},0\n" for k in (0, 1) for t in times)
    (tmp_path / "long.csv").write_text("id,t,x,y\n" + rows)
    planned = gpszip(
        "match long.csv --network roads.geojson -o routes.geojson --dry-run --json"
    ).json
    assert (planned["points"], planned["sampled"]) == (5000, 2000)
    assert planned["cpu_seconds"] > 0
