import io

import numpy as np
import pytest

from gpszip.io.large.store import store_logs
from gpszip.io.logs.ais import read_ais, read_ais_batches
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source

DANISH = (
    "# Timestamp,Type of mobile,MMSI,Latitude,Longitude,Navigational status,ROT,SOG,COG,Heading"
)
AMERICAN = "MMSI,BaseDateTime,LAT,LON,SOG,COG,Heading,VesselName"
NEW_AMERICAN = "mmsi,base_date_time,longitude,latitude,sog,cog,heading,vessel_name"


def danish(clock, ship, lat, lon, sog="10.5", cog="90.0", heading="91", date="03/04/2024"):
    return f"{date} {clock},Class A,{ship},{lat},{lon},Under way,0.0,{sog},{cog},{heading}"


def text(header, *rows):
    return "\n".join([header, *rows, ""]).encode()


DAY = text(
    DANISH,
    *(danish(f"00:00:{i:02}", 219000001 + i % 2, 55 + i / 1e3, 12) for i in range(20)),
)


def test_dates_of_danish_files_begin_with_the_day():
    reading = read_logs(io.BytesIO(DAY))
    assert [track.id for track in reading] == ["219000001", "219000002"]
    start = np.datetime64("2024-04-03T00:00:00").astype(float)
    assert reading.tracks[0].times.tolist() == [start + i for i in range(0, 20, 2)]
    stated = read_logs(io.BytesIO(DAY), dates="mdy")
    assert stated.tracks[0].times[0] == np.datetime64("2024-03-04T00:00:00").astype(float)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        (AMERICAN, "{ship},2024-01-01T00:0{i}:00,47.{i},-122.5,0.{i},10,12,A"),
        (NEW_AMERICAN, "{ship},2024-01-01 00:0{i}:00,-122.5,47.{i},0.{i},10,12,A"),
    ],
)
def test_american_files_of_all_years_are_read(header, row):
    # A ship may have a single row.
    rows = [row.format(ship=366000001 + i // 3, i=i) for i in range(4)]
    log = read_ais(Source("ais.csv", data=text(header, *rows)), Request(heading=True))
    assert log.ids == ("366000001", "366000002")
    assert log.coordinates.tolist() == [[47 + i / 10, -122.5] for i in range(4)]
    assert log.times.tolist() == [1704067200.0 + 60 * i for i in range(4)]
    assert log.attributes["heading"].tolist() == [12] * 4


def test_numbers_that_stand_for_no_value_are_none():
    rows = [
        danish("00:00:01", 1, 55, 12),
        danish("00:00:02", 1, 91, 12, "102.3", "360.0", "511"),
        danish("00:00:03", 1, 55, 181),
        danish("00:00:04", 1, 55.1, 12, "", "", ""),
    ]
    reading = read_logs(io.BytesIO(text(DANISH, *rows)), keep=("SOG", "COG", "Heading"))
    assert (reading.points, reading.kept) == (4, 2)
    (repair,) = reading.repairs
    assert (repair.what, repair.value) == ("rows without a position dropped", "Latitude '91'")
    log = read_ais(
        Source("a", data=text(DANISH, *rows)), Request(keep=("SOG", "COG", "Heading", "ROT"))
    )
    for name, value in (("SOG", 10.5), ("COG", 90), ("Heading", 91)):
        np.testing.assert_equal(log.attributes[name], [value, np.nan, value, np.nan])
    assert log.attributes["ROT"].tolist() == [0] * 4


def test_batches_are_read_as_the_whole_file_is(tmp_path):
    (tmp_path / "day.csv").write_bytes(DAY)
    with store_logs(str(tmp_path / "day.csv"), rows=7) as stored:
        tracks = [stored.read(track) for track in stored.tracks]
    expected = read_logs(io.BytesIO(DAY)).tracks
    for track, other in zip(tracks, expected, strict=True):
        assert track.times.tolist() == other.times.tolist()
    opened = read_ais_batches(Source("a", data=DAY), Request())
    assert sum(len(log.times) for log in opened.batches) == 20


def test_users_overrule_columns():
    rows = [danish(f"00:00:0{i}", 219000001, 55, 12 + i / 1e3) for i in range(3)]
    log = read_ais(Source("a", data=text(DANISH, *rows)), Request(columns={"id": "Type of mobile"}))
    assert log.ids == ("Class A",)
    names = ("t", "-", "id", "lat", "lon")
    log = read_ais(Source("a", data=text(DANISH, *rows)), Request(columns=names, dates="dmy"))
    assert log.ids == ("219000001",)


def test_other_tables_stay_csv():
    assert format_for_reading(Source("a", data=DAY)).name == "ais"
    assert format_for_reading(Source("a", data=b"mmsi,t,lat,lon\n1,2,3,4\n")).name == "csv"


def test_decimal_commas_and_quotes():
    header = '"# Timestamp";"Type of mobile";"MMSI";"Latitude";"Longitude";"SOG"'
    rows = [
        f'"13/04/2024 00:00:0{i}";"Class A";"219000001";"{lat}";"12,5{i}";"1,5"'
        for i, lat in enumerate(("55,25", "91,0", "55,75"))
    ]
    source = Source("a", data=text(header, *rows))
    assert format_for_reading(source).name == "ais"
    log = read_ais(source, Request())
    np.testing.assert_equal(log.coordinates[:, 0], [55.25, np.nan, 55.75])
    assert log.coordinates[:, 1].tolist() == [12.5, 12.51, 12.52]
