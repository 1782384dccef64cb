"""A progress bar on standard error, if that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpszip.model import Listener, Progress

__all__ = ["progress_bar"]


@contextmanager
def progress_bar(*, quiet: bool) -> Iterator[Listener | None]:
    """Show the progress of a long computation.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Yields
    ------
    callable or None
        Listener for each :class:`~gpszip.model.Progress`; None if nothing is shown.
    """
    # A bar redraws its own line, which only a terminal can do.
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from gpszip.kernels.compiling import on_compile

    # The length is unknown until the first event; the bar is erased at the end.
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("begin", total=None)

        # A stage reports the share of its work that is done, from 0 to 1.
        def show(event: Progress) -> None:
            bar.update(task, description=event.stage, completed=event.done, total=1.0)

        # How many kernels are left is unknown, so the bar only moves; the count grows.
        kernels = count(1)

        def show_compiling() -> None:
            description = f"compile, once for this installation: kernel {next(kernels)}"
            bar.update(task, description=description, total=None)

        # While the caller works, say when a kernel compiles: it would look like a stalled stage.
        with on_compile(show_compiling):
            yield show
