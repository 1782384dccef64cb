import io
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.igc import read_igc
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import igc

START = datetime(2022, 8, 5, 23, 59, 58, tzinfo=UTC)


def fixes(count, **how):
    return [igc.fix(START + timedelta(seconds=i), 48 + i / 1e3, -11.5, **how) for i in range(count)]


def raw(*lines, **request):
    data = "\r\n".join(lines).encode("latin-1")
    return read_igc(Source("flight.igc", data=data), Request(**request))


def read(*lines, **options):
    return read_logs(io.BytesIO("\r\n".join(lines).encode("latin-1")), **options)


_STEPS = st.lists(
    st.tuples(
        st.integers(1, 40_000),
        st.floats(-89.99, 89.99),
        st.floats(-179.99, 179.99),
        st.sampled_from("AAAV"),
        st.booleans(),
    ),
    min_size=1,
    max_size=20,
)


@given(_STEPS)
def test_positions_and_times_are_those_of_a_plain_reader(steps):
    # Some flights repeat the date, also where a new day begins.
    time, lines = START, ["AXXX", igc.date(START), igc.fix(START, 1, 1)]
    for step, lat, lon, validity, repeats in steps:
        time += timedelta(seconds=step)
        lines += [igc.date(time)] * repeats + ["LPLTLOG", igc.fix(time, lat, lon, validity)]
    log = raw(*lines)
    rows = igc.read(lines)
    assert log.times.tolist() == [row[0] for row in rows]
    np.testing.assert_allclose(log.coordinates, [row[1:] for row in rows], rtol=0, atol=1e-11)


@pytest.mark.parametrize("header", ["HFDTE050822", "HFDTEDATE:050822,01", "HODTE: 050822"])
def test_dates_hold_over_midnight(header):
    log = raw("AXXX", header, *fixes(4))
    assert log.times.tolist() == [START.timestamp() + i for i in range(4)]


def test_a_date_between_chunks_holds_for_the_next_fix(monkeypatch):
    lines = ["AXXX", igc.date(START), *fixes(2), igc.date(START + timedelta(days=1)), *fixes(4)[2:]]
    for size in range(20, 200, 7):
        monkeypatch.setattr("gpszip.io.logs.text_lines._CHUNK_BYTES", size)
        assert raw(*lines).times.tolist() == [START.timestamp() + i for i in range(4)]


def test_fixes_before_the_first_date_are_dated_and_counted():
    log = raw("AXXX", "HFDTE000000", *fixes(2), igc.date(START), fixes(3)[2])
    assert [repair.count for repair in log.repairs] == [2]
    assert log.times[0] == START.timestamp()
    with pytest.raises(InputError, match="no date"):
        raw("AXXX", *fixes(2))


def test_fixes_that_are_void_or_damaged_are_dropped_and_counted():
    bad = ["B12345", "B2359594800000N01130000XA0000000000", fixes(1)[0].replace("B2", "Bx")]
    reading = read("AXXX", igc.date(START), *fixes(3), *bad, *fixes(5, validity="V")[3:])
    counts = {repair.what: repair.count for repair in reading.repairs}
    assert (reading.points, reading.kept) == (8, 3)
    assert counts["fixes that can't be read dropped"] == 3
    assert counts["fixes marked V, without a valid position, dropped"] == 2


def test_impossible_times_and_minutes_are_no_times_and_minutes():
    good = fixes(3)
    bad = [
        good[0].replace("B235958", "B246199"),
        igc.fix(START, 48, 11).replace("4800000", "4860000"),
    ]
    reading = read("AXXX", igc.date(START), *good, *bad)
    assert (reading.points, reading.kept) == (5, 3)


def test_a_flight_of_void_fixes_is_refused():
    with pytest.raises(InputError, match="no valid fix in this flight: 3 fixes marked V"):
        raw("AXXX", igc.date(START), *fixes(3, validity="V"))


def test_extensions_are_kept_by_their_codes_and_refine_fixes():
    # Accuracy, digits of latitude and longitude, decimals of seconds.
    lines = ["AXXX", igc.date(START), "I043638FXA3940LAD4141LOD4244TDS"]
    log = raw(*lines, *fixes(2, more="0125075 0"), keep=("alt", "pressure_alt", "fxa"))
    assert log.attributes["alt"].tolist() == [421, 421]
    assert log.attributes["pressure_alt"].tolist() == [280, 280]
    assert log.attributes["fxa"].tolist() == [12, 12]
    expected = igc.read([*lines, *fixes(2)])[0]
    assert log.coordinates[0, 0] == pytest.approx(expected[1] + 0.50 / 60_000, abs=1e-12)
    assert log.coordinates[0, 1] == pytest.approx(-(11.5 + 0.7 / 60_000), abs=1e-12)
    with pytest.raises(InputError, match="no 'enl' to keep; its points have: alt, pressure_alt"):
        raw(*lines, *fixes(2), keep=("enl",))


def test_files_are_known_by_their_content():
    data = "\n".join(["HFDTE050822", *fixes(2)]).encode()
    assert format_for_reading(Source("a.txt", data=data)).name == "igc"
    assert format_for_reading(Source("a", data=b"\xef\xbb\xbfAXXX\r" + data)).name == "igc"
    text = b"AXXX,t\n1,2\n"
    assert format_for_reading(Source("a.csv", data=text)).name == "csv"
