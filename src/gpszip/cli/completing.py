"""Names of files for a shell that completes a word."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click
from click.shell_completion import CompletionItem

__all__ = ["complete_files"]

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def complete_files(*suffixes: str) -> Completer:
    """Return a function that completes names of files with one of the suffixes.

    Folders are completed, too, and any file where there are no suffixes.
    """

    def complete(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
        # The shell itself knows best how to complete any file.
        if not suffixes:
            return [CompletionItem(incomplete, type="file")]
        return [CompletionItem(name) for name in _matching_names(incomplete, suffixes)]

    return complete


def _matching_names(incomplete: str, suffixes: tuple[str, ...]) -> list[str]:
    """Files with a suffix, and folders, whose names begin with an incomplete one."""
    # The folder as it was typed, so that completed words begin with what is there already.
    slash = incomplete.rfind("/") + 1
    folder, beginning = incomplete[:slash], incomplete[slash:]
    try:
        entries = sorted(Path(folder or ".").iterdir())
    except OSError:
        return []

    # Hidden files are completed where a dot was typed.
    names = []
    for entry in entries:
        if not entry.name.startswith(beginning) or entry.name.startswith(".") > bool(beginning):
            continue
        if entry.is_dir():
            names.append(f"{folder}{entry.name}/")
        elif entry.name.lower().endswith(suffixes):
            names.append(folder + entry.name)
    return names
