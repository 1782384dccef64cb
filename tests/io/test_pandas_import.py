"""The command line leaves pandas out, and plugins may import it."""

import importlib.util
import subprocess
import sys

import pytest

from gpszip.io.pandas_import import hide_pandas, show_pandas

#: Runs a command, and says whether pandas was imported.
COMMAND = """
import sys
from gpszip.cli.main import run
sys.argv = ["gpszip", *{words!r}]
try:
    run()
finally:
    print("pandas.core" in sys.modules)
"""


def test_commands_leave_pandas_out(tmp_path):
    pytest.importorskip("pandas")
    log = tmp_path / "a.csv"
    log.write_text("t,lat,lon\n" + "".join(f"2024-05-01T12:00:{i:02}Z,48,11\n" for i in range(9)))

    for words in (["compress", "a.csv"], ["decompress", "a.gpsz", "-o", "b.gpx"]):
        program = COMMAND.format(words=words)
        done = subprocess.run(
            [sys.executable, "-c", program],
            cwd=tmp_path,
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.split()[-1] == "False"


def test_pandas_can_be_shown_again(monkeypatch):
    pytest.importorskip("pandas")
    monkeypatch.delitem(sys.modules, "pandas")
    hide_pandas()
    with pytest.raises(ImportError):
        import pandas  # noqa: F401
    show_pandas()
    assert importlib.util.find_spec("pandas") is not None


def test_pandas_that_is_imported_stays():
    pandas = pytest.importorskip("pandas")
    hide_pandas()
    show_pandas()
    assert sys.modules["pandas"] is pandas
