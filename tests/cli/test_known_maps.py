"""compress --map, --update-map and --append."""

import numpy as np
import pytest

import gpszip as package
from gpszip.testing import patrol


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A patrol of two hours, a file for each."""
    folder = tmp_path_factory.mktemp("logs")
    track = patrol(96000, seed=6)
    times, positions = track.times[::16], track.positions[::16]
    paths = []
    for hour in range(2):
        rows = np.column_stack([times, positions])[hour * 3000 : (hour + 1) * 3000]
        paths.append(folder / f"hour{hour}.csv")
        np.savetxt(paths[-1], rows, delimiter=",", header="t,x,y", comments="", fmt="%.3f")
    return paths


@pytest.fixture(scope="module")
def first_hour(logs):
    """Bytes of an archive of the first hour."""
    return package.compress(str(logs[0]), rmse=0.4, effort=1).to_bytes()


def rmse(archive, log):
    (track,) = package.read(log)
    off = archive.position("0", track.times, metres=True) - track.positions
    return np.sqrt((off**2).sum(axis=1).mean())


def test_compress_on_a_map_and_decompress_with_it(gpszip, logs, tmp_path):
    assert gpszip("compress", logs[0], "-o", "map.gpsz", "--rmse", "0.4", "--effort", "1").code == 0
    done = gpszip(f"compress {logs[1]} -o on/later.gpsz --rmse 0.4 --effort 1 --map map.gpsz")
    assert done.code == 1
    (tmp_path / "on").mkdir()
    done = gpszip(
        f"compress {logs[1]} -o on/later.gpsz --rmse 0.4 --effort 1 --map map.gpsz",
        "--update-map",
        "updated.gpsz",
        "--json",
    )
    assert done.code == 0, done.err
    assert done.json["rmse"] <= 0.4
    done = gpszip("decompress", "on/later.gpsz", "-o", "later.csv")
    assert done.code == 5
    assert "kept elsewhere; give it with --map" in done.err
    assert (
        gpszip("decompress", "on/later.gpsz", "-o", "later.csv", "--map", "updated.gpsz").code == 5
    )
    assert not (tmp_path / "later.csv").exists()
    assert (
        gpszip(
            "decompress", "on/later.gpsz", "-o", "later.csv", "--map", "map.gpsz", "--every", "1s"
        ).code
        == 0
    )
    for command in (["info", "--detail"], ["verify"]):
        assert gpszip(*command, "on/later.gpsz").code == 5
        assert gpszip(*command, "on/later.gpsz", "--map", "map.gpsz").code == 0
    assert gpszip("map", "on/later.gpsz", "-o", "later.geojson", "--map", "map.gpsz").code == 0
    archive = package.open("on/later.gpsz", map="map.gpsz")
    assert rmse(archive, logs[1]) <= 0.4
    updated = package.open("updated.gpsz")
    assert rmse(updated, logs[0]) <= 0.4
    assert rmse(updated, logs[1]) <= 0.4


def test_the_map_in_the_same_folder_is_found(gpszip, logs, first_hour, tmp_path):
    (tmp_path / "map.gpsz").write_bytes(first_hour)
    gpszip(f"compress {logs[1]} -o later.gpsz --rmse 0.4 --map map.gpsz --effort 1")
    assert gpszip("decompress", "later.gpsz", "-o", "-").out.startswith("track_id,t,x,y")
    shown = gpszip("info", "later.gpsz").out
    assert "kept elsewhere" in shown
    assert "RMSE at most 0.4 m" in shown


def test_appending_hour_by_hour(gpszip, logs):
    first = gpszip(f"compress {logs[0]} -o robot.gpsz --rmse 0.4 --append --effort 1 --json")
    assert first.code == 0, first.err
    done = gpszip("compress", logs[1], "-o", "robot.gpsz", "--append", "--effort", "1", "--json")
    assert done.code == 0, done.err
    assert done.json["bytes_out"] > first.json["bytes_out"]
    archive = package.open("robot.gpsz")
    assert archive.ids == ("0",)
    assert rmse(archive, logs[0]) <= 0.4
    assert rmse(archive, logs[1]) <= 0.4
    # The same log again overlaps in time, and the archive stays as it was.
    before = archive.to_bytes()
    again = gpszip("compress", logs[1], "-o", "robot.gpsz", "--append", "--effort", "1")
    assert again.code == 2
    assert "overlaps in time" in again.err
    assert package.open("robot.gpsz").to_bytes() == before


def test_a_map_is_not_updated_with_a_log_that_it_holds_already(gpszip, logs, first_hour, tmp_path):
    (tmp_path / "map.gpsz").write_bytes(first_hour)
    done = gpszip(
        f"compress {logs[0]} -o on.gpsz --rmse 0.4 --effort 1 --map map.gpsz --update-map new.gpsz"
    )
    assert done.code == 2
    assert "track '0' overlaps in time" in done.err
    assert not (tmp_path / "on.gpsz").exists()
    assert not (tmp_path / "new.gpsz").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--append", "-o", "-"], "neither standard output nor --map"),
        (["--append", "--map", "map.gpsz", "-o", "x.gpsz"], "neither standard output nor --map"),
        (["--update-map", "new.gpsz", "-o", "x.gpsz"], "needs --map"),
        (["--map", "none.gpsz", "-o", "x.gpsz"], "no such file"),
    ],
)
def test_options_that_contradict_each_other(gpszip, logs, arguments, says):
    done = gpszip("compress", logs[0], *arguments)
    assert done.code in {1, 2}
    assert says in done.err
