import html
import json
import re

import numpy as np
import pytest

import gpszip as package
from gpszip.archive import new_archive
from gpszip.model import GridWalk, GridWalks, QuantisationGrid

WALK = GridWalk(np.array([0, 1, 2], np.int32), np.array([0, 10, 20]), np.zeros(2, bool))
NODES = np.array([[0, 0], [100, 0], [100, 50]])
GRID = QuantisationGrid((0, 0), 0, 128, 128)

ROADS = {
    "type": "FeatureCollection",
    "crs": {"type": "name", "properties": {"name": "metres"}},
    "features": [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "LineString", "coordinates": [[0, 0], [100, 0], [100, 50]]},
        }
    ],
}


def small_archive(name="bus"):
    return new_archive(GRID, [name], GridWalks(NODES, (WALK,), True))


@pytest.fixture
def archive(tmp_path):
    small_archive().save(tmp_path / "bus.gpsz")
    (tmp_path / "bus.csv").write_text("id,t,x,y\nbus,0,0,0\nbus,10,100,3\nbus,20,100,50\n")
    return "bus.gpsz"


def scene_of(page):
    text = re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.DOTALL)
    return json.loads(text.group(1))


def test_the_page_has_the_name_of_the_archive_and_all_data(gpszip, archive, tmp_path):
    run = gpszip("view", archive, "--raw", "bus.csv")
    assert run.code == 0, run.err
    assert re.search(r"^bus\.html: a page of 0\.\d MB with 3 points$", run.err, re.MULTILINE)
    page = (tmp_path / "bus.html").read_text()
    (shown,) = scene_of(page)["archives"]
    assert (shown["name"], shown["points"]) == ("bus.gpsz", 3)
    assert shown["max_error"] == pytest.approx(3.0, abs=0.01)


def test_the_page_asks_for_nothing_from_elsewhere(gpszip, archive):
    page = gpszip("view", archive, "-o", "-").out
    policy = re.search(r'http-equiv="Content-Security-Policy"\s+content="([^"]*)"', page).group(1)
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", page)
    assert "@import" not in page


def test_names_are_data_and_never_markup(gpszip, tmp_path):
    name = "</script><img src=x onerror=alert(1)>&\u2028"
    small_archive(name).save(tmp_path / "a.gpsz")
    page = gpszip("view a.gpsz -o -").out
    assert "<img" not in page
    assert scene_of(page)["archives"][0]["tracks"]["ids"] == [name]


def test_several_logs_may_stand_behind_one_option(gpszip, archive, tmp_path):
    for number, name in enumerate(("bus", "tram"), 1):
        (tmp_path / f"{number}.csv").write_text(f"track_id,t,x,y\n{name},0,0,0\n{name},9,9,9\n")
    run = gpszip("view --raw 1.csv 2.csv bus.gpsz --json")
    assert run.code == 0, run.err
    assert run.json["points"] == run.json["points_drawn"] == 4


def test_roads_and_routes(gpszip, archive, tmp_path):
    (tmp_path / "roads.geojson").write_text(json.dumps(ROADS))
    run = gpszip("view bus.gpsz --raw bus.csv --network roads.geojson --match -o -")
    assert run.code == 0, run.err
    scene = scene_of(run.out)
    assert scene["network"]["x"]["count"] == 3
    assert scene["archives"][0]["routes"]["x"]["count"] >= 2


def test_two_archives(gpszip, archive, tmp_path):
    small_archive("tram").save(tmp_path / "tram.gpsz")
    run = gpszip("view bus.gpsz tram.gpsz -o -")
    scene = scene_of(run.out)
    assert scene["title"] == "bus.gpsz and tram.gpsz"
    assert [shown["name"] for shown in scene["archives"]] == ["bus.gpsz", "tram.gpsz"]


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        ("a.gpsz a.gpsz a.gpsz", 2, "one archive or two, not 3"),
        ("bus.gpsz --match", 2, "--match needs a log and roads; give --raw and --network, too"),
        ("bus.gpsz --timezone Europe/Berlin", 2, "give --history, too"),
        ("bus.gpsz --open -o -", 2, "--open needs a file"),
        ("bus.gpsz --raw other.csv", 2, "no archive has a track 'tram' of the log"),
        ("bus.gpsz --raw deep.csv", 2, "the log is in x, y, z, the archive in x, y"),
        ("bus.gpsz -o bus.csv", 1, "exists already"),
        ("nowhere.gpsz", 1, "no such file"),
    ],
)
def test_mistakes(gpszip, archive, tmp_path, arguments, code, says):
    (tmp_path / "deep.csv").write_text("t,x,y,z\n0,0,0,0\n1,1,1,1\n")
    (tmp_path / "other.csv").write_text("id,t,x,y\ntram,0,0,0\ntram,1,1,1\n")
    run = gpszip(f"view {arguments}")
    assert run.code == code
    assert says in run.err
    assert not (tmp_path / "bus.html").exists()


def test_python_writes_the_same_page(gpszip, archive, tmp_path):
    opened = package.open(tmp_path / archive)
    track = package.Track("bus", [0, 10, 20], [[0, 0], [100, 3], [100, 50]])
    size = package.write_page(opened, tmp_path / "page.html", raw=track, title="A & B")
    page = (tmp_path / "page.html").read_text()
    assert len(page.encode()) == size
    assert "<title>A &amp; B</title>" in page
    assert scene_of(page)["archives"][0]["points"] == 3
    with pytest.raises(package.OutputError, match="force=True"):
        package.write_page(opened, tmp_path / "page.html")
    with pytest.raises(package.OptionError, match="history, which is not shown"):
        package.write_page(opened, tmp_path / "other.html", timezone="Europe/Berlin")
    with pytest.raises(package.OptionError, match="not 3"):
        package.write_page([opened] * 3, tmp_path / "other.html")


def test_values_show_themselves_in_a_notebook(archive, tmp_path):
    opened = package.open(tmp_path / archive)
    track = package.read(tmp_path / "bus.csv")
    for value in (opened, opened.road_map, track, track[0]):
        frame = value._repr_html_()
        source = re.fullmatch(r'<iframe srcdoc="([^"]*)" sandbox="allow-scripts".*', frame)
        (shown,) = scene_of(html.unescape(source.group(1)))["archives"]
        assert shown["nodes"]["x"]["count"] or shown["raw"]


def test_large_values_say_how_to_be_seen():
    times = np.arange(60_000.0)
    track = package.Track("<long>", times, np.column_stack([times, times]))
    shown = track._repr_html_()
    assert "iframe" not in shown
    assert "&lt;long&gt;" in shown
    assert "gpszip.write_page(" in shown


def test_rows_that_were_dropped_are_named(gpszip, archive, tmp_path):
    rows = "".join(f"bus,{t},{5 * t},0\n" for t in range(21))
    (tmp_path / "bus.csv").write_text(f"id,t,x,y\n{rows}bus,21,nan,0\n")
    run = gpszip("view", archive, "--raw", "bus.csv")
    assert run.code == 0
    assert "with 21 points; bus.csv: row 23: 1 row without a position dropped" in run.err
