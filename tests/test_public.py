import dataclasses
import inspect
import re
import subprocess
import sys

import pytest

import gpszip

#: Names in annotations that Python, numpy and the standard library define, or stand for these.
FOREIGN = {
    "Any",
    "AsyncIterable",
    "AsyncIterator",
    "ArrayLike",
    "BinaryIO",
    "Callable",
    "Iterable",
    "Iterator",
    "Mapping",
    "NDArray",
    "Floats",
    "None",
    "Self",
    "Sequence",
    "V_co",
}

#: Aliases of arguments, which the signatures spell out for mypy and the docstrings for people.
ALIASES = {"ArchiveSource", "Archives", "LogSource", "Logs", "Times"}

#: What an archive is made of inside; these attributes serve the package itself.
INTERNAL = {"contents", "prior", "grid_walks", "index"}

FUNCTIONS = [name for name in gpszip.__all__ if inspect.isfunction(getattr(gpszip, name))]
CLASSES = [name for name in gpszip.__all__ if inspect.isclass(getattr(gpszip, name))]


def annotations_of(owner):
    """Annotations of a function, or of all public methods, properties and fields of a class."""
    if inspect.isfunction(owner):
        yield from owner.__annotations__.values()
        return
    for name, member in vars(owner).items():
        function = getattr(member, "fget", None) or getattr(member, "func", member)
        if inspect.isfunction(function) and name not in INTERNAL and not name.startswith("_"):
            yield from function.__annotations__.values()
    for field in dataclasses.fields(owner) if dataclasses.is_dataclass(owner) else ():
        if field.name not in INTERNAL and not field.name.startswith("_"):
            yield field.type


def test_names_are_sorted_and_listed():
    assert gpszip.__all__ == sorted(gpszip.__all__)
    assert dir(gpszip) == gpszip.__all__
    named = [name for names in gpszip._HOMES.values() for name in names]
    assert sorted([*named, "__version__"]) == gpszip.__all__


@pytest.mark.parametrize("name", gpszip.__all__)
def test_every_public_name_exists_and_is_documented(name):
    value = getattr(gpszip, name)
    assert name in {"__version__", "Listener"} or value.__doc__


def test_other_names_do_not_exist():
    with pytest.raises(AttributeError, match="no attribute 'Zip'"):
        gpszip.Zip  # noqa: B018


@pytest.mark.parametrize("name", [*FUNCTIONS, *CLASSES])
def test_every_type_in_a_public_signature_is_public(name):
    known = {*gpszip.__all__, *FOREIGN, *ALIASES}
    for annotation in annotations_of(getattr(gpszip, name)):
        text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
        types = set(re.findall(r"\b(?<!\.)[A-Z]\w+", text))
        assert types <= known, f"{name}: {annotation}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signatures_are_typed(name):
    signature = inspect.signature(getattr(gpszip, name))
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation not in {inspect.Parameter.empty, "Any"}
        assert parameter.kind is not inspect.Parameter.VAR_KEYWORD


def test_errors_have_one_root():
    errors = [getattr(gpszip, name) for name in gpszip.__all__ if name.endswith("Error")]
    assert all(issubclass(error, gpszip.GPSZipError) for error in errors)


def test_importing_gpszip_imports_nothing_heavy():
    code = (
        "import gpszip, sys; heavy = ('numpy', 'numba', 'scipy', 'pyarrow', 'pyproj'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
