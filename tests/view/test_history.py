"""What a page holds of a history."""

import json

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError, OutputError
from gpszip.view.history import show_history
from guard_log import NAME, ODD_ROUND, guard_archive, guard_findings
from view.unpacking import unpack


@pytest.fixture(scope="module")
def shown():
    return show_history(guard_findings(), guard_archive())


def test_the_use_of_edges_sums_up_to_all_travel(shown):
    usage, rows = shown["usage"], guard_findings().history.traversals
    metres = np.bincount(unpack(usage["edge"]).astype(int), unpack(usage["metres"]))
    expected = np.bincount(rows.edge, rows.metres)
    np.testing.assert_allclose(metres, expected, atol=len(unpack(usage["edge"])))

    # Monday evening in Berlin: 21 h is the first hour.
    slots = unpack(usage["slot"]).astype(int)
    assert usage["weekdays"] is True
    assert slots.min() == 21
    assert set(slots // 24) == {0, 1}
    traversals = unpack(usage["traversals"])
    counted = rows.metres >= 0.5 * guard_findings().history.network.lengths[rows.edge]
    assert traversals.sum() == counted.sum()


def test_trips_stays_and_places_come_back(shown):
    trips, places = guard_findings().trips, shown["places"]
    starts = unpack(places["trips"]["start"])
    np.testing.assert_allclose(starts, [trip.start for trip in trips.trips], atol=0.06)
    ends = unpack(places["stays"]["end"])
    np.testing.assert_allclose(ends, [stay.end for stay in trips.stays], atol=0.06)
    assert unpack(places["stays"]["place"]).tolist() == [stay.place for stay in trips.stays]

    # The station is at the origin of the plane.
    assert abs(unpack(places["x"])[0]) < 3
    assert abs(unpack(places["y"])[0]) < 3
    assert unpack(places["visits"])[0] == trips.places[0].visits


def test_unusual_trips_come_by_rank_with_their_place(shown):
    first = shown["unusual"][0]
    trip = guard_findings().trips.trips[ODD_ROUND]
    assert trip.start - 1000 < first["start"] < first["end"] < trip.end + 1000
    assert first["reason"].startswith("rare turn")
    assert np.hypot(first["x"] - 120, first["y"] - 90) < 10  # the middle of the short cut


def test_the_usual_round_and_what_rounds_miss(shown):
    rounds = guard_findings().rounds
    assert set(shown["rounds"]["edges"]) == {edge for edge, _ in rounds.usual}
    assert [row["share"] for row in shown["rounds"]["rows"]] == [
        round(each.share, 4) for each in rounds.rounds
    ]
    missed = [each.edge for each in rounds.edges if each.missed]
    assert shown["rounds"]["missed"] == missed


def test_positions_move_to_the_plane_of_the_page():
    moved = show_history(
        guard_findings(), guard_archive(), lambda rows: rows + np.array([1000.0, 0.0])
    )
    here = show_history(guard_findings(), guard_archive())
    for key in ("x", "y"):
        shift = unpack(moved["places"][key]) - unpack(here["places"][key])
        np.testing.assert_allclose(shift, 1000.0 if key == "x" else 0.0, atol=0.2)


def test_a_page_has_a_history_if_it_is_asked_for(tmp_path):
    line = np.column_stack([np.arange(20.0) * 10, np.zeros(20)])
    walk = gpszip.compress(gpszip.Track(NAME, np.arange(20.0), line), rmse=1.0, effort=1)
    gpszip.write_page(walk, tmp_path / "plain.html")
    gpszip.write_page([walk, walk], tmp_path / "told.html", history=["usage", "rounds"])
    plain, told = (_scene(tmp_path / name) for name in ("plain.html", "told.html"))
    assert plain["archives"][0]["history"] is None
    for archive in told["archives"]:
        assert archive["history"]["usage"] is not None
        assert archive["history"]["notes"] == {"rounds": "travel doesn't repeat in rounds"}
    with pytest.raises(OptionError, match="'all of it' is no part"):
        gpszip.write_page(walk, tmp_path / "no.html", history="all of it")
    with pytest.raises(OutputError):
        gpszip.write_page(walk, tmp_path / "told.html", history="all")


def _scene(path):
    text = path.read_text().split('id="scene">')[1].split("</script>")[0]
    return json.loads(text)
