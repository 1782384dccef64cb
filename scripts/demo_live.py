"""Show live positions end to end: a generated fleet, its map, a listener with a page, a replay.

    python scripts/demo_live.py [--seconds 20]

Shuttle buses drive for two days. The first day is compressed to a map. A listener follows the
second day on it, which is replayed 60 times as fast. It ends at Ctrl-C, or after some seconds: 15
by default where the variable CI is set.
"""

import argparse
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np

from gpszip.model import Plane, Track
from gpszip.model.projection import to_geographic
from gpszip.testing import shuttles

#: Where the buses drive, in units of 1e-7 degrees.
TOWN = Plane(((480_000_000, 115_000_000),))

#: Seconds from one position of a bus to the next, as they are recorded.
PERIOD = 10.0

#: Seconds for which the demo runs where nobody watches.
UNWATCHED_SECONDS = 15.0

#: Seconds within which the listener has to listen.
START_SECONDS = 120.0


def main() -> int:
    """Run the demo; return 1 if no position arrived."""
    # For how long.
    parser = argparse.ArgumentParser(description="Show live positions end to end.")
    parser.add_argument("--seconds", type=float, help="end after so many seconds")
    seconds = parser.parse_args().seconds
    if seconds is None and os.environ.get("CI"):
        seconds = UNWATCHED_SECONDS

    # The map of the first day, then the second day live.
    with tempfile.TemporaryDirectory(prefix="gpszip-demo-") as name:
        folder = Path(name)
        write_logs(folder)
        run(
            "compress",
            folder / "first.csv",
            "--rmse",
            "8m",
            "--effort",
            "1",
            "-o",
            folder / "map.gpsz",
        )
        return show(folder, seconds)


def write_logs(folder: Path) -> None:
    """Write both days; the second one begins now."""
    log = shuttles(6, days=2, period=PERIOD)
    begin = min(float(track.times[0]) for track in log.tracks)
    middle = begin + 86_400.0
    shift = time.time() - middle
    days = {"first.csv": (begin, middle), "second.csv": (middle, np.inf)}
    for name, (start, end) in days.items():
        parts = [track_rows(track, start, end, shift) for track in log.tracks]
        (folder / name).write_text("id,time,lat,lon\n" + "".join(parts))


def track_rows(track: Track, start: float, end: float, shift: float) -> str:
    """Rows of a track between two times, as if they were some seconds later."""
    is_in = (track.times >= start) & (track.times < end)
    lat, lon = to_geographic(track.positions[is_in], TOWN)
    rows = zip(track.times[is_in] + shift, lat, lon, strict=True)
    return "".join(f"{track.id},{t:.1f},{a:.7f},{b:.7f}\n" for t, a, b in rows)


def show(folder: Path, seconds: float | None) -> int:
    """Listen and replay until Ctrl-C, or for some seconds."""
    # Start the listener, and replay the second day to it.
    words = ["listen", folder / "map.gpsz", "--journal", folder / "journal", "--delay", "1s"]
    words += ["--http", "127.0.0.1:0", "--page", "127.0.0.1:0"]
    listener = start(*words, stderr=subprocess.PIPE)
    replay = None
    try:
        target, page = addresses(listener)
        second = folder / "second.csv"
        to_listener = ["--as", "owntracks", "--to", f"{target}/owntracks", "--speed", "60"]
        replay = start("replay", second, *to_listener, "--quiet")

        # Wait.
        print(f"open {page} in a browser; Ctrl-C ends the demo", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(seconds if seconds is not None else 1e9)
        stored = count_stored(target)
    finally:
        # The replay has nothing to finish; the listener has.
        if replay is not None:
            replay.kill()
            replay.wait()
        listener.send_signal(signal.SIGINT)
        listener.communicate(timeout=60)
    print(f"{stored:,} positions were taken")
    return 0 if stored else 1


def addresses(listener: subprocess.Popen[str]) -> tuple[str, str]:
    """Addresses of the server for positions and of the page, which the listener tells."""
    assert listener.stderr is not None
    found: list[str] = []
    end = time.monotonic() + START_SECONDS
    while len(found) < 2 and time.monotonic() < end and listener.poll() is None:
        line = listener.stderr.readline()
        found += re.findall(r"http://[\w.:]+", line)
        if not found:
            print(line, end="", file=sys.stderr)
    if len(found) < 2:
        raise SystemExit("the listener did not begin")
    return found[0], found[1]


def count_stored(target: str) -> int:
    """Positions that the listener stored."""
    with urllib.request.urlopen(f"{target}/health", timeout=30) as answer:
        counts: dict[str, int] = json.load(answer)["counts"]
    return counts.get("stored", 0)


def run(*words: object) -> None:
    """Run a command of gpszip."""
    subprocess.run([sys.executable, "-m", "gpszip", *map(str, words)], check=True)


def start(*words: object, stderr: int | None = None) -> "subprocess.Popen[str]":
    """Start a command of gpszip; Ctrl-C at the terminal is for this script."""
    return subprocess.Popen(
        [sys.executable, "-m", "gpszip", *map(str, words)],
        stderr=stderr,
        text=True,
        start_new_session=True,
    )


if __name__ == "__main__":
    sys.exit(main())
