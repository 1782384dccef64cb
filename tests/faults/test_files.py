"""Outputs that can't be written, and the files that are left."""

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from cli.conftest import two_walks
from gpszip.archive import open_archive
from gpszip.cli.main import main
from gpszip.cli.output import write_archive_and_map
from gpszip.container.contents import single_group_contents
from gpszip.container.writer import to_bytes, write
from gpszip.errors import InputError, OutputError
from gpszip.files.atomic_write import atomic_write, atomic_write_all
from gpszip.files.interrupts import defer_signals
from gpszip.files.os_errors import explain_os_error
from gpszip.files.temporary import OUTPUT_PREFIX, temporary_folder
from gpszip.files.written import collect_outputs
from gpszip.io.logs.write import write_tracks
from gpszip.io.storage.display_name import printable_name
from gpszip.io.storage.temporary import read_numbers, write_numbers
from gpszip.model import Plane
from gpszip.testing import patrol
from oracle.archives import FLAT

ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "in" / "two.gpsz"
    path.parent.mkdir()
    two_walks(Plane(((480_000_000, 110_000_000),))).save(path)
    return path


@pytest.fixture
def run(capfd):
    """Run a command, and return its exit code and its message."""

    def call(*words):
        capfd.readouterr()
        code = main([str(word) for word in words])
        return code, capfd.readouterr().err

    return call


def _mounted(folder, *options):
    done = subprocess.run(["mount", *options, str(folder)], capture_output=True, check=False)
    if done.returncode:
        pytest.skip("nothing can be mounted here")


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 64 KiB."""
    if not ROOT or shutil.which("mount") is None:
        pytest.skip("needs rights to mount a disk")
    folder = tmp_path / "disk"
    folder.mkdir()
    _mounted(folder, "-t", "tmpfs", "-o", "size=64k", "tmpfs")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("name", ["log.csv", "log.gpx", "log.geojson", "log.parquet"])
def test_a_full_disk_keeps_the_old_log(small_disk, name):
    path = small_disk / name
    path.write_text("old")
    track = patrol(20_000, seed=1)
    if name.endswith(("gpx", "geojson")):
        track = patrol_on_earth(20_000)
    with pytest.raises(
        OutputError, match=rf"{name}: can't be written: .*[Nn]o space left on device"
    ):
        write_tracks([track], path)
    assert path.read_text() == "old"
    assert [one.name for one in small_disk.iterdir()] == [name]


def patrol_on_earth(count):
    from gpszip import Track

    log = patrol(count, seed=1)
    return Track("a", log.times, log.positions, plane=Plane(((480_000_000, 110_000_000),)))


@pytest.mark.parametrize(
    "name",
    [
        "map.gpkg",
        "map.fgb",
        "map.shp.zip",
        "map.parquet",
        "map.geojson",
        "map.graphml",
        "map.osm",
        "map.csv",
        "intact.gpsz",
    ],
)
def test_a_full_disk_keeps_the_old_map(small_disk, archive, run, name):
    path = small_disk / name
    path.write_text("old")
    (small_disk / "ballast").write_bytes(bytes((64 << 10) - 4096))
    command = "recover" if name.endswith("gpsz") else "map"
    code, words = run(command, archive, "-o", path, "--force")
    assert code == 1
    assert "No space left on device" in words
    assert len(words.splitlines()) == 1
    assert path.read_text() == "old"
    assert sorted(one.name for one in small_disk.iterdir()) == sorted(["ballast", name])


def test_a_read_only_disk(small_disk, archive, run):
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    code, words = run("recover", archive, "-o", small_disk / "out.gpsz")
    assert (code, len(words.splitlines())) == (1, 1)
    assert "Read-only file system" in words
    with pytest.raises(OutputError, match="Read-only file system; name a file on another disk"):
        two_walks().save(small_disk / "out.gpsz")


@pytest.mark.skipif(
    not ROOT or shutil.which("chattr") is None, reason="needs files that nobody may change"
)
def test_a_file_that_nobody_may_change(tmp_path, archive, run):
    path = tmp_path / "out.csv"
    path.write_text("old")
    if subprocess.run(["chattr", "+i", str(path)], capture_output=True, check=False).returncode:
        pytest.skip("this file system has no such files")
    try:
        code, words = run("decompress", archive, "-o", path, "--force")
    finally:
        subprocess.run(["chattr", "-i", str(path)], check=True)
    assert (code, len(words.splitlines())) == (1, 1)
    reason = "Operation not permitted; check the owner, the mode and the attributes"
    assert f"out.csv: can't be written: {reason}" in words
    assert path.read_text() == "old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["in", "out.csv"]


def test_pipes_folders_and_devices_are_not_replaced(tmp_path, archive, run):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere" / "out.csv")
    for name, says in (
        ("pipe", "no regular file"),
        ("folder", "is a folder"),
        ("dangling", "no such folder"),
        ("/dev/full", "no regular file"),
    ):
        for command in (
            ["decompress", "--format", "csv"],
            ["recover"],
            ["map", "--format", "geojson"],
        ):
            code, words = run(command[0], archive, *command[1:], "-o", tmp_path / name, "--force")
            assert (code, len(words.splitlines())) == (1, 1)
            assert says in words
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_stays_a_link_and_a_mode_stays_a_mode(tmp_path, archive, run):
    (tmp_path / "real.csv").write_text("old")
    (tmp_path / "real.csv").chmod(0o600)
    (tmp_path / "link.csv").symlink_to("real.csv")
    assert run("decompress", archive, "-o", tmp_path / "link.csv", "--force")[0] == 0
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text().startswith("track_id")
    assert (tmp_path / "real.csv").stat().st_mode & 0o777 == 0o600


def test_the_folder_may_be_removed_while_writing(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    with (
        pytest.raises(
            OutputError,
            match=r"out.csv: can't be written: No such file or directory; its folder is gone",
        ),
        atomic_write(folder / "out.csv") as part,
    ):
        part.write_text("new")
        shutil.rmtree(folder)
    assert not folder.exists()


def test_another_process_may_write_the_file_first(tmp_path):
    path = tmp_path / "out.gpsz"
    with (
        pytest.raises(OutputError, match="exists already"),
        atomic_write(path, force=False) as part,
    ):
        part.write_text("ours")
        path.write_text("theirs")
    assert path.read_text() == "theirs"
    assert [one.name for one in tmp_path.iterdir()] == ["out.gpsz"]


def test_an_error_of_another_file_is_not_reported_as_one_of_the_output(tmp_path):
    with (
        pytest.raises(FileNotFoundError, match="elsewhere"),
        atomic_write(tmp_path / "out") as part,
    ):
        part.write_bytes(Path("/elsewhere/in").read_bytes())
    assert not list(tmp_path.iterdir())


def test_two_files_are_written_only_if_both_can_be(tmp_path):
    archive = two_walks()
    (tmp_path / "map.gpsz").write_text("old")
    with pytest.raises(OutputError, match="b: is a folder"):
        (tmp_path / "b").mkdir()
        write_archive_and_map(str(tmp_path / "map.gpsz"), archive, str(tmp_path / "b"), archive)
    assert (tmp_path / "map.gpsz").read_text() == "old"
    write_archive_and_map(str(tmp_path / "map.gpsz"), archive, str(tmp_path / "a.gpsz"), archive)
    assert (
        open_archive(tmp_path / "map.gpsz").ids
        == open_archive(tmp_path / "a.gpsz").ids
        == archive.ids
    )


def test_the_error_names_the_one_of_two_files_that_is_written(tmp_path):
    with (
        pytest.raises(OutputError, match=r"two: can't be written: .*; .*one is written"),
        atomic_write_all([tmp_path / "one", tmp_path / "two"]) as parts,
    ):
        for part in parts:
            part.write_text("new")
        (tmp_path / "two").mkdir()
        (tmp_path / "two" / "full").touch()
    assert (tmp_path / "one").read_text() == "new"


def _left(folder, age):
    """Make the temporary folder that a killed process leaves."""
    left = folder / f"{OUTPUT_PREFIX}abcdefgh.part"
    left.mkdir()
    (left / "half").write_text("half")
    then = time.time() - age
    for path in (left / "half", left):
        os.utime(path, (then, then))
    return left


@pytest.mark.skipif(
    sys.platform == "win32", reason="nobody can tell there whether a folder is in use"
)
def test_temporary_files_of_a_killed_process_are_removed_by_the_next(tmp_path):
    old = _left(tmp_path, 3 * 3600)
    mine = tmp_path / ".gpszip-mine"
    mine.mkdir()
    os.utime(mine, (0, 0))
    two_walks().save(tmp_path / "out.gpsz")
    assert not old.exists()
    assert mine.exists()


@pytest.mark.skipif(
    sys.platform == "win32", reason="nobody can tell there whether a folder is in use"
)
def test_temporary_files_that_may_be_in_use_stay(tmp_path):
    young = _left(tmp_path, 60)
    two_walks().save(tmp_path / "out.gpsz")
    assert young.exists()
    shutil.rmtree(young)
    with temporary_folder(tmp_path, OUTPUT_PREFIX) as used:
        os.utime(used, (0, 0))
        two_walks().save(tmp_path / "out.gpsz", force=True)
        assert used.exists()
    assert [one.name for one in tmp_path.iterdir()] == ["out.gpsz"]


@pytest.mark.skipif(
    not ROOT or shutil.which("chattr") is None, reason="needs folders that can't be removed"
)
def test_a_temporary_folder_that_cannot_be_removed_is_named(tmp_path):
    kept = []
    with (
        pytest.raises(
            OutputError,
            match=r"this temporary folder can't be removed \(Operation not permitted\); delete it; "
            ".*out is written",
        ),
        atomic_write(tmp_path / "out") as part,
    ):
        part.write_text("new")
        (part.parent / "stays").touch()
        if subprocess.run(
            ["chattr", "+i", str(part.parent / "stays")], capture_output=True, check=False
        ).returncode:
            pytest.skip("this file system has no such files")
        kept.append(part.parent)
    subprocess.run(["chattr", "-i", str(kept[0] / "stays")], check=True)
    assert (tmp_path / "out").read_text() == "new"


class _ShortWrites(io.RawIOBase):
    """A raw stream that takes a few bytes at a time, as a pipe does."""

    def __init__(self):
        self.data = bytearray()

    def writable(self):
        return True

    def write(self, data):
        self.data += data[:7]
        return min(len(data), 7)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_short_writes_are_continued(format):
    whole, short = io.BytesIO(), _ShortWrites()
    track = patrol(500, seed=2)
    write_tracks([track], whole, format)
    write_tracks([track], short, format)
    assert bytes(short.data) == whole.getvalue()


def test_short_writes_of_archives():
    from gpszip.io.storage.sink import open_sink

    contents, short = single_group_contents(FLAT, ("0",), b"walks of one track"), _ShortWrites()
    with open_sink(short) as stream:
        write(contents, stream)
    assert bytes(short.data) == to_bytes(contents)


def test_numbers_of_a_temporary_file_that_is_too_short(tmp_path):
    import numpy as np

    with (tmp_path / "numbers").open("wb") as file:
        write_numbers(np.arange(10.0).reshape(5, 2)[:, :1], file)
    assert read_numbers(tmp_path / "numbers", np.float64, 1, 3).tolist() == [2, 4, 6]
    assert read_numbers(tmp_path / "numbers", np.float64, 5, 0).tolist() == []
    with pytest.raises(OutputError, match="this temporary file is 8 bytes too short"):
        read_numbers(tmp_path / "numbers", np.float64, 3, 3)
    with pytest.raises(OutputError, match="temporary files can't be written"):
        read_numbers(tmp_path / "none", np.float64, 0, 1)


def test_errors_of_the_system_get_a_remedy():
    assert explain_os_error(OSError(errno.EIO, "Input/output error")).startswith(
        "Input/output error; check the disk"
    )
    assert explain_os_error(OSError("Arrow says\nmuch")) == "Arrow says"
    assert explain_os_error(OSError()) == "OSError"


def test_a_stream_that_fails_is_an_input_error(tmp_path):
    from gpszip.io.large.store import store_logs
    from gpszip.io.logs.read import read_logs

    class Torn(io.RawIOBase):
        name = "torn"

        def readable(self):
            return True

        def read(self, size=-1):
            raise OSError(errno.EIO, "Input/output error")

    for read in (read_logs, lambda stream: store_logs(stream, rows=1000)):
        with pytest.raises(InputError, match="torn: can't be read: Input/output error"):
            read(Torn())


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_file_names_that_are_not_utf8(tmp_path, run):
    name = os.fsdecode(b"caf\xe9.csv")
    (tmp_path / name).write_text("t,x,y\n" + "".join(f"{t},{t},0\n" for t in range(50)))
    code, words = run(
        "coreset", tmp_path / name, "-o", tmp_path / os.fsdecode(b"out\xff.parquet"), "--size", "3"
    )
    assert code == 0, words
    assert (tmp_path / os.fsdecode(b"out\xff.parquet")).exists()
    code, words = run(
        "coreset",
        tmp_path / os.fsdecode(b"no\xff.csv"),
        "-o",
        tmp_path / "x.parquet",
        "--size",
        "3",
    )
    assert code == 1
    assert "no such file" in words
    assert len(words.splitlines()) == 1
    assert printable_name(name) == "caf\\xe9.csv"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_deferred_to_the_end_of_a_block(number):
    before = signal.signal(number, signal.default_int_handler)
    steps = []
    try:
        with pytest.raises(KeyboardInterrupt), defer_signals():
            os.kill(os.getpid(), number)
            steps.append("through")
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert steps == ["through"]


def test_written_files_are_collected(tmp_path):
    two_walks().save(tmp_path / "before.gpsz")
    with collect_outputs() as written:
        two_walks().save(tmp_path / "a.gpsz")
        with pytest.raises(OutputError):
            two_walks().save(tmp_path / "a.gpsz")
    two_walks().save(tmp_path / "after.gpsz")
    assert written == [f"{tmp_path / 'a.gpsz'} is written"]


def test_many_threads_write_side_by_side(tmp_path):
    archive = two_walks()
    threads = [
        threading.Thread(
            target=archive.save, args=(tmp_path / f"{i % 3}.gpsz",), kwargs={"force": True}
        )
        for i in range(12)
    ]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert sorted(one.name for one in tmp_path.iterdir()) == ["0.gpsz", "1.gpsz", "2.gpsz"]
    assert {one.read_bytes() for one in tmp_path.iterdir()} == {archive.to_bytes()}
