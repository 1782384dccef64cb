"""GeoParquet, GeoPackage, FlatGeobuf, GeoJSONL and MF-JSON from the command line."""

import io
import zipfile

import numpy as np
import pytest

from gpszip.geo.planes import to_geographic
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks

pytest.importorskip("pyogrio", reason="needs pyogrio: pip install 'gpszip[gis]'")

#: Seconds from 1970 to 2024-05-04.
START = 1_714_780_800
ROWS = [(START + 10 * i, 48 + i % 20 / 1e3, 11.5 + i / 1e4, 500 + i) for i in range(60)]
SUFFIXES = [".geoparquet", ".gpkg", ".fgb", ".geojsonl", ".geojsons", ".mfjson"]


def table(track="walk"):
    rows = "".join(f"{track},{t},{lat},{lon},{ele}\n" for t, lat, lon, ele in ROWS)
    return f"track_id,t,lat,lon,ele\n{rows}"


def test_samples_are_written_in_each_format_and_read_again(gpszip, tmp_path):
    (tmp_path / "log.csv").write_text(table())
    run = gpszip("compress log.csv -o a.gpsz --max-error 5m --effort 1 --keep ele --keep-times")
    assert run.code == 0, run.err
    for suffix in SUFFIXES:
        run = gpszip(f"decompress a.gpsz -o log{suffix} --samples")
        assert run.code == 0, run.err
        [track] = read_logs(tmp_path / f"log{suffix}", keep=("ele",)).tracks
        assert (track.id, track.times.tolist()) == ("walk", [row[0] for row in ROWS])
        assert track.attributes["ele"].tolist() == [row[3] for row in ROWS]
        lat, lon = to_geographic(track.positions, track.plane)
        _, lats, lons, _ = np.array(ROWS).T
        assert np.hypot((lat - lats) * 111_200, (lon - lons) * 74_500).max() < 5.1


def test_a_folder_and_a_zip_file_of_mixed_files_are_read(gpszip, tmp_path):
    (tmp_path / "logs").mkdir()
    for suffix in SUFFIXES:
        tracks = read_logs(io.BytesIO(table(suffix[1:]).encode())).tracks
        write_tracks(tracks, tmp_path / "logs" / f"log{suffix}")
    with zipfile.ZipFile(tmp_path / "logs.zip", "w") as archive:
        for path in (tmp_path / "logs").iterdir():
            archive.write(path, path.name)

    for number, logs in enumerate(("logs/log.*", "logs.zip", "logs/log.* --memory 1GiB")):
        run = gpszip(f"compress {logs} -o {number}.gpsz --max-error 5m --effort 1 --json")
        assert run.code == 0, run.err
        assert (run.json["points"], run.json["tracks"]) == (60 * len(SUFFIXES), len(SUFFIXES))


def test_the_formats_are_listed(gpszip):
    listed = gpszip("formats").out
    for name in ("geoparquet", "gpkg", "flatgeobuf", "geojsonl", "mf-json"):
        assert f"\n  {name} " in listed
