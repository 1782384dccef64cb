import builtins
import json
from pathlib import Path

import gpszip as package

FILES = {"patrol.csv", "patrol.gpsz", "knots.csv", "map.geojson", "map.png", "page.html"}


def test_demo_writes_log_archive_map_and_picture(gpszip):
    done = gpszip("demo", "--points", "4000", "--out", "show")
    assert done.code == 0, done.err
    assert {path.name for path in Path("show").iterdir()} == FILES
    assert "4,000 points" in done.out
    picture, page = done.out.splitlines()[-2:]
    assert picture.startswith(f"look at {Path('show', 'map.png')}")
    assert page.startswith(f"open {Path('show', 'page.html')}")
    assert '"points":4000' in Path("show/page.html").read_text()
    assert len(package.read("show/patrol.csv")[0]) == 4000
    assert json.loads(Path("show/map.geojson").read_text())["features"]


def test_demo_holds_its_bound_and_repeats_itself(gpszip):
    first = gpszip("demo", "--points", "2000", "--out", "one", "--json").json
    assert first["rmse"] <= 0.24
    gpszip("demo", "--points", "2000", "--out", "two")
    assert Path("one/patrol.gpsz").read_bytes() == Path("two/patrol.gpsz").read_bytes()


def test_demo_replaces_files_only_with_force(gpszip):
    Path("show").mkdir()
    Path("show/patrol.csv").write_text("precious")
    done = gpszip("demo", "--points", "500", "--out", "show")
    assert done.code == 1
    assert "--force" in done.err
    assert Path("show/patrol.csv").read_text() == "precious"


def test_demo_without_matplotlib_names_the_extra(gpszip, monkeypatch):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    done = gpszip("demo", "--points", "500", "--out", "show")
    assert done.code == 0
    assert "pip install 'gpszip[plot]'" in done.err
    assert {path.name for path in Path("show").iterdir()} == {
        name for name in FILES if not name.endswith("png")
    }


def test_the_picture_says_how_few_bytes_hold_the_points(gpszip):
    gpszip("demo", "--points", "1500", "--out", "show")
    size = Path("show/patrol.gpsz").stat().st_size
    title = f"1,500 points as {size:,} bytes"
    assert title.encode() in Path("show/map.png").read_bytes()
