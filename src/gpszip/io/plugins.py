"""Formats that other installed packages add, found by entry points.

A package adds a format in its ``pyproject.toml``::

    [project.entry-points."gpszip.map_formats"]
    kml = "my_package.kml:FORMAT"

The groups are ``gpszip.formats`` (logs), ``gpszip.network_formats`` and ``gpszip.map_formats``.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import Any, TypeVar, overload

from gpszip.errors import InputError

__all__ = ["forget_plugins", "load_plugins"]

Plugin = TypeVar("Plugin")


@overload
def load_plugins(group: str) -> tuple[Any, ...]: ...


@overload
def load_plugins(group: str, kind: type[Plugin]) -> tuple[Plugin, ...]: ...


def load_plugins(group: str, kind: type[Any] = object) -> tuple[Any, ...]:
    """Load what installed packages register in a group of entry points.

    A group is loaded at its first use, and once in a process.

    Parameters
    ----------
    group : str
        Name of the group, such as ``gpszip.map_formats``.
    kind : type, optional
        Type that the objects must have.

    Returns
    -------
    tuple
        The objects, in the order of their names; empty if no package registers any.

    Raises
    ------
    InputError
        If an object can't be imported or has another type. The message names the package.

    Examples
    --------
    >>> load_plugins("gpszip.no_such_group")
    ()
    """
    for plugin, where in _load_group(group):
        if not isinstance(plugin, kind):
            raise InputError(
                f"is a {type(plugin).__name__}, not a {kind.__name__}",
                location=where,
                remedy="update or uninstall this package",
            )
    return tuple(plugin for plugin, _ in _load_group(group))


@cache
def _load_group(group: str) -> tuple[tuple[Any, str], ...]:
    """Return each object of a group, with what messages call it."""
    plugins = []
    for entry_point in sorted(entry_points(group=group), key=lambda entry_point: entry_point.name):
        distribution = entry_point.dist
        package = entry_point.module if distribution is None else distribution.name
        where = f"plugin {entry_point.name!r} of {package}"

        # A plugin may fail in any way when it is imported.
        try:
            plugins.append((entry_point.load(), where))
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(
                f"can't be loaded: {reason}",
                location=where,
                remedy="update or uninstall this package",
            ) from error
    return tuple(plugins)


def forget_plugins() -> None:
    """Load all groups anew at their next use, for tests that install a package."""
    _load_group.cache_clear()
