"""Commands on small archives, help and usage errors answer without compiler and heavy imports."""

import subprocess
import sys

import pytest

HEAVY = ("numba", "scipy", "pyarrow", "matplotlib", "rich")


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["compress", "--help"], 0),
        (["plot", "--help"], 0),
        (["info", "two.gpsz"], 0),
        (["verify", "two.gpsz"], 0),
        (["compress"], 2),
        ([], 2),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_fast_answers_import_nothing_heavy(archive, arguments, code):
    script = (
        "import sys\nfrom gpszip.cli.main import main\n"
        f"code = main({arguments!r})\n"
        f"print('heavy:', [name for name in {HEAVY!r} if name in sys.modules], code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        cwd=archive.parent,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == f"heavy: [] {code}"


def test_formats_needs_no_compiler(archive):
    script = (
        "import sys\nfrom gpszip.cli.main import main\n"
        "main(['formats'])\nassert 'numba' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        cwd=archive.parent,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "geojson" in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["decompress", "two.gpsz", "-o", "-"],
        ["decompress", "two.gpsz", "-o", "two.geojson"],
        ["decompress", "two.gpsz", "--every", "1", "-o", "-"],
        ["map", "two.gpsz", "--raw", "-o", "-"],
    ],
    ids=" ".join,
)
def test_small_archives_are_written_without_the_compiler(archive, arguments):
    assert_needs_no_compiler(
        f"from gpszip.cli.main import main\nassert main({arguments!r}) == 0", archive.parent
    )


def test_small_archives_answer_in_python_without_the_compiler(archive):
    assert_needs_no_compiler(
        "import gpszip\narchive = gpszip.open('two.gpsz')\n"
        "assert len(archive.road_map.edges)\n"
        "track = archive.ids[0]\nstart = archive[track].start\n"
        "assert archive.position(track, start).min() > -1e9\n"
        "archive.sample(1.0)",
        archive.parent,
    )


def assert_needs_no_compiler(script, folder):
    done = subprocess.run(
        [sys.executable, "-c", f"{script}\nimport sys\nassert 'numba' not in sys.modules"],
        capture_output=True,
        cwd=folder,
        check=False,
    )
    assert done.returncode == 0, done.stderr
