import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.point_batches import PointBatch, open_points, read_points
from gpszip.io.logs.raw import Request
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.source import Source


def parser(*batches, found=()):
    def parse(_source, _request, findings):
        for what, number, drops in found:
            findings.count(what, number, drops=drops)
        yield from batches

    return parse


def batch(times, tracks=None, **attributes):
    times = np.array(times, float)
    return PointBatch(times, np.stack([times, -times], axis=1), attributes, tracks)


def test_batches_number_tracks_and_rows_as_the_whole_file_does():
    parse = parser(batch([0, 1], ["b", "a"]), batch([2, 3], ["c", ""]))
    whole = read_points(Source("log.rec"), Request(), parse)
    assert whole.ids == ("b", "a", "c", "log")
    assert whole.codes.tolist() == [0, 1, 2, 3]

    parts = list(open_points(Source("log.rec"), Request(), parse, None).batches)
    assert [part.first for part in parts] == [1, 3, 5]
    assert np.concatenate([part.codes for part in parts]).tolist() == [0, 1, 2, 3]


def test_names_of_one_quantity_stand_for_each_other():
    values = np.arange(2.0)
    parse = parser(batch([0, 1], alt=values, course=values + 5, FXA=values, empty=values + np.nan))
    log = read_points(Source("a"), Request(keep=("Elevation", "FXA"), heading=True), parse)
    assert log.attributes["Elevation"].tolist() == [0, 1]
    assert log.attributes["heading"].tolist() == [5, 6]
    assert log.dropped_columns == ()
    log = read_points(Source("a"), Request(), parse)
    assert log.dropped_columns == ("alt", "course", "FXA")
    with pytest.raises(InputError, match="no 'speed' to keep; its points have: alt, course"):
        read_points(Source("a"), Request(keep=("speed",)), parse)


def test_a_file_without_points_says_what_it_holds():
    with pytest.raises(InputError, match="a: no position in this file: 3 waypoints; name a file"):
        read_points(Source("a"), Request(), parser(found=[("waypoints", 3, False)]))


@given(st.lists(st.text(st.characters(exclude_characters="\r\n", codec="utf-8"), max_size=5)))
def test_lines_come_back_whatever_ends_them(lines):
    for end in ("\n", "\r\n", "\r"):
        for encoding in ("utf-8", "utf-16"):
            source = Source("a", data=end.join(lines).encode(encoding))
            found = [line for part in read_lines(source) for line in part.to_pylist()]
            expected = [line.removeprefix("\ufeff") for line in lines[:1]] + lines[1:]
            assert found in (expected or [""], lines)


def test_lines_are_cut_at_no_chunk(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.text_lines._CHUNK_BYTES", 3)
    source = Source("a", data="aé\r\nbcdefgh\r\r\n\nx".encode())
    found = [line for part in read_lines(source) for line in part.to_pylist()]
    assert found == ["aé", "bcdefgh", "", "", "x"]


def test_a_line_without_end_is_refused():
    source = Source("a", data=b"ok\n" + b"x" * 9_000_000)
    with pytest.raises(InputError, match="a: line 2: a line of more than 4 million letters"):
        list(read_lines(source))


def test_a_damaged_gzip_file_is_an_error():
    import gzip

    packed = gzip.compress(b"line\n" * 100)
    with pytest.raises(InputError, match="damaged gzip"):
        list(read_lines(Source("a", data=packed[:-20])))


def test_numbers_that_are_too_large_become_infinite_without_a_warning():
    def parse(_source, _request, _findings):
        yield batch([0, 1], alt=np.array([1e308, 1]) * 10)

    log = read_points(Source("a"), Request(keep=("alt",)), parse)
    assert log.attributes["alt"].tolist() == [np.inf, 10]
