import pytest

from gpszip.cli.times import parse_times
from gpszip.errors import InputError, OptionError


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("5", [5.0]),
        ("1e3, -2", [1000.0, -2.0]),
        ("1970-01-01T00:01:00Z", [60.0]),
        ("1970-01-01T01:01:00+01:00", [60.0]),
        ("1970-01-02", [86400.0]),
    ],
)
def test_lists(text, times):
    assert parse_times(text) == times


@pytest.mark.parametrize("text", ["t\n5\n6\n", "5,start\n6,end\n", "5\n\n6"])
def test_files(tmp_path, text):
    path = tmp_path / "when.txt"
    path.write_text(text)
    assert parse_times(str(path)) == [5.0, 6.0]


def test_a_line_without_a_time_is_named(tmp_path):
    path = tmp_path / "when.txt"
    path.write_text("5\nsix\n")
    with pytest.raises(InputError, match="line 2: 'six' is no time"):
        parse_times(str(path))


@pytest.mark.parametrize("data", [b"", b"t\n", b"\xff\xfe\xff"])
def test_files_without_times(tmp_path, data):
    path = tmp_path / "when.txt"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"when\.txt"):
        parse_times(str(path))


def test_neither_times_nor_a_file():
    with pytest.raises(OptionError, match="'noon' is no time"):
        parse_times("5,noon")


@pytest.mark.parametrize("text", ["nan", "5,inf", "-Infinity"])
def test_numbers_that_are_not_finite_are_no_times(text):
    with pytest.raises(OptionError, match="is no time"):
        parse_times(text)
