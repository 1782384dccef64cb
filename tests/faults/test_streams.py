"""Standard streams that are closed or full, few descriptors, and the same numbers whatever compiles them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cli.conftest import two_walks
from gpszip.io.reading import read_logs
from gpszip.testing import patrol

ALL = os.environ.get("GPSZIP_FAULTS") == "all"
RUN = [sys.executable, "-c", "from gpszip.cli.main import run; run()"]

posix = pytest.mark.skipif(os.name != "posix", reason="shells of POSIX")


@pytest.fixture
def archive(tmp_path):
    two_walks().save(tmp_path / "two.gpsz")
    return tmp_path / "two.gpsz"


def _shell(words, redirection, folder):
    """Run a command with its streams redirected; return its exit code and what it says."""
    line = f'exec "$@" {redirection}'
    done = subprocess.run(["sh", "-c", line, "sh", *RUN, *words], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@posix
@pytest.mark.parametrize(
    ("words", "redirection", "says"),
    [
        (["info", "two.gpsz"], ">&-", "standard output: can't be written: Bad file descriptor; it is closed"),
        (["info", "-"], "<&-", "standard input: can't be read: Bad file descriptor"),
        (["--version"], ">/dev/full", "standard output: can't be written: No space left on device"),
        (["info", "none.gpsz"], "2>&-", ""),
    ],
)
def test_closed_and_full_streams(archive, words, redirection, says):
    code, told = _shell(words, redirection, archive.parent)
    assert code == 1
    assert says in told
    assert len(told.splitlines()) <= 1


@posix
def test_all_streams_may_be_closed(archive):
    """No file is opened under the number of a closed stream, where others would write to it."""
    assert _shell(["recover", "two.gpsz", "-o", "out.gpsz"], "<&- >&- 2>&-", archive.parent) == (0, "")
    assert (archive.parent / "out.gpsz").read_bytes() == archive.read_bytes()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_json_holds_names_that_are_no_text(tmp_path):
    import json

    name = os.fsdecode(b"caf\xe9.gpsz")
    two_walks().save(tmp_path / name)
    done = subprocess.run([*RUN, "info", name, "--json"], cwd=tmp_path, capture_output=True, check=True, env={**os.environ, "LC_ALL": "C"})
    assert json.loads(done.stdout.decode("utf-8"))["archive"] == name


def test_more_logs_than_descriptors(tmp_path):
    resource = pytest.importorskip("resource")
    for number in range(300):
        (tmp_path / f"{number}.csv").write_text("t,x,y\n0,0,0\n1,1,0\n")
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, limits[1]))
    try:
        reading = read_logs(sorted(tmp_path.iterdir()))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert len(reading.tracks) == 300


@pytest.mark.skipif(not ALL, reason="takes minutes; GPSZIP_FAULTS=all")
@pytest.mark.parametrize("how", [{"NUMBA_DISABLE_JIT": "1"}, {"NUMBA_CPU_NAME": "generic"}], ids=["not compiled", "any processor"])
def test_archives_decode_to_the_same_numbers_everywhere(tmp_path, how):
    track = patrol(400, seed=1)
    rows = zip(track.times.tolist(), *track.positions.T.tolist(), strict=True)
    (tmp_path / "log.csv").write_text("t,x,y\n" + "".join(f"{t!r},{x!r},{y!r}\n" for t, x, y in rows))
    _decoded(tmp_path, ["compress", "log.csv", "-o", "log.gpsz", "--rmse", "30cm", "--keep-times", "--quiet", "--effort", "1"], {})
    for words in (
        ["decompress", "log.gpsz", "-o", "-"],
        ["decompress", "log.gpsz", "-o", "-", "--samples"],
        ["map", "log.gpsz", "-o", "-"],
    ):
        assert _decoded(tmp_path, words, how) == _decoded(tmp_path, words, {}) != b""


@pytest.mark.skipif(not ALL, reason="takes minutes; GPSZIP_FAULTS=all")
def test_archives_written_without_a_compiler_are_the_same(tmp_path):
    (tmp_path / "log.csv").write_text("t,x,y\n" + "".join(f"{t},{min(t, 30)},{max(t - 30, 0)}\n" for t in range(60)))
    words = ["compress", "log.csv", "-o", "-", "--max-error", "1m", "--effort", "1"]
    assert _decoded(tmp_path, words, {"NUMBA_DISABLE_JIT": "1"}) == _decoded(tmp_path, words, {}) != b""


def _decoded(folder: Path, words, how):
    return subprocess.run([*RUN, *words], cwd=folder, capture_output=True, check=True, env={**os.environ, **how}).stdout
