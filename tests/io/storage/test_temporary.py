import numpy as np
import pytest

from gpszip.errors import OutputError
from gpszip.io.large.store import store_logs
from gpszip.io.storage.temporary import (
    disk_errors_as_output_errors,
    read_numbers,
    scratch_folder,
    write_numbers,
)


def test_folder_is_removed_with_its_content(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with scratch_folder() as folder:
        (folder / "a").write_text("content")
        assert folder.parent == tmp_path
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["missing", "file"])
def test_no_other_folder_than_tmpdir_is_used(tmp_path, monkeypatch, name):
    (tmp_path / "file").touch()
    monkeypatch.setenv("TMPDIR", str(tmp_path / name))
    with (
        pytest.raises(OutputError, match=rf"TMPDIR names .*{name}: no temporary files can be made"),
        scratch_folder(),
    ):
        pass


def test_full_disk_is_named(tmp_path, monkeypatch):
    """A limit of 40,000 bytes per file imitates a full disk."""
    resource = pytest.importorskip("resource")
    (tmp_path / "log.csv").write_text("t,x,y\n" + "".join(f"{i},{i},0\n" for i in range(5000)))
    (tmp_path / "scratch").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "scratch"))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, limits[1]))
    try:
        with pytest.raises(
            OutputError,
            match=r"scratch: temporary files can't be written: .* let TMPDIR name a folder",
        ):
            store_logs(str(tmp_path / "log.csv"), rows=3000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list((tmp_path / "scratch").iterdir())


def test_other_errors_pass_through():
    with pytest.raises(KeyError), disk_errors_as_output_errors():
        raise KeyError


@pytest.mark.parametrize("shape", [(0,), (0, 3), (3, 0), (2, 3), (4,)])
def test_numbers_of_any_shape_are_read_back(tmp_path, shape):
    numbers = np.arange(np.prod(shape), dtype=np.float64).reshape(shape)
    with (tmp_path / "numbers").open("wb") as file:
        write_numbers(numbers, file)
        write_numbers(numbers.T, file)
    read = read_numbers(tmp_path / "numbers", np.float64, 0, 2 * numbers.size)
    assert read.tolist() == [*numbers.ravel(), *numbers.T.ravel()]
