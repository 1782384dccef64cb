"""Write the man pages of gpszip and its commands.

python scripts/write_man_pages.py build/man
"""

import sys
from pathlib import Path

import click
from click_man.core import write_man_pages

import gpszip
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.main import cli


def main() -> None:
    """Write a page for each command to the folder that the command line names."""
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)

    # The page writer wants all commands at hand, with the lists of formats in their help texts.
    context = click.Context(cli)
    # A man page can't keep the lines of the examples apart.
    about = str(cli.help).partition("\n\n\b")[0]
    group = click.Group("gpszip", help=about, epilog=cli.epilog, params=cli.params)
    group.short_help = "learn the map that position logs repeat"
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        group.add_command(command.filled() if isinstance(command, CommandWithFormats) else command)
    write_man_pages("gpszip", group, version=gpszip.__version__, target_dir=str(target))


if __name__ == "__main__":
    main()
