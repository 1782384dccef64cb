"""Ends of tracks and of their pieces in archives, also after appending and merging."""

import io
import zlib

import numpy as np
import pytest

from gpszip.archive import open_archive
from gpszip.container.reader import from_bytes
from gpszip.io.logs.read import read_logs
from gpszip.model import Options, Track
from gpszip.model.merge_options import MergeOptions
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge


def reopened(archive):
    return open_archive(archive.to_bytes())


def ends_of_pieces(archive):
    return {
        piece.id: (float(piece.times[0]), float(piece.times[-1])) for piece in archive.decompress()
    }


def test_a_parked_track_keeps_its_ends():
    track = Track("van", [0.0, 60.0, 3540.0, 3600.0], np.zeros((4, 2)))
    archive, _ = compress(track, Options(rmse=5.0, effort=1))
    assert ends_of_pieces(reopened(archive)) == {"van": (0.0, 3600.0)}
    assert np.isnan(archive.position("van", [3601.0, -1.0])).all()


@pytest.mark.parametrize("shift", [0.0, 1_714_809_600.25])
def test_ends_are_exact_within_a_sampling_interval(shift):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.8, 1.2, 300)) + shift
    positions = np.stack([times - shift, 3 * np.sin(times / 9)], axis=1) * 4
    archive, _ = compress(Track("walk", times, positions), Options(rmse=3.0, effort=1))
    first, last = ends_of_pieces(reopened(archive))["walk"]
    assert times[0] - 1 < first <= times[0] + 1e-3
    assert times[-1] - 1e-3 <= last < times[-1] + 1


def test_a_piece_of_one_sample_claims_no_travel():
    track = Track("a", [0.0, 7200.0, 14400.0], [[0.0, 0.0], [30_000.0, 40_000.0], [200.0, 150.0]])
    archive, _ = compress(track, Options(max_error=10.0, gap=60.0, effort=1))
    for piece in reopened(archive).decompress():
        assert np.ptp(piece.positions, axis=0).max() == 0
        assert piece.times[-1] - piece.times[0] < 60
    assert len(archive.trimmed_map.edges) == 0
    assert len(archive.clean_map().length) == 0


def test_a_parked_track_is_continued():
    van = Track("van", [0.0, 60.0, 3540.0, 3600.0], np.zeros((4, 2)))
    archive, _ = compress(van, Options(rmse=5.0, effort=1))
    times = 7200 + 10.0 * np.arange(61)
    drive = Track("van", times, np.stack([1.1 * (times - 7200), np.zeros(61)], axis=1))
    both, report = append(archive, drive)
    assert report.rmse <= 5
    assert ends_of_pieces(reopened(both))["van"] == (0.0, 7800.0)
    assert np.linalg.norm(both.position("van", van.times), axis=1).max() <= 10
    with pytest.raises(Exception, match="overlaps in time"):
        append(archive, Track("van", times - 3700, drive.positions))


def test_merged_tracks_keep_their_ends():
    rng = np.random.default_rng(3)
    archives = []
    for name in "ab":
        times = 5.0 * np.arange(80) + 7
        positions = np.stack([times * 8, 300 * np.sin(times / 100)], axis=1) + rng.normal(
            0, 2, (80, 2)
        )
        archives.append(compress(Track(name, times, positions), Options(rmse=5.0, effort=1))[0])
    merged, _ = merge(archives, MergeOptions(), names=["one", "two"])
    ends = ends_of_pieces(reopened(merged))
    assert all(abs(first - 7) <= 1.25 and abs(last - 402) <= 1.25 for first, last in ends.values())


def test_tracks_of_version_2_end_at_their_knots():
    old = bytes.fromhex("a75a020000807878000005efbdc0")
    sealed = old + zlib.crc32(old).to_bytes(4, "little")
    archive = open_archive(sealed)
    assert from_bytes(sealed).version == 2
    assert len(archive.decompress()) == 1
    assert archive.to_bytes() == sealed


GPX = """<gpx version="1.1" creator="t"><rte><name>plan</name>{}</rte>
<trk><name>ride</name><trkseg>{}</trkseg></trk></gpx>"""


def mixed_log():
    """A GPX file with a route, which has no times, and a track."""
    plan = "".join(f'<rtept lat="{48 + i / 1000}" lon="{11 + (i % 7) / 2000}"/>' for i in range(40))
    ride = "".join(
        f'<trkpt lat="{48 + i / 1000}" lon="{11 + (i % 7) / 2000}">'
        f"<time>2024-05-04T08:{i:02d}:00Z</time></trkpt>"
        for i in range(40)
    )
    return io.BytesIO(GPX.format(plan, ride).encode())


def test_routes_without_times_are_kept_next_to_tracks():
    result = read_logs(mixed_log(), format="gpx")
    archive, report = compress(result.tracks, Options(max_error=10.0, effort=1))
    pieces = {piece.id: piece for piece in reopened(archive).decompress()}
    assert (pieces["plan"].timed, pieces["ride"].timed) == (False, True)
    assert any("'plan'" in note for note in report.notes)
    assert reopened(archive).untimed == ("plan",)
    assert report.max_error <= 10


def test_shapes_are_merged_and_appended_but_not_continued():
    shapes = [track for track in read_logs(mixed_log(), format="gpx").tracks if not track.timed]
    moved = [
        Track("other", track.times, track.positions + 3, plane=track.plane, timed=False)
        for track in shapes
    ]
    archives = [
        compress(tracks, Options(max_error=10.0, effort=1))[0] for tracks in (shapes, moved)
    ]
    merged, _ = merge(archives, MergeOptions(), names=["one", "two"])
    assert (merged.timed, set(merged.untimed)) == (False, {"plan", "other"})
    ride = [track for track in read_logs(mixed_log(), format="gpx").tracks if track.timed]
    timed, _ = compress(ride, Options(max_error=10.0, effort=1))
    both, _ = append(timed, shapes)
    assert (both.ids, both.untimed) == (("ride", "plan"), ("plan",))
    with pytest.raises(Exception, match="one of both has no times"):
        append(both, shapes)


@pytest.mark.parametrize(("rmse", "maximum"), [(2.0, 5.0), (2.0, 8.0), (5.0, 6.0)])
def test_rmse_and_maximum_hold_together(rmse, maximum):
    rng = np.random.default_rng(1)
    times = np.arange(400.0)
    positions = np.stack([times * 3, 40 * np.sin(times / 30)], axis=1) + rng.normal(0, 1, (400, 2))
    positions[200] += 15
    archive, report = compress(
        Track("a", times, positions), Options(rmse=rmse, max_error=maximum, effort=1)
    )
    assert (report.rmse <= rmse, report.max_error <= maximum) == (True, True)
    error_bound = reopened(archive).error_bound
    assert (error_bound.metres, error_bound.max_error) == (rmse, maximum)
    assert report.bound == f"RMSE <= {rmse:g} m, maximum <= {maximum:g} m"


def test_without_a_bound_rmse_and_maximum_are_chosen():
    times = np.arange(300.0)
    positions = np.stack([times * 3, 40 * np.sin(times / 30)], axis=1)
    positions[100] += 60
    archive, report = compress(Track("a", times, positions), Options(effort=1))
    error_bound = archive.error_bound
    assert error_bound.max_error == pytest.approx(4 * error_bound.metres, rel=0.01)
    assert report.max_error <= error_bound.max_error
    assert any("were estimated" in note and "maximum" in note for note in report.notes)
