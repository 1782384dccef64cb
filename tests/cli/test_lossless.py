"""gpszip compress --lossless, decompress --exact and diff --exact, as a user runs them."""

import gzip
import io
import json
import os
import sys
import zipfile

import pytest

from batches import force_batches
from gpszip.cli.main import main
from gpszip.lossless.logs import ExactLogs

#: A log with what a reader drops or repairs: repeated rows, disorder, gaps, odd notations, CRLF.
MESSY = (
    '# made by hand\r\nt,x,y,note\r\n0,1.0,2.00,"a, b"\r\n1,1.5,-0.0,\r\n1,1.5,-0.0,\r\n'
    "3,nan,2,é\r\n2,2.50,3.125,late\r\n4,1e1,+4,x\r\n\r\n5,11,5,end"
)


@pytest.fixture
def messy(tmp_path):
    path = tmp_path / "messy.csv"
    path.write_bytes(MESSY.replace("# made by hand\r\n", "").encode())
    return path


def test_a_log_comes_back_byte_by_byte(gpszip, log, tmp_path):
    done = gpszip("compress walk.csv --lossless --effort 1")
    assert done.code == 0
    assert gpszip("decompress walk.gpsz --exact -o back.csv").code == 0
    assert (tmp_path / "back.csv").read_bytes() == log.read_bytes()
    assert (tmp_path / "walk.gpsz").stat().st_size < log.stat().st_size / 3


def test_rows_that_are_dropped_or_repaired_are_kept(gpszip, messy, tmp_path):
    assert "not kept: note" in gpszip("compress messy.csv --effort 1 --sort -o without.gpsz").err
    done = gpszip("compress messy.csv --lossless --effort 1 --sort -o a.gpsz")
    assert done.code in {0, 3}
    assert "not kept" not in done.err
    assert gpszip("decompress a.gpsz --exact -o back.csv").code == 0
    assert (tmp_path / "back.csv").read_bytes() == messy.read_bytes()


def test_the_walks_are_the_same_without_the_logs(gpszip, lossless_archive, tmp_path):
    bound = json.loads(gpszip("info walk.gpsz --json").out)["error_bound_m"]
    lossless_archive.rename(tmp_path / "with.gpsz")
    gpszip(f"compress walk.csv --effort 1 --rmse {bound}m -o without.gpsz")
    for name in ("with", "without"):
        assert gpszip(f"decompress {name}.gpsz -o {name}.csv").code == 0
    assert (tmp_path / "with.csv").read_text() == (tmp_path / "without.csv").read_text()


def test_several_logs_come_back_into_a_folder(gpszip, log, tmp_path):
    for name in "abc":
        rows = log.read_text().splitlines()[: 100 + 10 * ord(name) % 7]
        (tmp_path / f"{name}.csv").write_text("\n".join(rows))
    assert gpszip("compress a.csv b.csv c.csv --lossless --effort 1 -o all.gpsz").code == 0
    assert gpszip("decompress all.gpsz --exact -o back").code == 0
    for name in "abc":
        kept = (tmp_path / "back" / f"{name}.csv").read_bytes()
        assert kept == (tmp_path / f"{name}.csv").read_bytes()
    assert gpszip("decompress all.gpsz --exact --log b.csv -o one.csv").code == 0
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    done = gpszip("decompress all.gpsz --exact --log d.csv -o two.csv")
    assert (done.code, "there are a.csv, b.csv, c.csv" in done.err) == (2, True)
    assert gpszip("diff --exact all.gpsz a.csv b.csv c.csv").code == 0


def test_existing_files_are_not_replaced_without_force(gpszip, lossless_archive):
    done = gpszip("decompress walk.gpsz --exact")
    assert (done.code, "exists" in done.err) == (1, True)
    assert gpszip("decompress walk.gpsz --exact --force").code == 0


def test_gzip_files_are_kept_unpacked(gpszip, log, tmp_path):
    (tmp_path / "walk.csv.gz").write_bytes(gzip.compress(log.read_bytes()))
    assert gpszip("compress walk.csv.gz --lossless --effort 1 -o a.gpsz").code == 0
    assert gpszip("diff --exact a.gpsz walk.csv.gz walk.csv").code == 0
    assert gpszip("decompress a.gpsz --exact -o b").code == 0
    assert (tmp_path / "b").read_bytes() == log.read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize(
    ("file_name", "kept"),
    [
        ("wälk ☃.csv", "wälk ☃.csv"),
        ("a\nb.csv", "a_nb.csv"),
        ("a\\b.csv", "a_b.csv"),
        (os.fsdecode(b"odd\xff.csv"), "odd_xff.csv"),
    ],
)
def test_names_with_odd_letters_come_back(gpszip, log, tmp_path, file_name, kept):
    data = log.read_bytes()
    log.rename(tmp_path / file_name)
    done = gpszip("compress --lossless --effort 1 -o a.gpsz", file_name)
    assert done.code == 0, done.err
    assert gpszip("info a.gpsz --json").json["exact_logs"] == [kept]
    assert gpszip("diff --exact a.gpsz", file_name).code == 0
    (tmp_path / "back").mkdir()
    assert gpszip("decompress a.gpsz --exact -o back").code == 0
    assert (tmp_path / "back" / kept).read_bytes() == data


def test_standard_input_is_kept(gpszip, log, tmp_path):
    done = gpszip("compress - --lossless --effort 1 -o a.gpsz", data=log.read_bytes())
    assert done.code == 0
    assert gpszip("decompress a.gpsz --exact -o -").out.encode() == log.read_bytes()


@pytest.mark.parametrize("suffix", ["gpx", "geojson"])
def test_other_formats_come_back_byte_by_byte(gpszip, log, tmp_path, suffix):
    rows = [line.split(",") for line in log.read_text().splitlines()[1:]]
    degrees = [f"{t},{48 + float(y) / 1e4:.7f},{11 + float(x) / 1e4:.7f}\n" for t, x, y in rows]
    (tmp_path / "earth.csv").write_text("t,lat,lon\n" + "".join(degrees))
    gpszip("compress earth.csv --rmse 1m --effort 1 -o walk.gpsz")
    assert gpszip(f"decompress walk.gpsz -o other.{suffix} --every 1s").code == 0
    assert gpszip(f"compress other.{suffix} --lossless --effort 1 -o a.gpsz").code == 0
    assert gpszip(f"decompress a.gpsz --exact -o back.{suffix}").code == 0
    other, back = tmp_path / f"other.{suffix}", tmp_path / f"back.{suffix}"
    assert back.read_bytes() == other.read_bytes()


def test_diff_names_the_first_line_that_differs(gpszip, lossless_archive, log):
    assert gpszip("diff --exact walk.gpsz walk.csv").code == 0
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join([*lines[:50], b"x,y,z\n", *lines[51:]]))
    done = gpszip("diff --exact walk.gpsz walk.csv")
    assert done.code == 1
    assert "walk.csv: line 51: the log has 'x,y,z', the archive '49" in done.err
    log.write_bytes(b"".join(lines[:7]))
    done = gpszip("diff --exact walk.gpsz walk.csv")
    assert (done.code, "line 8: the log has '', the archive '6" in done.err) == (1, True)


def test_diff_needs_an_archive_that_keeps_logs(gpszip, walk_archive):
    for command in ("diff --exact walk.gpsz walk.csv", "decompress walk.gpsz --exact -o b.csv"):
        done = gpszip(command)
        assert done.code == 2
        assert "keeps no log exactly; compress the log with --lossless" in done.err


def test_rm_deletes_what_is_proved(gpszip, log):
    done = gpszip("compress walk.csv --lossless --effort 1 --rm")
    assert (done.code, log.exists()) == (0, False)
    assert "holds the logs, as proved; deleted 1" in done.err
    assert gpszip("decompress walk.gpsz --exact").code == 0
    assert log.exists()


def test_rm_deletes_nothing_where_the_log_has_changed(gpszip, log, monkeypatch):
    from gpszip.cli import compress

    # Another program appends to the log after it was read.
    write = compress._write

    def write_and_append(*arguments, **options):
        write(*arguments, **options)
        with log.open("ab") as file:
            file.write(b"999,0,0\n")

    monkeypatch.setattr(compress, "_write", write_and_append)
    done = gpszip("compress walk.csv --lossless --effort 1 --rm")
    assert (done.code, log.exists()) == (1, True)
    assert "line 202: the log has '999,0,0', the archive ''" in done.err


def test_rm_is_refused_where_nothing_could_be_proved(gpszip, log, tmp_path, monkeypatch):
    done = gpszip("compress walk.csv --rm")
    assert (done.code, "add --lossless" in done.err) == (2, True)
    done = gpszip("compress walk.csv --lossless --rm -o -")
    assert (done.code, "can't be read back" in done.err) == (2, True)
    with zipfile.ZipFile(tmp_path / "logs.zip", "w") as archive:
        archive.write(log, "walk.csv")
    done = gpszip("compress logs.zip --lossless --rm -o a.gpsz")
    assert (done.code, "is no file by itself" in done.err) == (2, True)
    assert not (tmp_path / "a.gpsz").exists()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(log.read_bytes())))
    assert main(["compress", "-", "--lossless", "--rm", "-o", "a.gpsz"]) == 2
    assert log.exists()


def test_two_logs_of_one_name_are_refused(gpszip, log, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "walk.csv").write_bytes(log.read_bytes())
    done = gpszip("compress walk.csv other/walk.csv --lossless --split -o a.gpsz")
    assert (done.code, "two logs are named 'walk.csv'" in done.err) == (2, True)


def test_contradicting_options_are_refused(gpszip, lossless_archive):
    done = gpszip("compress walk.csv --lossless --append -o walk.gpsz")
    assert (done.code, "--lossless and --append" in done.err) == (2, True)
    done = gpszip("decompress walk.gpsz --exact --samples -o b.csv")
    assert (done.code, "--exact and --samples" in done.err) == (2, True)
    done = gpszip("decompress walk.gpsz --log walk.csv -o b.csv")
    assert (done.code, "add --exact" in done.err) == (2, True)


def test_a_size_counts_the_logs_too(gpszip, log, tmp_path):
    done = gpszip("compress walk.csv --lossless --effort 1 --bytes 200 -o a.gpsz")
    assert (done.code, "what is kept exactly takes" in done.err) == (6, True)
    gpszip("compress walk.csv --lossless --effort 1 --bytes 4000 -o a.gpsz")
    assert (tmp_path / "a.gpsz").stat().st_size <= 4000


def test_verify_checks_the_logs(gpszip, lossless_archive):
    assert gpszip("verify walk.gpsz").code == 0


def test_info_says_what_is_kept(gpszip, lossless_archive):
    assert "kept         every byte of the logs (walk.csv)" in gpszip("info walk.gpsz").out
    assert gpszip("info walk.gpsz --json").json["exact_logs"] == ["walk.csv"]


def test_json_tells_the_outcome(gpszip, lossless_archive, log):
    facts = gpszip("diff --exact walk.gpsz walk.csv --json").json
    assert facts == {
        "archive": "walk.gpsz",
        "equal": True,
        "logs": 1,
        "bytes": log.stat().st_size,
    }
    assert gpszip("decompress walk.gpsz --exact -o b.csv --json").json["logs"] == 1


def test_logs_larger_than_memory_are_kept(gpszip, tmp_path, monkeypatch):
    force_batches(monkeypatch, batch=1000, subsample=1000)
    rows = [f"{i},{i % 100},{i % 70}.5\n" for i in range(3000)]
    (tmp_path / "long.csv").write_text("t,x,y\n" + "".join(rows))
    done = gpszip("compress long.csv --lossless --memory 420MiB -o a.gpsz --effort 1 --rmse 5m")
    assert done.code == 0, done.err
    assert gpszip("diff --exact a.gpsz long.csv").code == 0


def test_what_would_not_come_back_is_not_written(gpszip, log, tmp_path, monkeypatch):
    # An archive that returns another second row than it was given.
    read = ExactLogs.read

    def read_otherwise(self, number):
        for block in read(self, number):
            yield block.replace(b"\n1,", b"\n9,", 1)

    monkeypatch.setattr(ExactLogs, "read", read_otherwise)
    before = log.read_bytes()
    done = gpszip("compress walk.csv --lossless --effort 1 --rm")

    # The line is named, the log is still there, and there is no archive.
    assert done.code == 1
    assert "walk.csv: line 3: the log has '1," in done.err
    assert "nothing was written" in done.err
    assert "please report this" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["walk.csv"]
    assert log.read_bytes() == before
