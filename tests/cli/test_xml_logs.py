"""KML, KMZ and TCX on the command line: what goes in comes out, with heights."""

import csv
import io
import xml.etree.ElementTree as ET
import zipfile

import pytest

HEIGHTS = [500.5 + i % 3 for i in range(20)]
RATES = [60 + i % 5 for i in range(20)]
TIMES = [f"2024-05-04T08:00:{second:02d}Z" for second in range(20)]
PLACES = [(48.1 + i / 1e4, 11.5 + (i % 4) / 1e4) for i in range(20)]


def kml():
    whens = "".join(f"<when>{time}</when>" for time in TIMES)
    coords = "".join(
        f"<gx:coord>{lon:.4f} {lat:.4f} {height}</gx:coord>"
        for (lat, lon), height in zip(PLACES, HEIGHTS, strict=True)
    )
    values = "".join(f"<gx:value>{rate}</gx:value>" for rate in RATES)
    data = f"<SchemaData><gx:SimpleArrayData name='hr'>{values}</gx:SimpleArrayData></SchemaData>"
    return (
        "<kml xmlns='http://www.opengis.net/kml/2.2' xmlns:gx='http://www.google.com/kml/ext/2.2'>"
        f"<Document><Placemark><name>walk</name><gx:Track>{whens}{coords}"
        f"<ExtendedData>{data}</ExtendedData></gx:Track></Placemark></Document></kml>"
    )


def tcx():
    points = "".join(
        f"<Trackpoint><Time>{time}</Time><Position><LatitudeDegrees>{lat:.4f}</LatitudeDegrees>"
        f"<LongitudeDegrees>{lon:.4f}</LongitudeDegrees></Position>"
        f"<AltitudeMeters>{height}</AltitudeMeters>"
        f"<HeartRateBpm><Value>{rate}</Value></HeartRateBpm></Trackpoint>"
        for time, (lat, lon), height, rate in zip(TIMES, PLACES, HEIGHTS, RATES, strict=True)
    )
    return (
        "  <?xml version='1.0'?><TrainingCenterDatabase><Activities><Activity><Id>walk</Id><Lap>"
        f"<Track>{points}</Track></Lap></Activity></Activities></TrainingCenterDatabase>"
    )


def kmz():
    with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
        archive.writestr("doc.kml", kml())
        archive.writestr("files/start.png", b"\x89PNG\r\n\x1a\n\0\0")
    return file.getvalue()


def heights_of(path):
    """Heights in a file, found without GPSZip."""
    if path.suffix == ".csv":
        return [float(row["ele"]) for row in csv.DictReader(path.read_text().splitlines())]
    if path.suffix == ".gpx":
        return [
            float(element.text) for element in ET.parse(path).iter() if element.tag[-3:] == "ele"
        ]
    text = path.read_bytes()
    if path.suffix == ".kmz":
        with zipfile.ZipFile(path) as archive:
            text = archive.read("doc.kml")
    coords = [e.text.split() for e in ET.fromstring(text).iter() if e.tag.endswith("}coord")]
    return [float(alt) for _, _, alt in coords]


@pytest.mark.parametrize(
    ("name", "data"), [("walk.kml", kml()), ("walk.kmz", kmz()), ("walk.tcx", tcx())]
)
def test_heights_come_back_in_every_format(gpszip, tmp_path, name, data):
    log = tmp_path / name
    log.write_bytes(data if isinstance(data, bytes) else data.encode())
    done = gpszip(f"compress {name} -o walk.gpsz --max-error 1m --effort 1 --keep ele,hr")
    assert done.code == 0, done.err
    for suffix in ("csv", "gpx", "kml", "kmz"):
        done = gpszip(f"decompress walk.gpsz --samples -o copy.{suffix}")
        assert done.code == 0, done.err
        assert heights_of(tmp_path / f"copy.{suffix}") == HEIGHTS, suffix


def test_columns_come_back_from_kmz(gpszip, tmp_path):
    (tmp_path / "walk.kmz").write_bytes(kmz())
    assert (
        gpszip("compress walk.kmz -o walk.gpsz --max-error 1m --effort 1 --keep ele,hr").code == 0
    )
    assert gpszip("decompress walk.gpsz --samples -o copy.kmz").code == 0
    assert (
        gpszip("compress copy.kmz -o copy.gpsz --max-error 1m --effort 1 --keep ele,hr").code == 0
    )
    assert gpszip("decompress copy.gpsz --samples -o copy.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "copy.csv").read_text().splitlines()))
    assert [float(row["hr"]) for row in rows] == RATES
    assert [float(row["ele"]) for row in rows] == HEIGHTS


def test_the_formats_are_listed(gpszip):
    listed = " ".join(gpszip("formats").out.split())
    for line in ("kml .kml read, write", "kmz .kmz read, write", "tcx .tcx read "):
        assert line in listed
    assert "kml, kmz" in " ".join(gpszip("decompress --help").out.split())


def test_damaged_files_are_refused_in_one_line(gpszip, tmp_path):
    for name, text in (("walk.kml", kml()), ("walk.tcx", tcx())):
        log = tmp_path / name
        log.write_text(text[:-200])
        done = gpszip(f"compress {name} -o a.gpsz --rmse 1m")
        assert done.code == 1
        assert "the file ends within" in done.err
        assert len(done.err.splitlines()) == 1
