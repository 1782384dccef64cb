import ast
import pickle
from pathlib import Path

import pytest

import gpszip
from gpszip import errors
from gpszip.errors import (
    CorruptArchiveError,
    InputError,
    MissingExtraError,
    OptionError,
    TrackError,
    UnknownTrackError,
)

FULL = InputError("time goes back 14 s", path="a: b.gpx", location="point 7", remedy="sort")
ERRORS = [
    InputError("plain"),
    FULL,
    FULL.with_path("other.gpx"),
    TrackError("no samples", location="track 'bus'"),
    CorruptArchiveError("torn", 71),
    CorruptArchiveError("torn", 71, path="x.gpsz", remedy="fetch it again"),
    UnknownTrackError("there is no track 'x'"),
    MissingExtraError("plot", "drawing"),
]


def test_a_message_is_made_of_its_fields():
    assert str(FULL) == "a: b.gpx: point 7: time goes back 14 s; sort"
    assert FULL.detail == "point 7: time goes back 14 s; sort"
    assert (FULL.path, FULL.location, FULL.reason, FULL.remedy) == (
        "a: b.gpx",
        "point 7",
        "time goes back 14 s",
        "sort",
    )


def test_a_plain_message_stays_what_it_is():
    error = InputError("walk.gpx: no points")
    assert str(error) == error.reason == error.detail == "walk.gpx: no points"
    assert error.path is error.location is error.remedy is None


def test_a_caller_that_knows_the_file_adds_it():
    error = TrackError("no samples", location="track 'bus'").with_path("log.csv")
    assert isinstance(error, TrackError)
    assert str(error) == "log.csv: track 'bus': no samples"
    assert error.path == "log.csv"
    assert str(FULL.with_path("other.gpx")) == "other.gpx: point 7: time goes back 14 s; sort"
    corrupt = CorruptArchiveError("torn", 71).with_path("x.gpsz")
    assert (str(corrupt), corrupt.offset) == ("x.gpsz: torn (at byte 71)", 71)


def test_a_path_that_is_known_stays():
    assert FULL.located_at("other.gpx") is FULL
    located = TrackError("no samples", location="track 'bus'").located_at("log.csv")
    assert str(located) == "log.csv: track 'bus': no samples"


def test_a_message_can_do_without_its_places():
    assert FULL.advice == "time goes back 14 s; sort"
    assert InputError("plain").advice == "plain"
    corrupt = CorruptArchiveError("torn", 71, path="x.gpsz", remedy="fetch it again")
    assert str(corrupt) == "x.gpsz: torn (at byte 71); fetch it again"
    assert corrupt.remedy == "fetch it again"


@pytest.mark.parametrize("error", ERRORS, ids=str)
def test_errors_come_back_from_other_processes(error):
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert vars(back) == vars(error)


def test_an_unknown_track_is_a_key_and_an_option_error():
    error = UnknownTrackError("there is no track 'x'")
    assert isinstance(error, KeyError)
    assert isinstance(error, OptionError)
    assert str(error) == "there is no track 'x'"


def test_the_tree_in_the_docstring_is_the_tree_of_classes():
    for name in errors.__all__:
        assert name in errors.__doc__


SOURCES = Path(gpszip.__file__).parent


def _names_in_texts(source):
    """Return the lines of errors whose text begins with a value and a colon, as a path would."""
    lines = []
    # Most modules raise none of these errors.
    if not any(f"{name}(" in source for name in errors.__all__):
        return lines
    for call in ast.walk(ast.parse(source)):
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.args):
            continue
        text = call.args[0]
        if call.func.id in errors.__all__ and isinstance(text, ast.JoinedStr):
            first, *others = text.values
            after = others[0].value if others and isinstance(others[0], ast.Constant) else ""
            if isinstance(first, ast.FormattedValue) and after.startswith(": "):
                lines.append(call.lineno)
    return lines


def test_texts_that_begin_with_a_name_are_found():
    bad = 'raise InputError(f"{name}: row {row}: no time; drop it")'
    good = 'raise InputError(f"no time {name}: drop it", path=name)'
    assert _names_in_texts(f"{good}\n{bad}\n") == [2]


def test_names_are_fields_and_not_part_of_texts():
    for path in sorted(SOURCES.rglob("*.py")):
        lines = _names_in_texts(path.read_text(encoding="utf-8"))
        assert not lines, f"{path.relative_to(SOURCES)}, lines {lines}: give path= or location="
