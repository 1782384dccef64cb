"""Everything that docs/python.md shows works: its code runs, from top to bottom, in one session."""

import re
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import gpszip
from frames import missing_packages
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.write import write_tracks

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/python.md").read_text()
README = (ROOT / "README.md").read_text()

START = datetime(2024, 5, 1, 10, tzinfo=UTC).timestamp()
CENTER = (52.51, 13.4)

#: Degrees of longitude as long as one of latitude there.
WIDTH = 1 / np.cos(np.radians(CENTER[0]))


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)


def round_the_block(id, *, start=START, n=60, seed=0, gap=False, attributes=None):
    """A walk around a block of 200 m by 100 m, with a sample every five seconds."""
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [200, 0], [200, 100], [0, 100], [0, 0]], dtype=float)
    along = 7.0 * np.arange(n) % 600
    knots = np.array([0, 200, 300, 500, 600])
    east, north = (np.interp(along, knots, axis) + rng.normal(0, 1, n) for axis in corners.T)
    lat, lon = CENTER[0] + north / 111_200, CENTER[1] + east / 111_200 * WIDTH
    times = start + 5.0 * np.arange(n)
    kept = ~((np.arange(n) > 20) & (np.arange(n) < 30)) if gap else np.ones(n, bool)
    plane = choose_plane([CENTER[0]], [CENTER[1]])
    positions = to_plane(lat, lon, plane)[kept]
    attributes = {name: values[kept] for name, values in (attributes or {}).items()}
    return gpszip.Track(id, times[kept], positions, attributes=attributes, plane=plane)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The files that the page names."""
    monkeypatch.chdir(tmp_path)
    for name in ("walks", "fleet"):
        Path(name).mkdir()
    for number in (1, 3):
        write_tracks([round_the_block(f"walk-{number}", seed=number)], f"walks/{number}.gpx")
    day = 86_400.0
    for number, name in enumerate(("monday", "tuesday")):
        log = round_the_block(name, start=START + day * number, seed=number)
        write_tracks([log], f"{name}.csv")
        shutil.copy(f"{name}.csv", f"fleet/{name}.csv")
    speed = {"speed": np.round(np.linspace(1, 2, 60), 2)}
    write_tracks([round_the_block("bus", gap=True, attributes=speed)], "log.csv")
    for number, name in enumerate(("north", "south")):
        archive = gpszip.compress(round_the_block(name, seed=number), rmse=5.0, effort=1)
        archive.save(f"{name}.gpsz")
    degrees = [
        f"[{CENTER[1] + east / 111_200 * WIDTH}, {CENTER[0] + north / 111_200}]"
        for east, north in ((0, 0), (200, 0), (200, 100), (0, 100), (0, 0))
    ]
    Path("roads.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
        f'"geometry": {{"type": "LineString", "coordinates": [{", ".join(degrees)}]}}}}]}}'
    )
    return tmp_path


def test_the_code_of_the_page_runs_from_top_to_bottom(folder):
    namespace = {}
    for block in blocks(PAGE):
        if missing_packages(block):
            continue
        try:
            exec(compile(block, "docs/python.md", "exec"), namespace)
        except Exception as error:
            raise AssertionError(f"docs/python.md: {block}") from error
    # What the comments of the page say.
    archive = gpszip.open("walks.gpsz")
    assert archive.error_bound.metres == 5.0
    assert archive.position("walk-3", "2024-05-01T10:00:30Z").round(2).tolist() == [52.51, 13.4]
    assert repr(archive["walk-1"]) == (
        "TrackView('walk-1', 1 piece, 2024-05-01 10:00:00 to 10:04:55 UTC)"
    )
    assert namespace["matching"].share > 0.9
    assert namespace["patching"].filled == 1


def test_the_code_of_the_readme_runs(folder):
    namespace = {}
    for block in blocks(README):
        exec(compile(block, "README.md", "exec"), namespace)
    assert np.isfinite(namespace["archive"].position("walk-3", "2024-05-01T10:00:30Z")).all()


def test_names_on_the_page_exist():
    names = set(re.findall(r"(?<!from )\bgpszip\.([A-Za-z_]\w*)(?![\w.])", PAGE)) - {"NAME"}
    assert names <= {*gpszip.__all__, *dir(gpszip)}
    tree = re.findall(r"^ {4}[│ ├└─]*(\w+Error)\b", PAGE, flags=re.MULTILINE)
    assert sorted(tree) == sorted(name for name in gpszip.__all__ if name.endswith("Error"))


def test_every_public_type_is_on_the_page():
    words = set(re.findall(r"\w+", PAGE))
    missing = [name for name in gpszip.__all__ if name not in words and name != "__version__"]
    assert not missing
