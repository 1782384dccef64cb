"""The commands and the code of the documentation's introductions work, from top to bottom."""

import re
import shlex
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from sybil import Sybil
from sybil.document import Document
from sybil.parsers.markdown import PythonCodeBlockParser
from sybil.region import Region

import gpszip
from gpszip.cli.main import main
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.write import write_tracks

DOCS = Path(__file__).parents[1] / "docs"
PAGES = [
    "tutorial.md",
    "robots.md",
    "fleets.md",
    "phones.md",
    "lossless.md",
    "notebooks.md",
    "qgis.md",
]

#: A command in an indented block.
COMMAND = re.compile(r"^ {4}(gpszip .*?)(?: {2,}#.*)?$", re.MULTILINE)

START = datetime(2024, 5, 1, 10, tzinfo=UTC).timestamp()


def parse_commands(document: Document):
    """Yield the commands of a page."""
    for match in COMMAND.finditer(document.text):
        yield Region(match.start(), match.end(), match.group(1), run_command)


def run_command(example):
    """Run a command as a shell would: patterns without quotes are expanded."""
    words = []
    for word in shlex.split(example.parsed, posix=False)[1:]:
        if word.startswith("'"):
            words.append(word.strip("'"))
        elif "*" in word:
            words += sorted(map(str, Path().glob(word)))
        else:
            words.append(word)
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


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The files that the pages name."""
    monkeypatch.chdir(tmp_path)
    for name in ("rides", "walks", "fleet"):
        Path(name).mkdir()
    for number in range(3):
        write_tracks([gps_lap(f"ride-{number}", number=number)], f"rides/{number}.gpx")
        write_tracks([gps_lap(f"cab-{number}", number=number)], f"fleet/{number}.parquet")
    shutil.copy("rides/0.gpx", "walks/walk.gpx")
    write_tracks([gps_lap("next", number=4)], "next.gpx")
    write_tracks([gps_lap("phone")], "history.csv")
    for number, name in enumerate(("patrol", "tomorrow")):
        log = gpszip.Track(*lap("robot", number=number, start=0.0))
        write_tracks([log], f"{name}.csv")
    table = Path("patrol.csv").read_text().splitlines()
    Path("odometry.csv").write_text("\n".join(["id,stamp,px,py", *table[1:]]))

    # Archives that pages of how-tos begin with.
    for number, name in enumerate(("monday", "tuesday", "fleet")):
        archive = gpszip.compress([gps_lap("cab", number=number)], rmse=5.0, effort=1)
        archive.save(f"{name}.gpsz")
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_the_blocks_of_the_page_run_from_top_to_bottom(folder, page, capsys):
    # The fleet's how-to makes the archive that others begin with.
    if page == "fleets.md":
        Path("fleet.gpsz").unlink()
    sybil = Sybil([parse_commands, PythonCodeBlockParser()])
    document = sybil.parse(DOCS / page)
    examples = list(document.examples())
    assert len(examples) >= 2
    for example in examples:
        example.evaluate()
