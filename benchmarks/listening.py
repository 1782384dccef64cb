"""Replay a day of a generated fleet to a listener, and print its memory and the archive's errors.

    python benchmarks/listening.py FOLDER [--vehicles 30] [--hours 24] [--speed 100]

Half of the vehicles drive lines all day, the others are taxis, which wait, and are off for 14
hours. All send a position every 10 seconds, as OwnTracks over HTTP. The listener follows them on
the map of the lines' first two hours, writes events, shows its page to one browser, and appends the
journal to an archive every 36 s, which is an hour of the log at 100 times its speed. Every 10 s of
the clock its memory is read.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import gpszip
from gpszip.model import Plane, Track
from gpszip.model.projection import map_coordinates
from gpszip.testing import fleet, taxis

#: Where the fleet drives, in units of 1e-7 degrees.
TOWN = Plane(((480_000_000, 115_000_000),))

#: Seconds between two positions of a vehicle.
PERIOD = 10.0

#: Seconds of the clock between two readings of the memory.
READING = 10.0

#: Hours of the lines that make the map.
MAP_HOURS = 2.0

#: Metres: the RMSE of map and archive.
RMSE = "8m"

#: Seconds of the log after which the journal is appended to the archive.
ROLL = 3600.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--vehicles", type=int, default=30)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--speed", type=float, default=100.0)
    arguments = parser.parse_args()
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)

    # The log, which begins as long ago as it lasts, and the map.
    tracks = make_tracks(arguments.vehicles, arguments.hours)
    write_log(folder / "log.csv", tracks)
    run("compress", folder / "log.csv", "-o", folder / "map.gpsz", *first_hours(tracks))

    # Play it.
    listener = start_listener(folder, arguments.speed)
    target, page = addresses(listener)
    threading.Thread(target=watch, args=(page,), daemon=True).start()
    replay = ["replay", folder / "log.csv", "--as", "owntracks", "--to", f"{target}/owntracks"]
    player = start(
        *replay, "--speed", arguments.speed, "--connections", 64, "--json", stdout=subprocess.PIPE
    )
    rows = read_memory(listener.pid, player, target)

    # What became of it.
    print(json.dumps(json.loads(player.communicate()[0])), flush=True)
    listener.send_signal(signal.SIGTERM)
    listener.wait(600)
    report(rows, folder, tracks)


def make_tracks(vehicles: int, hours: float) -> list[Track]:
    """Vehicles of lines and taxis, whose last position is from now."""
    points = int(hours * 3600 / PERIOD)
    lines = fleet(vehicles - vehicles // 2, points=points, period=PERIOD).tracks
    others = taxis(max(vehicles // 2, 1), points=points, period=PERIOD).tracks
    begin = time.time() - hours * 3600
    moved = [Track(t.id, begin + t.times - t.times[0], t.positions) for t in [*lines, *others]]
    return [part(track, begin + hours * 3600) for track in moved]


def part(track: Track, end: float) -> Track:
    is_in = track.times < end
    return Track(track.id, np.round(track.times[is_in]), track.positions[is_in])


def write_log(path: Path, tracks: Sequence[Track]) -> None:
    with path.open("w") as file:
        file.write("id,time,lat,lon\n")
        for track in tracks:
            rows = zip(track.times, degrees(track), strict=True)
            file.writelines(f"{track.id},{t:.0f},{lat:.7f},{lon:.7f}\n" for t, (lat, lon) in rows)


def degrees(track: Track) -> np.ndarray:
    return np.round(map_coordinates(track.positions, TOWN), 7)


def first_hours(tracks: Sequence[Track]) -> list[str]:
    """Options of compress for the map."""
    begin = tracks[0].times[0]
    lines = [
        word for track in tracks if track.id.startswith("van") for word in ("--track", track.id)
    ]
    until = str(begin + MAP_HOURS * 3600)
    return [*lines, "--until", until, "--rmse", RMSE, "--effort", "1", "--force"]


def start_listener(folder: Path, speed: float) -> subprocess.Popen:
    words = ["listen", folder / "map.gpsz", "--journal", folder / "journal"]
    words += ["--http", "127.0.0.1:0", "--page", "127.0.0.1:0", "-o", folder / "events.ndjson"]
    words += ["--archive", folder / "day.gpsz", "--roll", f"{ROLL / speed:g}s", "--rmse", RMSE]
    return start(*words, "--effort", "1", stderr=subprocess.PIPE)


def start(*words: object, **streams: int) -> subprocess.Popen:
    command = [sys.executable, "-m", "gpszip", *map(str, words)]
    return subprocess.Popen(command, text=True, **streams)


def run(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "gpszip", *map(str, words)], check=True)


def addresses(listener: subprocess.Popen) -> list[str]:
    """Addresses of the server for positions and of the page; later lines are printed."""
    found: list[str] = []
    while len(found) < 2:
        line = listener.stderr.readline()
        if not line:
            raise SystemExit("the listener did not begin")
        found += re.findall(r"http://[\w.:]+", line)

    def echo() -> None:
        for line in listener.stderr:
            print("listener:", line, end="", flush=True)

    threading.Thread(target=echo, daemon=True).start()
    return found


def watch(page: str) -> None:
    """Read the stream of the page, as a browser does."""
    with urllib.request.urlopen(f"{page}/stream") as stream:
        while stream.read1(65_536):
            pass


def read_memory(pid: int, player: subprocess.Popen, target: str) -> list[tuple[float, ...]]:
    """Seconds, MiB of the listener and of the process that archives, positions stored."""
    begin, rows = time.monotonic(), []
    while player.poll() is None:
        time.sleep(READING)
        with urllib.request.urlopen(f"{target}/health") as answer:
            counts = json.load(answer)["counts"]
        seconds = time.monotonic() - begin
        rolling = sum(resident(child) for child in children(pid))
        rows.append((seconds, resident(pid), rolling, counts.get("stored", 0)))
        print("{:6.0f} s {:7.1f} MiB {:7.1f} MiB {:9,} stored".format(*rows[-1]), flush=True)
    return rows


def resident(pid: int) -> float:
    """MiB of memory of a process; 0 if it has ended."""
    try:
        text = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    found = re.search(r"VmRSS:\s+(\d+)", text)
    return int(found[1]) / 1024 if found else 0.0


def children(pid: int) -> list[int]:
    return [
        int(child)
        for task in Path(f"/proc/{pid}/task").iterdir()
        for child in (task / "children").read_text().split()
    ]


def report(rows: list[tuple[float, ...]], folder: Path, tracks: Sequence[Track]) -> None:
    """Print the memory at the beginning, in the middle and at the end, and the archive's errors."""
    begin = rows[min(2, len(rows) - 1)]
    for name, row in {"begin": begin, "middle": rows[len(rows) // 2], "end": rows[-1]}.items():
        print(f"{name:6} {row[0]:6.0f} s: {row[1]:.1f} MiB, {row[3]:,} positions stored")
    print(
        f"most: {max(row[1] for row in rows):.1f} MiB, of a process that archives "
        f"{max(row[2] for row in rows):.1f} MiB"
    )

    # Each position at its time.
    archive, found = gpszip.open(folder / "day.gpsz"), []
    for track in tracks:
        places = archive.position(track.id, track.times)
        metres = np.diff([degrees(track), places], axis=0)[0] * 111_195
        metres[:, 1] *= np.cos(np.radians(places[:, 0]))
        found.append(np.linalg.norm(metres, axis=1))
    errors = np.concatenate(found)
    late = [name for name in archive.ids if name not in {track.id for track in tracks}]
    size = (folder / "day.gpsz").stat().st_size
    print(
        f"{len(errors):,} positions in {size:,} B, RMSE {np.sqrt(np.mean(errors**2)):.2f} m, "
        f"largest error {np.nanmax(errors):.2f} m, {np.isnan(errors).sum():,} missing, "
        f"further tracks {late}, bound {archive.error_bound}"
    )
    lines = (folder / "events.ndjson").read_text().splitlines()
    ids = {json.loads(line)["id"] for line in lines}
    print(f"{len(lines):,} events, {len(ids):,} ids")


if __name__ == "__main__":
    main()
