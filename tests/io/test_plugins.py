"""Formats that other packages register as entry points."""

import pytest

from gpszip.errors import InputError
from gpszip.io.plugins import load_plugins


def test_registered_objects_are_loaded(install_plugin):
    install_plugin("gpszip.toys", "FORMAT = 7\n")
    assert load_plugins("gpszip.toys", int) == (7,)
    assert load_plugins("gpszip.others") == ()


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("FORMAT = 1 / 0\n", "plugin 'toy' of toy: can't be loaded: ZeroDivisionError"),
        ("import no_such_module\n", "can't be loaded: ModuleNotFoundError"),
        ("OTHER = 7\n", "can't be loaded: AttributeError"),
        ("FORMAT = 'seven'\n", "is a str, not a int; update or uninstall this package"),
    ],
)
def test_a_broken_plugin_is_named(install_plugin, source, message):
    install_plugin("gpszip.toys", source)
    with pytest.raises(InputError, match=message):
        load_plugins("gpszip.toys", int)
