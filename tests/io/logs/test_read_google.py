import io
import json
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.google.read import read_google, read_google_batches
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import google as g
from random_tests import examples

START = datetime(2024, 5, 4, 8, 0, 30, 120_000, tzinfo=timezone(timedelta(hours=2)))
ROWS = [(START + timedelta(minutes=i), 48 + i / 1e3, -11 - i / 1e3, 7) for i in range(12)]
FORMS = {
    "records": g.records,
    "old records": g.old_records,
    "raw signals": lambda rows: g.android([], rows),
    "paths": g.android,
    "ios": g.ios,
    "edits": g.edits,
    "months": g.months,
}


def raw(history, **request):
    return read_google(Source("history.json", data=g.encode(history)), Request(**request))


def read(history, **options):
    return read_logs(io.BytesIO(g.encode(history)), **options)


def rows_of(log):
    return [
        (time, *position)
        for time, position in zip(log.times.tolist(), log.coordinates.tolist(), strict=True)
    ]


# Positions and times


@examples(60)
@given(
    st.sampled_from(sorted(FORMS)),
    st.lists(
        st.tuples(
            st.integers(631_152_000_000, 2_208_988_800_000).map(
                lambda n: datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=n)
            ),
            st.integers(-900_000_000, 900_000_000).map(lambda n: n / 1e7),
            st.integers(-1_800_000_000, 1_800_000_000).map(lambda n: n / 1e7),
            st.just(7),
        ),
        min_size=2,
        max_size=20,
    ),
)
def test_positions_and_times_of_all_forms_are_those_written(form, rows):
    rows = sorted(rows)
    log = raw(FORMS[form](rows))
    is_ios = form == "ios"
    expected = g.expected(rows, decimals=6 if is_ios else 7, minutes=is_ios)
    assert rows_of(log) == expected


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_histories_are_recognised_by_their_content(form, encoding):
    data = g.encode(FORMS[form](ROWS), encoding)
    assert format_for_reading(Source("a.json", data=data)).name == "google"
    assert len(read_logs(io.BytesIO(data)).tracks[0]) == len(ROWS)


@pytest.mark.parametrize(
    "text",
    [
        '{"type": "FeatureCollection", "features": []}',
        '[{"type": "Feature", "locations": 1}]',
        '{"properties": {"locations": []}, "type": "Feature"}',
        '"locations",x,y\n1,2,3\n',
    ],
)
def test_other_files_are_no_histories(text):
    assert format_for_reading(Source("a.json", data=text.encode())).name != "google"


# Tracks


def test_devices_are_tracks():
    rows = [(*row[:3], 7 + i % 2) for i, row in enumerate(ROWS)]
    for form in (g.records, g.edits):
        assert [(t.id, len(t)) for t in read(form(rows)).tracks] == [("7", 6), ("8", 6)]
    # A track without a device is named after the file.
    rows[3] = (*rows[3][:3], 0)
    assert raw(g.records(rows)).ids == ("7", "8", "history")
    assert raw(g.android(ROWS)).ids == ()


def test_the_first_list_decides_whether_devices_are_tracks(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.google.read._BATCH_ROWS", 20)
    signals = g.signals(ROWS) * 2
    assert raw({"rawSignals": signals, **g.records(ROWS)}).ids == ()
    assert raw({**g.records(ROWS), "rawSignals": signals}).ids == ("7", "history")


def test_positions_and_paths_are_never_mixed():
    measured = [(time + timedelta(days=400), lat, lon, 0) for time, lat, lon, _ in ROWS[:4]]
    history = g.android(ROWS, measured)
    reading = read(history)
    assert len(reading.tracks[0]) == 4
    (left_out,) = reading.left_out
    assert left_out.name == "stream: 12 points of paths"
    assert "--format google-paths reads them" in left_out.reason

    reading = read(history, format="google-paths")
    assert len(reading.tracks[0]) == 12
    (left_out,) = reading.left_out
    assert left_out.name == "stream: 4 positions of devices"


# What is left out


def test_entries_without_a_position_are_counted_by_kind():
    (repair,) = raw(g.months(ROWS)).repairs
    assert (repair.count, repair.drops, repair.value) == (3, False, "waypoint, placeVisit")
    (repair,) = raw(g.android([], ROWS)).repairs
    assert (repair.count, repair.value) == (2, "wifiScan, activityRecord")

    with pytest.raises(InputError, match="no position in this location history, only 1 visit"):
        read([{"startTime": "2024-01-01T00:00:00Z", "visit": {}}])
    with pytest.raises(InputError, match="no position in this location history; export"):
        read({"locations": []})
    with pytest.raises(InputError, match="no path in this location history, only 12 positions"):
        read(g.records(ROWS), format="google-paths")


def test_values_that_are_none_cost_only_their_point():
    history = g.records(ROWS)
    wrong = (None, True, "48", [1], {}, 10**400, 1e300, "x")
    history["locations"] += [
        {**history["locations"][0], "latitudeE7": value} for value in wrong if value != "48"
    ]
    history["locations"] += [None, [], "x", 3, {}, {"timestamp": "2024-01-01T00:00:00Z"}]
    history["locations"] += [{**history["locations"][0], "timestamp": "never"}]
    reading = read(history, skip_bad=True, sort=True)
    assert sum(map(len, reading.tracks)) == len(ROWS)
    assert reading.points == len(ROWS) + len(wrong)
    (ignored,) = [repair for repair in reading.repairs if "ignored" in repair.what]
    assert ignored.count == 6


def test_points_of_paths_without_a_start_have_no_time():
    history = g.ios(ROWS)
    del history[1]["startTime"]
    assert np.isnan(raw(history).times).all()


def test_numbers_that_overflow_are_corrected_and_counted():
    history = g.records(ROWS)
    history["locations"][2]["longitudeE7"] += 2**32
    history["locations"][3]["latitudeE7"] = 950_000_000
    log = raw(history)
    np.testing.assert_allclose(log.coordinates[2], ROWS[2][1:3], atol=1e-7)
    assert log.coordinates[3, 0] == 95
    (repair,) = [repair for repair in log.repairs if "overflowed" in repair.what]
    assert (repair.count, repair.drops) == (1, False)


def test_points_that_can_not_be_read_are_named():
    history = g.android(ROWS)
    history["semanticSegments"][2]["timelinePath"][1]["point"] = "somewhere"
    reading = read(history)
    (repair,) = [repair for repair in reading.repairs if repair.drops]
    assert repair.where == "stream: point 4"
    assert repair.value == "point 'somewhere'"


def test_damaged_files_are_refused_or_read_up_to_the_damage():
    data = g.encode(g.records(ROWS))[:-1000]
    with pytest.raises(InputError, match="damaged JSON file: it is cut short"):
        read_logs(io.BytesIO(data))
    reading = read_logs(io.BytesIO(data), skip_bad=True)
    (left_out,) = reading.left_out
    assert left_out.name == f"stream: all after entry {len(reading.tracks[0])}"


# Attributes


def test_accuracy_altitude_speed_and_heading_can_be_kept():
    names = ("accuracy", "ele", "velocity", "heading")
    kept = raw(g.records(ROWS), keep=names).attributes
    assert [kept[name][1] for name in names] == [21, 500, 3, 90]
    kept = raw(g.edits(ROWS), keep=names).attributes
    assert kept["accuracy"].tolist() == [13.0] * len(ROWS)
    assert np.isnan(kept["ele"]).all()
    log = raw(g.android([], ROWS), keep=("speed",))
    assert log.attributes["speed"].tolist() == [1.5] * len(ROWS)
    assert log.dropped_columns == ("accuracy", "alt")
    with pytest.raises(InputError, match="no 'hr' to keep; its points have: accuracy, alt, speed"):
        raw(g.records(ROWS), keep=("hr",))


# Large files


def test_a_history_is_the_same_in_batches(tmp_path, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.google.read._BATCH_ROWS", 1000)
    # More positions than are turned into columns together; the second device appears late.
    rows = [(START + timedelta(seconds=i), 48 + i / 1e6, 11, 7 + (i > 1200)) for i in range(1500)]
    history = json.dumps(g.records(rows))
    opened = read_google_batches(Source("a.json", data=history.encode()), Request())
    assert [len(batch.times) for batch in opened.batches] == [1000, 500, 0]

    (tmp_path / "Records.json").write_text(history)
    whole = read_logs(tmp_path / "Records.json", keep=("accuracy",))
    assert [len(track) for track in whole.tracks] == [1201, 299]
    with store_logs(tmp_path / "Records.json", rows=1000, keep=("accuracy",)) as log:
        for stored, track in zip(log.tracks, whole.tracks, strict=True):
            np.testing.assert_array_equal(log.read(stored).times, track.times)
        assert log.read_result.repairs == whole.repairs
