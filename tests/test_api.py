import json
from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip import api
from gpszip.errors import InputError, OptionError
from gpszip.model import Options
from gpszip.pipeline.compress import compress
from gpszip.pipeline.match import read_network
from gpszip.sketches.sketch import build_sketch
from oracle.decoded import measure


def patrol(n=400, seed=0):
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [30, 0], [30, 20], [0, 20]])
    lap = np.arange(n) * 0.02
    side = lap.astype(int)
    start, end = corners[side % 4], corners[(side + 1) % 4]
    line = start + (lap - side)[:, None] * (end - start)
    return gpszip.Track("patrol", np.arange(n) * 0.5, line + rng.normal(0, 0.05, (n, 2)))


def write_csv(path, track):
    rows = [
        f"{track.id},{t},{x:.3f},{y:.3f}"
        for t, (x, y) in zip(track.times, track.positions, strict=True)
    ]
    path.write_text("\n".join(["track_id,t,x,y", *rows]) + "\n")
    return path


@pytest.fixture(scope="module")
def archive():
    return gpszip.compress([patrol()], rmse=0.3)


def test_from_a_log_to_positions(tmp_path):
    track = patrol()
    log = write_csv(tmp_path / "patrol.csv", track)
    tracks = gpszip.read(log)
    assert [t.id for t in tracks] == ["patrol"]
    saved = tmp_path / "patrol.gpsz"
    gpszip.compress(tracks, rmse=0.3, effort=1).save(saved)
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
    # A time step may end up to its own length after the last sample, at 199.5 s.
    last = archive.decompress()[0].times[-1]
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


def test_a_segment_mean_of_numbers_too_far_from_zero_is_refused():
    far = gpszip.Track("a", np.arange(9.0), np.outer(np.arange(9.0), [1e300, 0.0]))
    for counts in ((), (2, 1)):
        with pytest.raises(InputError, match="too far from zero"):
            api.segment_mean(far, *counts)


def test_a_report_is_plain_enough_for_json():
    _, report = compress(patrol(100), Options(rmse=0.3, effort=1))
    assert json.loads(json.dumps(vars(report)))["points"] == 100


def test_losses_are_warned_of(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("track_id,t,x,y\n" + "".join(f"bike,{i // 5},{i},0\n" for i in range(30)))
    with pytest.warns(
        gpszip.LossWarning,
        match="lost 24 of 30 points of track 'bike' of .*log.csv, up to 5 at one time",
    ):
        assert len(gpszip.read(path)[0]) == 6


def test_files_are_read_where_tracks_are_taken(tmp_path, archive):
    path = write_csv(tmp_path / "patrol.csv", patrol(200))
    expected = gpszip.compress(gpszip.read(path), rmse=0.3, effort=1).to_bytes()
    for files in (path, str(path), [path], str(tmp_path / "*.csv")):
        assert gpszip.compress(files, rmse=0.3, effort=1).to_bytes() == expected
    assert gpszip.match(path, archive).share > 0.9
    assert gpszip.patch([path], archive).filled == 0
    assert gpszip.compress(path, rmse=0.3, effort=1, memory=1 << 30).to_bytes() == expected
    assert len(gpszip.coreset(path, size=10)) == len(gpszip.coreset(path, size=10, memory=1 << 30))
    later = write_csv(tmp_path / "later.txt", replace(patrol(200), id="later"))
    assert gpszip.append(archive, later, effort=1).ids == ("patrol", "later")
    with pytest.raises(OptionError, match="tracks and logs"):
        gpszip.compress([patrol(), path])


def test_columns_and_losses_of_files_that_are_compressed(tmp_path):
    path = tmp_path / "log.csv"
    rows = "".join(f"bike,{i // 2},{i},0,{i}\n" for i in range(30))
    path.write_text("track_id,t,x,y,speed\n" + rows)
    with pytest.warns(gpszip.LossWarning, match="15 of 30 points of track 'bike'") as caught:
        archive = gpszip.compress(path, rmse=1.0, keep="speed", effort=1)
    assert [warning.filename for warning in caught] == [__file__]
    assert archive.attributes("bike")["speed"].tolist() == list(range(0, 30, 2))


def test_a_read_result_is_a_sequence_of_tracks_with_an_account(tmp_path):
    path = write_csv(tmp_path / "patrol.csv", patrol(50))
    result = gpszip.read(str(path), columns="track_id,t,x,y", time_unit="s", sort=True)
    assert isinstance(result, gpszip.ReadResult)
    (track,) = result
    assert result[0] is track
    assert result[:1] == (track,)
    assert (len(result), result.points, result.lost, result.geographic) == (1, 50, 0, False)
    with path.open("rb") as stream:
        assert len(gpszip.read(stream)[0]) == 50


def test_archives_that_were_made_say_how(archive):
    assert isinstance(archive.report, gpszip.Report)
    assert archive.report.points == 400
    assert gpszip.open(archive.to_bytes()).report is None
    other = gpszip.compress(replace(patrol(100), id="other"), rmse=0.3, effort=1)
    merged = gpszip.merge([archive, other])
    assert isinstance(merged.report, gpszip.MergeReport)
    assert merged.report.tracks == 2


def test_decompress_takes_times_of_any_kind():
    track = replace(patrol(50), times=1.4e9 + np.arange(50.0))
    archive = gpszip.compress(track, rmse=0.3, effort=1)
    (sampled,) = gpszip.decompress(archive, at=["2014-05-13T16:53:30Z", "2014-05-13T16:53:25Z"])
    assert sampled.times.tolist() == [1.4e9 + 5, 1.4e9 + 10]
    with pytest.raises(OptionError, match="milliseconds"):
        gpszip.decompress(archive, at=[1.4e12 + 5000])


def test_an_archive_is_opened_from_a_binary_file(tmp_path, archive):
    archive.save(tmp_path / "a.gpsz")
    with (tmp_path / "a.gpsz").open("rb") as file:
        assert gpszip.open(file).ids == ("patrol",)


def values_to_show(archive):
    track = patrol()
    matching = gpszip.match(track, archive)
    gappy = gpszip.Track("gappy", np.append(track.times[:100], 900.0), track.positions[:101])
    patching = gpszip.patch(gappy, archive, gap=60.0)
    live = gpszip.Matcher(archive).push(0.0, [1.0, 0.0])
    coreset = gpszip.coreset(track, size=20)
    view = archive["patrol"]
    match = matching[0]
    return [
        track,
        archive,
        view,
        view.walk,
        view.waypoints,
        archive.road_map,
        archive.clean_map(),
        archive.road_map.directed(),
        archive.report,
        archive.error_bound,
        archive.grid,
        archive.grid_walks,
        archive.grid_walks.walks[0],
        archive.grid_walks.ends,
        read_network(archive).network,
        matching,
        matching.scales,
        match,
        match.pieces[0],
        match.pieces[0].route,
        patching,
        patching.patches[0],
        live,
        coreset,
        build_sketch(track),
        api.segment_mean(track, 9, 4),
        gpszip.polyline([0, 1], [[0], [1]]),
        gpszip.Plane(((1, 2),) * 4000),
        gpszip.Progress("learn", 0.5),
        gpszip.ReadResult((track,) * 1000, 400_000, 1, False),
    ]


def test_every_value_shows_in_one_or_two_lines(archive):
    for value in values_to_show(archive):
        text = repr(value)
        assert text.count("\n") <= 1
        assert len(text) <= 200, text
        assert "array(" not in text
        assert text.startswith(type(value).__name__)


@pytest.mark.parametrize("name", ["match", "patch"])
def test_headings_of_files_are_read_for_matching_and_patching(tmp_path, monkeypatch, name):
    path = tmp_path / "walk.csv"
    path.write_text("t,x,y,heading\n0,0,0,90\n1,1,0,90\n2,2,0,90\n")
    seen = []
    monkeypatch.setattr(
        f"gpszip.pipeline.match.{name}", lambda tracks, *_, **__: seen.append(tracks)
    )
    network = gpszip.Network(
        np.array([[0.0, 0.0], [2.0, 0.0]]),
        *(np.array([node], np.int32) for node in (0, 1)),
        np.array([0, 2]),
        np.array([[0.0, 0.0], [2.0, 0.0]]),
        *(np.array([True]),) * 2,
        np.array([8.0]),
    )
    getattr(gpszip, name)(path, network)
    assert list(seen[0][0].attributes) == ["heading"]
