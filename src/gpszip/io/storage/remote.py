"""Logs in object storage: names such as ``s3://bucket/logs/*.parquet``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from typing import Any

import pyarrow as pa
from pyarrow import fs

from gpszip.errors import InputError

__all__ = ["fetch_objects", "is_url"]

_SCHEME = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)


def is_url(name: str) -> bool:
    """Tell whether a name is a URL.

    Examples
    --------
    >>> is_url("s3://bucket/log.csv"), is_url("C:/log.csv"), is_url("log.csv")
    (True, False, False)
    """
    return _SCHEME.match(name) is not None


def fetch_objects(name: str) -> Iterator[tuple[str, bytes] | InputError]:
    """Read the objects that a URL stands for: one, those that its pattern matches, or the Parquet files in a folder.

    Credentials, regions and AWS_ENDPOINT_URL are taken from where the storage's own tools look for them.

    Yields
    ------
    (str, bytes) or InputError
        Name and content, in the order of the names; the error where one can't be read.
    """
    base = re.split(r"[*?\[]", name, maxsplit=1)[0]
    pattern = len(base) < len(name)
    base = base.rsplit("/", 1)[0] if pattern else base.rstrip("/")
    try:
        system, root = fs.FileSystem.from_uri(base)
        whole = root.rstrip("/") + name[len(base) :]
        paths = sorted(_paths(system, root, whole if pattern else None))
    except (OSError, ValueError, pa.ArrowException) as error:
        yield InputError(f"{name}: can't be read: {_explain_error(error)}")
        return
    if (
        not paths
        and system.type_name == "s3"
        and system.get_file_info(root.split("/")[0]).type == fs.FileType.NotFound
    ):
        yield InputError(f"{name}: there is no bucket {root.split('/')[0]!r}")
    elif not paths:
        yield InputError(
            f"{name}: no file matches this pattern"
            if pattern
            else f"{name}: no such file, and no folder with Parquet files"
        )
    for path in paths:
        shown = name if path == root else base + path[len(root.rstrip("/")) :]
        try:
            with system.open_input_stream(path, compression=None) as stream:
                yield shown, stream.read()
        except (OSError, pa.ArrowException) as error:
            yield InputError(f"{shown}: can't be read: {_explain_error(error)}")


def _paths(system: Any, root: str, pattern: str | None) -> Iterator[str]:
    if pattern is None and system.get_file_info(root).type == fs.FileType.File:
        yield root
        return
    deep = pattern is None or "**" in pattern or "/" in pattern[len(root) :].lstrip("/")
    for found in system.get_file_info(fs.FileSelector(root, recursive=deep, allow_not_found=True)):
        wanted = (
            found.path.endswith(".parquet") if pattern is None else _matches(found.path, pattern)
        )
        if wanted and found.type == fs.FileType.File:
            yield found.path


def _matches(path: str, pattern: str) -> bool:
    """Whether each folder and the file's name match; ``**`` stands for any number of folders."""
    if "**" in pattern:
        return fnmatchcase(path, pattern.replace("**/", "*"))
    parts, wanted = path.split("/"), pattern.split("/")
    return len(parts) == len(wanted) and all(
        fnmatchcase(*pair) for pair in zip(parts, wanted, strict=True)
    )


def _explain_error(error: BaseException) -> str:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    denied = any(
        word in text
        for word in (
            "ACCESS_DENIED",
            "INVALID_ACCESS_KEY",
            "SIGNATURE_DOES_NOT_MATCH",
            "redentials",
        )
    )
    return (
        f"access denied; check AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or the profile ({text})"
        if denied
        else text
    )
