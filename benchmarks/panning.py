"""Measure how fluidly a page of a million points and 50,000 edges moves in a browser.

    python benchmarks/panning.py

Needs chromium, chromedriver and selenium. The browser draws without a graphics card. A map is
dragged by the mouse once a frame, at full view and zoomed in 8 times. Printed are the median time
from one frame to the next in milliseconds, which should be at most 60 (16 is what a screen allows),
and the CPU time of the page's thread for a frame, which other programs don't change.
"""

import shutil
import statistics
import tempfile
from pathlib import Path

import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from gpszip.view.blocks import pack_lines, pack_numbers
from gpszip.view.page import build_page

POINTS = 1_000_000
TRACKS = 100

#: Edges of the map: streets of a grid between neighbouring crossings.
CROSSINGS = 159

#: Metres between crossings, and of the error of a position.
BLOCK = 60.0
NOISE = 3.0

#: Frames that are measured.
FRAMES = 60

#: What a frame may take, in milliseconds.
BAR = 60

FLAGS = (
    "--headless=new --no-sandbox --disable-dev-shm-usage --disable-gpu --no-first-run "
    "--disable-background-networking --window-size=1280,800"
)

#: Drags the map by a few pixels in each frame, and returns the times between frames.
DRAG = """
const [frames, done] = arguments;
const canvas = document.querySelectorAll(".pane canvas")[1];
const box = canvas.getBoundingClientRect();
const times = [];
let x = 400;
function send(type) {
  canvas.dispatchEvent(new PointerEvent(type, {
    pointerId: 1, button: 0, bubbles: true, clientX: box.left + x, clientY: box.top + 300,
  }));
}
canvas.setPointerCapture = () => {};
send("pointerdown");
function step(now) {
  times.push(now);
  if (times.length > frames) {
    send("pointerup");
    return done(times.slice(1).map((time, i) => time - times[i]));
  }
  x += times.length % 20 < 10 ? 7 : -7;
  send("pointermove");
  requestAnimationFrame(step);
}
requestAnimationFrame(step);
"""


def main() -> None:
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        print("no chromium and chromedriver: nothing is measured")
        return
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in FLAGS.split():
        options.add_argument(flag)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(build_page(make_scene()), encoding="utf-8")
        print(f"page      {page.stat().st_size / 1e6:.1f} MB")
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            measure(driver, page)
        finally:
            driver.quit()


def measure(driver: webdriver.Chrome, page: Path) -> None:
    """Print the median frame of a page at full view, and zoomed in."""
    driver.set_script_timeout(300)
    driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
    driver.get(page.as_uri())
    driver.execute_async_script(
        "const done = arguments[0];"
        "(function wait() { document.documentElement.dataset.ready"
        " ? done() : setTimeout(wait, 50); })();"
    )
    loaded = driver.execute_script("return performance.now()") / 1e3
    print(f"load      {loaded:.1f} s, {thread_seconds(driver):.1f} s of CPU")
    for name, zooms in (("full view", 0), ("8 times", 4)):
        for _ in range(zooms):
            driver.find_element("id", "zoom-in").click()
        before = thread_seconds(driver)
        frames = driver.execute_async_script(DRAG, FRAMES)
        cpu = (thread_seconds(driver) - before) / FRAMES * 1e3
        median = statistics.median(frames)
        print(f"{name:<9} {median:.0f} ms a frame, {cpu:.0f} ms of CPU; bar {BAR}")


def thread_seconds(driver: webdriver.Chrome) -> float:
    """CPU seconds of the page's main thread."""
    metrics = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "TaskDuration")


def make_scene() -> dict:
    """A city: tracks along the streets of a grid, and the grid as its map."""
    rng = np.random.default_rng(1)
    side = np.arange(CROSSINGS) * BLOCK
    nodes = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    numbers = np.arange(CROSSINGS**2).reshape(CROSSINGS, CROSSINGS)
    edges = np.concatenate(
        [
            np.column_stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()]),
            np.column_stack([numbers[:-1].ravel(), numbers[1:].ravel()]),
        ]
    )
    travels = rng.integers(0, 30, (2, len(edges)))
    ends = nodes[edges].reshape(-1, 2)
    offsets = np.arange(len(edges) + 1) * 2

    # Each track follows one street after the other.
    count = POINTS // TRACKS
    positions, knots = zip(*(drive(rng, count) for _ in range(TRACKS)), strict=True)
    times = np.tile(1.7e9 + np.arange(count), TRACKS)
    walks = np.concatenate(knots)
    errors = np.abs(rng.normal(0, NOISE, POINTS))
    ids = [f"car {i}" for i in range(TRACKS)]
    samples = np.concatenate(positions)
    knots_of = len(walks) // TRACKS
    tracks = {"ids": ids, "timed": [True] * TRACKS}
    archive = {
        "name": "city.gpsz",
        "facts": [["Points", f"{POINTS:,}"]],
        "bytes": 100_000,
        "log_bytes": None,
        "points": POINTS,
        "sections": [["walks", 100_000]],
        "bound": None,
        "rmse": NOISE,
        "max_error": float(errors.max()),
        "dimension": 2,
        "nodes": {"x": pack_numbers(nodes[:, 0], 0.1), "y": pack_numbers(nodes[:, 1], 0.1)},
        "edges": {
            "from": pack_numbers(edges[:, 0]),
            "to": pack_numbers(edges[:, 1]),
            "forward": pack_numbers(travels[0]),
            "backward": pack_numbers(travels[1]),
        },
        "clean": {
            **pack_lines(ends, offsets, 0.1),
            "forward": pack_numbers(travels[0]),
            "backward": pack_numbers(travels[1]),
        },
        "new_edges": None,
        "tracks": {**tracks, "offsets": pack_numbers(np.arange(TRACKS + 1) * knots_of)},
        "knots": {
            "node": pack_numbers(walks),
            "time": pack_numbers(np.tile(np.linspace(1.7e9, 1.7e9 + count, knots_of), TRACKS)),
            "gap": pack_numbers(np.zeros(len(walks))),
        },
        "raw": {
            "tracks": {**tracks, "offsets": pack_numbers(np.arange(TRACKS + 1) * count)},
            "walk": pack_numbers(np.arange(TRACKS)),
            "x": pack_numbers(samples[:, 0], 0.2),
            "y": pack_numbers(samples[:, 1], 0.2),
            "time": pack_numbers(times),
            "error": pack_numbers(errors, 0.1, with_nan=True),
            "total": POINTS,
            "drawn": POINTS,
        },
        "kept": None,
        "routes": None,
    }
    return {
        "version": 1,
        "generator": "GPSZip",
        "title": "city.gpsz",
        "geographic": False,
        "planes": [],
        "plane_spread": 1 << 25,
        "epoch": "unix",
        "archives": [archive],
        "network": None,
    }


def drive(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a drive along the streets, and the nodes that it passes."""
    legs = rng.integers(0, CROSSINGS, (40, 2))
    corners = np.empty((80, 2), np.int64)
    corners[0::2] = np.column_stack([legs[:, 0], np.r_[legs[0, 1], legs[:-1, 1]]])
    corners[1::2] = legs
    along = np.r_[0, np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1))]
    places = np.linspace(0, along[-1], count)
    exact = np.column_stack([np.interp(places, along, corners[:, axis]) for axis in (0, 1)])
    positions = exact * BLOCK + rng.normal(0, NOISE, (count, 2))
    return positions, corners[:, 1] * CROSSINGS + corners[:, 0]


if __name__ == "__main__":
    main()
