"""Options that say where a command runs its work, and the executor for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from gpszip.run.executor import Executor

__all__ = ["engine_options", "open_executor"]

F = TypeVar("F", bound=Callable[..., Any])

#: The options in the order of help texts.
_OPTIONS = (
    click.option(
        "--workers",
        type=click.IntRange(1),
        metavar="N",
        envvar="GPSZIP_WORKERS",
        show_envvar=True,
        help="Threads or processes; by default one for each core.",
    ),
    click.option(
        "--engine",
        type=click.Choice(["threads", "processes"]),
        default=None,
        envvar="GPSZIP_ENGINE",
        show_envvar=True,
        help="Where work runs.  [default: threads]",
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        envvar="GPSZIP_SCHEDULER",
        show_envvar=True,
        help="Run on a Dask cluster, such as tcp://10.0.0.1:8786.",
    ),
)


def engine_options(command: F) -> F:
    """Add the options ``--workers``, ``--engine`` and ``--scheduler``."""
    # Decorators apply from the bottom up: the one that is applied last is listed first.
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@contextmanager
def open_executor(
    workers: int | None, engine: str | None, scheduler: str | None
) -> Iterator[Executor]:
    """Open the executor that the options name, and close it at the end.

    Parameters
    ----------
    workers : int, optional
        Number of threads or processes; one for each core if left out.
    engine : str, optional
        ``threads`` or ``processes``.
    scheduler : str, optional
        Address of a Dask cluster, which has its own workers.

    Raises
    ------
    OptionError
        If a scheduler is given together with workers or an engine.
    """
    from gpszip.errors import OptionError
    from gpszip.run import Dask, Processes, Threads

    # Refuse options that a cluster would ignore, then connect to it; local work runs in threads
    # unless processes are asked for.
    if scheduler is not None:
        if workers is not None or engine is not None:
            raise OptionError(
                "--scheduler uses the cluster's own workers",
                remedy="leave out --workers and --engine",
            )
        from gpszip.run.dask import connect

        # Disconnect at the end; the cluster itself keeps running.
        with connect(scheduler) as client:
            yield Dask(client)
    elif engine == "processes":
        from gpszip.pipeline.warm import warm

        # Compile the kernels into the cache from which all worker processes load them.
        warm()  # otherwise each process would compile the kernels
        with Processes(workers) as executor:
            yield executor
    else:
        yield Threads() if workers is None else Threads(workers)
