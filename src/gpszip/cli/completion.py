"""gpszip completion: print the script with which a shell completes commands."""

from __future__ import annotations

import sys

import click

from gpszip.cli.outcome import Outcome

__all__ = ["command"]

#: Where a user puts the script, by shell.
_INSTALL = {
    "bash": "~/.local/share/bash-completion/completions/gpszip",
    "zsh": "a folder of $fpath, as the file _gpszip",
    "fish": "~/.config/fish/completions/gpszip.fish",
}


@click.command("completion", short_help="Print a script that completes commands in a shell.")
@click.argument("shell", type=click.Choice(list(_INSTALL)))
def command(shell: str) -> Outcome:
    r"""Print the script with which SHELL completes commands, options and files.

    \b
    gpszip completion bash > ~/.local/share/bash-completion/completions/gpszip
    gpszip completion zsh  > ~/.zfunc/_gpszip       # with ~/.zfunc in $fpath
    gpszip completion fish > ~/.config/fish/completions/gpszip.fish
    """
    from click.shell_completion import get_completion_class

    from gpszip.cli.main import cli
    from gpszip.cli.output import print_status

    kind = get_completion_class(shell)
    assert kind is not None
    completion = kind(cli, {}, "gpszip", "_GPSZIP_COMPLETE")
    script = completion.source_template % completion.source_vars()
    click.echo(script)

    # On a terminal, the script is of no use: say where it belongs.
    if sys.stdout.isatty():
        print_status(f"redirect this to {_INSTALL[shell]}")
    return Outcome.DONE
