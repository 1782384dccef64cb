from datetime import UTC, date, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OptionError
from gpszip.model.timestamps import to_seconds, wrong_unit

NOON = datetime(2024, 5, 1, 12, 0, 0, 250_000, tzinfo=UTC)
SECONDS = 1_714_564_800.25


@pytest.mark.parametrize(
    "time",
    [
        NOON,
        NOON.replace(tzinfo=None),
        NOON.astimezone(timezone(timedelta(hours=-7))),
        np.datetime64("2024-05-01T12:00:00.250"),
        np.datetime64("2024-05-01T12:00:00.250000000"),
        "2024-05-01T12:00:00.250Z",
        "2024-05-01 14:00:00.250+02:00",
        SECONDS,
        np.float64(SECONDS),
    ],
)
def test_one_time_in_any_form(time):
    assert to_seconds(time).shape == ()
    assert float(to_seconds(time)) == SECONDS
    assert to_seconds([time, time]).tolist() == [SECONDS, SECONDS]
    assert to_seconds(np.array([[time]])).tolist() == [[SECONDS]]


def test_dates_and_mixed_lists():
    mixed = [date(1970, 1, 2), "1970-01-03", 5, np.datetime64("1970-01-01", "D")]
    assert to_seconds(mixed).tolist() == [86400.0, 172800.0, 5.0, 0.0]
    assert to_seconds([]).tolist() == []
    assert to_seconds(range(3)).tolist() == [0.0, 1.0, 2.0]
    assert np.isnan(to_seconds(np.array(["NaT", "2024"], "datetime64[s]"))[0])


@given(st.datetimes(datetime(1800, 1, 1), datetime(2500, 1, 1)))
def test_datetimes_and_numpy_agree(moment):
    exact = (moment - datetime(1970, 1, 1)) / timedelta(seconds=1)
    assert float(to_seconds(moment)) == pytest.approx(exact, abs=1e-6)
    assert float(to_seconds(np.datetime64(moment))) == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(
    "bad", ["noon", "12.5", None, True, [[1.0], [2.0, 3.0]], timedelta(1), np.timedelta64(1, "s")]
)
def test_what_is_no_time_is_refused_by_name(bad):
    with pytest.raises(OptionError, match="when"):
        to_seconds(bad, name="when")


EPOCH = (1_400_000_000.0, 1_400_005_000.0)
OWN_ZERO = (0.0, 5000.0)


@pytest.mark.parametrize(
    ("times", "span", "says"),
    [
        ([12.0, 13.5], EPOCH, "12 looks like seconds from the start of the log: add 1400000000"),
        ([1.400001e12], EPOCH, "milliseconds: divide by 1000"),
        ([1.400001e15], EPOCH, "microseconds: divide by 1e6"),
        ([1.400001e18], EPOCH, "nanoseconds: divide by 1e9"),
        ([1.400001e12], OWN_ZERO, "milliseconds"),
        ([1.4e9], OWN_ZERO, "a date, or seconds since 1970"),
    ],
)
def test_another_unit_is_recognised(times, span, says):
    assert says in wrong_unit(np.array(times), *span)


@pytest.mark.parametrize(
    ("times", "span"),
    [
        ([1_400_002_000.0, 12.0], EPOCH),  # one of them lies in the log
        ([1_399_000_000.0], EPOCH),  # before it
        ([1.5e9], EPOCH),  # after it
        ([-5.0], OWN_ZERO),
        ([60_000.0], OWN_ZERO),
        ([np.nan], EPOCH),
        ([], EPOCH),
    ],
)
def test_a_time_that_the_log_does_not_cover_is_a_fair_question(times, span):
    assert wrong_unit(np.array(times), *span) is None
