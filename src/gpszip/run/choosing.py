"""What the user gave as an executor, made one."""

from __future__ import annotations

from typing import Any

from gpszip.errors import OptionError
from gpszip.run.dask import Dask
from gpszip.run.executor import Executor
from gpszip.run.threads import Threads

__all__ = ["resolve_executor"]


def resolve_executor(given: Any) -> Executor:
    """Return an executor: the one given, that of a ready ``distributed.Client``, or a thread for each core.

    Raises
    ------
    OptionError
        If it is nothing that work can run on.

    Examples
    --------
    >>> resolve_executor(Threads(2))
    Threads(workers=2)
    """
    if given is None:
        return Threads()
    if hasattr(given, "scatter") and hasattr(given, "submit"):
        return Dask(given)
    if not hasattr(given, "map") or hasattr(given, "submit"):
        raise OptionError(
            f"{given!r} is no executor; give one of gpszip.run or a distributed.Client"
        )
    executor: Executor = given
    return executor
