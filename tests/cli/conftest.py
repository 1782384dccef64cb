import io
import json
import subprocess
import sys
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from gpszip.archive import new_archive
from gpszip.cli.main import main
from gpszip.model import GridWalk, GridWalks, Plane, QuantisationGrid


@dataclass
class Run:
    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


def _words(arguments):
    if not arguments:
        return []
    return [*str(arguments[0]).split(), *map(str, arguments[1:])]


@pytest.fixture
def gpszip(capfd, tmp_path, monkeypatch):
    """Run the command line in a temporary folder, inside this process.

    ``gpszip("compress log.csv -o out.gpsz", "--keep", "a b")``: blanks separate the words of the
    first argument only. ``data`` are bytes of standard input.
    """
    monkeypatch.chdir(tmp_path)

    def call(*arguments, data=None):
        if data is not None:
            monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
        capfd.readouterr()
        code = main(_words(arguments))
        out, err = capfd.readouterr()
        return Run(code, out, err)

    return call


@pytest.fixture
def shell(tmp_path):
    """Run the command as a user does, in another process; arguments as for ``gpszip``."""

    def call(*arguments, data=None):
        command = [sys.executable, "-m", "gpszip", *_words(arguments)]
        return subprocess.run(
            command, input=data, capture_output=True, cwd=tmp_path, check=False, timeout=120
        )

    return call


def square_log():
    """Text of a log of 200 points on a square that is driven twice."""
    corners = np.array(
        [[0, 0], [40, 0], [40, 30], [0, 30], [0, 0], [40, 0], [40, 30], [0, 30], [0, 0]], float
    )
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    way = np.linspace(0, along[-1], 200)
    rows = [
        f"{t},{np.interp(s, along, corners[:, 0]):.3f},{np.interp(s, along, corners[:, 1]):.3f}"
        for t, s in enumerate(way)
    ]
    return "\n".join(["t,x,y", *rows]) + "\n"


@pytest.fixture
def log(tmp_path):
    """A log of 200 points on a square that is driven twice."""
    path = tmp_path / "walk.csv"
    path.write_text(square_log())
    return path


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Bytes of archives of the square, each made by one run of compress for all tests."""
    folder = tmp_path_factory.mktemp("made_once")
    (folder / "walk.csv").write_text(square_log())

    @cache
    def call(options):
        words = ["compress", str(folder / "walk.csv"), "-o", str(folder / "walk.gpsz"), "--force"]
        assert main([*words, "--quiet", *options.split()]) == 0
        return (folder / "walk.gpsz").read_bytes()

    return call


@pytest.fixture
def walk_archive(made_once, log, tmp_path):
    """An archive of the square beside its log."""
    path = tmp_path / "walk.gpsz"
    path.write_bytes(made_once("--rmse 1 --effort 1"))
    return path


@pytest.fixture
def lossless_archive(made_once, log, tmp_path):
    """An archive of the square that keeps its log exactly, beside the log."""
    path = tmp_path / "walk.gpsz"
    path.write_bytes(made_once("--lossless --effort 1"))
    return path


def two_walks(plane=None, timed=True):
    """An archive of two walks, the first with a gap."""
    first = GridWalk(
        np.array([0, 1, 2, 0, 1], np.int32),
        np.array([0, 10, 20, 90, 100]),
        np.array([False, False, True, False]),
    )
    second = GridWalk(np.array([0, 2], np.int32), np.array([5, 25]), np.array([False]))
    walks = GridWalks(np.array([[0, 0], [100, 0], [100, 50]]), (first, second), timed)
    return new_archive(QuantisationGrid((0, 0), 0, 128, 128, plane), ["a", "b c"], walks)


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "two.gpsz"
    two_walks().save(path)
    return path


@pytest.fixture
def earthly(tmp_path):
    path = tmp_path / "earth.gpsz"
    two_walks(Plane(((480_000_000, 110_000_000),))).save(path)
    return path


@pytest.fixture
def timeless(tmp_path):
    path = tmp_path / "timeless.gpsz"
    walk = GridWalk(np.array([0, 1, 0], np.int32), np.zeros(3, np.int64), np.array([False, False]))
    new_archive(
        QuantisationGrid((0, 0), 0, 128, 128),
        ["0"],
        GridWalks(np.array([[0, 0], [9, 0]]), (walk,), False),
    ).save(path)
    return path
