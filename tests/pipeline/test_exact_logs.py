"""Logs kept byte by byte, from Python."""

import io

import numpy as np
import pytest

import gpszip
from gpszip.archive.exact import find_exact_logs
from gpszip.errors import CorruptArchiveError, InputError, OptionError
from gpszip.io.storage.source import Source
from gpszip.lossless.logs import ExactLogs
from gpszip.pipeline import exact_logs
from gpszip.pipeline.exact_logs import check_exact

TEXT = "t,x,y\n" + "".join(f"{i},{10 * abs(i % 40 - 20)},{i % 3}\n" for i in range(500))


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    path = tmp_path_factory.mktemp("exact") / "walk.csv"
    path.write_text(TEXT)
    return gpszip.compress(path, rmse=2, effort=1, lossless=True)


def test_the_log_is_read_from_the_archive(archive, path, tmp_path):
    archive.save(tmp_path / "a.gpsz")
    opened = gpszip.open(tmp_path / "a.gpsz")
    assert opened.exact_names == ("walk.csv",)
    assert opened.exact_log("walk.csv") == path.read_bytes()
    assert opened.exact_log("walk.csv", 6, 8) == b"0,200,0\n"
    with pytest.raises(OptionError, match="no log 'run' is kept exactly"):
        opened.exact_log("run")


def test_tracks_and_streams_are_refused(tmp_path):
    track = gpszip.Track("0", np.arange(9.0), np.zeros((9, 2)))
    for given in (track, io.BytesIO(TEXT.encode()), "-"):
        with pytest.raises(OptionError, match="lossless keeps files"):
            gpszip.compress(given, rmse=1, lossless=True)


@pytest.mark.parametrize("fault", ["other bytes", "an error"])
def test_no_archive_is_returned_that_would_not_return_the_log(path, monkeypatch, fault):
    read = ExactLogs.read

    def read_otherwise(self, number):
        if fault == "an error":
            raise CorruptArchiveError("wrong block")
        for block in read(self, number):
            yield block.replace(b"7,", b"8,", 1)

    monkeypatch.setattr(ExactLogs, "read", read_otherwise)
    message = r"walk\.csv: .*nothing was written.*please report"
    with pytest.raises(InputError, match=message) as error:
        gpszip.compress(path, rmse=2, effort=1, lossless=True)
    assert error.value.location == ("line 9" if fault == "other bytes" else None)


def test_damage_is_found(archive, path):
    data = bytearray(archive.to_bytes())
    data[-9] ^= 1
    with pytest.raises(CorruptArchiveError):
        gpszip.open(bytes(data)).exact_log("walk.csv")


def test_the_report_counts_the_whole_archive(archive):
    assert archive.report.bytes_out == len(archive.to_bytes())


def test_a_merge_says_that_logs_are_left_behind(archive, path):
    track = gpszip.Track("b", np.arange(9.0), np.zeros((9, 2)))
    other = gpszip.compress(track, rmse=2, effort=1)
    merged = gpszip.merge([archive, other])
    assert merged.exact_names == ()
    assert any("logs kept exactly are not merged" in note for note in merged.report.notes)


def test_an_appended_archive_still_holds_the_first_log(archive):
    times = np.arange(1000.0, 1009)
    grown = gpszip.append(archive, gpszip.Track("b", times, np.zeros((9, 2))))
    assert grown.exact_log("walk.csv") == TEXT.encode()
    # Its walks may have changed, so that they no longer predict it.
    assert find_exact_logs(archive).is_guided
    assert not find_exact_logs(grown).is_guided
    again = gpszip.append(grown, gpszip.Track("c", times, np.zeros((9, 2))))
    assert again.contents.extras == grown.contents.extras
    assert again.exact_log("walk.csv") == TEXT.encode()


def test_walks_of_another_archive_predict_nothing(archive, path):
    on_map = gpszip.compress(path, rmse=2, effort=1, map=archive, lossless=True)
    assert not find_exact_logs(on_map).is_guided
    assert on_map.exact_log("walk.csv") == TEXT.encode()


def test_a_size_counts_the_log(path):
    rows = TEXT[: TEXT.index("\n60,") + 1]
    path.write_text(rows)
    archive = gpszip.compress(path, size=700, effort=1, lossless=True)
    assert archive.size <= 700
    assert not find_exact_logs(archive).is_guided
    assert archive.exact_log("walk.csv") == rows.encode()


def test_a_bound_that_is_estimated_is_twice_as_large(path):
    without = gpszip.compress(path, effort=1)
    with_log = gpszip.compress(path, effort=1, lossless=True)
    bounds = [archive.info()["error_bound_m"] for archive in (with_log, without)]
    assert bounds[0] == pytest.approx(2 * bounds[1], rel=0.01)
    assert with_log.info()["error_bound_max_m"] is None
    assert any("2 times as much as without" in note for note in with_log.report.notes)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda text: text[:-1], "line 502: the log has no more lines, the archive ''"),
        (lambda text: text.replace("7,", "8,", 1), "line 9"),
        (lambda text: text + "x" * 100, "line 502: the log has 'x{60}...', the archive ''"),
        (lambda text: "", "line 1: the log has '', the archive 't,x,y'"),
    ],
)
def test_the_first_difference_is_named(archive, path, change, place):
    assert check_exact(archive, [Source(str(path), path=path)]) == len(TEXT)
    path.write_text(change(TEXT))
    with pytest.raises(InputError, match=place):
        check_exact(archive, [Source(str(path), path=path)])


def test_a_difference_many_chunks_into_a_log_is_named(archive, path, monkeypatch):
    monkeypatch.setattr(exact_logs, "_CHUNK_BYTES", 100)
    assert check_exact(archive, [Source(str(path), path=path)]) == len(TEXT)
    path.write_text(TEXT.replace("480,200,0\n", "x\n"))
    with pytest.raises(InputError, match="line 482: the log has 'x', the archive '480,200,0'"):
        check_exact(archive, [Source(str(path), path=path)])
