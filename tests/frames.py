"""Packages of frames, for tests that are skipped where a package isn't installed."""

import warnings

import pytest


def package(name):
    """Import a package, or skip the test."""
    with warnings.catch_warnings():
        # movingpandas warns of packages that only some of its classes need.
        warnings.simplefilter("ignore")
        return pytest.importorskip(name, reason=f"{name} is not installed", exc_type=ImportError)
