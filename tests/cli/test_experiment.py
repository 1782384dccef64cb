import csv
import json
import re
from pathlib import Path

import pytest

from gpszip.experiments.listing import EXPERIMENTS

ROOT = Path(__file__).parents[2]


def without_seconds(folder):
    """Tables of all experiments of a folder, but for the time that they took."""
    found = {}
    for path in sorted(folder.glob("*.csv")):
        if not path.stem.endswith("seconds"):
            rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
            found[path.name] = list(csv.DictReader(rows))
    return found


def test_all_quick_writes_every_experiment(gpszip, log, tmp_path):
    run = gpszip("experiment all walk.csv --rmse 2m --quick -o out --json")
    assert run.code == 0, run.err
    written = run.json["written"]
    assert sorted(written) == sorted(path.name for path in (tmp_path / "out").iterdir())
    for experiment in EXPERIMENTS:
        if experiment.needs_roads:
            continue
        page = (tmp_path / "out" / f"{experiment.name}.md").read_text()
        assert f"`gpszip experiment {experiment.name} walk.csv --quick --seed 1 --rmse 2m`" in page
        for name in re.findall(r"!\[.*?\]\((.*?)\)", page):
            assert (tmp_path / "out" / name).stat().st_size > 2000


def test_roads_are_asked_for_and_read(gpszip, log):
    roads = {"type": "LineString", "coordinates": [[0, 0], [40, 0], [40, 30], [0, 30], [0, 0]]}
    Path("roads.geojson").write_text(json.dumps(roads))
    run = gpszip("experiment figure-5.1 walk.csv --quick -o out")
    assert run.code == 2
    assert "--network" in run.err
    run = gpszip("experiment all walk.csv --quick -o out --network none.geojson")
    assert run.code == 1
    assert "none.geojson" in run.err
    run = gpszip("experiment figure-5.1 walk.csv --quick -o out --network roads.geojson")
    assert run.code == 0, run.err
    assert "--network roads.geojson --quick" in Path("out/figure-5.1.md").read_text()


def test_the_same_seed_gives_the_same_numbers(gpszip):
    for folder, seed in (("a", 3), ("b", 3), ("c", 4)):
        run = gpszip(f"experiment figure-8.7 --quick --seed {seed} -o {folder}")
        assert run.code == 0, run.err
    assert without_seconds(Path("a")) == without_seconds(Path("b"))
    assert without_seconds(Path("a")) != without_seconds(Path("c"))


def test_a_log_of_the_user_is_compressed_both_ways(gpszip, log):
    run = gpszip("experiment table-8.1 walk.csv --rmse 2m -o out")
    assert run.code == 0, run.err
    (row,) = json.loads(Path("out/table-8.1.json").read_text())["tables"]["main"]
    assert row["points"] == 200
    assert row["rmse_m"] < 2.1
    assert "walk.csv" in Path("out/table-8.1.md").read_text()


def test_a_log_that_the_segments_fit_exactly_has_an_archive(gpszip):
    Path("still.csv").write_text("t,x,y\n" + "".join(f"{t},5,5\n" for t in range(50)))
    run = gpszip("experiment table-8.1 still.csv --quick -o out")
    assert run.code == 0, run.err
    (row,) = json.loads(Path("out/table-8.1.json").read_text())["tables"]["archive"]
    assert row["archive_rmse_m"] <= 0.001


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("experiment table-9.9", 2, "table-8.1"),
        ("experiment table-8.2 none.csv", 1, "none.csv"),
        ("experiment table-8.2 --quick -o walk.csv", 1, "name another folder"),
        ("experiment table-8.2 shape.geojson -o out", 2, "times"),
        ("experiment figure-8.7 far.csv --quick -o out", 1, "too far from zero"),
    ],
)
def test_mistakes_are_told(gpszip, log, words, code, message):
    shape = {"type": "LineString", "coordinates": [[0, 0], [1, 1], [2, 1]]}
    Path("shape.geojson").write_text(json.dumps(shape))
    Path("far.csv").write_text("t,x,y\n" + "".join(f"{t},{t}e300,0\n" for t in range(9)))
    run = gpszip(words)
    assert run.code == code
    assert message in run.err


def test_existing_files_are_refused_before_any_work(gpszip, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "figure-8.2.md").write_text("precious")
    run = gpszip("experiment all --quick -o out")
    assert run.code == 1
    assert "figure-8.2.md: exists" in run.err
    assert "table-8.1: " not in run.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["figure-8.2.md"]


def test_help_and_documentation_list_all_experiments(gpszip):
    out = gpszip("experiment --help").out
    page = (ROOT / "docs" / "experiments.md").read_text()
    for experiment in EXPERIMENTS:
        assert experiment.name in out
        assert experiment.name in page
