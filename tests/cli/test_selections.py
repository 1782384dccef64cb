"""--track, --since, --until and --bbox, and the commands select, split, join and cat."""

import csv
import io
import json

import numpy as np
import pytest

import gpszip as package


@pytest.fixture(scope="module")
def taxis():
    """Two taxis that drive to and fro for a day each, on the earth: a log and its archive."""
    times = np.arange(0, 86_400, 60.0)
    along = 0.05 * np.abs(times % 7200 - 3600) / 3600
    rows = [
        (name, 1_700_006_400 + day * 86_400 + t, 52.5, 13.4 + x)
        for day, name in enumerate(["cab 1", "cab/2"])
        for t, x in zip(times, along, strict=True)
    ]
    lines = ["track_id,t,lat,lon", *(f"{n},{t:.0f},{lat},{lon:.7f}" for n, t, lat, lon in rows)]
    text = "\n".join(lines)
    log = package.read(io.BytesIO(text.encode()))
    return text, package.compress(log, max_error=5, effort=1).to_bytes()


@pytest.fixture
def archive(taxis, tmp_path):
    """The archive of the taxis, beside their log."""
    text, data = taxis
    (tmp_path / "log.csv").write_text(text)
    (tmp_path / "a.gpsz").write_bytes(data)
    return "a.gpsz"


def _rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_decompress_of_a_time_range(gpszip, archive):
    done = gpszip(
        f"decompress {archive} -o - --since 2023-11-15T03:00:00Z --until 2023-11-15T04:00Z"
    )
    assert done.code == 0, done.err
    times = [float(row["t"]) for row in _rows(done.out)]
    assert (times[0], times[-1]) == (1_700_017_200, 1_700_020_800)


def test_decompress_and_cat_of_an_area(gpszip, archive):
    options = "--bbox 13.41,52,13.42,53"
    done = gpszip(f"decompress {archive} -o - --every 30s {options}")
    assert done.code == 0, done.err
    lon = [float(row["lon"]) for row in _rows(done.out)]
    assert 13.4099 < min(lon) < 13.411
    assert 13.419 < max(lon) < 13.4201
    knots = gpszip(f"decompress {archive} -o - {options}")
    assert _rows(gpszip(f"cat {archive} {options}").out) == _rows(knots.out)


def test_cat_prints_what_decompress_writes(gpszip, archive):
    assert gpszip(f"cat {archive}").out == gpszip(f"decompress {archive} -o -").out
    every = "--every 5m --track", "cab 1"
    assert (
        gpszip(f"cat {archive} {every[0]}", every[1]).out
        == gpszip(f"decompress {archive} -o - {every[0]}", every[1]).out
    )
    assert json.loads(gpszip(f"cat {archive} --format geojson").out)["features"]


def test_select_writes_a_part(gpszip, archive, tmp_path):
    done = gpszip(f"select {archive} -o part.gpsz --track", "cab 1", "--json")
    assert done.code == 0, done.err
    assert done.json["parts"][0]["tracks"] == 1
    assert package.open(tmp_path / "part.gpsz").ids == ("cab 1",)
    assert (
        "1 of 2 tracks" in gpszip(f"select {archive} -o part.gpsz --force --until 2023-11-15").err
    )
    assert gpszip(f"select {archive} -o other.gpsz").code == 2
    assert gpszip(f"select {archive} -o part.gpsz --track", "cab 1").code == 1


@pytest.mark.parametrize("by", ["track", "6h"])
def test_the_parts_of_split_join_again(gpszip, archive, tmp_path, by):
    done = gpszip(f"split {archive} --by {by} --json")
    assert done.code == 0, done.err
    parts = [part["output"] for part in done.json["parts"]]
    expected = ["a/cab 1.gpsz", "a/cab_2.gpsz"]
    if by == "6h":
        assert parts[0].endswith("a-2023-11-15T000000.gpsz")
        assert len(parts) == 8
    else:
        assert parts == expected
    done = gpszip("join", *parts, "-o", "whole.gpsz")
    assert done.code == 0, done.err
    whole, before = package.open(tmp_path / "whole.gpsz"), package.open(tmp_path / archive)
    assert whole.ids == before.ids
    times = np.linspace(1_700_006_000, 1_700_180_000, 3000)
    for name in whole.ids:
        np.testing.assert_allclose(
            whole.position(name, times, metres=True),
            before.position(name, times, metres=True),
            atol=5.0,
        )


def test_split_writes_nothing_where_a_file_exists(gpszip, archive, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/cab_2.gpsz").write_text("mine")
    done = gpszip(f"split {archive} --by track -o out")
    assert done.code == 1
    assert "exists already" in done.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["cab_2.gpsz"]


def test_join_refuses_archives_of_other_grids(gpszip, archive, tmp_path):
    package.compress(str(tmp_path / "log.csv"), max_error=50, effort=1).save(tmp_path / "b.gpsz")
    done = gpszip(f"join {archive} b.gpsz -o c.gpsz")
    assert done.code == 2
    assert "b.gpsz: lies on another grid than the first one; 'gpszip merge'" in done.err


def test_the_map_of_a_time_range_counts_its_travel_alone(gpszip, archive, tmp_path):
    for options, target in (("", "all.geojson"), ("--until 2023-11-15T02:00Z", "early.geojson")):
        done = gpszip(f"map {archive} -o {target} {options}")
        assert done.code == 0, done.err
    counts = [
        sum(
            edge["properties"]["forward"] + edge["properties"]["backward"]
            for edge in json.loads((tmp_path / name).read_text())["features"]
        )
        for name in ("all.geojson", "early.geojson")
    ]
    assert counts[0] > 10 * counts[1] > 0


def test_compress_reads_what_is_selected(gpszip, archive, tmp_path):
    done = gpszip(
        "compress log.csv -o c.gpsz --effort 1 --track cab/2 --since 2023-11-16T12:00Z --json"
    )
    assert done.code == 0, done.err
    assert done.json["points"] == done.json["points_read"] == 720
    assert done.json["points_not_selected"] == 2 * 1440 - 720
    assert package.open(tmp_path / "c.gpsz").ids == ("cab/2",)


def test_a_person_reads_first_how_much_was_selected(gpszip, archive):
    done = gpszip("compress log.csv -o c.gpsz --effort 1 --until 2023-11-15T01:00Z")
    assert done.err.startswith("gpszip: selected 61 of 2,880 points\n")
    assert "selected" not in gpszip("compress log.csv -o d.gpsz --effort 1").err


def test_a_damaged_part_is_named(gpszip, archive, tmp_path):
    assert gpszip(f"split {archive} --by track").code == 0
    part = tmp_path / "a" / "cab_2.gpsz"
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 255
    part.write_bytes(data)
    for command in ("join", "view", "plot"):
        target = {"join": "w.gpsz", "view": "w.html", "plot": "w.svg"}[command]
        kind = " --kind rate" if command == "plot" else ""
        done = gpszip(f"{command}{kind} -o {target}", "a/cab 1.gpsz", "a/cab_2.gpsz")
        assert done.code == 4, done.err
        assert done.err.startswith("gpszip: a/cab_2.gpsz: ")


def test_split_writes_all_parts_or_none(gpszip, archive, tmp_path, monkeypatch):
    from gpszip.container import writer

    written = []

    def fail_at_the_second(contents, file):
        written.append(contents)
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        file.write(b"part")

    monkeypatch.setattr(writer, "write", fail_at_the_second)
    done = gpszip(f"split {archive} --by track")
    assert done.code == 1
    assert "disk is full" in done.err or "No space" in done.err
    assert not list((tmp_path / "a").iterdir())


def test_a_period_that_would_make_too_many_files_is_refused_at_once(gpszip, archive):
    done = gpszip(f"split {archive} --by 1ms")
    assert done.code == 2
    assert "give a longer period" in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--since 2023", "2023 may be a date or seconds; write 2023-01-01"),
        ("--since 20231115", "20231115 may be a date or seconds; write 2023-11-15"),
        ("--since noon", "'noon' is no time"),
        ("--bbox 1,2,3", "'1,2,3' is no box"),
        ("--bbox 1,5,3,2", "ends south of where it begins"),
        ("--since 2024-01-02 --until 2024-01-01", "ends before it begins"),
        ("--until 2001-01-01", "nothing is selected; the archive has 2023-11-15"),
        ("--track nobody", "there is no track 'nobody'"),
    ],
)
def test_selections_that_make_no_sense(gpszip, archive, options, message):
    for command in (f"decompress {archive} -o x.csv", f"map {archive} -o x.geojson"):
        done = gpszip(f"{command} {options}")
        assert done.code == 2, done.err
        assert message in done.err


def test_logs_kept_exactly_are_not_copied_and_this_is_told(gpszip, archive):
    assert gpszip("compress log.csv -o l.gpsz --effort 1 --max-error 5m --lossless").code == 0
    for command in ("select l.gpsz -o p.gpsz --track cab/2", "split l.gpsz --by track"):
        assert "not copied: keep l.gpsz" in gpszip(command).err
    assert "not copied" not in gpszip(f"select {archive} -o q.gpsz --track cab/2").err
    assert "not copied: keep l.gpsz" in gpszip("join l.gpsz -o w.gpsz").err
