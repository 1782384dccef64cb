"""Formats of other packages, installed as pip does it, as a user of the command meets them."""

import importlib
import os
import subprocess
import sys
import textwrap

import pytest

from gpszip.io.plugins import forget_plugins

GROUPS = {"logs": "formats", "networks": "network_formats", "maps": "map_formats"}

LOGS = """
import numpy as np
from gpszip.io.logs.log_format import LogFormat
from gpszip.io.logs.raw import RawLog

def sniff(head):
    return head.startswith(b"TOY")

def read(source, request):
    rows = np.array([line.split() for line in source.read().splitlines()[1:]], float)
    return RawLog(source.name, (), None, rows[:, 0], rows[:, 1:], geographic=False)

FORMAT = LogFormat(name="toy", suffixes=(".toy",), description="toys", sniff=sniff, read=read)
"""

NETWORKS = """
import numpy as np
import pyarrow as pa
from gpszip.io.networks.formats import NetworkFormat
from gpszip.io.networks.lines import RoadLines

def sniff(head, name):
    return head.startswith(b"TOY")

def read(source, metric):
    rows = np.loadtxt(source.read().decode().splitlines()[1:], ndmin=2)
    count = len(rows)
    both = np.ones(count, bool)
    return RoadLines(
        source.name, rows.reshape(-1, 2), 2 * np.arange(count + 1), False, both, both,
        np.full(count, np.nan), np.zeros(count, np.uint8),
        pa.array(map(str, range(count)), pa.string()), pa.nulls(count, pa.string()),
    )

FORMAT = NetworkFormat("Toy", (".toy",), sniff, read)
"""

MAPS = """
from gpszip.io.maps.write import MapFormat

def write(table, path):
    path.write_text(f"{len(table.offsets) - 1} edges")

def write_with_nodes(table, path):
    path.write_text(f"{len(table.node_positions)} nodes")

FORMAT = MapFormat("toy", (".toy",), write, write_with_nodes)
"""

SOURCES = {"logs": LOGS, "networks": NETWORKS, "maps": MAPS}

#: A command that needs the format of each table; it writes ``out``.
COMMANDS = {
    "logs": ("compress", "walk.toy", "-o", "out", "--rmse", "1m", "--effort", "1"),
    "networks": ("network", "roads.toy", "-o", "out"),
    "maps": ("map", "two.gpsz", "-o", "out", "--format", "toy"),
}

TABLES = pytest.mark.parametrize("table", ["logs", "networks", "maps"])


@pytest.fixture
def folder(archive):
    """A folder with a log, a network and an archive."""
    steps = "".join(f"{t} {t % 7} {t}\n" for t in range(50))
    (archive.parent / "walk.toy").write_text("TOY\n" + steps)
    (archive.parent / "roads.toy").write_text("TOY\n0 0 30 40\n30 40 30 50\n")
    return archive.parent


@pytest.fixture
def install(folder):
    """Write a package ``toys`` with formats for some tables, each in a module of its own."""

    def call(**sources):
        metadata = folder / "toys-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
        entries = ""
        for table, source in sources.items():
            (folder / f"toy_{table}.py").write_text(source)
            entries += f"[gpszip.{GROUPS[table]}]\ntoy = toy_{table}:FORMAT\n"
        (metadata / "entry_points.txt").write_text(entries)

    return call


@pytest.fixture
def run(folder):
    """Run the command in another process, with the package installed."""

    def call(*words):
        path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
        return subprocess.run(
            [sys.executable, "-m", "gpszip", *words],
            capture_output=True,
            text=True,
            cwd=folder,
            check=False,
            env={**os.environ, "PYTHONPATH": path},
        )

    return call


@pytest.fixture
def run_here(folder, gpszip, monkeypatch):
    """Run the command in this process, with the package installed until the test ends."""
    monkeypatch.syspath_prepend(folder)
    forget_plugins()

    def run(*words):
        # Python sees a package that was installed within a tick of the clock only if told so.
        importlib.invalidate_caches()
        return gpszip("", *words)

    yield run
    forget_plugins()
    for table in GROUPS:
        sys.modules.pop(f"toy_{table}", None)


def failing(table, body):
    """The package of a table whose functions run ``body`` instead of reading or writing."""
    head, name = SOURCES[table], "write" if table == "maps" else "read"
    return head + textwrap.dedent(f"""
        from dataclasses import replace

        def fail(*arguments):
            {body}

        FORMAT = replace(FORMAT, {name}=fail)
    """)


@TABLES
def test_a_format_of_another_package_is_used(install, run, folder, table):
    install(**{table: SOURCES[table]})
    done = run(*COMMANDS[table])
    assert done.returncode == 0, done.stderr
    assert (folder / "out").stat().st_size > 0


@TABLES
@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("import no_such_module\n", "can't be loaded: ModuleNotFoundError"),
        ("raise SystemExit(3)\n", "can't be loaded: SystemExit: 3"),
        ("FORMAT = 7\n", "is a int, not a "),
    ],
)
def test_a_package_that_cannot_be_loaded_is_named_in_one_line(
    install, run_here, folder, table, source, says
):
    install(**{table: source})
    done = run_here(*COMMANDS[table])
    assert done.code == 1
    (line,) = done.err.splitlines()
    assert f"plugin 'toy' of toys: {says}" in line
    assert "update or uninstall this package" in line
    assert not (folder / "out").exists()


@TABLES
@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("return {}['lost']", "failed: KeyError: 'lost'; report it to the authors"),
        ("raise SystemExit(3)", "failed: SystemExit: 3; report it to the authors"),
        ("raise MemoryError", "not enough memory; give less at once"),
    ],
)
def test_what_a_package_does_wrong_is_an_error_in_one_line(
    install, run_here, folder, table, body, says
):
    install(**{table: failing(table, body)})
    done = run_here(*COMMANDS[table])
    assert done.code == 1
    (line,) = done.err.splitlines()
    assert says in line
    assert ("plugin 'toy' of toys" in line) == ("authors" in says)
    assert ("or --memory" in line) == ("memory" in says and table == "logs")
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("table", "what", "file"),
    [("logs", "RawLog", "walk.toy"), ("networks", "RoadLines", "roads.toy")],
)
def test_a_package_that_returns_something_else_is_named_with_the_file(
    install, run_here, table, what, file
):
    install(**{table: failing(table, "return 'nothing'")})
    (line,) = run_here(*COMMANDS[table]).err.splitlines()
    assert f"{file}: plugin 'toy' of toys failed: TypeError: a {what} is expected, not str" in line


@pytest.mark.parametrize("table", ["logs", "networks"])
def test_a_package_that_fails_to_recognise_a_file_is_named(install, run_here, table):
    install(**{table: SOURCES[table].replace("head.startswith", "head.no_such_name")})
    (line,) = run_here(*COMMANDS[table]).err.splitlines()
    assert "plugin 'toy' of toys failed: AttributeError" in line


def test_other_packages_are_listed_and_imported_only_where_their_formats_matter(install, run):
    install(**{table: f"print('imported')\n{source}" for table, source in SOURCES.items()})
    listed = run("formats").stdout
    assert listed.count("imported") == listed.count(".toy") == 3
    for words in (("--help",), ("info", "two.gpsz"), ("map", "two.gpsz", "-o", "map.geojson")):
        assert "imported" not in run(*words).stdout


def test_a_format_of_gpszip_is_written_whatever_other_packages_do(install, run_here, folder):
    install(maps="import no_such_module\n")
    for words in (("-o", "map.geojson"), ("-o", "map", "--format", "csv")):
        done = run_here("map", "two.gpsz", *words)
        assert done.code == 0, done.err
    assert (folder / "map.geojson").exists()
    assert "see 'gpszip formats'" in run_here("map", "--help").out
