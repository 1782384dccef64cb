"""Kernels under versions of numba that lack what the project changes in it."""

import os
import subprocess
import sys

import numpy as np
import pytest

from gpszip.kernels.private_names import has_names

#: Kernels of all kinds.
MODULE = """
import numpy as np
from gpszip.kernels.jit import inner, inner_uncounted, jit, jit_uncounted

@inner_uncounted
def add_square(values, i, x):
    values[i] += x * x

@inner
def square_all(values):
    out = np.zeros(len(values))
    for i in range(len(values)):
        add_square(out, i, values[i])
    return out

@jit
def sum_squares(values):
    return square_all(values).sum()

@jit_uncounted
def set_square(values, i):
    x, values[i] = values[i], 0
    add_square(values, i, x)
"""

#: Change numba, call the kernels, and print what they return and how many are compiled.
RUN = """
import numba, numpy as np
{change}
from gpszip.kernels import jit
from gpszip.kernels.compiling import on_compile
from fresh.kernels import set_square, sum_squares
events, values = [], np.arange(4.0)
with on_compile(lambda: events.append(1)):
    set_square(values, 3)
    print(jit.LINKS, jit.CACHES, sum_squares(values), len(events) > 0)
"""

#: A class that a module of numba no longer has.
NO_LIBRARY = "import numba.core.codegen\ndel numba.core.codegen.JITCodeLibrary"

#: Names that no class has any more.
NO_NAMES = """
from gpszip.kernels import private_names
private_names.has_names = lambda *_: False
"""


class Base:
    def __init__(self):
        self.inherited = 1

    def method(self):
        return self.inherited


class Derived(Base):
    def __init__(self):
        super().__init__()
        self.own = 2


def test_names_are_methods_and_what_init_sets():
    assert has_names(Derived, "own", "inherited", "method")
    assert has_names(Derived)
    assert not has_names(Derived, "own", "missing")
    assert not has_names(Base, "own")
    assert has_names(np.ndarray, "shape")


@pytest.mark.parametrize(
    ("change", "links", "caches"),
    [("", True, True), (NO_LIBRARY, False, True), (NO_NAMES, False, False)],
    ids=["this numba", "no library", "no names"],
)
def test_kernels_are_compiled_by_any_numba(tmp_path, change, links, caches):
    (tmp_path / "fresh").mkdir()
    (tmp_path / "fresh/kernels.py").write_text(MODULE)
    (tmp_path / "fresh/__init__.py").touch()

    def run():
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", RUN.format(change=change)],
            cwd=tmp_path,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]),
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
            },
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    # 0 + 1 + 4 + 9^2, since the last number is squared before; a cache spares the second run.
    assert run() == [str(links), str(caches), "86.0", "True"]
    assert run() == [str(links), str(caches), "86.0", str(not caches)]
