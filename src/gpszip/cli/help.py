"""gpszip help: the help of a command, or a text about what several commands share."""

from __future__ import annotations

from difflib import get_close_matches

import click

from gpszip.cli.outcome import Outcome
from gpszip.cli.topics import TOPICS

__all__ = ["command"]


@click.command("help", short_help="Explain a command, or a topic such as units.")
@click.argument("topic", required=False)
@click.pass_context
def command(context: click.Context, topic: str | None) -> Outcome:
    """Explain a command, or a TOPIC: errors, units, exit-codes, environment, input, output."""
    group = context.find_root().command
    assert isinstance(group, click.Group)
    root = context.find_root()

    # Without a topic: all commands, then all topics.
    if topic is None:
        click.echo(group.get_help(root))
        click.echo(f"\nTopics of gpszip help: {', '.join(TOPICS)}.")
        return Outcome.DONE
    if topic in TOPICS:
        click.echo(TOPICS[topic].rstrip())
        return Outcome.DONE

    # A command.
    found = group.get_command(root, topic)
    if found is None:
        raise click.UsageError(_unknown(topic, [*TOPICS, *group.list_commands(root)]))
    with click.Context(found, parent=root, info_name=topic) as shown:
        click.echo(found.get_help(shown))
    return Outcome.DONE


def _unknown(topic: str, names: list[str]) -> str:
    """Say that there is no such topic, and which was meant."""
    nearest = get_close_matches(topic, names, n=1)
    hint = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(names)}"
    return f"no command or topic {topic!r}; {hint}"
