import csv
import io
import json

import pytest

from gpszip.errors import OutputError
from gpszip.experiments.experiment import Outcome
from gpszip.experiments.listing import Experiment
from gpszip.experiments.table import Column, Table, to_csv, to_markdown
from gpszip.experiments.write import write_outcome

COLUMNS = (Column("log", "log"), Column("rmse_m", "RMSE m", 1), Column("points", "points"))
ROWS = ({"log": 'a|b, "c"', "rmse_m": 1.25, "points": 1234567}, {"log": "d", "points": 2})
TABLE = Table("", "Sizes", COLUMNS, ROWS)
EXPERIMENT = Experiment("sizes", "sizes of logs", "nowhere")


def test_markdown_has_as_many_cells_in_each_row():
    rows = to_markdown(TABLE).replace("\\|", "").splitlines()
    assert {row.count("|") for row in rows} == {4}
    assert rows[2] == '| ab, "c" | 1.2 | 1,234,567 |'


def test_csv_gives_the_values_back():
    text = to_csv(TABLE, ["two\nlines"])
    comment, rest = text.split("\n", 1)
    assert comment == "# two lines"
    first, second = csv.DictReader(io.StringIO(rest))
    assert first == {"log": 'a|b, "c"', "rmse_m": "1.25", "points": "1234567"}
    assert second == {"log": "d", "rmse_m": "", "points": "2"}


def test_files_say_how_they_were_made(tmp_path):
    outcome = Outcome((TABLE, Table("more", "More", COLUMNS, ROWS)), notes=("One note.",))
    names = write_outcome(
        EXPERIMENT, outcome, tmp_path, seed=7, command="gpszip experiment sizes", version="1.2"
    )
    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    assert names == ["sizes.md", "sizes.json", "sizes.csv", "sizes-more.csv"]
    for name in names:
        text = (tmp_path / name).read_text()
        assert "gpszip experiment sizes" in text
        assert "numpy" in text
        assert "1.2" in text
    found = json.loads((tmp_path / "sizes.json").read_text())
    assert found["seed"] == 7
    assert found["tables"]["main"][1] == {"log": "d", "rmse_m": None, "points": 2}
    assert found["notes"] == ["One note."]


def test_files_are_replaced_only_with_force(tmp_path):
    (tmp_path / "sizes.csv").write_text("precious")
    with pytest.raises(OutputError, match="exists"):
        write_outcome(EXPERIMENT, Outcome((TABLE,)), tmp_path, seed=1, command="c", version="1")
    assert [path.name for path in tmp_path.iterdir()] == ["sizes.csv"]
    write_outcome(
        EXPERIMENT, Outcome((TABLE,)), tmp_path, seed=1, command="c", version="1", force=True
    )
    assert (tmp_path / "sizes.csv").read_text() != "precious"
