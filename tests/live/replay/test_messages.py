"""Messages of replay are read back as the samples that they were made of."""

import json
from urllib.parse import parse_qsl, unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OptionError
from gpszip.live.formats.apps import App, parse_message
from gpszip.live.formats.nmea import NmeaParser
from gpszip.live.formats.query import parse_query
from gpszip.live.formats.values import Context
from gpszip.live.replay.messages import APPS, Sample, app_message, nmea_sentences

CONTEXT = Context(1.8e9, "test")

samples = st.builds(
    Sample,
    track=st.text("abcß /&?", min_size=1, max_size=9).filter(str.strip).map(str.strip),
    time=st.floats(3.2e8, 1.9e9).map(lambda time: round(time, 3)),
    latitude=st.floats(-90, 90),
    longitude=st.floats(-180, 180),
)


def read(app, message):
    """Fixes of a request, as the server finds them."""
    path, _, query = message.path.partition("?")
    fields = dict(parse_qsl(query))
    agent = fields.get("u") or unquote(path.strip("/"))
    context = Context(1.8e9, "test", agent)
    if message.body is None:
        return parse_query(fields, context)
    return parse_message(App(app), json.loads(message.body), context)


@pytest.mark.parametrize("app", APPS)
@given(sample=samples)
def test_every_app_says_what_the_sample_says(app, sample):
    (fix,) = read(app, app_message(app, [sample]))
    assert (fix.agent, fix.time) == (sample.track, pytest.approx(sample.time, abs=1e-6))
    assert fix.position == pytest.approx((sample.latitude, sample.longitude), abs=1e-9)
    assert (fix.speed, fix.heading, fix.accuracy) == (None, None, None)


def test_overland_sends_batches():
    batch = [Sample("a", 1.7e9 + t, 48.0, 11.0) for t in range(5)]
    fixes = read("overland", app_message("overland", batch))
    assert [fix.time for fix in fixes] == [sample.time for sample in batch]


@given(samples)
def test_sentences_say_what_the_sample_says(sample):
    lines = nmea_sentences(sample).splitlines()
    parser = NmeaParser("boat")
    assert all(parser.push(line, CONTEXT) == [] for line in lines)
    (fix,) = parser.finish(CONTEXT)
    assert fix.time == pytest.approx(sample.time, abs=1e-3)
    assert fix.position == pytest.approx((sample.latitude, sample.longitude), abs=2e-9)


@pytest.mark.parametrize(("latitude", "longitude"), [(48.1234567, 11.7654321), (-0.5, -179.99999)])
def test_another_reader_reads_the_same_sentences(latitude, longitude):
    pynmeagps = pytest.importorskip("pynmeagps")
    lines = nmea_sentences(Sample("a", 1.795e9, latitude, longitude)).splitlines(keepends=True)
    rmc, gga = (pynmeagps.NMEAReader.parse(line) for line in lines)
    assert (rmc.msgID, gga.msgID, rmc.status, gga.quality) == ("RMC", "GGA", "A", 1)
    for parsed in (rmc, gga):
        assert (parsed.lat, parsed.lon) == pytest.approx((latitude, longitude), abs=1e-6)


def test_years_that_two_digits_cannot_tell_are_refused():
    with pytest.raises(OptionError, match="no year 1970"):
        nmea_sentences(Sample("a", 7.0, 1.0, 2.0))
