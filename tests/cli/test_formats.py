"""The table of formats says what each of them can do, and errors what helps with a format."""

import re

import pytest

import exports
from gpszip.errors import InputError
from gpszip.io.logs.formats import LOG_FORMATS
from gpszip.io.logs.read import read_logs


def test_the_table_has_a_row_and_all_columns_for_each_format(gpszip):
    lines = gpszip("formats").out.splitlines()
    header = lines[1]
    starts = [header.index(name) for name in ("format", "suffixes", "does", "in batches", "needs")]
    rows = {line.split()[0]: line for line in lines[2 : 2 + len(LOG_FORMATS)]}
    assert set(rows) == {log_format.name for log_format in LOG_FORMATS}
    for line in rows.values():
        # Each column starts below its heading, after blanks.
        assert all(line[start] != " " and line[start - 1] == " " for start in starts)
    assert rows["gpx"][starts[2] :].split()[:4] == ["read,", "write", "yes", "-"]
    assert rows["fit"][starts[2] :].split()[:3] == ["read", "no", "gpszip[fit]"]


def test_programs_get_the_same(gpszip):
    logs = {entry["name"]: entry for entry in gpszip("formats --json").json["logs"]}
    assert logs["gpx"]["batches"]
    assert logs["gpx"]["write"]
    assert (logs["fit"]["batches"], logs["fit"]["extra"]) == (False, "fit")


@pytest.mark.parametrize("form", ["gpx", "csv"])
def test_only_tables_are_told_to_name_columns(tmp_path, form):
    """A clock that stands still, and a log of which one point is left."""
    time = exports.google.iso(exports.START)
    same = [f"{time},{lat},{lon}" for _, lat, lon, _ in exports.rows(0)]
    data = {
        "csv": "\n".join(["time,lat,lon", *same]).encode(),
        "gpx": re.sub(rb"<time>[^<]*", f"<time>{time}".encode(), exports.gpx(0, "ride")),
    }
    path = tmp_path / f"a.{form}"
    path.write_bytes(data[form])
    with pytest.raises(InputError, match="have the same time") as caught:
        read_logs(path)
    assert ("--columns" in str(caught.value)) == (form == "csv")


def test_an_unknown_xml_file_is_told_what_can_be_read(gpszip, tmp_path):
    (tmp_path / "export.xml").write_bytes(exports.apple()["apple_health_export/export.xml"])
    assert "workout-routes" in gpszip("compress export.xml -o a.gpsz").err
    (tmp_path / "a.xml").write_text("<places/>")
    assert "'gpszip formats' lists what can be read" in gpszip("compress a.xml -o a.gpsz").err
