"""What the documentation names exists."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from gpszip.cli.main import cli

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        assert "://" in target or (page.parent / target).exists(), f"{page.name}: {target}"


def test_named_sources_exist():
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", (ROOT / "docs/algorithms.md").read_text()):
        assert (ROOT / name).exists() or (ROOT / "src/gpszip" / name).exists(), name


def options_of(command):
    found = cli.get_command(None, command)
    return {
        name
        for parameter in found.params
        if not getattr(parameter, "hidden", False)
        for name in (*parameter.opts, *parameter.secondary_opts)
    } | {"--help"}


def test_commands_and_options_exist():
    known = {name for command in cli.list_commands(None) for name in options_of(command)} | {
        "--version"
    }
    for page in PAGES:
        text = page.read_text()
        for line in re.findall(r"^ {4}gpszip (.*)", text, flags=re.MULTILINE):
            command = line.split()[0]
            if command == "COMMAND":
                continue
            assert command in cli.list_commands(None), f"{page.name}: {line}"
            wrong = set(re.findall(r"--[a-z][a-z-]+", line.split("#")[0])) - options_of(command)
            assert not wrong, f"{page.name}: {line}"
        if page.name in {"cli.md", "README.md"}:
            told = set(re.findall(r"`(--[a-z][a-z-]+)", text))
            assert told <= known, f"{page.name}: {told - known}"


def test_every_command_and_option_is_documented():
    text = (ROOT / "docs/cli.md").read_text()
    for command in cli.list_commands(None):
        assert f"gpszip {command} " in text, command
        for name in options_of(command):
            assert not name.startswith("--") or name in {"--help", "--output"} or name in text, (
                f"{command} {name}"
            )


def test_exit_codes_are_documented():
    rows = re.findall(r"^\| (\d+) \|", (ROOT / "docs/cli.md").read_text(), flags=re.MULTILINE)
    assert rows == ["0", "1", "2", "3", "4", "5", "6", "130"]


def test_the_picture_of_the_architecture_is_up_to_date(tmp_path):
    script = ROOT / "scripts" / "draw_architecture.py"
    subprocess.run([sys.executable, script, tmp_path / "new.svg"], check=True)
    drawn = (ROOT / "docs" / "architecture.svg").read_text()
    assert drawn == (tmp_path / "new.svg").read_text(), "run make docs"


#: What the thesis numbers: definitions and the like by section, algorithms, tables and figures.
NUMBERED = {
    "definition": ["4.1." + str(i) for i in range(1, 10)] + ["6.2.1", "6.2.8", "6.2.10"],
    "problem": ["4.2.1", "4.2.2", "4.2.3"],
    "theorem": ["5.1.1", "6.1.1", "6.2.9", "6.2.11", "6.2.16"],
    "claim": ["6.2.3", "6.2.5", "6.2.6", "6.2.7", "6.2.14", "6.2.15"],
    "observation": ["6.2.4", "6.2.13"],
    "remark": ["6.2.2", "6.2.12", "6.3.1"],
    "algorithm": [str(i) for i in range(1, 7)],
    "table": ["8.1", "8.2"],
    "figure": [
        *("1-1", "1-2", "1-3", "1-4", "2-1", "3-1", "5-1", "6-1", "6-2", "6-3", "6-4", "6-5"),
        *(f"8-{i}" for i in range(1, 9)),
    ],
}


def test_algorithms_have_a_row_for_all_that_the_thesis_numbers():
    rows = [
        line.split("|")[1].lower()
        for line in (ROOT / "docs/algorithms.md").read_text().splitlines()
        if line.startswith("| ")
    ]
    missing = [
        f"{kind} {number}"
        for kind, numbers in NUMBERED.items()
        for number in numbers
        if not any(kind in row and covers(row, number) for row in rows)
    ]
    assert not missing


def covers(row, number):
    """Whether a row names a number, alone or in a range such as ``6.2.5 to 6.2.7``."""
    if re.search(rf"(?<![\d.-]){re.escape(number)}(?![\d-]|\.\d)", row):
        return True
    ranges = re.findall(r"(\d+\.\d+\.)(\d+) to \1(\d+)", row)
    return any(number in {f"{stem}{i}" for i in range(int(a), int(b) + 1)} for stem, a, b in ranges)
