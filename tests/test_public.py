import inspect
import subprocess
import sys

import pytest

import gpszip

PUBLIC = [
    "Archive",
    "BoundError",
    "Coreset",
    "CoresetStream",
    "CorruptArchiveError",
    "GPSZipError",
    "InputError",
    "LossWarning",
    "MapError",
    "Matcher",
    "MissingExtraError",
    "OptionError",
    "OutputError",
    "RoadMap",
    "SegmentMean",
    "Track",
    "TrackError",
    "UnknownFormatError",
    "Walk",
    "WorkerError",
    "__version__",
    "append",
    "compress",
    "coreset",
    "decompress",
    "match",
    "merge",
    "open",
    "open_coreset",
    "patch",
    "read",
    "save_coreset",
    "segment_mean",
]


def test_public_names_are_these_and_no_others():
    assert gpszip.__all__ == PUBLIC == sorted(PUBLIC)
    assert dir(gpszip) == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_there_and_documented(name):
    value = getattr(gpszip, name)
    assert name == "__version__" or value.__doc__


def test_other_names_are_not():
    with pytest.raises(AttributeError, match="no attribute 'Zip'"):
        gpszip.Zip  # noqa: B018


def test_errors_have_one_root():
    errors = [getattr(gpszip, name) for name in PUBLIC if name.endswith("Error")]
    assert all(issubclass(error, gpszip.GPSZipError) for error in errors)


@pytest.mark.parametrize("name", ["compress", "decompress", "open", "read", "segment_mean"])
def test_signatures_are_typed(name):
    signature = inspect.signature(getattr(gpszip, name))
    assert signature.return_annotation is not inspect.Signature.empty
    assert all(
        one.annotation is not inspect.Parameter.empty for one in signature.parameters.values()
    )


def test_importing_gpszip_imports_nothing_heavy():
    code = "import gpszip, sys; print([name for name in ('numpy', 'numba', 'scipy', 'pyarrow', 'pyproj') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
