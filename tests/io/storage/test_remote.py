import pytest

from gpszip.errors import InputError
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.remote import fetch_objects
from gpszip.io.storage.source import expand


@pytest.fixture
def folder(tmp_path):
    for name, x in (("b", 2), ("a", 1)):
        (tmp_path / f"{name}.csv").write_text(f"t,x,y\n0,0,0\n1,{x},0\n2,{2 * x},0\n")
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "c.csv").write_text("t,x,y\n0,0,0\n1,3,0\n")
    return tmp_path


def test_url_is_read_like_a_file(folder):
    local, remote = (
        read_logs([name]) for name in (str(folder / "a.csv"), f"file://{folder}/a.csv")
    )
    assert [track.id for track in remote.tracks] == [track.id for track in local.tracks]
    assert remote.tracks[0].positions.tolist() == local.tracks[0].positions.tolist()
    assert remote.bytes == local.bytes


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("*.csv", ["a.csv", "b.csv"]),
        ("[b]*", ["b.csv"]),
        ("*/*.csv", ["deep/c.csv"]),
        ("**/*.csv", ["a.csv", "b.csv", "deep/c.csv"]),
    ],
)
def test_pattern_matches_files_in_order(folder, pattern, names):
    assert [source.name for source in expand(f"file://{folder}/{pattern}")] == [
        f"file://{folder}/{name}" for name in names
    ]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.csv", "no such file"),
        ("*.gpx", "no file matches"),
        ("deep", "no folder with Parquet files"),
    ],
)
def test_missing_objects_are_named(folder, name, message):
    (error,) = fetch_objects(f"file://{folder}/{name}")
    assert isinstance(error, InputError)
    assert f"file://{folder}/{name}" in str(error)
    assert message in str(error)


def test_unknown_scheme_is_named():
    (error,) = fetch_objects("gopher://host/log.csv")
    assert isinstance(error, InputError)
    assert "gopher" in str(error)
