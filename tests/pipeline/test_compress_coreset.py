"""Archives of logs of which only the coreset is at hand."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import BoundError, OptionError
from gpszip.model import Options, Track
from gpszip.pipeline.compress_coreset import compress_coreset
from gpszip.testing import patrol

RMSE = 0.4


@pytest.fixture(scope="module")
def track():
    return patrol(4000, seed=3, id="robot")


@pytest.fixture(scope="module")
def small(track):
    return gpszip.coreset(track, size=120)


def rmse(archive, track):
    found = archive.position(track.id, track.times, metres=True)
    return float(np.sqrt(np.mean(np.sum((found - track.positions) ** 2, axis=1))))


def test_the_rmse_holds_at_samples_that_were_not_at_hand(small, track):
    archive, report = compress_coreset(small, Options(rmse=RMSE, effort=1))
    archive = gpszip.open(archive.to_bytes())
    assert archive.error_bound.metres == RMSE
    assert rmse(archive, track) <= report.rmse <= RMSE
    assert (report.points, report.max_error) == (4000, np.inf)
    assert "between" in report.notes[-1]


def test_two_tracks_hold_it_together(track):
    half = Track("other", track.times[:1500], track.positions[:1500] + 3.0)
    tracks = [track, half]
    blocks = gpszip.coreset(tracks, size=200)
    archive, report = compress_coreset(blocks, Options(rmse=RMSE, effort=1))
    squares = sum(rmse(archive, each) ** 2 * len(each) for each in tracks)
    assert np.sqrt(squares / 5500) <= report.rmse <= RMSE
    assert archive.ids == ("robot", "other")


def test_a_stream_and_the_thesis_model_state_what_they_hold(track):
    stream = gpszip.CoresetStream(120)
    stream.push(track.times, track.positions)
    archive = gpszip.compress(stream, k=30, m=10)
    [name] = archive.ids
    own = Track(name, track.times, track.positions)
    assert rmse(archive, own) <= archive.report.rmse <= archive.error_bound.metres
    assert "maximum" not in repr(archive.report)


def test_too_few_blocks_are_an_error(small):
    with pytest.raises(BoundError, match="its blocks alone have"):
        compress_coreset(small, Options(rmse=0.01))


@pytest.mark.parametrize(
    "options",
    [
        {"max_error": 1.0},
        {"size": 100},
        {"rmse": 1.0, "keep": ("hr",)},
        {"rmse": 1.0, "times": False},
        {"rmse": 1.0, "gap": 60.0},
        {"k": 3},
        {},
    ],
)
def test_what_needs_samples_is_refused(small, options):
    with pytest.raises(OptionError):
        compress_coreset(small, Options(**options))


def test_the_command_takes_a_file_of_blocks(gpszip_command, small, tmp_path):
    gpszip.save_coreset(small, tmp_path / "small.parquet")
    run = gpszip_command("compress small.parquet --rmse 40cm --effort 1")
    assert run == 0
    assert gpszip.open(tmp_path / "small.gpsz").error_bound.metres == RMSE
    assert gpszip_command("compress small.parquet --rmse 40cm --sort --force") == 2


@pytest.fixture
def gpszip_command(tmp_path, monkeypatch):
    from gpszip.cli.main import main

    monkeypatch.chdir(tmp_path)
    return lambda words: main(words.split())
