"""A progress bar on standard error, for people only."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpszip.model import Listener, Progress

__all__ = ["progress_bar"]


@contextmanager
def progress_bar(*, quiet: bool) -> Iterator[Listener | None]:
    """Listen to the events of a long computation and show them, while standard error is a terminal.

    Yields
    ------
    callable or None
        Takes each :class:`~gpszip.model.Progress`; None where nobody watches.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from gpszip.kernels.compiling import on_compile

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("begin", total=None)

        def show(event: Progress) -> None:
            bar.update(task, description=event.stage, completed=event.done, total=1.0)

        with on_compile(
            lambda: bar.update(task, description="compile, once for this installation", total=None)
        ):
            yield show
