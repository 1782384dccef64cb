"""Commands of docs/live.md; listeners run until they are told to stop, so they are parsed only."""

import re
import shlex
from pathlib import Path

import click
import pytest

from gpszip.cli.main import cli

PAGE = (Path(__file__).parents[2] / "docs" / "live.md").read_text()
COMMANDS = re.findall(r"gpszip ((?:listen|replay) .+)$", PAGE.replace("\\\n", ""), re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_options_of_commands_are_right(command):
    name, *words = shlex.split(command)
    found = cli.get_command(click.Context(cli), name)
    context = found.make_context(name, words)
    assert context.params["folder" if name == "listen" else "logs"]


def test_the_page_has_commands_of_both():
    assert {command.split()[0] for command in COMMANDS} == {"listen", "replay"}
