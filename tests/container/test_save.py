import os
import random
import stat
import tempfile
from dataclasses import replace

import pytest

from gpszip.container.contents import Section, SpooledBytes, single_group_contents
from gpszip.container.layout import SectionKind
from gpszip.container.reader import load
from gpszip.container.writer import archive_size, save, to_bytes
from gpszip.errors import InputError, OptionError, OutputError
from oracle import archives

CONTENTS = archives.small_archives()["named"]


def _names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_save_and_load(tmp_path):
    path = tmp_path / "walks.gpsz"
    assert save(CONTENTS, path) == path.stat().st_size == len(to_bytes(CONTENTS))
    assert load(str(path)) == CONTENTS
    assert _names(tmp_path) == ["walks.gpsz"]


def test_new_file_has_the_rights_of_any_new_file(tmp_path):
    save(CONTENTS, tmp_path / "a.gpsz")
    (tmp_path / "plain").touch()
    assert (tmp_path / "a.gpsz").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_existing_file_stays_without_force(tmp_path):
    path = tmp_path / "walks.gpsz"
    path.write_text("mine")
    path.chmod(0o640)
    with pytest.raises(OutputError, match="exists already; replace it with --force"):
        save(CONTENTS, path)
    assert path.read_text() == "mine"
    save(CONTENTS, path, force=True)
    assert load(path) == CONTENTS
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert _names(tmp_path) == ["walks.gpsz"]


def test_dangling_link_is_something_that_exists(tmp_path):
    path = tmp_path / "walks.gpsz"
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="exists"):
        save(CONTENTS, path)


def test_folders_are_named(tmp_path):
    with pytest.raises(OutputError, match="create it first"):
        save(CONTENTS, tmp_path / "none" / "walks.gpsz")
    with pytest.raises(OutputError, match="is a folder"):
        save(CONTENTS, tmp_path, force=True)
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="written"):
        save(CONTENTS, tmp_path / "file" / "walks.gpsz")


def test_full_disk_leaves_nothing_behind(tmp_path):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        with pytest.raises(OutputError, match="File too large"):
            save(CONTENTS, tmp_path / "walks.gpsz")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert _names(tmp_path) == []


def test_link_stays_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "walks.gpsz").touch()
    (tmp_path / "link.gpsz").symlink_to(tmp_path / "real" / "walks.gpsz")
    save(CONTENTS, tmp_path / "link.gpsz", force=True)
    assert (tmp_path / "link.gpsz").is_symlink()
    assert load(tmp_path / "real" / "walks.gpsz") == CONTENTS


def test_devices_are_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="no regular file"):
        save(CONTENTS, pipe, force=True)
    assert pipe.is_fifo()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_no_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="Permission denied"):
        save(CONTENTS, tmp_path / "walks.gpsz")


def test_failure_leaves_nothing_behind(tmp_path):
    with pytest.raises(OptionError):
        save(single_group_contents(archives.FLAT, ("0",), b"", "zip"), tmp_path / "walks.gpsz")
    with pytest.raises(OutputError):
        save(CONTENTS, tmp_path / ("x" * 300))
    assert _names(tmp_path) == []


def test_load_of_no_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "none.gpsz")
    with pytest.raises(InputError, match="is a folder"):
        load(tmp_path)
    with pytest.raises(InputError, match="no regular file"):
        load("/dev/null")


@pytest.mark.parametrize("size", [5, 1 << 17, 3 << 20])
def test_a_section_in_a_temporary_file_is_written_as_one_in_memory(tmp_path, size):
    body = random.Random(size).randbytes(size)
    with tempfile.TemporaryFile() as file:
        file.write(body)
        spooled = replace(
            CONTENTS, extras=(Section(SectionKind.ATTRIBUTES, SpooledBytes(file, size)),)
        )
        held = replace(CONTENTS, extras=(Section(SectionKind.ATTRIBUTES, body),))
        assert to_bytes(spooled) == to_bytes(held)
        assert save(spooled, tmp_path / "a.gpsz") == archive_size(spooled) == len(to_bytes(held))
    assert (tmp_path / "a.gpsz").read_bytes() == to_bytes(held)
    assert load(tmp_path / "a.gpsz") == held
