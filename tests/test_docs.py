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
