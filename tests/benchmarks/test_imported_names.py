"""Benchmarks, which take minutes, import only what there is."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_imports_of_benchmarks_exist():
    paths = sorted(BENCHMARKS.glob("*.py"))
    assert paths
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gpszip"):
                check_names(path, node)


def check_names(path, node):
    """Check the names that a script imports from a module."""
    module = importlib.import_module(node.module)
    for each in node.names:
        # A module that nobody has imported yet is no attribute of its package.
        if not hasattr(module, each.name):
            try:
                importlib.import_module(f"{node.module}.{each.name}")
            except ModuleNotFoundError:
                raise AssertionError(f"{path.name}: {node.module} has no {each.name}") from None
