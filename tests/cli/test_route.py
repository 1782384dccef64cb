"""gpszip route, as a user runs it."""

import json

import pytest

import gpszip as package
from gpszip.testing import fleet


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """An archive of a small town in metres, and one of the same town on the Earth."""
    folder = tmp_path_factory.mktemp("town")
    log = fleet(2, lines=1, points=400, blocks=3, seed=2)
    package.compress(log.tracks, rmse=6, effort=1).save(folder / "town.gpsz")
    rows = ["track_id,t,lat,lon"]
    for track in log.tracks[:1]:
        for time, (x, y) in zip(track.times, track.positions, strict=True):
            lat, lon = -33.5 + y / 111_000, 13.4 + x / 92_800
            rows.append(f"{track.id},{1_704_090_000 + time:.0f},{lat:.7f},{lon:.7f}")
    (folder / "earth.csv").write_text("\n".join(rows))
    track = log.tracks[0]
    return folder, [tuple(track.positions[number]) for number in (2, 100)]


def test_routes_in_metres(gpszip, files, tmp_path):
    folder, ((x, y), (u, v)) = files
    done = gpszip(f"route {folder / 'town.gpsz'} {x},{y} {u},{v} -o r.geojson --depart 00:20")
    assert done.code == 0, done.err
    assert "fastest" in done.out
    assert "only directions that were travelled" in done.out
    properties = json.loads((tmp_path / "r.geojson").read_text())["features"][0]["properties"]
    facts = gpszip(f"route {folder / 'town.gpsz'} {x},{y} {u},{v} --by length --json").json
    assert facts["routes"][0]["length"] <= properties["length"] + 0.1
    assert facts["routes"][0]["length"] > 100
    assert facts["routes"][0]["seconds_low"] <= facts["routes"][0]["seconds"]


def test_routes_on_the_southern_half(gpszip, files, tmp_path):
    # A place that begins with a minus is no option; logs are compressed on the way.
    folder, ((x, y), (u, v)) = files
    places = [f"{-33.5 + b / 111_000},{13.4 + a / 92_800}" for a, b in ((x, y), (u, v))]
    done = gpszip(f"route {folder / 'earth.csv'} {places[0]} {places[1]} -o r.gpx")
    assert done.code == 0, done.err
    assert "<trkpt" in (tmp_path / "r.gpx").read_text()
    done = gpszip(f"route {folder / 'earth.csv'} {places[0]} {places[1]} -o r.geojson")
    line = json.loads((tmp_path / "r.geojson").read_text())["features"][0]
    lon, lat = line["geometry"]["coordinates"][0]
    assert abs(lat - (-33.5 + y / 111_000)) < 5e-4
    assert abs(lon - (13.4 + x / 92_800)) < 5e-4


def test_mistakes_are_told(gpszip, files):
    folder, ((x, y), _) = files
    town = folder / "town.gpsz"
    far = gpszip(f"route {town} {x},{y} 99999,0")
    assert (far.code, "from the map" in far.err) == (2, True)
    assert "is no place" in gpszip(f"route {town} {x},{y} there").err
    assert "no such option --fast" in gpszip(f"route {town} {x},{y} 1,2 --fast").err
    assert "two places" in gpszip(f"route {town} {x},{y}").err
    assert "GPX or GeoJSON" in gpszip(f"route {town} {x},{y} 1,2 -o r.kml").err
