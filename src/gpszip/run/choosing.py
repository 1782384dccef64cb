"""Conversion of the user's ``executor`` argument to an executor."""

from __future__ import annotations

from typing import Any

from gpszip.errors import OptionError
from gpszip.run.dask import Dask
from gpszip.run.executor import Executor
from gpszip.run.threads import Threads

__all__ = ["resolve_executor"]


def resolve_executor(given: Any) -> Executor:
    """Return an executor for an argument: an executor, a ``distributed.Client`` or None.

    None stands for a thread for each core.

    Raises
    ------
    OptionError
        If it is none of these.

    Examples
    --------
    >>> resolve_executor(Threads(2))
    Threads(workers=2)
    """
    if given is None:
        return Threads()
    # A client of Dask, found by its methods: Dask may not be installed.
    if hasattr(given, "scatter") and hasattr(given, "submit"):
        return Dask(given)

    # concurrent.futures' executors have submit, and a map that holds all items at once
    if not hasattr(given, "map") or hasattr(given, "submit"):
        raise OptionError(
            f"{given!r} is no executor; give one of gpszip.run or a distributed.Client"
        )
    executor: Executor = given
    return executor
