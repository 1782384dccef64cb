"""Commands on small archives, help and usage errors answer without compiler and heavy imports.

What one command imports stays imported, so one process runs many and names the first that fails.
"""

import subprocess
import sys

HEAVY = ("numba", "scipy", "pyarrow", "matplotlib", "rich")

#: Commands that import nothing heavy, and their exit codes.
LIGHT = [
    ([], 2),
    (["compress"], 2),
    (["--help"], 0),
    (["--version"], 0),
    (["compress", "--help"], 0),
    (["plot", "--help"], 0),
    (["info", "two.gpsz"], 0),
    (["verify", "two.gpsz"], 0),
]

#: Commands that need no compiler.
UNCOMPILED = [
    ["formats"],
    ["decompress", "two.gpsz", "-o", "-"],
    ["decompress", "two.gpsz", "-o", "two.geojson"],
    ["decompress", "two.gpsz", "--every", "1", "-o", "-"],
    ["map", "two.gpsz", "--raw", "-o", "-"],
]


def run(script, folder):
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{script}"],
        capture_output=True,
        cwd=folder,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_fast_answers_import_nothing_heavy(archive):
    script = f"""
from gpszip.cli.main import main
for words, code in {LIGHT!r}:
    assert main(words) == code, words
    heavy = [name for name in {HEAVY!r} if name in sys.modules]
    assert not heavy, (words, heavy)
"""
    run(script, archive.parent)


def test_small_archives_are_written_and_formats_listed_without_the_compiler(archive):
    script = f"""
from gpszip.cli.main import main
for words in {UNCOMPILED!r}:
    assert main(words) == 0, words
    assert "numba" not in sys.modules, words
"""
    assert b"geojson" in run(script, archive.parent)


def test_small_archives_answer_in_python_without_the_compiler(archive):
    script = """
import gpszip
archive = gpszip.open("two.gpsz")
assert len(archive.road_map.edges)
track = archive.ids[0]
start = archive[track].start
assert archive.position(track, start).min() > -1e9
archive.sample(1.0)
assert "numba" not in sys.modules
"""
    run(script, archive.parent)
