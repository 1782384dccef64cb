import json

import numpy as np
import pytest

import gpszip
from gpszip import api
from gpszip.errors import OptionError
from gpszip.model import Options
from gpszip.pipeline.compress import compress
from oracle.decoded import measure


def patrol(n=400, seed=0):
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [30, 0], [30, 20], [0, 20]])
    lap = np.arange(n) * 0.02
    whole = lap.astype(int)
    places = corners[whole % 4] + (lap - whole)[:, None] * (
        corners[(whole + 1) % 4] - corners[whole % 4]
    )
    return gpszip.Track("patrol", np.arange(n) * 0.5, places + rng.normal(0, 0.05, (n, 2)))


@pytest.fixture(scope="module")
def archive():
    return gpszip.compress([patrol()], rmse=0.3)


def test_the_short_way_from_logs_to_positions(tmp_path):
    track = patrol()
    log = tmp_path / "patrol.csv"
    rows = [
        f"patrol,{t},{x:.3f},{y:.3f}"
        for t, (x, y) in zip(track.times, track.positions, strict=True)
    ]
    log.write_text("\n".join(["track_id,t,x,y", *rows]) + "\n")
    tracks = gpszip.read(log)
    assert [t.id for t in tracks] == ["patrol"]
    saved = tmp_path / "patrol.gpsz"
    gpszip.compress(tracks, rmse=0.3).save(saved)
    assert saved.stat().st_size < log.stat().st_size / 30
    opened = gpszip.open(saved)
    assert opened.ids == ("patrol",)
    away = opened.position("patrol", track.times) - track.positions
    assert np.sqrt((away**2).sum(axis=1).mean()) <= 0.3 + 0.001
    assert opened.road_map.nodes.shape[1] == 2


def test_decompress_takes_an_archive_its_bytes_or_its_file(archive, tmp_path):
    archive.save(tmp_path / "a.gpsz")
    expected = [
        (track.id, track.times.tolist(), track.positions.tolist()) for track in archive.decompress()
    ]
    for source in (archive, archive.to_bytes(), tmp_path / "a.gpsz", str(tmp_path / "a.gpsz")):
        assert [
            (track.id, track.times.tolist(), track.positions.tolist())
            for track in gpszip.decompress(source)
        ] == expected
    (sampled,) = gpszip.decompress(archive, every=10.0)
    last = archive.decompress()[0].times[
        -1
    ]  # a cell may end up to its own length after the last sample, at 199.5 s
    assert last >= 199.5
    assert sampled.times.tolist() == [10.0 * i for i in range(int(last // 10) + 1)]
    (sampled,) = gpszip.decompress(archive, at=[3.25])
    assert sampled.times.tolist() == [3.25]


def test_compress_is_the_pipeline_with_its_options(archive):
    other, report = compress(patrol(), Options(rmse=0.3))
    assert other.to_bytes() == archive.to_bytes()
    assert report.bytes_out == len(archive.to_bytes())


def test_the_bound_holds_from_outside(archive):
    rmse, _, lost = measure([patrol()], gpszip.decompress(archive))
    assert lost == 0
    assert rmse <= 0.3


def test_contradictory_options_are_refused_before_any_work():
    with pytest.raises(OptionError, match="give one"):
        gpszip.compress([], rmse=1.0, size=200)


def test_segment_means_search_what_is_left_out():
    track = patrol(200)
    assert (api.segment_mean(track, 9, 4).k, api.segment_mean(track, 9, 4).m) == (9, 4)
    assert api.segment_mean(track, 9).k == 9
    assert api.segment_mean(track, m=4).m == 4
    free = api.segment_mean(track)
    assert 1 <= free.m <= free.k <= 20
    short = gpszip.Track("two", [0, 1], [[0.0], [1.0]])
    assert api.segment_mean(short).k <= 2


def test_a_report_is_plain_enough_for_json():
    _, report = compress(patrol(100), Options(rmse=0.3))
    assert json.loads(json.dumps(vars(report)))["points"] == 100


def test_losses_are_warned_of(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("track_id,t,x,y\n" + "".join(f"bike,{i // 5},{i},0\n" for i in range(30)))
    with pytest.warns(
        gpszip.LossWarning,
        match="lost 24 of 30 points of track 'bike' of .*log.csv, up to 5 at one time",
    ):
        assert len(gpszip.read(path)[0]) == 6
