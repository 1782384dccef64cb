"""Benchmarks, which take minutes, import only what there is."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.mark.parametrize("path", sorted(BENCHMARKS.glob("*.py")), ids=lambda path: path.stem)
def test_imports_of_benchmarks_exist(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gpszip"):
            module = importlib.import_module(node.module)
            for each in node.names:
                # A module that nobody has imported yet is no attribute of its package.
                assert hasattr(module, each.name) or importlib.import_module(
                    f"{node.module}.{each.name}"
                )
