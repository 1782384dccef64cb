"""The names and roles of a table's columns, as the user gives them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpszip.errors import InputError
from gpszip.io.logs.raw import Request
from gpszip.io.tables.roles import Roles, find_roles

__all__ = ["find_requested_roles", "rename_columns"]

#: Names by which ``--columns`` passes over a column.
_UNNAMED = ("", "-", "_")

#: Columns that messages name.
_MAX_SHOWN_NAMES = 20


def rename_columns(names: Any, request: Request, where: str) -> tuple[str, ...]:
    """Return the names of a table's columns, replaced by those that the user gives in order.

    Parameters
    ----------
    names : iterable of str
        Names in the table.
    request : Request
        The columns that the user gives.
    where : str
        Name of the log for messages.

    Raises
    ------
    InputError
        If the user names more columns than there are.

    Examples
    --------
    >>> rename_columns(["a", "b", "c"], Request(columns=("t", "-")), "log.parquet")
    ('t', 'b', 'c')
    """
    found = tuple(str(name) for name in names)
    if not isinstance(request.columns, tuple):
        return found
    if len(request.columns) > len(found):
        raise InputError(
            f"has {len(found)} columns, but --columns names {len(request.columns)}",
            path=where,
            remedy=f"it has: {', '.join(found[:_MAX_SHOWN_NAMES])}",
        )
    renamed = tuple(
        old if new in _UNNAMED else new for new, old in zip(request.columns, found, strict=False)
    )
    return renamed + found[len(renamed) :]


def find_requested_roles(names: tuple[str, ...], request: Request, where: str) -> Roles:
    """Find the roles of columns, those first that the user gives by name.

    Parameters
    ----------
    names : tuple of str
        Names of the columns.
    request : Request
        What the user asks for.
    where : str
        Name of the log for messages.

    Raises
    ------
    InputError
        If a column is missing.

    Examples
    --------
    >>> find_requested_roles(("t", "x", "y"), Request(), "log.parquet").axes
    (1, 2)
    """
    return find_roles(
        names,
        request.columns if isinstance(request.columns, Mapping) else None,
        request.keep,
        where,
        heading=request.heading,
        accuracy=request.accuracy,
        times=request.times,
        optional=request.optional,
    )
