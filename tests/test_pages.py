"""The commands and the code of the documentation work, page by page, from top to bottom.

tests/test_python_page.py runs docs/python.md and the code of README.md; docs/cli.md has patterns of
commands, whose names and options tests/test_docs.py checks.
"""

import contextlib
import json
import re
import shlex
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from sybil import Sybil
from sybil.document import Document
from sybil.parsers.markdown import PythonCodeBlockParser
from sybil.region import Region

import exports
import gpszip
from frames import missing_packages
from gpszip.cli.main import main
from gpszip.geo.planes import choose_plane, to_geographic, to_plane
from gpszip.io.logs.write import write_tracks
from gpszip.io.networks.read import read_network
from oracle import google

ROOT = Path(__file__).parents[1]

#: Pages, and the archives that they begin with.
PAGES = {
    "docs/index.md": (),
    "docs/tutorial.md": (),
    "docs/robots.md": (),
    "docs/fleets.md": ("monday", "tuesday"),
    "docs/events.md": (),
    "docs/phones.md": (),
    "docs/trips.md": (),
    "docs/lossless.md": (),
    "docs/notebooks.md": ("monday", "tuesday", "fleet"),
    "docs/qgis.md": ("fleet",),
    "docs/known-maps.md": (),
    "docs/history.md": ("fleet", "night", "monday", "tuesday"),
    "docs/map.md": ("fleet",),
    "docs/coreset.md": (),
    "docs/generators.md": (),
    "docs/matching.md": (),
    "docs/merging.md": ("north", "south"),
    "docs/networks.md": (),
    "docs/parallel.md": (),
    "docs/patching.md": (),
    "docs/prediction.md": (),
    "docs/pictures.md": ("patrol", "fine", "medium", "coarse"),
    "docs/report.md": ("fleet", "night"),
    "docs/segments.md": (),
    "docs/view.md": ("walks",),
    "README.md": ("monday", "north", "south"),
}

#: What a page needs besides the dependencies of the tests.
NEEDS = {"docs/robots.md": "rosbags", "docs/phones.md": "fitdecode"}

#: The log of each archive that pages begin with.
LOGS = {"patrol": "patrol.csv", "night": "night.csv", "walks": "walks/walk.gpx"}

#: Files that a page writes itself.
WRITTEN = {"docs/index.md": "walks.csv"}

#: Parts of commands that are not run: they need another machine, load all kernels first, which
#: takes half a minute, or run until they are told to stop. tests/cli/test_engines.py runs
#: processes, and tests/live/ listeners.
NOT_RUN = ("s3://", "gpszip warm", "--engine processes", "gpszip listen")

#: A command in an indented block.
COMMAND = re.compile(r"^ {4}(gpszip .*?)(?: {2,}#.*)?$", re.MULTILINE)

START = datetime(2024, 5, 1, 10, tzinfo=UTC).timestamp()


def parse_commands(document: Document):
    """Yield the commands of a page."""
    for match in COMMAND.finditer(document.text):
        yield Region(match.start(), match.end(), match.group(1), run_command)


def run_command(example):
    """Run a command as a shell would: patterns without quotes are expanded."""
    if any(part in example.parsed for part in NOT_RUN):
        return
    words = []
    for word in shlex.split(example.parsed, posix=False)[1:]:
        # No test opens a browser.
        if word == "--open":
            continue
        if word.startswith("'"):
            words.append(word.strip("'"))
        elif "*" in word:
            words += sorted(map(str, Path().glob(word)))
        else:
            words.append(word)

    # The least effort takes the same options; other tests compress with the default one.
    if words[0] == "compress" and "--effort" not in words:
        words += ["--effort", "1"]
    code = main(words)
    assert code == 0, f"{example.parsed} ends with {code}"


def lap(id, *, number=0, n=100, start=START):
    """A lap around a block of 200 m by 100 m with a sample every five seconds."""
    rng = np.random.default_rng(number)
    corners = np.array([[0, 0], [200, 0], [200, 100], [0, 100], [0, 0]], dtype=float)
    along = 7.0 * np.arange(n) % 600
    knots = np.array([0, 200, 300, 500, 600])
    east, north = (np.interp(along, knots, axis) + rng.normal(0, 1, n) for axis in corners.T)
    times = start + 86_400.0 * number + 5.0 * np.arange(n)
    return id, times, np.stack([east, north], axis=1)


def gps_lap(id, **options):
    id, times, metres = lap(id, **options)
    lat, lon = 52.51 + metres[:, 1] / 111_200, 13.4 + metres[:, 0] / 67_700
    plane = choose_plane([52.51], [13.4])
    return gpszip.Track(id, times, to_plane(lat, lon, plane), plane=plane)


def office(messages):
    """Yield messages of a robot that drifts: its odometry, and transforms that correct it."""
    _, times, positions = lap("robot", start=1.7e9)
    yield "/tf_static", 0, messages.transforms(messages.transform(0, (5, 5, 0), child="dock"))
    for i, (time, position) in enumerate(zip(times, positions, strict=True)):
        ns, p = round(time * 1e9), (*position, 0)
        moved = messages.transform(ns, p, frame="odom", child="base_link")
        yield "/odom", ns, messages.odometry(ns, p)
        yield "/tf", ns, messages.transforms(moved, messages.transform(ns, (-i / 50, 0, 0)))


def roads(east, north):
    """GeoJSON of the streets around blocks of 200 m by 100 m, as many as are asked for."""
    corners = [(200 * i, 100 * j) for i in range(east + 1) for j in range(north + 1)]
    ends = [((x, y), (x + 200, y)) for x, y in corners if x < 200 * east]
    ends += [((x, y), (x, y + 100)) for x, y in corners if y < 100 * north]
    lines = [[[13.4 + x / 67_700, 52.51 + y / 111_200] for x, y in line] for line in ends]
    features = [
        {
            "type": "Feature",
            "properties": {"highway": "residential"},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for line in lines
    ]
    return {"type": "FeatureCollection", "features": features}


def write_osm(path, collection):
    """Write lines as ways of OpenStreetMap."""
    osmium = pytest.importorskip("osmium")
    ways = [feature["geometry"]["coordinates"] for feature in collection["features"]]
    numbers = {point: n for n, point in enumerate({tuple(p) for way in ways for p in way}, 1)}
    with osmium.SimpleWriter(str(path)) as writer:
        for point, number in numbers.items():
            writer.add_node(osmium.osm.mutable.Node(id=number, location=point, version=1))
        for number, way in enumerate(ways, 1):
            nodes = [numbers[tuple(point)] for point in way]
            tags = {"highway": "residential"}
            writer.add_way(osmium.osm.mutable.Way(id=number, nodes=nodes, tags=tags, version=1))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with the files that the pages name, but for archives."""
    folder = tmp_path_factory.mktemp("pages")
    with contextlib.chdir(folder):
        write_files()
    return folder


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    """A copy of these files for one page."""
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def write_files():
    """Write the files into the current folder."""
    # Logs on the earth, in folders and alone.
    for name in ("rides", "walks", "fleet", "logs"):
        Path(name).mkdir()
    for number in range(3):
        write_tracks([gps_lap(f"ride-{number}", number=number)], f"rides/{number}.gpx")
        write_tracks([gps_lap(f"cab-{number}", number=number)], f"fleet/{number}.parquet")
        write_tracks([gps_lap(f"cab-{number}", number=number)], f"logs/{number}.csv")
    shutil.copy("rides/0.gpx", "walks/walk.gpx")
    shutil.copy("rides/0.gpx", "walks.gpx")
    write_tracks([gps_lap("next", number=4)], "next.gpx")
    for name in ("walk", "walks", "drive", "drives"):
        write_tracks([gps_lap(name)], f"{name}.csv")
    phone = gps_lap("history")
    errors = {"accuracy": np.full(len(phone), 10.0)}
    write_tracks([replace(phone, attributes=errors)], "history.csv")
    for number, name in enumerate(("monday", "tuesday")):
        write_tracks([gps_lap(name, number=number)], f"{name}.csv")

    # Two buses in turn, with further columns.
    rows = [
        f"v{7 + i % 2},{START + i:.0f},{52.5 + i / 1e5:.5f},13.40000,{34 + i % 3}.5,{90 + i % 7}"
        for i in range(60)
    ]
    Path("buses.csv").write_text("\n".join(["id,t,lat,lon,ele,hr", *rows, ""]))

    # The history of a phone.
    fixes = [
        (datetime.fromtimestamp(START + 60 * i, UTC), 52.51 + i % 20 / 1e3, 13.4, 0)
        for i in range(100)
    ]
    Path("Timeline.json").write_bytes(google.encode(google.android(fixes)))
    for name in ("strava", "garmin", "takeout", "apple"):
        Path(f"{name}.zip").write_bytes(exports.zipped(getattr(exports, name)()))
    exports.unpacked(exports.days(), Path("days"))

    # Logs of a robot in metres.
    for number, name in enumerate(("patrol", "tomorrow")):
        log = gpszip.Track(*lap("robot", number=number, start=0.0))
        write_tracks([log], f"{name}.csv")
    table = Path("patrol.csv").read_text().splitlines()
    Path("odometry.csv").write_text("\n".join(["id,stamp,px,py", *table[1:]]))

    # A guard's rounds, two minutes each.
    corners = [[0, 0], [90, 0], [90, 60], [0, 60]] * 40
    times = START + 30.0 * np.arange(len(corners))
    write_tracks([gpszip.Track("guard", times, np.array(corners, float))], "night.csv")

    # A bag of ROS 2, where its extra is installed.
    if find_spec("rosbags"):
        from ros_bags import write_bag

        write_bag("office", "sqlite", office)

    # Roads.
    Path("roads.geojson").write_text(json.dumps(roads(2, 2)))
    write_osm("roads.osm.pbf", roads(2, 2))
    shutil.copy("roads.osm.pbf", "CITY.osm.pbf")


def write_archives(names):
    """Write the archives that a page begins with."""
    for number, name in enumerate(names):
        compress_page_log(name, number).save(f"{name}.gpsz")


@cache
def compress_page_log(name, number):
    """Compress the log of an archive, once for all pages that begin with it."""
    if name in LOGS:
        tracks = list(gpszip.read(LOGS[name]))
    elif name in {"fine", "medium", "coarse"}:
        tracks = list(gpszip.read("walk.csv"))
    else:
        tracks = [gps_lap("cab" if name in {"monday", "tuesday", "fleet"} else name, number=number)]
    return gpszip.compress(tracks, rmse=5.0 + number, effort=1)


def values_of(page):
    """The names that the code of a page takes for granted."""
    track = gps_lap("bus", n=300)
    names = {"gpszip": gpszip, "track": track, "tracks": [track]}
    if page == "docs/coreset.md":
        names |= {"times": track.times[::50], "positions": track.positions[::50]}
        names["chunks"] = [
            (track.times[i : i + 100], track.positions[i : i + 100]) for i in (0, 100)
        ]
        for number, name in enumerate(("monday", "tuesday", "other_car")):
            names[name] = gpszip.coreset(gps_lap(name[:3], number=number), size=50)
    if page == "docs/matching.md":
        network = read_network("roads.geojson")
        on_network = gpszip.Track("a", track.times, to_network(track, network), plane=network.plane)
        names |= {"earlier": [on_network], "network": network, "heading": 90.0}
        names |= {"t": float(track.times[0]), "position": on_network.positions[0]}
    return names


def to_network(track, network):
    """Positions of a track on the plane of a network."""
    lat, lon = to_geographic(track.positions, track.plane)
    return to_plane(lat, lon, network.plane)


@pytest.mark.parametrize("page", PAGES)
def test_the_blocks_of_the_page_run_from_top_to_bottom(folder, page, request):
    if page in NEEDS:
        pytest.importorskip(NEEDS[page])
    if page in WRITTEN:
        Path(WRITTEN[page]).unlink()
    write_archives(PAGES[page])
    # The code of the introduction is run by tests/test_python_page.py.
    parsers = [parse_commands]
    if page != "README.md":
        parsers.append(PythonCodeBlockParser())
    document = Sybil(parsers).parse(ROOT / page)
    document.namespace.update(values_of(page))
    if page == "docs/parallel.md":
        document.namespace["client"] = request.getfixturevalue("client")
    examples = list(document.examples())
    assert examples
    for example in examples:
        if not missing_packages(str(example.parsed)):
            example.evaluate()


@pytest.fixture
def client():
    """A cluster of Dask in this process."""
    distributed = pytest.importorskip("distributed")
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as connected:
        yield connected


def test_every_page_with_code_or_commands_is_run():
    # docs/formats.md names files that other programs write, and tests/live/test_page.py runs
    # docs/live.md.
    told = {"docs/python.md", "docs/cli.md", "docs/formats.md", "docs/live.md"}
    for path in [*ROOT.glob("docs/*.md"), ROOT / "README.md"]:
        text = path.read_text()
        if COMMAND.search(text) or "```python" in text:
            assert str(path.relative_to(ROOT)) in {*PAGES, *told}, path.name
