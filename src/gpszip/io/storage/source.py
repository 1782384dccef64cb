"""Where a log's bytes come from: a file, a stream or standard input; packed with gzip, in a zip archive, or plain."""

from __future__ import annotations

import glob
import io
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.storage.display_name import printable_name
from gpszip.io.storage.expansion import open_gzip, read_chunk
from gpszip.io.storage.remote import fetch_objects, is_url
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder
from gpszip.io.storage.zip_files import ZipMember, find_members, is_zip

__all__ = ["Source", "expand", "is_stray_file", "spooled"]

_GZIP = b"\x1f\x8b"

#: Bytes of a log that its format is told from.
_HEAD_BYTES = 1 << 18

#: Bytes that are copied at a time.
_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class Source:
    """One log, not read yet. It holds no file open.

    Parameters
    ----------
    name : str
        What to call it in messages.
    path : Path, optional
        The file.
    data : bytes, optional
        The log itself where it doesn't come from a file.
    folder : Path, optional
        The folder that was named, for a file in it; folders between them may be keys of partitions (``vehicle=7``).
    archive : str
        The zip archive that it is a member of; empty where it is none.
    stored_bytes : int, optional
        Number of bytes that a member takes in its archive.
    """

    name: str
    path: Path | None = None
    data: bytes | None = field(default=None, repr=False)
    folder: Path | None = None
    archive: str = ""
    stored_bytes: int | None = None

    @property
    def log(self) -> str:
        """What was named: all files of a folder are one log."""
        return self.name if self.folder is None else str(self.folder)

    @property
    def size(self) -> int:
        """Number of bytes as stored: of a member of a zip archive, and of a gzip file, the packed ones.

        Raises
        ------
        InputError
            If the file is gone.
        """
        if self.stored_bytes is not None:
            return self.stored_bytes
        if self.data is not None:
            return len(self.data)
        assert self.path is not None
        try:
            return self.path.stat().st_size
        except OSError as error:
            raise InputError(f"{self.name}: {_explain_error(error)}") from None

    @property
    def stem(self) -> str:
        """The log's name: the file's without its suffixes ``.gz`` and the like, or that of the folder that was named."""
        if self.folder is not None:
            return printable_name(self.folder.resolve().name)
        name = Path(self.name).name
        name = name[:-3] if name.lower().endswith(".gz") else name
        return Path(name).stem or name

    @property
    def is_gzip(self) -> bool:
        """Whether it is packed with gzip."""
        with self._plain() as plain:
            return bool(plain.read(2) == _GZIP)

    def open(self) -> Any:
        """Open the log for reading, unpacked, as an Arrow file.

        Raises
        ------
        InputError
            If it can't be opened; while reading, if a gzip file is damaged or expands beyond the limit that
            :mod:`gpszip.io.storage.expansion` states.
        """
        plain = self._plain()
        packed = plain.read(2) == _GZIP
        plain.seek(0)
        return open_gzip(plain, self.name) if packed else plain

    def head(self) -> bytes:
        """Return the first 256 KiB of the log, unpacked."""
        return self._read(_HEAD_BYTES)

    def read(self) -> bytes:
        """Return the whole log, unpacked."""
        return self._read(None)

    def _plain(self) -> Any:
        if self.data is not None:
            return pa.BufferReader(self.data)
        try:
            # not mapped to memory: a file that shrinks while it is read would end the program
            return pa.OSFile(os.fsencode(str(self.path)))
        except OSError as error:
            raise InputError(f"{self.name}: {_explain_error(error)}") from None

    def _read(self, size: int | None) -> bytes:
        pieces: list[bytes] = []
        left = sys.maxsize if size is None else size
        try:
            with self.open() as stream:
                while left and (piece := read_chunk(stream, min(left, _CHUNK_BYTES))):
                    pieces.append(piece)
                    left -= len(piece)
        except OSError as error:
            raise InputError(f"{self.name}: {_explain_error(error)}") from None
        return b"".join(pieces)


@dataclass(frozen=True)
class _Stream:
    """What can be read once only; of a member of a zip archive, with the archive's name and the bytes that it takes there."""

    name: str
    chunks: Callable[[], Iterator[bytes]]
    archive: str = ""
    stored_bytes: int | None = None


_Items = Iterable[str | Path | BinaryIO | Source | InputError] | str | Path | BinaryIO


def expand(sources: _Items, *, unzip: bool = True) -> Iterator[Source | InputError]:
    """Turn names, patterns and streams into logs to read.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of what :func:`spooled` gives
        ``-`` is standard input. A name with ``*``, ``?`` or ``[`` that is no file is a pattern; it stands for the
        files it matches, in the order of their names. URLs such as ``s3://bucket/logs/*.parquet`` are fetched.
    unzip : bool
        Whether a zip archive stands for the files in it, each a log called ``ARCHIVE/FILE``. Nothing is written to disk.

    Yields
    ------
    Source or InputError
        The error where a name can't be read, so that the caller may leave it out. Streams and members of archives are
        in memory, one at a time.
    """
    return _expand(sources, _in_memory, unzip=unzip)


@contextmanager
def spooled(sources: _Items) -> Iterator[list[Source | InputError]]:
    r"""Find all logs; those that are no files of their own are temporary files for as long as the context lasts.

    So all of them can be read in pieces, and more than once.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`expand`.

    Examples
    --------
    >>> import io
    >>> with spooled(io.BytesIO(b"t,x,y\n0,0,0\n")) as sources:
    ...     [(source.name, source.size) for source in sources]
    [('stream', 12)]
    """
    with scratch_folder() as folder:
        number = 0

        def keep(stream: _Stream) -> Source:
            nonlocal number
            number += 1
            return _on_disk(stream, folder / str(number))

        yield list(_expand(sources, keep, unzip=True))


def is_stray_file(source: Source | InputError, error: InputError) -> bool:
    """Whether an error says no more than that a zip archive holds a file besides its logs."""
    return (
        isinstance(source, Source)
        and bool(source.archive)
        and isinstance(error, UnknownFormatError)
    )


def _expand(
    sources: Any, keep: Callable[[_Stream], Source], *, unzip: bool
) -> Iterator[Source | InputError]:
    single = isinstance(sources, (str, Path)) or hasattr(sources, "read")
    for item in [sources] if single else sources:
        if isinstance(item, (Source, InputError)):
            yield item
            continue
        for found in _resolve(item):
            one = _store_stream(found, keep) if isinstance(found, _Stream) else found
            if unzip and isinstance(one, Source) and _is_zip(one):
                yield from _zip_sources(one, keep)
            else:
                yield one


def _resolve(item: str | Path | BinaryIO) -> Iterator[Source | _Stream | InputError]:
    """What a name or a stream stands for."""
    if not isinstance(item, (str, Path)):
        yield _Stream(_stream_name(item), lambda: _read_stream(item))
    elif str(item) == "-":
        # an interpreter that was started without standard input has None there
        none = sys.stdin is None
        yield (
            InputError("standard input: is closed; name a file")
            if none
            else _Stream("standard input", lambda: _read_stream(sys.stdin.buffer))
        )
    elif is_url(str(item)):
        for fetched in fetch_objects(str(item)):
            yield fetched if isinstance(fetched, InputError) else _fetched_stream(*fetched)
    else:
        for name in _match_pattern(str(item)):
            yield from _files(name)


def _store_stream(stream: _Stream, keep: Callable[[_Stream], Source]) -> Source | InputError:
    try:
        return keep(stream)
    except InputError as error:
        return error


def _in_memory(stream: _Stream) -> Source:
    return Source(
        stream.name,
        data=b"".join(_checked_chunks(stream)),
        archive=stream.archive,
        stored_bytes=stream.stored_bytes,
    )


def _on_disk(stream: _Stream, path: Path) -> Source:
    with disk_errors_as_output_errors(), path.open("wb") as file:
        for piece in _checked_chunks(stream):
            file.write(piece)
    return Source(stream.name, path=path, archive=stream.archive, stored_bytes=stream.stored_bytes)


def _checked_chunks(stream: _Stream) -> Iterator[bytes]:
    try:
        yield from stream.chunks()
    except (OSError, ValueError) as error:
        raise InputError(f"{stream.name}: {_explain_error(error)}") from None


def _read_stream(stream: Any) -> Iterator[bytes]:
    """Read a stream to its end; one of text is taken as UTF-8."""
    while piece := stream.read(_CHUNK_BYTES):
        yield piece.encode("utf-8", "replace") if isinstance(piece, str) else piece


def _read_file(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        yield from _read_stream(file)


def _fetched_stream(name: str, data: bytes) -> _Stream:
    return _Stream(printable_name(name), lambda: iter((data,)))


def _is_zip(source: Source) -> bool:
    try:
        with source._plain() as plain:
            return is_zip(plain.read(4))
    except (InputError, OSError):
        return False  # told when it is read


def _zip_sources(
    source: Source, keep: Callable[[_Stream], Source]
) -> Iterator[Source | InputError]:
    """Files in a zip archive, each kept before the next one is opened."""
    try:
        file: Any = io.BytesIO(source.data) if source.data is not None else source.path.open("rb")  # type: ignore[union-attr]
    except OSError as error:
        yield InputError(f"{source.name}: {_explain_error(error)}")
        return
    with file:
        for member in find_members(file, source.name):
            yield (
                member
                if isinstance(member, InputError)
                else _store_stream(_member_stream(member, source.name), keep)
            )


def _member_stream(member: ZipMember, archive: str) -> _Stream:
    return _Stream(
        f"{archive}/{printable_name(member.name)}", member.chunks, archive, member.stored_bytes
    )


def _stream_name(stream: Any) -> str:
    name = getattr(stream, "name", None)
    return printable_name(name) if isinstance(name, str) else "stream"


def _match_pattern(name: str) -> list[str]:
    if any(mark in name for mark in "*?[") and not Path(name).exists():
        return sorted(glob.glob(name, recursive=True)) or [name]  # noqa: PTH207 (Path.glob takes no absolute pattern)
    return [name]


def _files(name: str) -> Iterator[Source | _Stream | InputError]:
    """The file of this name, or the Parquet files in the folder of this name."""
    try:
        path = Path(name).expanduser()
        folder = path.is_dir()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, or a home that nobody has
        yield InputError(f"{printable_name(name)}: {_explain_error(error)}")
        return
    if not folder:
        yield _file(name, path)
        return
    found = sorted(path.rglob("*.parquet"))
    yield from (Source(printable_name(str(file)), path=file, folder=path) for file in found)
    if not found:
        yield InputError(
            f"{printable_name(name)}: is a folder; name the files in it: '{printable_name(name).rstrip('/')}/*.csv'"
        )


def _file(name: str, path: Path) -> Source | _Stream | InputError:
    try:
        if path.is_file() and printable_name(str(path)) == str(path):
            with path.open("rb"):
                return Source(printable_name(name), path=path)
        path.stat()
    except FileNotFoundError as error:
        pattern = any(mark in name for mark in "*?[")
        return InputError(
            f"{printable_name(name)}: {'no file matches this pattern' if pattern else _explain_error(error)}"
        )
    except (OSError, ValueError) as error:
        return InputError(f"{printable_name(name)}: {_explain_error(error)}")
    return _Stream(printable_name(name), lambda: _read_file(path))  # a pipe


def _explain_error(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, PermissionError):
        return "no permission to read it"
    number = getattr(error, "errno", None)
    return f"can't be read: {os.strerror(number) if number else str(error)[:120]}"
