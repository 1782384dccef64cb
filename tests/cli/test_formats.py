"""The table of formats says what each of them can do."""

from gpszip.io.logs.formats import LOG_FORMATS


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
