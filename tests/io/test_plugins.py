"""Formats that other packages register as entry points."""

import pytest

from gpszip.errors import InputError, OutputError
from gpszip.io.plugins import Guard, load_plugins
from gpszip.io.storage.source import Source


def test_registered_objects_are_loaded(install_plugin):
    install_plugin("gpszip.toys", "FORMAT = 7\n")
    assert load_plugins("gpszip.toys", int, lambda number, _guard: number + 1) == (8,)
    assert load_plugins("gpszip.others", int, lambda number, _guard: number) == ()


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("FORMAT = 1 / 0\n", "plugin 'toy' of toy: can't be loaded: ZeroDivisionError"),
        ("import no_such_module\n", "can't be loaded: ModuleNotFoundError"),
        ("OTHER = 7\n", "can't be loaded: AttributeError"),
        ("raise SystemExit(1)\n", "can't be loaded: SystemExit: 1"),
        ("FORMAT = 'seven'\n", "is a str, not a int; update or uninstall this package"),
    ],
)
def test_a_broken_plugin_is_named(install_plugin, source, message):
    install_plugin("gpszip.toys", source)
    with pytest.raises(InputError, match=message):
        load_plugins("gpszip.toys", int, lambda number, _guard: number)


@pytest.mark.parametrize("fault", [KeyError("lost"), SystemExit("lost"), RecursionError("lost")])
def test_a_guarded_function_names_the_plugin_and_the_file(fault):
    def read(_source, *_others):
        raise fault

    guarded = Guard("plugin 'toy' of toys").wrap(read, OutputError)
    with pytest.raises(
        OutputError, match=r"^a\.toy: plugin 'toy' of toys failed: .*lost"
    ) as caught:
        guarded(Source("a.toy", data=b""), 1)
    assert caught.value.__cause__ is fault
    with pytest.raises(OutputError, match=r"^plugin 'toy' of toys failed"):
        guarded("a.toy")


@pytest.mark.parametrize("fault", [InputError("no log"), FileNotFoundError(2, "x"), MemoryError()])
def test_errors_that_are_understood_pass_the_guard(fault):
    def read():
        raise fault

    with pytest.raises(type(fault)) as caught:
        Guard("plugin 'toy' of toys").wrap(read, OutputError)()
    assert caught.value is fault


def test_a_guarded_function_returns_what_is_expected():
    guard = Guard("plugin 'toy' of toys")
    assert guard.wrap(max, InputError, int)(3, 4) == 4
    with pytest.raises(InputError, match="TypeError: a str is expected, not int"):
        guard.wrap(max, InputError, str)(3, 4)
