"""What every command prints with --json has the form that its schema says."""

import json

import click
import pytest
from jsonschema import Draft202012Validator

from gpszip.cli.main import cli
from gpszip.cli.schemas import ERROR, SCHEMAS

ROADS = {
    "type": "FeatureCollection",
    "gpszip": {"coordinates": "metres"},
    "features": [
        {
            "type": "Feature",
            "properties": {"id": f"s{number}"},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for number, line in enumerate(
            [[[0, 0], [40, 0]], [[40, 0], [40, 30]], [[40, 30], [0, 30]], [[0, 30], [0, 0]]]
        )
    ],
}


@pytest.fixture
def files(gpszip, log, walk_archive, archive, tmp_path):
    """A log on the square of some roads, an archive of it, and others."""
    (tmp_path / "roads.geojson").write_text(json.dumps(ROADS))
    # A log with a gap, with rows that are dropped, and with columns.
    header, *rows = log.read_text().splitlines()
    rows = [f"{row},note" for number, row in enumerate(rows) if not 60 <= number < 90]
    rows[3] = "nonsense,1,1,note"
    assert gpszip("coreset walk.csv -o small.parquet --size 9").code == 0
    (tmp_path / "rough.csv").write_text("\n".join([f"{header},about", *rows, rows[-1]]))
    (tmp_path / "place.csv").write_text("t,lat,lon\n1714557600,48,11\n1714557601,48,11.1\n")
    (tmp_path / "bad.gpx").write_text("<gpx><trk>")
    corners = ["0,0", "90,0", "90,60", "0,60"] * 5
    rows = [f"{30 * i},{corner}" for i, corner in enumerate(corners)]
    (tmp_path / "patrol.csv").write_text("\n".join(["t,x,y", *rows]))


def check(output, command):
    Draft202012Validator(SCHEMAS[command]).validate(output)


#: Commands, with exit code 0 unless another is named.
COMMANDS = [
    "compress walk.csv -o out.gpsz --rmse 1 --effort 1",
    "compress walk.csv -o out.gpsz --effort 1 --keep-times",
    "compress rough.csv bad.gpx -o out.gpsz --rmse 1 --effort 1 --skip-bad",
    "decompress walk.gpsz -o out.csv",
    "map walk.gpsz -o out.geojson",
    "plot walk.gpsz -o out.svg",
    "plot walk.gpsz --raw walk.csv -o out.svg",
    "coreset rough.csv -o out.parquet --size 9",
    "coreset walk.csv -o out.csv --size 9 --k 4 --points",
    "segments rough.csv -o out.csv --k 4 --m 2",
    "segments small.parquet -o out.csv --k 4 --m 2",
    "network roads.geojson -o out.gpsz --metres",
    "match rough.csv --network roads.geojson -o out.geojson",
    "patch rough.csv --network roads.geojson -o out.csv --gap 10s",
    "trips rough.csv -o out.csv --radius 5m --min-stay 1s",
    "trips walk.gpsz",
    "merge walk.gpsz two.gpsz -o out.gpsz --deviation 1",
    "select two.gpsz --track a -o out.gpsz",
    "split two.gpsz --by track -o parts",
    "join two.gpsz -o out.gpsz",
    "view walk.gpsz -o out.html",
    "view walk.gpsz --raw rough.csv -o out.html",
    "diff walk.gpsz walk.csv",
    "diff walk.gpsz two.gpsz",
    "listen --journal journal --stdin",
    "replay place.csv --as nmea --to udp://127.0.0.1:9",
    "usage walk.gpsz --by none",
    "rounds patrol.csv -o out.csv",
    "report patrol.csv -o out.html",
    "report two.gpsz -o out.html",
    "changes walk.gpsz walk.csv",
    "route walk.gpsz 1,1 20,1 -o out.geojson",
    "usage walk.csv --likelihood walk.csv --by hour -o out.csv",
    "predict walk.gpsz",
    "predict walk.gpsz walk.csv -o out.csv --edges 2",
    "unusual walk.csv --map walk.gpsz",
    "unusual walk.csv --map walk.gpsz -o out.json --stretches",
    "info walk.gpsz",
    "info two.gpsz --detail",
    "verify walk.gpsz",
    "recover walk.gpsz -o out.gpsz",
    "formats",
    "demo --out demo --points 200",
    "experiment generators -o out",
]


@pytest.mark.parametrize("words", COMMANDS)
def test_the_output_of_a_command_has_the_form_of_its_schema(gpszip, files, words):
    run = gpszip(f"{words} --json")
    assert run.code == (3 if "--skip-bad" in words else 0), run.err
    check(run.json, words.split()[0])


def test_a_dry_run_has_a_schema_of_its_own(gpszip, files):
    for options in ("--rmse 1", "--bytes 90", "--k 4 --m 2", "--no-times"):
        run = gpszip(f"compress rough.csv -o out.gpsz --effort 1 {options} --dry-run --json")
        assert run.code == 0, run.err
        check(run.json, "compress --dry-run")


def test_streams_have_a_schema_of_their_own(gpszip, files):
    run = gpszip("compress rough.csv --stream -o out.gpsz --rmse 1 --effort 1 --json")
    assert run.code == 3, run.err
    check(run.json, "compress --stream")


def test_bytes_have_schemas_of_their_own(gpszip, lossless_archive):
    for words in ("diff walk.gpsz walk.csv --exact", "decompress walk.gpsz --exact -o back.csv"):
        run = gpszip(f"{words} --json")
        assert run.code == 0, run.err
        check(run.json, f"{words.split()[0]} --exact")


def test_json_on_standard_error_has_the_same_form(gpszip, files):
    run = gpszip("decompress walk.gpsz -o - --json")
    check(json.loads(run.err), "decompress")


@pytest.mark.parametrize(
    "words",
    ["info none.gpsz", "info walk.csv", "compress walk.csv --rmse none", "compress", "nonsense"],
)
def test_errors_have_a_form_too(gpszip, files, words):
    run = gpszip(f"{words} --json")
    assert run.code != 0
    assert run.out == ""
    found = json.loads(run.err)
    Draft202012Validator(ERROR).validate(found)
    assert found["error"]["exit_code"] == run.code


def takes_json(command):
    found = cli.get_command(click.Context(cli), command)
    return any("--json" in parameter.opts for parameter in found.params)


def test_every_command_with_json_has_a_schema_and_is_tested():
    # What cat prints with --json is an error alone: its rows are data.
    with_json = {name for name in cli.list_commands(None) if takes_json(name)} - {"cat"}
    assert with_json == {name for name in SCHEMAS if " " not in name}
    # What warm prints needs no kernels to be compiled by a test.
    assert with_json - {words.split()[0] for words in COMMANDS} == {"warm"}


@pytest.mark.parametrize("name", SCHEMAS)
def test_schemas_are_valid_and_describe_every_field(name):
    schema = SCHEMAS[name]
    Draft202012Validator.check_schema(schema)
    for field, described in schema["properties"].items():
        assert described.get("description"), field


def test_a_field_that_is_unknown_or_missing_is_found():
    validator = Draft202012Validator(SCHEMAS["map"])
    assert validator.is_valid({"output": "a", "edges": 1})
    assert not validator.is_valid({"output": "a"})
    assert not validator.is_valid({"output": "a", "edges": 1, "more": 2})
    assert not validator.is_valid({"output": "a", "edges": 1.5})
