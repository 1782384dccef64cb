import json

import pytest

from guard_log import NAME, guard_archive


@pytest.fixture
def guard(tmp_path):
    guard_archive().save(tmp_path / "guard.gpsz")
    return "guard.gpsz"


def test_a_report_has_the_name_of_the_archive(gpszip, guard, tmp_path):
    run = gpszip("report guard.gpsz --timezone Europe/Berlin")
    assert run.code == 0, run.err
    assert run.err.startswith("guard.report.html: a report of 0.")
    page = (tmp_path / "guard.report.html").read_text()
    assert "<h1>guard.gpsz</h1>" in page
    assert NAME not in page
    again = gpszip("report guard.gpsz")
    assert again.code == 1
    assert "exists" in again.err


def test_a_log_is_compressed_on_the_way_or_shown_beside_its_archive(gpszip, walk_archive, tmp_path):
    log = (tmp_path / "walk.csv").read_text()
    (tmp_path / "walk.csv").write_text(f"{log}nonsense,1,1\n")
    for words in ("report walk.csv -o a.html", "report walk.gpsz walk.csv -o b.html"):
        run = gpszip(f"{words} --json")
        assert run.code == 0, run.err
        assert run.json["archive"]["points"] == 200
        assert run.json["read"]["repairs"][0]["count"] == 1
        page = (tmp_path / run.json["output"]).read_text()
        assert "1 row" in page.split('id="doubt"')[1]


def test_standard_input_and_output(gpszip, guard, tmp_path):
    run = gpszip("report - -o - --json", data=(tmp_path / guard).read_bytes())
    assert run.code == 0, run.err
    assert run.out.startswith("<!DOCTYPE html>")
    assert json.loads(run.err)["name"] == "archive"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("report walk.csv guard.gpsz", "guard.gpsz is an archive, and stands behind other files"),
        ("report guard.gpsz --since 2020-01-01", "since lies outside"),
        ("report guard.gpsz --timezone Mars/Olympus", "no time zone 'Mars/Olympus'"),
        ("view guard.gpsz --history speed", "'speed' is no part of a history"),
        ("view guard.gpsz --history usage --timezone Mars/Olympus", "no time zone"),
    ],
)
def test_wrong_questions_are_refused(gpszip, guard, log, words, message):
    run = gpszip(words)
    assert run.code == 2
    assert message in run.err


def test_a_page_shows_the_parts_of_the_history_that_were_named(gpszip, guard, tmp_path):
    run = gpszip("view guard.gpsz --history usage,rounds -o page.html")
    assert run.code == 0, run.err
    page = (tmp_path / "page.html").read_text()
    scene = json.loads(page.split('id="scene">')[1].split("</script>")[0])
    history = scene["archives"][0]["history"]
    assert history["places"] is history["unusual"] is None
    assert len(history["rounds"]["rows"]) > 10
    assert history["usage"] is not None
