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

#: A kernel that calls functions of the C library and of numba: logarithms and powers, sorting,
#: errors, and arrays that count references.
HELPERS_MODULE = """
import math
import numpy as np
from gpszip.kernels.jit import jit

@jit
def call_helpers(x):
    if len(x) == 0:
        raise ValueError("empty")
    total = math.log2(x[0]) + math.hypot(x[0], x[1]) + math.erf(x[1]) + math.gamma(x[0])
    for i in np.argsort(x):
        total += math.sin(x[i]) * math.exp(x[i]) + math.atan2(x[i], total) + x[i] ** 1.5
    return total
"""

#: Call it in a process of its own; print its result, how many kernels are compiled, and whether all
#: that the compiler knows is imported.
CALL_HELPERS = """
import sys
import numpy as np
from gpszip.kernels.compiling import on_compile
from fresh.helpers import call_helpers
events = []
with on_compile(lambda: events.append(1)):
    result = call_helpers(np.array([1.5, 0.25, 3.0]))
print(result.hex(), len(events), "numba.np.linalg" in sys.modules)
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
def start(tmp_path):
    (tmp_path / "fresh").mkdir()
    (tmp_path / "fresh/__init__.py").touch()
    (tmp_path / "fresh/kernels.py").write_text(MODULE)
    (tmp_path / "fresh/helpers.py").write_text(HELPERS_MODULE)

    def start(script, cache, *words, **environment):
        """Run a script with an empty or used cache, and return the words printed."""
        search = os.pathsep.join([str(tmp_path), *sys.path])
        done = subprocess.run(
            [sys.executable, "-c", script, *words],
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
        return done.stdout.split()

    return start


@pytest.fixture
def run(start):
    def run(cache, action, *words, **environment):
        """Run the kernel with an empty or used cache, and return the numbers printed."""
        return [int(word) for word in start(RUN, cache, action, *words, **environment)]

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


def test_a_cached_kernel_finds_numbas_functions_without_the_compiler(start):
    result, compiled, is_imported = start(CALL_HELPERS, "cache")
    assert int(compiled) > 0
    assert is_imported == "True"
    assert start(CALL_HELPERS, "cache") == [result, "0", "False"]


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
