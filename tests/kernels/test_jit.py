import ast
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import NullCache

import gpszip
from calling import from_python
from gpszip.codec.kernels.rotation import rotate
from gpszip.kernels.compiling import on_compile
from gpszip.kernels.jit import inner, inner_uncounted, jit, jit_uncounted

PACKAGE = Path(gpszip.__file__).parent
UNCOUNTED = {"inner_uncounted", "jit_uncounted"}


@inner_uncounted
def _double(values, i):
    values[i] *= 2


@inner_uncounted
def _double_part(values, start):
    part = values[start:]
    for i in range(len(part)):
        _double(part, i)


@inner
def _doubled(values):
    copy = values.copy()
    _double_part(copy, 0)
    return copy


@jit
def _call_doubled(values):
    return _doubled(values)


@jit_uncounted
def _call_double(values, start):
    _double_part(values, start)
    return len(values)


def test_kernels_call_inner_kernels_in_any_depth():
    values = np.arange(4)
    assert _call_double(values, 2) == 4
    assert values.tolist() == [0, 1, 4, 6]
    assert _call_doubled(values).tolist() == [0, 2, 8, 12]
    assert values.tolist() == [0, 1, 4, 6]


def test_one_inner_kernel_serves_several_kernels():
    events = []
    values = np.arange(3.0)
    first, second = from_python(_double), from_python(_double)
    first(values, 1)
    with on_compile(lambda: events.append(1)):
        second(values, 1)
    assert len(events) == 1
    assert values.tolist() == [0, 4, 2]


def test_constants_are_numbers():
    @jit
    def twice(values):
        _double(values, 0)
        _double(values, 1)

    # A kernel from an earlier run's cache would compile nothing.
    twice._cache = NullCache()
    values = np.arange(1, 4)
    twice(values)
    assert values.tolist() == [2, 4, 3]
    assert len([types for types in _double.overloads if "int" in str(types[0].dtype)]) == 1


def test_python_may_not_call_an_inner_kernel():
    with pytest.raises(TypeError, match="rotate is an inner kernel: only kernels call it"):
        rotate(1, 2, 3)
    from_python(_double)(np.arange(3), 1)
    with pytest.raises(TypeError, match="_double is an inner kernel"):
        _double(np.arange(3), 1)


def test_an_uncounted_kernel_may_not_make_arrays():
    @inner_uncounted
    def make(count):
        return np.empty(count).sum()

    with pytest.raises(Exception, match="Only accept returning of array"):
        from_python(make)(3)


def _kernels():
    """Module, definition and decorator of each kernel."""
    for path in sorted(PACKAGE.rglob("kernels/*.py")):
        module = ".".join(("gpszip", *path.relative_to(PACKAGE).with_suffix("").parts))
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                for decorator in node.decorator_list:
                    yield module, node, ast.unparse(decorator)


def test_modules_without_kernels_import_no_inner_kernel():
    inside = {(m, node.name) for m, node, kind in _kernels() if kind.startswith("inner")}
    assert len(inside) > 100
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name != "kernels":
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom):
                    imported = {(node.module, alias.name) for alias in node.names}
                    assert not imported & inside, path


def _holders():
    """Names of the tuples that hold arrays."""
    return {
        node.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and "NDArray" in ast.unparse(node)
    }


def _returns_arrays(node, holders):
    names = {name.id for name in ast.walk(node.returns) if isinstance(name, ast.Name)}
    return bool(names & {"NDArray", "Any", *holders})


def test_uncounted_kernels_neither_return_arrays_nor_call_what_returns_them():
    # Such arrays would never be freed.
    kernels, holders = list(_kernels()), _holders()
    returning = {(m, node.name) for m, node, _ in kernels if _returns_arrays(node, holders)}
    uncounted = [(m, node) for m, node, kind in kernels if kind in UNCOUNTED]
    assert len(returning) > 30
    assert len(uncounted) > 100
    assert not [(m, node.name) for m, node in uncounted if (m, node.name) in returning]

    # what a name means depends on the imports of the module
    for module, node in uncounted:
        path = PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py")
        meaning = {
            alias.asname or alias.name: (imported.module, alias.name)
            for imported in ast.parse(path.read_text()).body
            if isinstance(imported, ast.ImportFrom)
            for alias in imported.names
        }
        for call in ast.walk(node):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name):
                name = call.func.id
                called = meaning.get(name, (module, name))
                assert called not in returning, f"{module}.{node.name} calls {name}"
