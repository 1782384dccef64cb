"""Closed and full standard streams, few file descriptors, and decoding without a compiler."""

import contextlib
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from cli.conftest import two_walks
from gpszip.cli.main import main
from gpszip.io.logs.read import read_logs

ALL = os.environ.get("GPSZIP_FAULTS") == "all"
RUN = [sys.executable, "-c", "from gpszip.cli.main import run; run()"]

posix = pytest.mark.skipif(os.name != "posix", reason="shells of POSIX")


@pytest.fixture
def archive(tmp_path):
    two_walks().save(tmp_path / "two.gpsz")
    return tmp_path / "two.gpsz"


def _shell(words, redirection, folder):
    """Run a command with its streams redirected; return its exit code and its message."""
    line = f'exec "$@" {redirection}'
    done = subprocess.run(
        ["sh", "-c", line, "sh", *RUN, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stderr


@posix
@pytest.mark.parametrize(
    ("words", "redirection", "says"),
    [
        (
            ["info", "two.gpsz"],
            ">&-",
            "standard output: can't be written: Bad file descriptor; it is closed",
        ),
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
    assert _shell(["recover", "two.gpsz", "-o", "out.gpsz"], "<&- >&- 2>&-", archive.parent) == (
        0,
        "",
    )
    assert (archive.parent / "out.gpsz").read_bytes() == archive.read_bytes()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_json_holds_file_names_that_are_not_utf8(tmp_path):
    import json

    name = os.fsdecode(b"caf\xe9.gpsz")
    two_walks().save(tmp_path / name)
    done = subprocess.run(
        [*RUN, "info", name, "--json"],
        cwd=tmp_path,
        capture_output=True,
        check=True,
        env={**os.environ, "LC_ALL": "C"},
    )
    assert json.loads(done.stdout.decode("utf-8"))["archive"] == name


def test_more_logs_than_descriptors(tmp_path):
    resource = pytest.importorskip("resource")
    for number in range(300):
        (tmp_path / f"{number}.csv").write_text("t,x,y\n0,0,0\n1,1,0\n")
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, limits[1]))
    try:
        read_result = read_logs(sorted(tmp_path.iterdir()))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert len(read_result.tracks) == 300


@pytest.fixture(scope="module")
def compressed(tmp_path_factory):
    """An archive that compiled code wrote, and what compiled code decodes it to."""
    folder, chance = tmp_path_factory.mktemp("log"), random.Random(5)
    corners = [(0, 0), (40, 0), (40, 30), (0, 30)] * 3
    sides = [(t, i) for i in range(len(corners) - 1) for t in range(25)]
    rows = [
        [
            a + (b - a) * t / 25 + chance.gauss(0, 0.1)
            for a, b in zip(corners[i], corners[i + 1], strict=True)
        ]
        for t, i in sides
    ]
    (folder / "log.csv").write_text(
        "t,x,y\n" + "".join(f"{t},{x:.3f},{y:.3f}\n" for t, (x, y) in enumerate(rows))
    )
    with contextlib.chdir(folder):
        assert main([*COMPRESS, "log.gpsz"]) == 0
        for number, words in enumerate(DECODE):
            assert main([*words[:-1], f"{number}.csv"]) == 0
    return folder, [(folder / f"{number}.csv").read_bytes() for number in range(len(DECODE))]


COMPRESS = [
    "compress",
    "log.csv",
    "--rmse",
    "30cm",
    "--keep-times",
    "--quiet",
    "--effort",
    "1",
    "-o",
]
DECODE = [["decompress", "log.gpsz", "-o", "-"], ["decompress", "log.gpsz", "--samples", "-o", "-"]]


def test_archives_decode_to_the_same_numbers_without_a_compiler(compressed):
    folder, expected = compressed
    assert [_output(folder, words, {"NUMBA_DISABLE_JIT": "1"}) for words in DECODE] == expected
    assert min(map(len, expected)) > 100


@pytest.mark.skipif(not ALL, reason="takes a minute; GPSZIP_FAULTS=all")
def test_archives_decode_to_the_same_numbers_on_any_processor(compressed):
    folder, expected = compressed
    assert [_output(folder, words, {"NUMBA_CPU_NAME": "generic"}) for words in DECODE] == expected


@pytest.mark.skipif(not ALL, reason="takes minutes; GPSZIP_FAULTS=all")
@pytest.mark.parametrize(
    "how",
    [{"NUMBA_DISABLE_JIT": "1"}, {"NUMBA_CPU_NAME": "generic"}],
    ids=["not compiled", "any processor"],
)
def test_archives_are_the_same_with_any_compiler(compressed, how):
    folder, _ = compressed
    _output(folder, [*COMPRESS, "again.gpsz", "--force"], how)
    assert (folder / "again.gpsz").read_bytes() == (folder / "log.gpsz").read_bytes()


def _output(folder: Path, words, how):
    return subprocess.run(
        [*RUN, *words], cwd=folder, capture_output=True, check=True, env={**os.environ, **how}
    ).stdout
