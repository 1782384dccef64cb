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

#: Words in Arrow's errors that mean missing or wrong credentials.
_DENIED_WORDS = (
    "ACCESS_DENIED",
    "INVALID_ACCESS_KEY",
    "SIGNATURE_DOES_NOT_MATCH",
    "redentials",
)

#: The scheme that begins a URL; one letter alone is a Windows drive.
_SCHEME = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)


def is_url(name: str) -> bool:
    """Whether a name is a URL.

    Examples
    --------
    >>> is_url("s3://bucket/log.csv"), is_url("C:/log.csv"), is_url("log.csv")
    (True, False, False)
    """
    return _SCHEME.match(name) is not None


def fetch_objects(name: str) -> Iterator[tuple[str, bytes] | InputError]:
    """Read the objects that a URL refers to.

    A URL is the name of an object, a pattern for several objects, or a folder with Parquet files.
    Credentials, regions and AWS_ENDPOINT_URL come from where the tools of the storage service look
    for them.

    Yields
    ------
    (str, bytes) or InputError
        Name and content of each object, in the order of names; an error for one that can't be read.
    """
    # The folder before the first wildcard is listed.
    base = re.split(r"[*?\[]", name, maxsplit=1)[0]
    has_pattern = len(base) < len(name)
    base = base.rsplit("/", 1)[0] if has_pattern else base.rstrip("/")
    try:
        system, root = fs.FileSystem.from_uri(base)
        pattern = root.rstrip("/") + name[len(base) :] if has_pattern else None
        paths = sorted(_list_paths(system, root, pattern))
    except (OSError, ValueError, pa.ArrowException) as error:
        yield InputError(f"can't be read: {_explain_error(error)}", path=name)
        return
    if not paths:
        yield InputError(_explain_absence(system, root, has_pattern=has_pattern), path=name)

    # Read the objects one by one.
    for path in paths:
        shown = name if path == root else base + path[len(root.rstrip("/")) :]
        try:
            # Gzip files are unpacked later, within the limit of expansion.
            with system.open_input_stream(path, compression=None) as stream:
                yield shown, stream.read()
        except (OSError, pa.ArrowException) as error:
            yield InputError(f"can't be read: {_explain_error(error)}", path=shown)


def _explain_absence(system: Any, root: str, *, has_pattern: bool) -> str:
    """Why no object was found."""
    bucket = root.split("/", maxsplit=1)[0]
    if system.type_name == "s3" and system.get_file_info(bucket).type == fs.FileType.NotFound:
        return f"there is no bucket {bucket!r}"
    if has_pattern:
        return "no file matches this pattern"
    return "no such file, and no folder with Parquet files"


def _list_paths(system: Any, root: str, pattern: str | None) -> Iterator[str]:
    """Paths that match a pattern; without one, the file itself or the Parquet files below it."""
    if pattern is None and system.get_file_info(root).type == fs.FileType.File:
        yield root
        return

    # Subfolders are listed only if the pattern reaches into them, as that may take long.
    is_deep = pattern is None or "**" in pattern or "/" in pattern[len(root) :].lstrip("/")
    selector = fs.FileSelector(root, recursive=is_deep, allow_not_found=True)
    for info in system.get_file_info(selector):
        is_wanted = (
            info.path.endswith(".parquet") if pattern is None else _matches(info.path, pattern)
        )
        if is_wanted and info.type == fs.FileType.File:
            yield info.path


def _matches(path: str, pattern: str) -> bool:
    """Whether all folders and the file name match; ``**`` matches any number of folders."""
    if "**" in pattern:
        return fnmatchcase(path, pattern.replace("**/", "*"))
    # In fnmatch, * matches slashes, too, so that folders are compared one by one.
    names, patterns = path.split("/"), pattern.split("/")
    return len(names) == len(patterns) and all(
        fnmatchcase(*pair) for pair in zip(names, patterns, strict=True)
    )


def _explain_error(error: BaseException) -> str:
    """An error in one line, with a remedy for missing credentials."""
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    if not any(word in text for word in _DENIED_WORDS):
        return text
    return (
        f"access denied; check AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or the profile ({text})"
    )
