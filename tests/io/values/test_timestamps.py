import io
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, OptionError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds
from random_tests import examples

EIGHT = 1714809600.0  # 2024-05-04T08:00:00Z


def times_of(*cells, unit=None, **options):
    return times_to_seconds(
        pa.chunked_array([list(cells)]), unit, "log.csv", "column 't'", **options
    ).tolist()


def read(text, **options):
    return read_logs(io.BytesIO(text.encode()), **options)


def times_read(text, **options):
    return read(text, **options).tracks[0].times.tolist()


@pytest.mark.parametrize(
    ("cell", "after"),
    [
        ("2024-05-04T08:00:00Z", 0),
        ("2024-05-04t08:00:00z", 0),
        (" 2024-05-04 10:00:00 +0200 ", 0),
        ("2024-05-04T08:00:00 UTC", 0),
        ("2024-05-04T08:00:00-00:00", 0),
        ("2024-05-04T10:00:00+02", 0),
        ("2024-05-04T13:30:00+0530", 0),
        ("2024-05-04T10:00:00+02:00[Europe/Berlin]", 0),
        ("2024-05-04T08:00Z", 0),
        ("2024-05-04T08:00:00,25Z", 0.25),
        ("2024-05-04T08:00:00.123456Z", 0.123456),
        ("2024-05-04T08:00:00.1234567890123456789Z", 0.123456789),
        ("20240504T080000Z", 0),
        ("20240504 080000", 0),
        ("20240504T0800Z", 0),
        ("20240504080000", 0),
        ("2024-05-03T24:00:00Z", -28800),
        ("2024-05-03T23:59:60Z", -28800.5),
        ("2024:05:04 08:00:00", 0),
        ("Sat May  4 08:00:00 2024", 0),
        ("Sat May  4 08:00:00 UTC 2024", 0),
        ("4 May 2024 08:00:00", 0),
        ("04-May-2024 08:00:00", 0),
        ("04-MAY-24 08:00:00 AM", 0),
        ("Sat, 04 May 2024 10:00:00 +0200", 0),
        ("Sat May 04 2024 10:00:00 GMT+0200 (Central European Summer Time)", 0),
        ("May 4, 2024 8:00:00 PM", 43200),
        (
            "Saturday, 4th Sept. 2021 08:00",
            (datetime(2021, 9, 4) - datetime(2024, 5, 4)).total_seconds(),
        ),
        ("04.05.2024 08:00", 0),
        ("4.5.24, 08:00:30", 30),
        ("05/30/2024 12:00:00 AM", 25 * 86400 + 57600),
        ("30/05/2024 12:00:00 PM", 26 * 86400 + 14400),
    ],
)
def test_common_dates_are_read(cell, after):
    assert times_of(cell) == [pytest.approx(EIGHT + after, abs=2.4e-7)]


@pytest.mark.parametrize(
    "cell",
    [
        "2024-02-30T08:00:00Z",
        "2023-02-29",
        "2024-05-04T25:00:00Z",
        "2024-05-04T24:00:01Z",
        "2024-05-04T08:60:00Z",
        "2024-05-04T08:00:61Z",
        "2024-05-04 13:00:00 PM",
        "2024-05-04 00:30:00 AM",
        "2024-05-04T08:00:00+24:00",
        "2024-05-04 08:00:00 CEST",  # names of zones mean several
        "2024-05-04T08:00:00[Europe/Berlin]",
        "32768-01-01T00:00:00Z",
        "99999-01-01T00:00:00Z",
        "0000-01-01T00:00:00Z",
        "-2024-05-04T08:00:00Z",
        "31/31/2024",
        "2024-05-04T08:00:00Zebra",
        "1.5 days",
        "4 Marble 2024",
        "Sunny 4 May 2024",
    ],
)
def test_invalid_dates_are_nan_or_an_error(cell):
    good, bad = times_of("2024-05-04T08:00:00Z", cell)
    assert good == EIGHT
    assert np.isnan(bad)
    with pytest.raises(
        InputError, match=r"log.csv: column 't': .* is no date and time; give ISO 8601"
    ) as caught:
        times_of(cell)
    assert repr(cell)[:20] in str(caught.value)


FORMS = [
    "%Y-%m-%dT%H:%M:%S%z",
    "%Y-%m-%d %H:%M:%S %z",
    "%Y%m%dT%H%M%S%z",
    "%Y/%m/%d %H:%M:%S%z",
    "%a, %d %b %Y %H:%M:%S %z",
    "%d-%b-%Y %H:%M:%S %z",
    "%d.%m.%Y %H:%M:%S %z",
    "%d %B %Y %I:%M:%S %p%z",
]
ZONES = st.integers(-23 * 60, 23 * 60).map(lambda minutes: timezone(timedelta(minutes=minutes)))
MOMENTS = st.datetimes(datetime(1000, 1, 3), datetime(9999, 12, 29), timezones=ZONES)


@examples(50)
@given(st.lists(st.tuples(MOMENTS, st.sampled_from(FORMS)), min_size=1, max_size=20))
def test_all_dates_match_the_calendar(written):
    cells = [moment.strftime(form) for moment, form in written]
    exact = [
        (moment.replace(microsecond=0) - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
        for moment, _ in written
    ]
    assert times_of(*cells) == exact


@examples(50)
@given(
    st.lists(
        st.text(max_size=30) | st.from_regex(r"[0-9T:./ ,+Zz-]{1,40}", fullmatch=True),
        min_size=1,
        max_size=10,
    )
)
def test_any_text_is_a_time_or_nan(cells):
    try:
        times = times_of(*cells)
    except InputError:
        return
    assert len(times) == len(cells)


@pytest.mark.parametrize(
    ("cells", "day_and_month"),
    [
        (["03/04/2024", "31/01/2024"], [(3, 4), (31, 1)]),
        (["03/04/2024", "01/31/2024"], [(4, 3), (31, 1)]),
        (["03.04.2024", "04.05.2024"], [(3, 4), (4, 5)]),
        (["03.04.2024", "04.30.2024"], [(4, 3), (30, 4)]),
        (["30-07-2024", "31-07-2024"], [(30, 7), (31, 7)]),
        (["4/5/24", "4/30/24"], [(5, 4), (30, 4)]),
        (["3/4/24", "45/45/2024", "31/1/24"], [(3, 4), None, (31, 1)]),
    ],
)
def test_all_cells_decide_the_order_of_day_and_month(cells, day_and_month):
    expected = [
        np.nan if date is None else datetime(2024, date[1], date[0], tzinfo=UTC).timestamp()
        for date in day_and_month
    ]
    np.testing.assert_equal(times_of(*cells), expected)


def test_ambiguous_orders_are_refused_with_all_readings():
    with pytest.raises(InputError) as caught:
        times_of("03/04/2024 08:00", "04/04/2024 08:00")
    assert str(caught.value) == (
        "log.csv: column 't': '03/04/2024 08:00' can be 3 Apr 2024 or 4 Mar 2024; "
        "say which: --dates dmy or --dates mdy"
    )
    with pytest.raises(
        InputError,
        match=r"can be 7 Jun 2008 or 6 Jul 2008 or 8 Jun 2007; say which: .* --dates ymd",
    ):
        times_of("07/06/08")
    with pytest.raises(
        InputError,
        match=r"'(31/01|01/31)/2024' and '(31/01|01/31)/2024' are in different orders",
    ):
        times_of("31/01/2024", "01/31/2024")


def test_the_user_or_the_column_name_decides_the_order():
    text = "03/04/2024 08:00,1,0\n04/04/2024 08:00,2,0\n"
    april, march = (
        datetime(2024, month, day, 8, tzinfo=UTC).timestamp() for day, month in ((3, 4), (4, 3))
    )
    assert times_read("time,x,y\n" + text, dates="dmy")[0] == april
    assert times_read("time,x,y\n" + text, dates="mdy")[0] == march
    assert times_read("time (DD/MM/YYYY hh:mm),x,y\n" + text)[0] == april
    assert times_of("24/05/04", dates="ymd") == [datetime(2024, 5, 4, tzinfo=UTC).timestamp()]
    with pytest.raises(OptionError, match="'us' is not one of dmy, mdy, ymd"):
        read("time,x,y\n" + text, dates="us")


def test_years_from_1_to_9999():
    assert times_of("0001-01-01T00:00:00Z", "9999-12-31T24:00:00Z") == [-62135596800, 253402300800]


def test_two_digit_years():
    times = times_of("1.1.68", "1.1.69", "1-Jan-99", "1-Jan-00")
    years = [datetime.fromtimestamp(time, UTC).year for time in times]
    assert years == [2068, 1969, 1999, 2000]


@pytest.mark.parametrize(
    ("header", "first", "second"),
    [
        ("date,time", "2024-05-04,8:00:00", "2024-05-04,08:00:30.5"),
        ("Date(UTC),Time(UTC)", "2024-05-04,08:00:00", "2024-05-04,08:00:30.5"),
        ("date,time", "20240504,80000", "20240504,80030.5"),
        ("date,time", "20240504,080000", "20240504,080030.5"),
        ("date,time", "5/30/24,8:00:00", "5/30/24,8:00:30.5"),
        ("date,time", "04.05.2024,8:00:00 AM", "04.05.2024,8:00:30.5 AM"),
        ("date,time", "2024-05-04 00:00:00,08:00:00", "2024-05-04 00:00:00,08:00:30.5"),
        ("date,time", "2024-05-04,2024-05-04T08:00:00Z", "2024-05-04,2024-05-04T08:00:30.5Z"),
        ("date,time", ",1714809600", ",1714809630.5"),
        ("date_ddmmyy,time", "040524,080000.00", "040524,080030.50"),
    ],
)
def test_date_and_time_of_day_in_two_columns(header, first, second):
    header = header.replace("date_ddmmyy", "Date (ddmmyy)")
    times = times_read(f"{header},x,y\n{first},0,0\n{second},1,1\n")
    day = 26 * 86400 if "5/30" in first else 0
    assert times == [EIGHT + day, EIGHT + day + 30.5]


def test_ambiguous_pairs_of_columns_are_refused():
    with pytest.raises(
        InputError, match="'04-05-24 08:00:00' can be 4 May 2024 or 5 Apr 2024 or 24 May 2004"
    ):
        read("date,time,x,y\n040524,080000,0,0\n040524,080001,1,1\n")
    with pytest.raises(
        InputError,
        match="column 'time': '100' can be seconds or hhmmss; if seconds, say so: --time-unit s",
    ):
        read("date,time,x,y\n20240504,5,0,0\n20240504,100,1,1\n")
    assert times_read("date,time,x,y\n20240504,5,0,0\n20240504,100,1,1\n", time_unit="s") == [
        5,
        100,
    ]
    assert times_read("date,time,x,y\n20240504,5,0,0\n20240504,75,1,1\n20240504,100,1,1\n") == [
        5,
        75,
        100,
    ]


def test_arrow_times_with_a_date_column():
    stream = io.BytesIO()
    clock = pa.array([28_800_000_000, 28_801_500_000], pa.time64("us"))
    table = pa.table(
        {
            "date": pa.array([19847, 19847], pa.date32()),
            "time": clock,
            "x": [0.0, 1.0],
            "y": [0.0, 0.0],
        }
    )
    pq.write_table(table, stream)
    assert read_logs(io.BytesIO(stream.getvalue())).tracks[0].times.tolist() == [EIGHT, EIGHT + 1.5]
    pq.write_table(table.drop(["date"]), stream := io.BytesIO())
    assert read_logs(io.BytesIO(stream.getvalue())).tracks[0].times.tolist() == [28800, 28801.5]


@pytest.mark.parametrize(
    "column",
    [
        pa.array([b"2024-05-04T08:00:00Z", b"2024-05-04T08:00:01Z"]),
        pa.array(["2024-05-04T08:00:00Z", "2024-05-04T08:00:01Z"]).dictionary_encode(),
        pa.array([1714809600, 1714809601]).dictionary_encode(),
        pa.array(["2024-05-04T10:00:00+0200", "2024-05-04T10:00:01+0200"], pa.large_string()),
        pa.array([1714809600000, 1714809601000], pa.timestamp("ms", "Europe/Berlin")),
        pa.array([20240504080000, 20240504080001]),
    ],
)
def test_parquet_types(column, tmp_path):
    pq.write_table(
        pa.table({"time": column, "x": [0.0, 1.0], "y": [0.0, 0.0]}), tmp_path / "log.parquet"
    )
    assert read_logs(tmp_path / "log.parquet").tracks[0].times.tolist() == [EIGHT, EIGHT + 1]
    with store_logs(tmp_path / "log.parquet", rows=1000) as log:
        assert log.read(log.tracks[0]).times.tolist() == [EIGHT, EIGHT + 1]


@pytest.mark.parametrize(
    "column", [pa.array([True, False]), pa.array([[1], [2]]), pa.array([b"\xff\xfe", b"\xff"])]
)
def test_other_parquet_types_are_no_times(column):
    pq.write_table(
        pa.table({"time": column, "x": [0.0, 1.0], "y": [0.0, 0.0]}), stream := io.BytesIO()
    )
    with pytest.raises(InputError, match="column 'time' holds"):
        read_logs(io.BytesIO(stream.getvalue()))


@pytest.mark.parametrize(
    ("cells", "unit", "expected"),
    [
        ([1700000000], None, [1.7e9]),
        ([1700000000077], None, [1700000000.077]),
        (["1.7e9", "-5"], None, [1.7e9, -5]),
        ([-1700000000077, -1700000000076], None, [-1700000000.077, -1700000000.076]),
        ([1700000000077123456, 1700000000154000000], None, [1700000000.0771234, 1700000000.154]),
        ([1.7000000000771236e18], None, [1700000000.0771236]),
        ([0, 1500], "ms", [0, 1.5]),
        ([0.5], "days", [43200]),
        ([25569.5, 45416.33333333], "excel", [43200, EIGHT]),
        (["739376.3333333334"], "matlab", [EIGHT]),
    ],
)
def test_numbers_in_any_unit(cells, unit, expected):
    options = {} if unit is None else {"origin": unit_origin(unit)}
    assert (
        times_of(*cells, unit=None if unit is None else unit_seconds(unit), **options) == expected
    )


def test_durations_are_times():
    column = pa.chunked_array([pa.array([1500, None], pa.duration("ms"))])
    np.testing.assert_equal(times_to_seconds(column, None, "a.csv", "t"), [1.5, np.nan])


def test_most_cells_decide_between_numbers_and_dates():
    np.testing.assert_equal(
        times_of("2024-05-04T08:00:00Z", "0", "2024-05-04T08:00:01Z"), [EIGHT, np.nan, EIGHT + 1]
    )
    np.testing.assert_equal(times_of("1", "2", "2024-05-04"), [1, 2, np.nan])


def test_times_of_day_without_date_count_from_midnight():
    result = read("time,x,y\n08:00:00,0,0\n08:00:05.5,1,1\n")
    assert result.tracks[0].times.tolist() == [28800, 28805.5]
    assert [(repair.what, repair.count, repair.drops) for repair in result.repairs] == [
        ("times of day without a date read as seconds from midnight", 2, False)
    ]


def log_at(times):
    """A CSV log with a position at each time."""
    lines = [f"{time},{48 + i / 1e4:.4f},{11 + i / 1e4:.4f}" for i, time in enumerate(times)]
    return io.BytesIO("\n".join(["utc,lat,lon", *lines]).encode())


@pytest.mark.parametrize("first", [28_860, 36_000])
def test_numbers_that_step_like_a_clock_are_refused(first):
    clock = [f"{t // 3600:02d}{t // 60 % 60:02d}{t % 60:02d}" for t in range(first, first + 90)]
    with pytest.raises(
        InputError,
        match=f"{clock[0]} and the numbers after it step like hours, minutes .*--time-unit s",
    ):
        read_logs(log_at(clock))
    assert len(read_logs(log_at(clock), time_unit="s").tracks[0]) == 90


def test_padded_numbers_within_a_minute_are_refused():
    with pytest.raises(InputError, match="write 08:01:00"):
        read_logs(log_at([f"0801{second:02d}" for second in range(30)]))


@pytest.mark.parametrize("step", [1, 20, 50, 100, 600])
def test_regular_seconds_are_seconds(step):
    times = [step * i for i in range(60)]
    assert read_logs(log_at(times)).tracks[0].times.tolist() == times
