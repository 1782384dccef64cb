import pickle

import pytest

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
    CorruptArchiveError("torn", 71, path="x.gpsz"),
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
