import importlib

import pytest

from gpszip.kernels import source_stamp as stamps
from gpszip.kernels.source_stamp import source_stamp


@pytest.fixture
def edited(monkeypatch):
    """Stamps as they are once a module's source has changed."""
    original = stamps._source

    def edit(changed):
        source_stamp.cache_clear()
        monkeypatch.setattr(
            stamps,
            "_source",
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
def test_a_kernel_is_compiled_anew_when_it_or_one_that_it_calls_has_changed(edited, changed):
    before = source_stamp("gpszip.codec.kernels.walk_coder")
    edited(changed)
    assert source_stamp("gpszip.codec.kernels.walk_coder") != before


def test_other_kernels_are_not(edited):
    before = source_stamp("gpszip.codec.kernels.range_coder")
    edited("gpszip.codec.kernels.walk_coder")
    assert source_stamp("gpszip.codec.kernels.range_coder") == before


def test_the_compilers_cache_goes_by_the_stamp():
    kernel = importlib.import_module("gpszip.codec.kernels.walk_coder").code_walks
    assert kernel._cache._cache_file._source_stamp[1] == source_stamp(
        "gpszip.codec.kernels.walk_coder"
    )
