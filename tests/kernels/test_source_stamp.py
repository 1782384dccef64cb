import importlib

import pytest

from gpszip.kernels import source_stamp as stamps
from gpszip.kernels.source_stamp import source_stamp


@pytest.fixture
def edited(monkeypatch):
    """A function that pretends that a module's source has changed."""
    original = stamps._read_source

    def edit(changed):
        source_stamp.cache_clear()
        monkeypatch.setattr(
            stamps,
            "_read_source",
            lambda module: original(module) + ("# changed" if module == changed else ""),
        )

    yield edit
    source_stamp.cache_clear()


@pytest.mark.parametrize(
    "changed",
    [
        "gpszip.codec.kernels.walk_coder",
        "gpszip.codec.kernels.step_coder",
        "gpszip.codec.kernels.range_coder",
        "gpszip.kernels.jit",
    ],
)
def test_stamp_changes_with_the_kernel_and_with_the_kernels_it_calls(edited, changed):
    before = source_stamp("gpszip.codec.kernels.walk_coder")
    edited(changed)
    assert source_stamp("gpszip.codec.kernels.walk_coder") != before


def test_stamp_ignores_kernels_that_are_not_called(edited):
    before = source_stamp("gpszip.codec.kernels.range_coder")
    edited("gpszip.codec.kernels.walk_coder")
    assert source_stamp("gpszip.codec.kernels.range_coder") == before


def test_numba_cache_uses_the_stamp():
    kernel = importlib.import_module("gpszip.codec.kernels.walk_coder").code_walks
    assert kernel._cache.numba._cache_file._source_stamp[1] == source_stamp(
        "gpszip.codec.kernels.walk_coder"
    )
