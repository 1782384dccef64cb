"""Refuse options of gpszip listen that contradict each other, or would do nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

__all__ = ["check_choices"]

#: Options that do nothing without one of some others.
_NEEDED = {
    "token": ("http", "page"),
    "max_rate": ("http",),
    "keys": ("http", "mqtt"),
    "delay": ("outputs", "page"),
    "silent_after": ("outputs", "page"),
    "every": ("archive",),
    "roll_now": ("archive",),
    "rmse": ("archive",),
    "max_error": ("archive",),
    "effort": ("archive",),
}

#: Options that name sources.
_SOURCES = ("http", "mqtt", "gpsd", "nmea", "ros", "mavlink", "signalk", "kafka")

#: Options that --roll-now leaves no time for, as it opens nothing and ends.
_NOT_NOW = (*_SOURCES, "stdin", "outputs", "page", "every")

#: Beginnings of the addresses of webhooks.
_WEBHOOKS = ("http://", "https://")


def check_choices(choices: dict[str, Any], folder: str) -> None:
    """Refuse options that contradict each other, or would do nothing.

    Variables of the environment are set for many commands, and may do nothing for one.

    Raises
    ------
    click.UsageError
        For the first such option.
    """
    # Options that need others.
    for name, needed in _NEEDED.items():
        if _is_given(name) and not any(choices[each] for each in needed):
            others = " or ".join(map(_option, needed))
            raise click.UsageError(f"{_option(name)} needs {others}")
    if _is_given("key") and not any(text.startswith(_WEBHOOKS) for text in choices["outputs"]):
        raise click.UsageError("--sign needs -o with a webhook, such as -o https://host/path")
    if choices["columns"] and not choices["stdin"] and any(choices[each] for each in _SOURCES):
        raise click.UsageError("--columns needs --stdin: it names columns of standard input")

    # Options that exclude others.
    for name in _NOT_NOW:
        if choices["roll_now"] and choices[name]:
            raise click.UsageError(f"--roll-now archives and ends; leave out {_option(name)}")
    _check_files(choices, Path(folder))
    _check_events(choices, Path(folder))


def _check_files(choices: dict[str, Any], folder: Path) -> None:
    """Refuse a file of events that the journal or the archive would replace."""
    for text in choices["outputs"]:
        if text in ("", "-") or "://" in text:
            continue
        path = Path(text).resolve()
        if path.parent == folder.resolve():
            raise click.UsageError(f"-o {text}: the journal has its own files there; name another")
        if choices["archive"] and path == Path(choices["archive"]).resolve():
            raise click.UsageError(f"-o {text}: that is the archive; name another file")


def _check_events(choices: dict[str, Any], folder: Path) -> None:
    """Refuse a map without events, and an archive that takes positions before their events."""
    from gpszip.live.place_read import read_place, state_path

    has_events = choices["outputs"] or choices["page"]
    if choices["map"] and not has_events:
        raise click.UsageError(
            "a map tells events; say where they go with -o, as -o events.ndjson, or --page"
        )
    if not choices["archive"] or choices["roll_now"] or has_events:
        return

    # A former listener told events, and the journal is kept for the next one that does.
    if read_place(folder) is not None:
        raise click.UsageError(
            f"{folder}: events of this journal were asked for, and --archive would delete "
            "positions before they are found; add -o or --page, or remove "
            f"{state_path(folder)} to do without events"
        )


def _is_given(name: str) -> bool:
    source = click.get_current_context().get_parameter_source(name)
    return source is ParameterSource.COMMANDLINE


def _option(name: str) -> str:
    """The option as it is written, such as --silent-after."""
    command = click.get_current_context().command
    return next(each.opts[-1] for each in command.params if each.name == name)
