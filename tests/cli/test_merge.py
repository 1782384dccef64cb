import json

import numpy as np
import pytest

from gpszip import open as open_archive
from gpszip.archive import new_archive
from gpszip.model import GridWalk, GridWalks, QuantisationGrid


def save(path, names, shift=0, timed=True):
    cells = np.array([0, 10, 20]) + 100 * shift if timed else np.zeros(3, np.int64)
    walk = GridWalk(np.array([0, 1, 2], np.int32), cells, np.zeros(2, bool))
    nodes = np.array([[0, 0], [100, 0], [100, 50]])
    new_archive(
        QuantisationGrid((0, 0), 0, 128, 128), names, GridWalks(nodes, (walk,) * len(names), timed)
    ).save(path)


@pytest.fixture
def two(tmp_path):
    save(tmp_path / "am.gpsz", ["bus"])
    save(tmp_path / "pm.gpsz", ["tram", "metro"], shift=1)
    return "am.gpsz", "pm.gpsz"


def test_archives_are_merged_and_one_line_describes_it(gpszip, two, tmp_path):
    run = gpszip("merge", *two, "-o", "city.gpsz")
    assert run.code == 0, run.err
    assert run.out == ""
    assert run.err.count("\n") == 1
    assert "2 archives with 3 tracks" in run.err
    assert "nodes 6 -> 3" in run.err
    city = open_archive(tmp_path / "city.gpsz")
    assert city.ids == ("bus", "metro", "tram")
    np.testing.assert_allclose(city.position("tram", 105.0), [50.0, 0.0], atol=1.5)


def test_facts_as_json(gpszip, two):
    facts = gpszip("merge", *two, "-o", "city.gpsz", "--max-deviation", "2m", "--json").json
    assert facts["tracks"] == 3
    assert (facts["nodes_in"], facts["nodes"]) == (6, 3)
    assert (facts["allowed"], facts["allowed_kind"]) == (2.0, "max")
    assert [one["name"] for one in facts["archives"]] == list(two)
    assert all(one["moved_max"] <= 2.0 for one in facts["archives"])
    assert facts["bytes_out"] < facts["bytes_in"]


def test_error_bounds_add_up(gpszip, tmp_path, log):
    other = tmp_path / "other.csv"
    other.write_text(log.read_text())
    for name in ("walk", "other"):
        assert (
            gpszip(
                "compress", f"{name}.csv", "-o", f"{name}.gpsz", "--max-error", "1m", "--effort", 1
            ).code
            == 0
        )
    run = gpszip(
        "merge", "walk.gpsz", "other.gpsz", "-o", "both.gpsz", "--same-id", "prefix", "--json"
    )
    assert run.code == 0, run.err
    assert run.json["error_bound"] == "max_error"
    assert run.json["error_bound_m"] <= 2.01
    assert open_archive(tmp_path / "both.gpsz").ids == ("other:0", "walk:0")


def test_tracks_of_one_name_are_refused_by_name(gpszip, tmp_path):
    save(tmp_path / "am.gpsz", ["bus"])
    save(tmp_path / "pm.gpsz", ["bus"], shift=1)
    run = gpszip("merge", "am.gpsz", "pm.gpsz", "-o", "city.gpsz")
    assert run.code == 2
    assert "track 'bus' is in am and in pm" in run.err
    assert not (tmp_path / "city.gpsz").exists()
    assert gpszip("merge", "am.gpsz", "pm.gpsz", "-o", "city.gpsz", "--same-id", "join").code == 0
    assert open_archive(tmp_path / "city.gpsz").ids == ("bus",)


def test_archives_of_one_file_name_are_named_by_their_paths(gpszip, tmp_path):
    for folder in ("am", "pm"):
        (tmp_path / folder).mkdir()
        save(tmp_path / folder / "bus.gpsz", ["0"])
    assert (
        gpszip("merge", "am/bus.gpsz", "pm/bus.gpsz", "-o", "city.gpsz", "--same-id", "prefix").code
        == 0
    )
    assert open_archive(tmp_path / "city.gpsz").ids == ("am/bus.gpsz:0", "pm/bus.gpsz:0")


def test_mistakes_are_named(gpszip, two, tmp_path):
    save(tmp_path / "timeless.gpsz", ["x"], timed=False)
    data = bytearray((tmp_path / "pm.gpsz").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "torn.gpsz").write_bytes(bytes(data))
    cases = [
        (("am.gpsz",), 2, "two or more"),
        (("am.gpsz", "torn.gpsz"), 4, "torn.gpsz"),
        (("torn.gpsz", "am.gpsz"), 4, "torn.gpsz"),
        (("am.gpsz", "nowhere.gpsz"), 1, "nowhere.gpsz"),
        ((*two, "--deviation", "1m", "--max-deviation", "1m"), 2, "give one"),
        ((*two, "--deviation", "-1m"), 2, "greater than 0"),
    ]
    for arguments, code, words in cases:
        run = gpszip("merge", *arguments, "-o", "city.gpsz")
        assert (run.code, words in run.err) == (code, True), run.err
        assert not (tmp_path / "city.gpsz").exists()
    (tmp_path / "city.gpsz").write_text("mine")
    assert gpszip("merge", *two, "-o", "city.gpsz").code == 1
    assert (tmp_path / "city.gpsz").read_text() == "mine"


def test_bad_archives_are_left_out_if_that_is_asked_for(gpszip, two, tmp_path):
    (tmp_path / "torn.gpsz").write_bytes((tmp_path / "pm.gpsz").read_bytes()[:-9])
    (tmp_path / "empty.gpsz").write_bytes(b"")
    bad = ("torn.gpsz", "empty.gpsz", "nowhere.gpsz")
    run = gpszip("merge", two[0], *bad, two[1], "-o", "city.gpsz", "--skip-bad")
    assert run.code == 3, run.err
    assert all(f"left out {name}: " in run.err for name in bad)
    assert len(open_archive(tmp_path / "city.gpsz").ids) == 3
    run = gpszip("merge", two[0], *bad, two[1], "-o", "-", "--skip-bad", "--json")
    assert (run.code, list(json.loads(run.err)["left_out"])) == (3, list(bad))
    run = gpszip("merge", *bad, "-o", "none.gpsz", "--skip-bad")
    assert (run.code, "none of the archives can be read" in run.err) == (1, True)
    run = gpszip("merge", two[0], *bad, "-o", "none.gpsz", "--skip-bad")
    assert (run.code, "only one of the archives can be read" in run.err) == (1, True)
    assert all(name in run.err for name in bad)
    assert not (tmp_path / "none.gpsz").exists()


def test_an_archive_named_twice_is_refused(gpszip, two):
    for choice in ("refuse", "prefix", "join"):
        run = gpszip("merge", *two, two[0], "-o", "city.gpsz", "--same-id", choice)
        assert (run.code, "am.gpsz is named twice" in run.err) == (2, True)


def test_errors_as_json(gpszip, two):
    run = gpszip("merge", two[0], two[0], "-o", "city.gpsz", "--json")
    assert json.loads(run.err)["error"]["exit_code"] == run.code == 2
