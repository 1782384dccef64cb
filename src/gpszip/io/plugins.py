"""Formats that other installed packages add, found by entry points.

A package adds a format in its ``pyproject.toml``::

    [project.entry-points."gpszip.map_formats"]
    kml = "my_package.kml:FORMAT"

The groups are ``gpszip.formats`` (logs), ``gpszip.network_formats`` and ``gpszip.map_formats``.
Packages are imported when the formats of a group are needed. Whatever they do wrong, then or later,
becomes an error that names them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any, ParamSpec, TypeVar

from gpszip.errors import GPSZipError, InputError
from gpszip.io.pandas_import import show_pandas

__all__ = ["Guard", "forget_plugins", "load_plugins"]

#: Letters of an exception's message that are shown.
_MAX_REASON_LETTERS = 120

Plugin = TypeVar("Plugin")
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Guard:
    """Turns exceptions that a plugin doesn't raise on purpose into errors that name it.

    Errors of GPSZip, errors of the system and lack of memory stay what they are; only the file is
    added to an error that names none.

    Parameters
    ----------
    plugin : str
        What messages call the plugin.

    Examples
    --------
    >>> guard = Guard("plugin 'toy' of toys")
    >>> guard.wrap(lambda x: 1 / x, InputError)(0)
    Traceback (most recent call last):
    gpszip.errors.InputError: plugin 'toy' of toys failed: ZeroDivisionError: division by zero; \
report it to the authors of that package
    """

    plugin: str

    def wrap(
        self,
        function: Callable[Arguments, Result],
        error: type[GPSZipError],
        result: type[object] = object,
    ) -> Callable[Arguments, Result]:
        """Return a function of the plugin with guarded calls.

        Parameters
        ----------
        function : callable
            The function. If its first argument is a file, messages begin with its name.
        error : type
            What its exceptions become.
        result : type, optional
            What it must return.
        """

        def guarded(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Result:
            with self.named_faults(error, _file_name(arguments)):
                returned = function(*arguments, **keywords)
                self.expect(result, returned)
            return returned

        return guarded

    @contextmanager
    def named_faults(self, error: type[GPSZipError], path: str | None = None) -> Iterator[None]:
        """Turn exceptions of a block into errors of a type; add the path to errors without one."""
        try:
            yield
        except InputError as refusal:
            if path is None or refusal.path is not None:
                raise
            raise refusal.with_path(path) from refusal
        except (GPSZipError, OSError, MemoryError):
            raise
        except (Exception, SystemExit) as fault:
            # SystemExit is among them, since a plugin must not end the process.
            raise error(
                f"{self.plugin} failed: {_explain(fault)}",
                path=path,
                remedy="report it to the authors of that package",
            ) from fault

    @staticmethod
    def expect(kind: type[object], value: object) -> None:
        """Raise a TypeError if a value is of another type."""
        if not isinstance(value, kind):
            raise TypeError(f"a {kind.__name__} is expected, not {type(value).__name__}")


def load_plugins(
    group: str, kind: type[Plugin], guarded: Callable[[Plugin, Guard], Plugin]
) -> tuple[Plugin, ...]:
    """Load what installed packages register in a group of entry points.

    A group is loaded at its first use, and once in a process.

    Parameters
    ----------
    group : str
        Name of the group, such as ``gpszip.map_formats``.
    kind : type
        Type that the objects must have.
    guarded : callable
        Returns an object whose functions are wrapped by the guard that it gets.

    Returns
    -------
    tuple
        The guarded objects, in the order of their names; empty if no package registers any.

    Raises
    ------
    InputError
        If an object can't be imported or has another type. The message names the package.

    Examples
    --------
    >>> load_plugins("gpszip.no_such_group", int, lambda number, guard: number)
    ()
    """
    for plugin, where in _load_group(group):
        if not isinstance(plugin, kind):
            raise InputError(
                f"is a {type(plugin).__name__}, not a {kind.__name__}",
                location=where,
                remedy="update or uninstall this package",
            )
    return tuple(guarded(plugin, Guard(where)) for plugin, where in _load_group(group))


@cache
def _load_group(group: str) -> tuple[tuple[Any, str], ...]:
    """Return each object of a group, with what messages call it."""
    plugins = []
    for entry_point in sorted(entry_points(group=group), key=lambda entry_point: entry_point.name):
        distribution = entry_point.dist
        package = entry_point.module if distribution is None else distribution.name
        where = f"plugin {entry_point.name!r} of {package}"
        show_pandas()  # a plugin may need it

        # A plugin may fail in any way when it is imported.
        try:
            plugins.append((entry_point.load(), where))
        except (Exception, SystemExit) as fault:
            raise InputError(
                f"can't be loaded: {_explain(fault)}",
                location=where,
                remedy="update or uninstall this package",
            ) from fault
    return tuple(plugins)


def forget_plugins() -> None:
    """Load all groups anew at their next use, for tests that install a package."""
    _load_group.cache_clear()


def _explain(fault: BaseException) -> str:
    """Type and message of an exception, in one short line."""
    return f"{type(fault).__name__}: {' '.join(str(fault).split())[:_MAX_REASON_LETTERS]}"


def _file_name(arguments: tuple[object, ...]) -> str | None:
    """Name of the file that is the first argument; None if it is none."""
    from gpszip.io.storage.source import Source

    first = arguments[0] if arguments else None
    return first.name if isinstance(first, Source) else None
