"""gpszip decompress --exact --track and --columns, and the same from Python."""

import pytest

import gpszip
from gpszip.errors import OptionError, UnknownTrackError

#: Rows of two vehicles in turn, with an odd notation, and a row that no reader can use.
VEHICLES = ("bike", "van")
LINES = [
    f"{VEHICLES[i % 3 > 0]},{i}.0,{10 * i}.50,{i % 7},{400 + i % 5}.{i % 10},{90 + i % 9}\r\n"
    for i in range(240)
]
LINES[7] = "van,7.0,oops,+1,,\r\n"
HEADER = "id,t,x,y,ele,hr\r\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Bytes of an archive that keeps a log of two vehicles, and another one."""
    folder = tmp_path_factory.mktemp("rows")
    fleet, notes = folder / "fleet.csv", folder / "one.csv"
    fleet.write_bytes((HEADER + "".join(LINES)).encode())
    notes.write_bytes(b"t,x,y\n" + b"".join(b"%d,%d,0\n" % (i, 3 * i) for i in range(40)))
    whole = gpszip.compress(fleet, rmse=5, effort=1, lossless=True)
    both = gpszip.compress([fleet, notes], rmse=5, effort=1, lossless=True)
    return whole, both


@pytest.fixture
def archive(made, tmp_path):
    made[0].save(tmp_path / "a.gpsz")
    return tmp_path / "a.gpsz"


def test_rows_of_a_track_are_those_of_the_log(gpszip, archive, tmp_path):
    done = gpszip("decompress a.gpsz --exact --track van -o van.csv")
    assert done.code == 0, done.err
    assert "van.csv: 160 rows" in done.err
    wanted = HEADER + "".join(line for line in LINES if line.startswith("van"))
    assert (tmp_path / "van.csv").read_bytes() == wanted.encode()
    done = gpszip("decompress a.gpsz --exact --track van -o van.csv")
    assert (done.code, "exists" in done.err) == (1, True)


def test_columns_are_those_of_the_log(gpszip, archive):
    done = gpszip("decompress a.gpsz --exact --columns hr,ele -o -")
    cells = [line.strip().split(",") for line in LINES]
    assert done.out == "hr,ele\n" + "".join(f"{row[5]},{row[4]}\n" for row in cells)
    done = gpszip("decompress a.gpsz --exact --track bike --columns t -o - --json")
    assert done.out == "t\n" + "".join(f"{row[1]}\n" for row in cells if row[0] == "bike")


def test_json_counts_rows(gpszip, archive, tmp_path):
    facts = gpszip("decompress a.gpsz --exact --track bike -o b.csv --json").json
    size = (tmp_path / "b.csv").stat().st_size
    assert facts == {"output": "b.csv", "logs": 1, "rows": 80, "bytes": size}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--exact --track bus", "there is no track 'bus' in the logs; there are bike, van"),
        ("--exact --columns ele,power", "no column 'power'; it has id, t, x, y, ele, hr"),
        ("--exact --track van --track bike", "2 tracks were given; give one --track"),
        ("--exact --columns ele --log b.csv", "no log 'b.csv' is kept exactly"),
        ("--columns ele", "--columns names what is kept exactly; add --exact"),
    ],
)
def test_what_is_not_kept_is_refused(gpszip, archive, options, message):
    done = gpszip(f"decompress a.gpsz {options} -o b.csv")
    assert done.code != 0
    assert message in done.err


def test_rows_of_text_are_no_parquet(gpszip, archive, tmp_path):
    done = gpszip("decompress a.gpsz --exact --columns ele -o ele.parquet")
    assert (done.code, "rows of text are written as text" in done.err) == (2, True)
    assert not (tmp_path / "ele.parquet").exists()


def test_tables_hold_the_texts_of_the_log(made):
    whole, _ = made
    rows = whole.exact_rows("van", ["t", "x", "ele"]).to_pylist()
    assert rows[:2] == [
        {"t": "1.0", "x": "10.50", "ele": "401.1"},
        {"t": "2.0", "x": "20.50", "ele": "402.2"},
    ]
    assert {"t": "7.0", "x": "oops", "ele": ""} in rows
    assert whole.exact_rows().num_rows == len(LINES)
    with pytest.raises(UnknownTrackError, match="'bus'"):
        whole.exact_rows("bus")


def test_a_log_without_names_of_tracks_is_one(made):
    _, both = made
    assert both.exact_names == ("fleet.csv", "one.csv")
    assert both.exact_rows("one")["x"].to_pylist()[:3] == ["0", "3", "6"]
    assert both.exact_rows("bike").num_rows == 80
    with pytest.raises(OptionError, match="have other columns; name one of them with --log"):
        both.exact_rows(columns=["t"])
    assert both.exact_rows(columns=["y"], log="one.csv").num_rows == 40


def test_rows_stay_after_another_track_is_appended(made):
    whole, _ = made
    track = gpszip.Track("new", [1000.0, 1001.0], [[0, 0], [1, 1]])
    grown = gpszip.append(whole, track)
    assert grown.exact_rows("bike", ["t"]).equals(whole.exact_rows("bike", ["t"]))
    assert grown.exact_log("fleet.csv") == (HEADER + "".join(LINES)).encode()


def test_a_log_without_rows_says_so(tmp_path):
    (tmp_path / "walk.gpx").write_text(
        "<gpx><trk><name>a</name><trkseg>"
        + "".join(
            f'<trkpt lat="48.{i:03}" lon="11"><time>2024-05-06T07:08:{i:02}Z</time></trkpt>\n'
            for i in range(30)
        )
        + "</trkseg></trk></gpx>"
    )
    archive = gpszip.compress(tmp_path / "walk.gpx", rmse=5, effort=1, lossless=True)
    with pytest.raises(OptionError, match=r"walk\.gpx has no rows with columns"):
        archive.exact_rows(columns=["ele"])


def test_a_line_that_ends_within_a_cell_is_no_table(tmp_path):
    cells = ["5\r6" if i == 9 else str(i) for i in range(40)]
    rows = [f"{i % 2},{i},{i},{cell}\n" for i, cell in enumerate(cells)]
    (tmp_path / "odd.csv").write_bytes(("id,t,x,y\n" + "".join(rows)).encode())
    archive = gpszip.compress(tmp_path / "odd.csv", rmse=1, effort=1, lossless=True)
    for columns in (["y"], ["y", "x"]):
        with pytest.raises(OptionError, match=r"odd\.csv has an end of a line within a cell"):
            archive.exact_rows(None, columns)
    assert archive.exact_rows("0", ["y"]).num_rows == 20
