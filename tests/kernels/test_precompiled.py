import os
import subprocess
import sys

import pytest

from gpszip.kernels import precompiled
from gpszip.kernels.source_stamp import source_stamp

#: A module with a kernel that calls another one.
MODULE = """
from gpszip.kernels.jit import inner, jit

@inner
def square(x):
    return x * x

@jit
def add_squares(values):
    total = 0
    for x in values:
        total += square(x)
    return total
"""

#: Run the kernel, and print its result and how many kernels are compiled; write those if asked.
RUN = """
import sys
from pathlib import Path
import numpy as np
from gpszip.kernels import precompiled
from gpszip.kernels.compiling import on_compile
from fresh.kernels import add_squares
precompiled.FOLDER = Path("compiled")
if len(sys.argv) > 2:
    precompiled._environment = lambda: sys.argv[2:]
events = []
with on_compile(lambda: events.append(1)):
    result = add_squares(np.arange(4))
if sys.argv[1] == "write":
    print(precompiled.write_precompiled(Path("compiled")), end=" ")
print(result, len(events))
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / "fresh").mkdir()
    (tmp_path / "fresh/kernels.py").write_text(MODULE)
    (tmp_path / "fresh/__init__.py").touch()

    def run(cache, action, *words, **environment):
        """Run the kernel with an empty or used cache, and return the numbers printed."""
        search = os.pathsep.join([str(tmp_path), *sys.path])
        done = subprocess.run(
            [sys.executable, "-c", RUN, action, *words],
            cwd=tmp_path,
            env={
                **os.environ,
                "PYTHONPATH": search,
                "NUMBA_CACHE_DIR": str(tmp_path / cache),
                **environment,
            },
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return [int(word) for word in done.stdout.split()]

    return run


def test_a_kernel_compiled_for_any_processor_is_not_compiled_again(run, tmp_path):
    written, result, compiled = run("cache1", "write", NUMBA_CPU_NAME="generic")
    assert (written, result) == (1, 14)
    assert compiled >= 2
    assert run("cache2", "read") == [14, 0]

    # other sources, at another line
    source = tmp_path / "fresh/kernels.py"
    source.write_text("# changed" + source.read_text().replace("x * x", "x * x + 1"))
    assert run("cache2", "read") == [14 + 4, compiled]


def test_a_kernel_compiled_by_other_versions_is_compiled_again(run):
    _, _, compiled = run("cache1", "write", NUMBA_CPU_NAME="generic")
    assert run("cache2", "read", "cpython-399", "0.1", "x86_64-unknown") == [14, compiled]


def test_the_platform_has_no_version():
    python, llvmlite, platform = precompiled._environment()
    assert python == sys.implementation.cache_tag
    assert llvmlite[0].isdigit()
    assert platform
    assert not platform[-1].isdigit()


def test_the_stamp_of_a_kernel_covers_the_kernels_that_it_calls(tmp_path):
    from gpszip.codec.kernels.walk_coder import code_walks

    stamp, *environment = code_walks._cache.precompiled(tmp_path)._source_stamp
    assert stamp == source_stamp("gpszip.codec.kernels.walk_coder")
    assert environment == list(precompiled._environment())
