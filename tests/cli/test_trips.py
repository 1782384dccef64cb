"""gpszip trips, as a user runs it."""

import csv
import io
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

#: Monday, 2024-05-06, midnight in UTC.
START = 1_714_953_600

HEAD = ["track_id", "kind", "t_start", "t_end", "place", "lat", "lon", "length", "moving_s"]


@pytest.fixture
def phone(tmp_path):
    """Three days at work, 4 km to the east, from 9 to 17 h; a poor fix each hour."""
    knots = np.array([0, 8.8, 9, 17, 17.2, 24])
    rows = ["track_id,t,lat,lon,accuracy"]
    rng = np.random.default_rng(1)
    for minute in range(0, 3 * 1440, 4):
        x = np.interp(minute / 60 % 24, knots, [0, 0, 4000, 4000, 0, 0]) + rng.normal(0, 5)
        accuracy = 10
        if minute % 60 == 32:
            x, accuracy = x + 2500, 3000
        time = START + 60 * minute
        rows.append(f"my phone,{time},48.1,{11.5 + x / 74_400:.6f},{accuracy}")
    path = tmp_path / "phone.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def read(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_a_log(gpszip, phone):
    run = gpszip("trips phone.csv -o T.csv --places P.csv --timezone Europe/Berlin")
    assert run.code == 0, run.err
    lines = run.out.splitlines()
    assert lines[0].startswith("6 trips of 24")
    assert "7 stays at 2 places" in lines[0]
    assert lines[1] == "local hours are those of Europe/Berlin"
    assert lines[2].startswith("place 1: 4 visits, 46.7 h")
    assert "3 trips from place 1 to place 2" in lines

    rows = read((phone.parent / "T.csv").read_text())
    assert list(rows[0])[: len(HEAD)] == HEAD
    assert [row["kind"] for row in rows] == ["stay", "trip"] * 6 + ["stay"]
    assert {row["track_id"] for row in rows} == {"my phone"}
    first, trip, work = rows[:3]
    assert float(first["t_start"]) == START
    assert first["local_start"] == "2024-05-06T02:00:00+02:00"
    assert float(trip["t_start"]) == pytest.approx(START + 8.8 * 3600, abs=240)
    assert float(trip["t_end"]) == pytest.approx(START + 9 * 3600, abs=240)
    assert (trip["from_place"], trip["place"], work["place"]) == ("1", "2", "2")
    assert float(trip["length"]) == pytest.approx(4000, abs=60)
    assert float(work["lon"]) == pytest.approx(11.5 + 4000 / 74_400, abs=2e-4)
    for one, other in zip(rows, rows[1:], strict=False):
        assert one["t_end"] == other["t_start"]

    home, work = read((phone.parent / "P.csv").read_text())
    assert (home["role"], home["evidence"]) == ("home", "3 of 3 nights known")
    assert work["evidence"] == "3 of 3 working days known"
    assert work["usual_hours"] == "11-19"


def test_an_archive_needs_no_log(gpszip, phone):
    assert gpszip("compress phone.csv -o A.gpsz --effort 1 --max-error 30m --clean").code == 0
    expected = gpszip("trips phone.csv --json").json
    phone.unlink()
    found = gpszip("trips A.gpsz --json").json
    assert found["read"] is None
    assert found["trips"] == expected["trips"] == 6
    assert [(each["from"], each["to"], each["trips"]) for each in found["matrix"]] == [
        (1, 2, 3),
        (2, 1, 3),
    ]
    only = gpszip("trips A.gpsz --json --until 2024-05-07").json
    assert only["trips"] == 2

    # Home and work are left out, the way between them is not.
    home = np.array([11.5, 11.5 + 4000 / 74_400])
    for options in ("", "--every 60s", "--bbox 11,48,12,49"):
        run = gpszip(f"decompress A.gpsz -o shared.csv --blur 300m --force {options}")
        assert run.code == 0, run.err
        rows = read((phone.parent / "shared.csv").read_text())
        lon = np.array([float(row["lon"]) for row in rows])
        away = np.abs(lon[:, None] - home).min(axis=1) * 74_400
        assert away.min() > 60
        assert (away > 1000).any()
    assert gpszip("decompress A.gpsz -o shared.csv --force --drop-ends 300m").code == 0
    run = gpszip("decompress A.gpsz -o shared.csv --force --blur 9km")
    assert run.code == 2 and "--blur leaves nothing" in run.err


def test_what_blur_cannot_hide_is_said(gpszip, tmp_path):
    rows = [f"{52 + i / 1e3},13.4" for i in range(30)]
    (tmp_path / "shape.csv").write_text("\n".join(["lat,lon", *rows]))
    assert gpszip("compress shape.csv -o S.gpsz --no-times --effort 1 --max-error 9m").code == 0
    run = gpszip("decompress S.gpsz -o S.csv --blur 200m")
    assert run.code == 2 and "no track without times tells" in run.err
    assert not (tmp_path / "S.csv").exists()
    rows = [f"{START + 10 * i},{52 + i / 1e3},13.4" for i in range(30)]
    (tmp_path / "walk.csv").write_text("\n".join(["t,lat,lon", *rows]))
    assert gpszip("compress walk.csv -o W.gpsz --effort 1 --max-error 9m").code == 0
    run = gpszip("decompress W.gpsz -o W.csv --blur 200m")
    assert run.code == 0 and "--blur hides nothing" in run.err


def test_standard_input(gpszip, phone, monkeypatch):
    options = "--effort 1 --max-error 30m --until 2024-05-07 --clean"
    assert gpszip(f"compress phone.csv -o A.gpsz {options}").code == 0
    for name, trips in (("phone.csv", 6), ("A.gpsz", 2)):
        given = io.TextIOWrapper(io.BytesIO((phone.parent / name).read_bytes()))
        monkeypatch.setattr("sys.stdin", given)
        assert gpszip("trips - --json").json["trips"] == trips


def test_formats(gpszip, phone):
    for name in ("T.csv", "T.json", "T.parquet", "T.geojson"):
        run = gpszip(f"trips phone.csv -o {name} --places {name.replace('T', 'P')}")
        assert run.code == 0, run.err
    folder = phone.parent
    rows = read((folder / "T.csv").read_text())

    table = pq.read_table(folder / "T.parquet")
    assert table.column_names == list(rows[0])
    assert [str(value) for value in table["kind"].to_pylist()] == [row["kind"] for row in rows]
    assert table["t_start"].to_pylist() == [float(row["t_start"]) for row in rows]

    document = json.loads((folder / "T.json").read_text())
    assert [row["t_end"] for row in document["rows"]] == table["t_end"].to_pylist()
    assert len(document["places"]) == 2 and document["timezone"] == "UTC"
    assert document["matrix"][0] | {"median_s": 0} == {
        "from": 1,
        "to": 2,
        "trips": 3,
        "median_s": 0,
    }

    features = json.loads((folder / "T.geojson").read_text())["features"]
    kinds = [feature["geometry"]["type"] for feature in features]
    assert kinds == ["Point", "LineString"] * 6 + ["Point"]
    line = features[1]["geometry"]["coordinates"]
    assert line[0][0] == pytest.approx(11.5, abs=3e-4) and line[0][1] == pytest.approx(48.1)
    points = json.loads((folder / "P.geojson").read_text())["features"]
    assert points[0]["properties"]["place"] == 1
    assert pq.read_table(folder / "P.parquet")["visits"].to_pylist() == [4, 3]


def test_standard_output_holds_the_table_alone(gpszip, phone):
    run = gpszip("trips phone.csv -o -")
    assert len(read(run.out)) == 13
    assert run.err.splitlines()[0].startswith("6 trips")
    run = gpszip("trips phone.csv -o - --json")
    assert len(read(run.out)) == 13
    assert json.loads(run.err)["trips"] == 6
    assert gpszip("trips phone.csv -o - --places -").code == 2


def test_points_out_of_order_are_sorted_and_counted(gpszip, phone):
    head, *rows = phone.read_text().splitlines()
    phone.write_text("\n".join([head, *rows[500:], *rows[:500]]))
    run = gpszip("trips phone.csv")
    assert "6 trips" in run.out
    assert "put in the order of time" in run.err


def test_metres_and_times_from_zero(gpszip, tmp_path):
    rows = [f"{t},{min(max(t - 1000, 0), 1000) * 5},0" for t in range(0, 3000, 10)]
    (tmp_path / "walk.csv").write_text("t,x,y\n" + "\n".join(rows))
    run = gpszip("trips walk.csv -o T.csv --places P.csv")
    assert run.code == 0
    assert "local hours" not in run.out
    rows = read((tmp_path / "T.csv").read_text())
    assert [row["kind"] for row in rows] == ["stay", "trip", "stay"]
    assert (rows[1]["x"], rows[1]["y"]) == ("5000", "0")
    assert "local_start" not in rows[0]

    run = gpszip("trips walk.csv --timezone Europe/Berlin")
    assert run.code == 2 and "they have no time zone" in run.err


def test_a_log_without_trips_has_a_table_of_heads(gpszip, tmp_path):
    (tmp_path / "one.csv").write_text("t,lat,lon\n5,48,11\n")
    assert gpszip("trips one.csv -o T.csv --places P.csv").code == 0
    assert (tmp_path / "T.csv").read_text().startswith(",".join(HEAD))
    assert (tmp_path / "P.csv").read_text() == (
        "place,lat,lon,spread,visits,dwell_s,first,last,departures,arrivals,role,evidence,"
        "usual_hours\n"
    )


def test_types_of_columns_do_not_depend_on_rows(gpszip, phone, tmp_path):
    (tmp_path / "one.csv").write_text("t,lat,lon\n1714953600,48,11\n")
    schemas = []
    for name in ("phone", "one"):
        run = gpszip(f"trips {name}.csv -o {name}.parquet --places {name}_places.parquet")
        assert run.code == 0, run.err
        schemas.append(pq.read_schema(tmp_path / f"{name}.parquet").to_string())
    text, number = "string", "double"
    kinds = dict(line.split(": ") for line in schemas[1].splitlines())
    assert (kinds["kind"], kinds["t_start"], kinds["first_seen"]) == (text, number, number)
    assert schemas[0].startswith(schemas[1])


def test_texts_are_quoted_where_one_needs_it(gpszip, phone):
    assert gpszip("trips phone.csv -o T.csv").code == 0
    assert '"' not in (phone.parent / "T.csv").read_text()
    phone.write_text(phone.read_text().replace("my phone", '"my, phone"'))
    assert gpszip("trips phone.csv -o T.csv --force").code == 0
    assert read((phone.parent / "T.csv").read_text())[0]["track_id"] == "my, phone"


def test_home_and_work_need_a_time_zone(gpszip, phone):
    lines = gpszip("trips phone.csv").out.splitlines()
    assert lines[1].startswith("hours are those of UTC, as no time zone was given: --timezone")
    assert not any("home" in line or "work" in line for line in lines[2:])
    assert {place["role"] for place in gpszip("trips phone.csv --json").json["places"]} == {""}


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ("trips phone.csv -o T.xlsx", 1, "trips can be written as .csv, .json, .geojson, .parquet"),
        ("trips phone.csv -o T.csv --places ./T.csv", 2, "two tables can't be in the same file"),
        ("trips phone.csv -o T.geoparquet", 1, "not as .geoparquet"),
        ("trips phone.csv --timezone Moon", 2, "there is no time zone 'Moon'"),
        ("trips phone.csv --min-stay 5m", 2, "write min for minutes"),
        ("trips phone.csv earth.gpsz", 2, "earth.gpsz is an archive, and 2 files were named"),
        ("trips timeless.gpsz", 2, "no track has times"),
        ("trips none.csv", 1, "no such file"),
        ("trips phone.csv -o phone.csv", 1, "exists already"),
    ],
)
def test_mistakes(gpszip, phone, earthly, timeless, words, code, text):
    earthly.rename(earthly.with_name("earth.gpsz"))
    run = gpszip(words)
    assert run.code == code
    assert text in run.err
