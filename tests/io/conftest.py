"""A package with an entry point, for tests of formats that come from outside."""

import sys

import pytest

from gpszip.io.plugins import forget_plugins


@pytest.fixture
def install_plugin(tmp_path, monkeypatch):
    """Install a package ``toy`` whose module has a ``FORMAT``, registered in a group.

    Call it as ``install_plugin("gpszip.map_formats", source_of_the_module)``.
    """

    def install(group, source):
        (tmp_path / "toy_plugin.py").write_text(source)
        metadata = tmp_path / "toy-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.0\n")
        (metadata / "entry_points.txt").write_text(f"[{group}]\ntoy = toy_plugin:FORMAT\n")
        monkeypatch.syspath_prepend(tmp_path)
        forget_plugins()

    yield install
    forget_plugins()
    sys.modules.pop("toy_plugin", None)
