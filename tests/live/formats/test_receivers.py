"""NMEA, gpsd and lines of text."""

from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.nmea.read import read_nmea
from gpszip.io.logs.raw import Request
from gpszip.io.storage.source import Source
from gpszip.live import Fix, Unusable
from gpszip.live.formats.gpsd import GpsdParser
from gpszip.live.formats.nmea import NmeaParser
from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context
from live import bodies

CONTEXT = Context(bodies.TIME + 3.0, "test")


def sentence(body):
    return f"${body}*{reduce(lambda a, b: a ^ b, body.encode()):02X}".encode()


def parse(parser, lines, context=CONTEXT):
    found = [item for line in lines for item in parser.push(line, context)]
    return [*found, *parser.finish(context)]


def drive(count=30, first=86_390):
    """Sentences of a receiver that goes over midnight, with dates in some of them only."""
    lines = []
    for second in range(first, first + count):
        clock = second % 86_400
        time = f"{clock // 3600:02}{clock // 60 % 60:02}{clock % 60:02}.00"
        day = 17 + second // 86_400
        minutes = 7.0 + (second - first) / 1000
        place = f"48{minutes:07.4f},S,011{31.0:07.4f},W"
        lines.append(sentence(f"GPGGA,{time},{place},1,08,0.9,545.4,M,46.9,M,,"))
        if second % 3 == 0:
            lines.append(sentence(f"GNRMC,{time},A,{place},9.72,84.4,{day:02}1126,,,A"))
        lines.append(sentence("GPGSV,1,1,00"))
    return lines


def test_live_sentences_give_what_the_log_gives():
    # The log knows later dates than the first sentence, so it begins with one here.
    lines = drive(first=86_391)[1:]
    fixes = parse(NmeaParser("boat"), lines)
    log = read_nmea(Source("a.nmea", data=b"\r\n".join(lines)), Request(keep=("speed",)))
    assert [fix.time for fix in fixes] == log.times.tolist()
    np.testing.assert_allclose([fix.position for fix in fixes], log.coordinates, atol=1e-9)
    speeds = [np.nan if fix.speed is None else fix.speed for fix in fixes]
    np.testing.assert_allclose(speeds, log.attributes["speed"], atol=1e-5)


def test_a_receiver_without_dates_has_those_of_the_clock():
    # Received three seconds after 11:06:40.
    lines = [sentence("GPGLL,4808.0,N,01134.0,E,110640,A,A")]
    assert parse(NmeaParser("boat"), lines)[0].time == bodies.TIME
    # A second before midnight, received a second after it.
    midnight = bodies.TIME - 40_000 + 86_400
    lines = [sentence("GPGLL,4808.0,N,01134.0,E,235959,A,A")]
    context = Context(midnight + 1.0, "t")
    assert parse(NmeaParser("boat"), lines, context)[0].time == midnight - 1


@pytest.mark.parametrize("date", ["2208-1", "220899999", "310226", ""])
def test_nonsense_in_a_date_is_replaced_by_the_clock(date):
    lines = [sentence(f"GPRMC,110640,A,4808.0,N,01134.0,E,0,0,{date},,")]
    assert parse(NmeaParser("boat"), lines)[0].time == bodies.TIME


@pytest.mark.parametrize(
    "body",
    [
        "GPRMC,110640,V,4808.0,N,01134.0,E,0,0,181126,,",
        "GPGGA,110640,4808.0,N,01134.0,E,0,00,,,M,,M,,",
        "GNGNS,110640,4808.0,N,01134.0,E,NN,00,,,,,",
    ],
)
def test_a_position_without_a_fix_is_none(body):
    (item,) = parse(NmeaParser("boat"), [sentence(body)])
    assert "not valid" in item.reason


def test_damaged_sentences_are_counted():
    good = sentence("GPGLL,4808.0,N,01134.0,E,110640,A,A")
    found = parse(NmeaParser("boat"), [good[9:], good.replace(b"4808", b"4809"), b"!AIVDM,x", good])
    assert [type(item) for item in found] == [Unusable, Unusable, Fix]
    assert "no sentence" in found[0].reason
    assert "checksum" in found[1].reason


def tpv(**more):
    report = {"class": "TPV", "device": "/dev/gps0", "mode": 3, "lat": 48.0, "lon": 11.0}
    return report | {"time": f"{bodies.ISO}.000Z", "speed": 5.0, "track": 270.0} | more


def test_gpsd_reports():
    parser = GpsdParser()
    (fix,) = parser.parse(tpv(eph=7.5), CONTEXT)
    assert (fix.agent, fix.time, fix.position) == ("/dev/gps0", bodies.TIME, (48.0, 11.0))
    assert (fix.accuracy, fix.heading, fix.speed) == (7.5, 270.0, 5.0)
    assert parser.parse({"class": "SKY"}, CONTEXT) == []
    # Mode 1 may come with the last position; a fix may come without a time.
    assert "without a fix" in parser.parse(tpv(mode=1), CONTEXT)[0].reason
    (timeless,) = parser.parse({**tpv(), "time": None}, CONTEXT)
    assert (timeless.time, timeless.quality) == (CONTEXT.received, "arrival")


def test_gpsd_reports_one_epoch_once():
    parser = GpsdParser()
    times = [f"{bodies.ISO}.{part}Z" for part in ("0000", "0015", "1000")]
    found = [parser.parse(tpv(time=time), CONTEXT)[0] for time in times]
    assert [type(item) for item in found] == [Fix, Unusable, Fix]
    other = parser.parse(tpv(time=f"{bodies.ISO}.1015Z", device="/dev/gps1"), CONTEXT)
    assert isinstance(other[0], Fix)


def test_tables():
    def fixes(text, **options):
        return parse(TextParser("log", **options), text.encode().split(b"\n"))

    table = f"Device ID;Longitude;Latitude;GPS Time;Accuracy\nann;11;48;{bodies.ISO}Z;12\n"
    (fix,) = fixes(table)
    assert (fix.agent, fix.time, fix.position) == ("ann", bodies.TIME, (48.0, 11.0))
    assert fix.accuracy == 12
    (fix,) = fixes("time_ms,x,y,z\n7500,1,2,3\n")
    assert (fix.agent, fix.time, fix.position, fix.geographic) == ("log", 7.5, (1, 2, 3), False)
    (fix,) = fixes("when,a,b\n7,1,2\n", columns={"t": "when", "x": "a", "y": "b"})
    assert fix.position == (1, 2)
    (fix,) = fixes("date,time,lat,lon\n2026-11-18,11:06:40,1,2")
    assert fix.time == bodies.TIME
    found = fixes('t,x,y\n1,2\n1,2,"\nnoon,1,2\n1,,2\n2,3,4')
    assert [type(item) for item in found] == [Unusable] * 4 + [Fix]
    with pytest.raises(InputError, match="needed"):
        fixes("hello world\n1\n")


def test_lines_of_json():
    parser = TextParser("log")
    lines = [
        b'{"id": "ann", "timestamp": 1795000000, "lat": 1, "lon": 2}',
        b'{"_type": "location", "tid": "bo", "tst": 1795000000, "lat": 1, "lon": 2}',
        b'{"class": "TPV", "mode": 3, "time": "2026-11-18T11:06:40Z", "lat": 1, "lon": 2}',
        b'{"class": "VERSION"}',
        b'{"class": "car", "timestamp": 1795000000, "lat": 1, "lon": 2}',
        b'{"speed": 1}',
        b"{",
    ]
    found = parse(parser, lines)
    assert [item.agent for item in found] == ["ann", "bo", "gpsd", "log", "log", "log"]
    assert [item.time for item in found[:4]] == [bodies.TIME] * 4
    assert all(isinstance(item, Unusable) for item in found[4:])


@given(st.lists(st.binary(max_size=40) | st.sampled_from(drive(2)), max_size=6))
def test_no_line_raises(lines):
    for parser in (NmeaParser("boat"), TextParser("log", {"t": "a", "x": "b", "y": "c"})):
        first = [] if isinstance(parser, NmeaParser) else [b"a,b,c"]
        for item in parse(parser, [*first, *lines]):
            assert isinstance(item, Fix | Unusable)
