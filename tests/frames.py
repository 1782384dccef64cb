"""Packages of frames, for tests that are skipped where a package isn't installed."""

import re
import warnings
from importlib.util import find_spec

import pytest


def package(name):
    """Import a package, or skip the test."""
    with warnings.catch_warnings():
        # movingpandas warns of packages that only some of its classes need.
        warnings.simplefilter("ignore")
        return pytest.importorskip(name, reason=f"{name} is not installed", exc_type=ImportError)


#: Packages that code of the documentation imports, or that a method such as ``to_polars`` needs.
PACKAGES = ("pandas", "polars", "geopandas", "movingpandas", "osmnx", "networkx")


def missing_packages(code):
    """Packages that code of the documentation needs, and that are not installed."""
    needed = re.findall(rf"\b(?:import |to_)({'|'.join(PACKAGES)})\b", code)
    return [name for name in needed if find_spec(name) is None]
