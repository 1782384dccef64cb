"""Commands that are run under faults, their inputs, and whether their outputs are old or new."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpszip.cli.main import main

__all__ = ["COMMANDS", "prepare"]


@dataclass(frozen=True)
class Command:
    """A command line, its inputs and its outputs.

    It runs in a folder with the inputs and with the outputs of an earlier run, which differ from
    those of this run.
    """

    arguments: list[str]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def files(self) -> tuple[str, ...]:
        """All files that may exist afterwards."""
        return (
            *self.inputs,
            *self.outputs,
            *(f"old-{name}" for name in self.outputs),
            *(f"new-{name}" for name in self.outputs),
        )

    def state(self, folder: Path) -> str:
        """``old`` or ``new`` if all outputs are, ``mixed`` if some are, ``torn`` otherwise."""
        states = {_state(folder, name) for name in self.outputs}
        return (
            states.pop() if len(states) == 1 else ("mixed" if states == {"old", "new"} else "torn")
        )


def _state(folder: Path, name: str) -> str:
    kinds = [kind for kind in ("old", "new") if _same(folder / name, folder / f"{kind}-{name}")]
    return kinds[0] if kinds else "torn"


def _same(one: Path, other: Path) -> bool:
    if not one.exists() or not other.exists():
        return one.exists() == other.exists()
    if one.suffix == ".gpkg" and one.read_bytes()[:6] == b"SQLite":
        return other.read_bytes()[:6] == b"SQLite" and _features(one) == _features(
            other
        )  # with the time of day in it
    return one.read_bytes() == other.read_bytes()


def _features(path: Path) -> list[bytes] | None:
    import pyogrio

    try:
        return pyogrio.raw.read(path)[2].tolist()
    except Exception:  # any error: the file is incomplete
        return None


_TINY = ("two.gpsz",)
_LOGS = ("a.csv", "b.csv")

COMMANDS = {
    "compress": Command(
        ["compress", "a.csv", "-o", "out.gpsz", "--rmse", "1m", "--force", "--effort", "1"],
        _LOGS,
        ("out.gpsz",),
    ),
    "append": Command(
        ["compress", "b.csv", "-o", "out.gpsz", "--append", "--effort", "1"], _LOGS, ("out.gpsz",)
    ),
    "memory": Command(
        [
            "compress",
            "a.csv",
            "-o",
            "out.gpsz",
            "--rmse",
            "1m",
            "--memory",
            "420MB",
            "--keep-times",
            "--force",
            "--effort",
            "1",
        ],
        _LOGS,
        ("out.gpsz",),
    ),
    "map": Command(
        [
            "compress",
            "b.csv",
            "-o",
            "out.gpsz",
            "--map",
            "city.gpsz",
            "--update-map",
            "map.gpsz",
            "--force",
            "--effort",
            "1",
        ],
        (*_LOGS, "city.gpsz"),
        ("out.gpsz", "map.gpsz"),
    ),
    "merge": Command(
        ["merge", "city.gpsz", "other.gpsz", "-o", "out.gpsz", "--force"],
        ("city.gpsz", "other.gpsz"),
        ("out.gpsz",),
    ),
    "recover": Command(["recover", "two.gpsz", "-o", "out.gpsz", "--force"], _TINY, ("out.gpsz",)),
    "network": Command(
        ["network", "city.gpsz", "-o", "out.gpsz", "--metres", "--force"],
        ("city.gpsz",),
        ("out.gpsz",),
    ),
    "csv": Command(["decompress", "two.gpsz", "-o", "out.csv", "--force"], _TINY, ("out.csv",)),
    "parquet": Command(
        ["decompress", "two.gpsz", "-o", "out.parquet", "--force"], _TINY, ("out.parquet",)
    ),
    "geojson": Command(
        ["map", "two.gpsz", "-o", "out.geojson", "--force"], _TINY, ("out.geojson",)
    ),
    "gpkg": Command(["map", "two.gpsz", "-o", "out.gpkg", "--force"], _TINY, ("out.gpkg",)),
    "segments": Command(
        ["segments", "a.csv", "-o", "out.json", "--k", "4", "--m", "2", "--force"],
        _LOGS,
        ("out.json",),
    ),
    "coreset": Command(
        ["coreset", "a.csv", "-o", "out.parquet", "--size", "9", "--force"], _LOGS, ("out.parquet",)
    ),
    "match": Command(
        ["match", "a.csv", "--network", "roads.gpsz", "-o", "out.csv", "--force"],
        ("a.csv", "roads.gpsz"),
        ("out.csv",),
    ),
}


def prepare(folder: Path, name: str) -> None:
    """Fill a folder with the inputs of a command, and with its old and new outputs."""
    command = COMMANDS[name]
    folder.mkdir()
    for one in command.inputs:
        _MAKERS[one](folder / one)
    for one in command.outputs:
        if name == "append":
            _archive(folder / one)
        else:
            (folder / one).write_bytes(b"old")
        shutil.copy(folder / one, folder / f"old-{one}")
    _run(folder, command.arguments)
    for one in command.outputs:
        (folder / one).replace(folder / f"new-{one}")
        shutil.copy(folder / f"old-{one}", folder / one)
    if command.state(folder) != "old":
        raise SystemExit(f"{name}: the new output is the old one")


def _run(folder: Path, arguments: list[str]) -> None:
    before = Path.cwd()
    os.chdir(folder)
    try:
        code = main(
            [*arguments, "--quiet"]
            if arguments[0] in ("compress", "merge", "coreset", "network")
            else arguments
        )
    finally:
        os.chdir(before)
    if code:
        raise SystemExit(f"{arguments}: exit code {code}")


def _laps(begin: float) -> str:
    """A log of 120 points on a square that is driven twice."""
    corners = np.array([[0, 0], [40, 0], [40, 30], [0, 30], [0, 0]], float)
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    distances = np.linspace(0, 2 * along[-1], 120) % along[-1]
    xs, ys = (np.interp(distances, along, axis) for axis in corners.T)
    rows = [f"a,{begin + t},{x:.3f},{y:.3f}" for t, (x, y) in enumerate(zip(xs, ys, strict=True))]
    return "\n".join(["track_id,t,x,y", *rows]) + "\n"


def _archive(path: Path) -> None:
    _log(path.with_suffix(".first.csv"), 0)
    _run(
        path.parent,
        [
            "compress",
            path.with_suffix(".first.csv").name,
            "-o",
            path.name,
            "--rmse",
            "1m",
            "--effort",
            "1",
            "--force",
        ],
    )
    path.with_suffix(".first.csv").unlink()


def _log(path: Path, begin: float) -> None:
    path.write_text(_laps(begin))


def _two(path: Path) -> None:
    from cli.conftest import two_walks

    two_walks().save(path)


def _other(path: Path) -> None:
    log = path.with_suffix(".csv")
    log.write_text(_laps(1000).replace("\na,", "\nb,"))
    _run(path.parent, ["compress", log.name, "-o", path.name, "--rmse", "1m", "--effort", "1"])
    log.unlink()


def _roads(path: Path) -> None:
    _archive(path.parent / "base.gpsz")
    _run(path.parent, ["network", "base.gpsz", "-o", path.name, "--metres"])
    (path.parent / "base.gpsz").unlink()


_MAKERS = {
    "a.csv": lambda path: _log(path, 0),
    "b.csv": lambda path: _log(path, 500),
    "two.gpsz": _two,
    "city.gpsz": _archive,
    "other.gpsz": _other,
    "roads.gpsz": _roads,
}
