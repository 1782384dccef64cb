"""The direction of imports, as pyproject.toml draws it."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_imports_point_down_the_levels():
    code = (
        "import sys; from importlinter.cli import lint_imports_command; "
        "sys.exit(lint_imports_command())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_only_kernels_import_numba():
    sources = (ROOT / "src").rglob("*.py")
    users = [
        path
        for path in sources
        if "import numba" in path.read_text() or "from numba" in path.read_text()
    ]
    assert users
    assert {path.parent.name for path in users} == {"kernels"}


def test_heavy_libraries_of_one_purpose_are_imported_where_they_belong():
    homes = {
        "matplotlib": {"drawing", "view"},
        "pyogrio": {"io"},
        "pyproj": {"geo", "model"},
        "hypothesis": {"testing"},
        "click": {"cli"},
        "rich": {"cli"},
    }
    for path in (ROOT / "src").rglob("*.py"):
        words = {
            line.split()[1].split(".")[0]
            for line in path.read_text().splitlines()
            if line.strip().startswith(("import ", "from "))
        }
        for library, packages in homes.items():
            assert library not in words or packages & set(
                path.relative_to(ROOT / "src/gpszip").parts
            ), f"{path} imports {library}"
