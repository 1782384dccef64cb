"""Help, version, info and usage errors answer without the compiler and other heavy imports."""

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
        (["info", "two.gpsz"], 0),
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
