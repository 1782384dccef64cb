import pytest

from gpszip.experiments.experiment import Setting
from gpszip.experiments.published import TABLE_8_1
from gpszip.experiments.table import to_records
from gpszip.experiments.table_8_1 import generated_logs, run
from gpszip.testing import taxis


@pytest.fixture(scope="module")
def rows():
    pipeline, archive, seconds = run(Setting(seed=2, quick=True)).tables
    return to_records(pipeline), to_records(archive), to_records(seconds)


def test_each_log_of_the_thesis_stands_above_ours(rows):
    theirs = [row for row in rows[0] if row["data"] != "here"]
    assert [row["log"] for row in theirs] == [row.log for row in TABLE_8_1]
    for above, below in zip(rows[0], rows[0][1:], strict=False):
        if above["data"] != "here":
            assert (below["log"], below["data"]) == (above["log"], "here")


def test_the_flight_has_a_row_in_three_dimensions(rows):
    here = [row["log"] for row in rows[0] if row["data"] == "here"]
    assert here.index("quadrotor 3-D") == here.index("quadrotor") + 1
    assert [row["log"] for row in rows[1]] == here == [row["log"] for row in rows[2]]


def test_archives_are_at_least_as_close_as_the_pipeline(rows):
    for row in rows[1]:
        assert row["archive_rmse_m"] <= row["thesis_rmse_m"] * (1 + 1e-6)
        assert row["archive_bytes"] <= row["timed_archive_bytes"]


def test_taxis_are_patched():
    recorded = taxis(4, points=120, seed=2)
    logs = {log.name: log.track for log in generated_logs(2, quick=True)}
    assert len(logs["taxi a"]) > 120
    assert len(logs["taxis"]) > len(recorded)
    assert set(recorded.tracks[0].times) <= set(logs["taxi a"].times)
