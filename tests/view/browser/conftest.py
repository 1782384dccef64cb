"""One browser for all tests, and pages of generated logs."""

import shutil

import numpy as np
import pytest

import gpszip
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.testing import city, patrol
from gpszip.view.blocks import pack_lines
from gpszip.view.page import build_page
from gpszip.view.scene import ShownArchive, build_scene, log_scene, map_scene

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")

FLAGS = (
    "--headless=new --no-sandbox --disable-dev-shm-usage --disable-gpu --no-first-run "
    "--disable-background-networking --disable-extensions --disable-component-update "
    "--hide-scrollbars --window-size=1000,740"
)

#: Seconds since 1970 at which the fleet starts: 2023-11-14 22:13:20 UTC.
START = 1_700_000_000.0

#: Streets of a grid in each direction.
STREETS = 60

#: Names that a page must not take for markup.
NAMES = ["<img src=x onerror=alert(1)>", "</script><script>document.title='bad'</script>", "c", "d"]


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None or CHROMEDRIVER is None:
        pytest.skip("no chromium and chromedriver to show pages with")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    for flag in FLAGS.split():
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(CHROMEDRIVER))
    try:
        driver.set_script_timeout(60)
        yield driver
    finally:
        driver.quit()


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def walk_positions(archive, number, times):
    """Metres of a walk at times: linear between its knots, NaN in gaps."""
    walk, nodes = archive.walks[number], archive.road_map.nodes
    x, y = (np.interp(times, walk.times, nodes[walk.nodes, axis]) for axis in (0, 1))
    segment = np.clip(np.searchsorted(walk.times, times) - 1, 0, len(walk.gaps) - 1)
    return np.where(walk.gaps[segment][..., None], np.nan, np.stack([x, y], axis=-1))


def save(folder, name, scene):
    path = folder / f"{name}.html"
    path.write_text(build_page(scene), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def fleet_tracks():
    """Four vehicles in Athens, with a gap in the first, at times since 1970."""
    town = list(city(vehicles=4, period=5.0, duration=900.0).values())
    degrees = np.concatenate([each for _, each in town])
    plane = choose_plane(degrees[:, 0], degrees[:, 1])
    tracks = []
    for number, (name, (times, each)) in enumerate(zip(NAMES, town, strict=True)):
        kept = np.ones(len(times), bool)
        if not number:
            kept[60:120] = False
        positions = to_plane(each[:, 0], each[:, 1], plane)
        tracks.append(gpszip.Track(name, START + times[kept], positions[kept], plane=plane))
    return tracks


@pytest.fixture(scope="session")
def fleet(fleet_tracks):
    return gpszip.compress(fleet_tracks, rmse=8.0, effort=1, gap=60.0)


@pytest.fixture(scope="session")
def robot():
    """A robot in a building, at times of its own, with a height and a column that is kept."""
    track = patrol(1500)
    positions = np.column_stack([track.positions, np.sin(track.times / 20)])
    battery = np.linspace(100.0, 90.0, len(track))
    track = gpszip.Track("robot", track.times, positions, attributes={"battery": battery})
    archive = gpszip.compress(track, rmse=0.3, effort=1, keep=["battery"])
    return archive, track


@pytest.fixture(scope="session")
def fleet_path(folder, fleet, fleet_tracks):
    """Page of the fleet with everything that a page can show."""
    subject = ShownArchive(fleet, "<b>fleet</b>.gpsz", fleet_tracks, 20_000)
    scene = build_scene([subject], title="fleet.gpsz")
    for key, north in (("new_edges", 20.0), ("routes", 40.0)):
        line = np.array([[-300.0, north], [300.0, north]])
        scene["archives"][0][key] = pack_lines(line, np.array([0, 2]), 0.1)
    roads = np.array([[-300.0, -30.0], [300.0, -30.0]])
    scene["network"] = pack_lines(roads, np.array([0, 2]), 0.1)
    return save(folder, "fleet", scene)


@pytest.fixture(scope="session")
def robot_path(folder, robot):
    archive, track = robot
    subject = ShownArchive(archive, "robot.gpsz", (track,), 100)
    return save(folder, "robot", build_scene([subject], title="robot"))


@pytest.fixture(scope="session")
def pair_path(folder, fleet, fleet_tracks):
    """Page of two archives, the second one without the first track."""
    coarse = gpszip.compress(fleet_tracks[1:], rmse=20.0, effort=1, gap=60.0)
    pair = ((fleet, "a.gpsz"), (coarse, "b.gpsz"))
    shown = [ShownArchive(archive, name, fleet_tracks) for archive, name in pair]
    return save(folder, "pair", build_scene(shown, title="pair"))


@pytest.fixture(scope="session")
def odd_paths(folder, fleet):
    """Pages of logs that lack something."""
    angle = np.linspace(0, 6, 100)
    shape = 50 * np.column_stack([np.cos(angle), np.sin(angle)])
    steps = np.linalg.norm(np.diff(shape, axis=0), axis=1)
    untimed = gpszip.Track("shape", np.r_[0, np.cumsum(steps)], shape, timed=False)
    dot = gpszip.Track("dot", [START], [[3.0, 4.0]])
    scenes = {
        "untimed": _scene(gpszip.compress(untimed, rmse=1.0, effort=1, times=False), untimed),
        "point": _scene(gpszip.compress(dot, rmse=1.0), dot),
        "map": map_scene(fleet.road_map, title="map"),
        "streets": map_scene(_streets(), title="streets"),
        "many": log_scene(_many_tracks(), title="many"),
        "ferry": _scene(*_ferry()),
        "travel": _travel(),
    }
    return {name: save(folder, name, scene) for name, scene in scenes.items()}


def _scene(archive, track):
    return build_scene([ShownArchive(archive, "a.gpsz", (track,))], title="a")


def _streets():
    """A grid of more edges than are stroked."""
    side = np.arange(STREETS) * 10.0
    nodes = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    numbers = np.arange(STREETS**2).reshape(STREETS, STREETS)
    along = np.column_stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()])
    edges = np.concatenate([along, np.column_stack([numbers[:-1].ravel(), numbers[1:].ravel()])])
    ones = np.ones(len(edges), np.int64)
    return gpszip.RoadMap(nodes, edges, ones, ones)


def _many_tracks():
    times = START + np.arange(3.0)
    starts = np.stack(np.meshgrid(np.arange(100.0), np.arange(100.0)), axis=-1).reshape(-1, 2)
    steps = np.array([[0.0, 0.0], [0.4, 0.1], [0.7, 0.3]])
    return [gpszip.Track(f"t{i}", times, start + steps) for i, start in enumerate(starts)]


def _travel():
    """Tracks on two planes: at 50 degrees north, and at 30 degrees south."""
    lat = np.r_[np.linspace(50, 50.01, 50), np.linspace(-30, -30.01, 50)]
    lon = np.r_[np.full(50, 8.0), np.full(50, 150.0)]
    plane = choose_plane(lat, lon)
    positions = to_plane(lat, lon, plane)
    times = START + 10.0 * np.arange(50)
    tracks = [
        gpszip.Track("north", times, positions[:50], plane=plane),
        gpszip.Track("south", times, positions[50:], plane=plane),
    ]
    subject = ShownArchive(gpszip.compress(tracks, rmse=20.0, effort=1), "a.gpsz", tracks)
    return build_scene([subject], title="a")


def _ferry():
    """A track across the antimeridian."""
    lat, lon = np.linspace(-17, -16.5, 100), 179.8 + np.linspace(0, 0.5, 100)
    lon = np.where(lon > 180, lon - 360, lon)
    plane = choose_plane(lat, lon)
    times = START + 60.0 * np.arange(100)
    track = gpszip.Track("ferry", times, to_plane(lat, lon, plane), plane=plane)
    return gpszip.compress(track, rmse=20.0, effort=1), track


def _open(browser, path):
    from view.browser.driving import Page  # which needs selenium

    return Page(browser, path).open()


@pytest.fixture
def fleet_page(browser, fleet_path):
    return _open(browser, fleet_path)


@pytest.fixture
def robot_page(browser, robot_path):
    return _open(browser, robot_path)


@pytest.fixture
def pair_page(browser, pair_path):
    return _open(browser, pair_path)
