"""Where a command's work runs, and the options that say so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from gpszip.run.executor import Executor

__all__ = ["engine_options", "open_executor"]

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--workers",
        type=click.IntRange(1),
        metavar="N",
        help="Threads or processes; by default one for each core.",
    ),
    click.option(
        "--engine",
        type=click.Choice(["threads", "processes"]),
        default=None,
        help="Where work runs.  [default: threads]",
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="Run on a Dask cluster that is there, such as tcp://10.0.0.1:8786.",
    ),
)


def engine_options(command: F) -> F:
    """Add the options ``--workers``, ``--engine`` and ``--scheduler``."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@contextmanager
def open_executor(
    workers: int | None, engine: str | None, scheduler: str | None
) -> Iterator[Executor]:
    """Give the executor that was asked for, and end it afterwards."""
    from gpszip.errors import OptionError
    from gpszip.run import Dask, Processes, Threads

    if scheduler is not None:
        if workers is not None or engine is not None:
            raise OptionError(
                "--scheduler uses the cluster's own workers; leave out --workers and --engine"
            )
        from gpszip.run.dask import connect

        with connect(scheduler) as client:
            yield Dask(client)
    elif engine == "processes":
        from gpszip.pipeline.warm import warm

        warm()  # else each process compiles for itself
        with Processes(workers) as executor:
            yield executor
    else:
        yield Threads() if workers is None else Threads(workers)
