import io
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.nmea.read import read_nmea, read_nmea_batches
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import nmea
from oracle.nmea import gga, gll, rmc, sentence, zda
from random_tests import examples

START = datetime(2021, 3, 7, 10, 29, 29, tzinfo=UTC)
GSV = sentence("GPGSV,4,1,15,01,06,015,,10,30,290,27,12,42,207,26,13,19,141,23")
VTG = sentence("GPVTG,12.5,T,,M,1.946,N,3.604,K,A")


def seconds(count):
    return START + timedelta(seconds=count)


def data(*lines):
    return "\r\n".join(lines).encode() + b"\r\n"


def raw(*lines, **request):
    return read_nmea(Source("log.nmea", data=data(*lines)), Request(**request))


def read(*lines, **options):
    return read_logs(io.BytesIO(data(*lines)), **options)


def count_of(reading, words):
    return sum(repair.count for repair in reading.repairs if words in repair.what)


# Positions and times


_STEP = st.sampled_from([0.2, 1.0, 5.0, 600.0, 30_000.0])
_SHOWN = st.sets(st.sampled_from(["RMC", "GGA", "GLL", "ZDA"]), min_size=1)
_EPOCH = st.tuples(
    _STEP,
    st.floats(-89.9, 89.9),
    st.floats(-179.9, 179.9),
    _SHOWN,
    st.sampled_from(["GP", "GN", "GL"]),
    st.sampled_from("AAAAV"),
    st.sampled_from(["", "12:00:01 ", "\xb5b\x01\x07$", "$GP", GSV]),
)


def lines_of(epochs):
    """Sentences of epochs, with something before each."""
    time = START
    for step, lat, lon, shown, talker, status, before in epochs:
        time += timedelta(seconds=step)
        if "GGA" in shown:
            yield before, gga(time, lat, lon, talker, quality=int(status == "A"))
        if "RMC" in shown:
            yield before, rmc(time, lat, lon, talker, status)
        if "GLL" in shown:
            yield before, gll(time, lat, lon, talker, status)
        if "ZDA" in shown:
            yield before, zda(time, talker)


@examples(100)
@given(st.lists(_EPOCH, min_size=1, max_size=30))
def test_positions_and_times_are_those_of_a_plain_reader(epochs):
    epochs = [(1.0, 48.0, 11.0, {"RMC"}, "GP", "A", ""), *epochs]
    lines = list(lines_of(epochs))
    log = read_nmea(Source("log", data="\n".join(map("".join, lines)).encode("latin-1")), Request())
    expected = nmea.read([line for _, line in lines])

    usable = np.isfinite(log.coordinates).all(axis=1)
    assert log.times[usable].tolist() == [row[0] for row in expected]
    np.testing.assert_allclose(
        log.coordinates[usable], [row[1:] for row in expected], rtol=0, atol=1e-12
    )


def test_sentences_of_one_time_are_one_point_whatever_their_talkers():
    log = raw(
        *(rmc(seconds(i), 48 + i / 1e4, 11, "GN") for i in range(2)),
        gga(seconds(1), 48.5, 11, "GL"),
        VTG,
        gll(seconds(1), 48.1, 11, "GP"),
    )
    # GGA comes before all others.
    assert log.coordinates[:, 0].tolist() == pytest.approx([48, 48.5])


def test_dates_hold_over_midnight_and_before_the_first_one():
    times = [datetime(2020, 2, 28, 23, 59, 58, tzinfo=UTC) + timedelta(seconds=i) for i in range(6)]
    sentences = [gga(time, 48, 11) for time in times]
    sentences.insert(4, zda(times[3]))
    reading = read(*sentences)
    assert reading.tracks[0].times.tolist() == [time.timestamp() for time in times]
    assert count_of(reading, "points without a date dated by") == 5


def test_without_any_date_times_count_from_the_first_midnight():
    times = [datetime(2020, 1, 1, 23, 59, 59, tzinfo=UTC) + timedelta(seconds=i) for i in range(3)]
    log = raw(*(gga(time, 48, 11) for time in times))
    assert log.time_of_day
    assert log.times.tolist() == [86_399, 86_400, 86_401]
    assert [repair.count for repair in log.repairs] == [3]

    # A small step back is a fault, and no midnight.
    with pytest.raises(InputError, match="point 2: the time of day goes back"):
        read(*(gga(seconds(i), 48, 11) for i in (5, 4, 6)))


def test_dates_of_receivers_before_their_first_fix_are_not_trusted():
    wrong = datetime(1980, 1, 6, 10, 29, 27, tzinfo=UTC)
    log = raw(rmc(wrong, 0, 0, status="V"), gga(seconds(0), 48, 11), rmc(seconds(1), 48, 11))
    assert log.times[1:].tolist() == [seconds(0).timestamp(), seconds(1).timestamp()]


@pytest.mark.parametrize("year", [1997, 2079])
def test_dates_that_a_wrong_week_number_explains_are_told(year):
    reading = read(*(rmc(datetime(year, 3, 7, 1, 1, i, tzinfo=UTC), 48, 11) for i in range(3)))
    (repair,) = reading.repairs
    assert "wrong week number" in repair.what
    assert (repair.count, repair.drops, repair.value) == (3, False, f"{year}-03-07")


def test_numbers_of_another_notation_are_neither_degrees_nor_dates():
    rows = ("1e999,N,01131.0,E", "4860.1,N,01131.0,E", "nan,N,01131.0,E", "4807.0,X,01131.0,E")
    bad = [sentence(f"GPRMC,102930,A,{row},,,070321,,") for row in rows]
    dates = [sentence(f"GPZDA,102931,{date}") for date in ("1e999,3,2021", "07,03,1e3", "7,,")]
    reading = read(rmc(seconds(0), 48, 11), *bad, *dates, rmc(seconds(1), 48, 11))
    assert len(reading.tracks[0]) == 2
    assert read(rmc(seconds(0), 48, 11), bad[0], rmc(seconds(2), 48, 11)).lost == 1


def test_times_and_dates_that_are_none_are_no_times():
    good = rmc(seconds(0), 48, 11)
    for time in ("246000", "106100", "10292", "1029290", "nan"):
        bad = sentence(f"GPRMC,{time},A,4807.038,N,01131.000,E,,,070321,,")
        assert count_of(read(good, bad, rmc(seconds(1), 48, 11)), "without a time dropped") == 1
    for date in ("310221", "001021", "071321", "7321"):
        bad = sentence(f"GPRMC,102930,A,4807.038,N,01131.000,E,,,{date},,")
        log = raw(good, bad)
        assert log.times.tolist() == [seconds(0).timestamp(), seconds(1).timestamp()]


# What is left out


def test_damaged_sentences_are_left_out_and_counted():
    lines = [rmc(seconds(i), 48 + i / 1e4, 11) for i in range(30)]
    lines[3] = lines[3].replace("A,48", "A,49")
    lines[4] = lines[4][:40]
    reading = read(*lines)
    assert count_of(reading, "sentences with a wrong checksum") == 2
    assert len(reading.tracks[0]) == 28
    assert reading.complete

    # Many of them are a loss.
    lines[5:10] = [line[:40] for line in lines[5:10]]
    (left_out,) = read(*lines).left_out
    assert left_out.name == "stream: 7 of 30 sentences"
    with pytest.raises(InputError, match="the checksums of all its 30 sentences are wrong"):
        read_logs(io.BytesIO(data(*(line[:-2] + "00" for line in lines[:30]))), format="nmea")


def test_a_log_without_any_checksums_is_read():
    lines = [rmc(seconds(i), 48, 11)[:-3] for i in range(3)]
    assert raw(*lines).times.tolist() == [seconds(i).timestamp() for i in range(3)]
    # With checksums, sentences without one are cut.
    assert len(raw(rmc(seconds(9), 48, 11), *lines).times) == 1


def test_positions_that_are_not_valid_are_dropped_and_counted():
    reading = read(
        sentence("GPRMC,,V,,,,,,,,,,N"),
        sentence("GPGGA,,,,,,0,00,99.99,,,,,,"),
        rmc(seconds(0), 0, 0, status="V"),
        gga(seconds(1), 0, 0, quality=0),
        sentence("GNGNS,102931,5327.03942,N,00214.42462,W,NN,06,5.88,56.0,48.5,,"),
        rmc(seconds(3), 48, 11),
        rmc(seconds(4), 48, 11),
    )
    assert len(reading.tracks[0]) == 2
    assert count_of(reading, "points without a time dropped") == 1
    (void,) = [repair for repair in reading.repairs if "without a position" in repair.what]
    assert void.count == 3
    assert void.value == "status 'not valid'"
    with pytest.raises(InputError, match=r"no point has a position .* status 'not valid'"):
        read(rmc(seconds(0), 48, 11, status="V"))


def test_other_sentences_are_ignored_and_named():
    ships = "!AIVDM,1,1,,A,33P;Tw0tjBQO22:E7dm66DrB20UP,0*2E"
    reading = read(GSV, ships, rmc(seconds(0), 48, 11), GSV, "$PGRME,15.0,M,45.0,M,25.0,M*1C")
    (repair,) = [repair for repair in reading.repairs if "ignored" in repair.what]
    assert (repair.count, repair.value) == (4, "GSV, VDM, PGRME")

    with pytest.raises(InputError, match="only 1 VDM; decode messages of AIS to CSV first"):
        read(ships)
    with pytest.raises(InputError, match=r"only 1 GSV; record RMC or GGA"):
        read(GSV)
    with pytest.raises(InputError, match=r"only dates and speeds; record RMC or GGA"):
        read(zda(seconds(0)), VTG)


# Files


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_files_are_recognised_and_read_in_any_encoding(encoding):
    source = Source("a", data=data(GSV, rmc(seconds(0), 48, 11)).decode().encode(encoding))
    assert format_for_reading(source).name == "nmea"
    assert read_nmea(source, Request()).times.tolist() == [START.timestamp()]


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y\n0,0,0\n",
        "price,note\n$GPS,5\n$GPGLL,5\n",
        "t,lat,lon,note\n0,48,11,$GPRMC*00\n",
        '{"sentence": "none"}',
    ],
)
def test_other_texts_are_no_nmea(text):
    assert format_for_reading(Source("a", data=text.encode())).name != "nmea"


def test_bytes_of_other_protocols_between_sentences_are_passed_over():
    noise = bytes(range(256)).replace(b"$", b"").replace(b"!", b"")
    lines = [rmc(seconds(i), 48, 11).encode() for i in range(5)]
    stream = noise + noise.join(lines) + noise
    source = Source("a", data=stream)
    assert format_for_reading(source).name == "nmea"
    assert len(read_nmea(source, Request()).times) == 5


def test_a_log_is_the_same_in_batches(tmp_path, monkeypatch):
    # Longer than the bytes that are read at a time, with the first date in the last part.
    monkeypatch.setattr("gpszip.io.logs.nmea.sentences._CHUNK_BYTES", 1 << 16)
    count = 3000
    lines = []
    for i in range(count):
        time, lat = seconds(i * 4), 48 + i / 1e5
        lines += [GSV, gga(time, lat, 11)]
        lines += [rmc(time, lat, 11)] if i > 2500 else []
    stream = data(*lines)
    assert len(stream) > 5 << 16
    (tmp_path / "log.nmea").write_bytes(stream)
    (track,) = read_logs(tmp_path / "log.nmea", keep=("alt", "speed")).tracks
    np.testing.assert_array_equal(track.times, START.timestamp() + np.arange(count) * 4.0)
    with store_logs(tmp_path / "log.nmea", rows=1000, keep=("alt", "speed")) as log:
        (only,) = log.tracks
        stored = log.read(only)
        np.testing.assert_array_equal(stored.times, track.times)
        np.testing.assert_allclose(stored.positions, track.positions, atol=1e-3)
        assert log.read_result.repairs == read_logs(tmp_path / "log.nmea").repairs


def test_batches_number_their_points(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.nmea.sentences._CHUNK_BYTES", 1 << 12)
    stream = data(*(rmc(seconds(i), 48, 11) for i in range(200)))
    opened = read_nmea_batches(Source("a", data=stream), Request())
    assert isinstance(opened, LogBatches)
    batches = list(opened.batches)
    assert len(batches) > 2
    for one, other in pairwise(batches):
        assert other.first == one.first + len(one.times)


# Attributes


def test_altitude_speed_course_satellites_and_hdop_can_be_kept():
    lines = (gga(seconds(0), 48, 11), VTG, rmc(seconds(1), 48, 11), gll(seconds(2), 48, 11))
    names = ("ele", "speed", "course", "satellites", "hdop")
    kept = raw(*lines, keep=names).attributes
    assert kept["ele"].tolist()[0] == 36.3
    assert kept["satellites"].tolist()[0] == 8
    assert kept["hdop"].tolist()[0] == 1.16
    # 1.946 and 0.273 knots; of VTG where RMC has none.
    assert kept["speed"].tolist()[:2] == [1.001109, 0.140443]
    assert kept["course"].tolist()[:2] == [12.5, 84.4]
    assert all(np.isnan(values[2]) for values in kept.values())

    assert raw(*lines, heading=True).attributes["heading"].tolist()[1] == 84.4
    assert raw(*lines, keep=("hdop",)).dropped_columns == ("alt", "speed", "course", "satellites")
    with pytest.raises(InputError, match="no 'hr' to keep; its points have: alt, speed, course"):
        raw(*lines, keep=("hr",))
