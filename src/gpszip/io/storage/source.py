"""Sources of a log's bytes: files, streams and standard input; plain, gzip or in zip archives."""

from __future__ import annotations

import glob
import io
import itertools
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError, NoPositionsError, UnknownFormatError
from gpszip.io.storage.display_name import printable_name
from gpszip.io.storage.expansion import open_gzip, read_chunk
from gpszip.io.storage.folders import FolderItem, find_folder_log, is_folder_log, walk_folder
from gpszip.io.storage.remote import fetch_objects, is_url
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder
from gpszip.io.storage.zip_files import ExpansionLimit, find_members, is_zip, reading_rank

__all__ = ["Source", "expand", "is_stray_file", "spooled"]

#: First bytes of a gzip file.
_GZIP = b"\x1f\x8b"

#: Bytes at the start of a log by which its format is recognised: 256 KiB.
_HEAD_BYTES = 1 << 18

#: Bytes that are copied at a time: 1 MiB.
_CHUNK_BYTES = 1 << 20

#: Zip archives in each other that are unpacked. Exports of Garmin have two, split backups three.
_MAX_DEPTH = 4

#: The window of zlib, with a header of gzip.
_GZIP_WINDOW = 31

#: Bytes of a digest: two different files have the same one with a probability of 2**-128.
_DIGEST_BYTES = 16


@dataclass(frozen=True)
class Source:
    """A log that is yet to be read. No file is open.

    Parameters
    ----------
    name : str
        Name for messages.
    path : Path, optional
        The file.
    data : bytes, optional
        The bytes of a log without a file.
    folder : Path, optional
        The folder that the user has given, for a file in it. Folders between may be keys of
        partitions (``vehicle=7``).
    collection : str
        Name of the folder or zip archive of mixed files that the user has given and that contains
        this one; empty for a file that was named.
    stored_bytes : int, optional
        Compressed size of a member of an archive.
    error : InputError, optional
        Why a file of a collection can't be opened.
    """

    name: str
    path: Path | None = None
    data: bytes | None = field(default=None, repr=False)
    folder: Path | None = None
    collection: str = ""
    stored_bytes: int | None = None
    error: InputError | None = None

    @property
    def log(self) -> str:
        """Name of the log: all files of a given folder are one log."""
        return self.name if self.folder is None else str(self.folder)

    @property
    def size(self) -> int:
        """Number of bytes as stored: compressed ones for gzip files and members of archives.

        Raises
        ------
        InputError
            If the file no longer exists.
        """
        if self.stored_bytes is not None:
            return self.stored_bytes
        if self.data is not None:
            return len(self.data)
        if self.error is not None:
            return 0
        assert self.path is not None
        try:
            return self.path.stat().st_size
        except OSError as error:
            raise InputError(_explain_error(error), path=self.name) from None

    def log_bytes(self, _points: int, _dimension: int) -> int:
        """Size of the log, from which compression ratios count: that of the file."""
        return self.size

    def stored_at(self, _path: Path) -> Source:
        """Return a source that can be read several times, as all files can."""
        return self

    @property
    def stem(self) -> str:
        """Name of the file without suffixes, also before ``.gz``, or that of the given folder."""
        if self.folder is not None:
            return printable_name(self.folder.resolve().name)
        name = Path(self.name).name
        name = name[:-3] if name.lower().endswith(".gz") else name
        return Path(name).stem or name

    @property
    def is_gzip(self) -> bool:
        """Whether it is compressed with gzip."""
        with self._open_stored() as stored:
            return bool(stored.read(len(_GZIP)) == _GZIP)

    def open(self) -> Any:
        """Open the log for reading, unpacked, as an Arrow file.

        Raises
        ------
        InputError
            If it can't be opened. Reading raises it if a gzip file is damaged or expands beyond
            the limit of :mod:`gpszip.io.storage.expansion`.
        """
        # The content decides, not the suffix: an object or a stream may have any name.
        stored = self._open_stored()
        is_gzip = stored.read(len(_GZIP)) == _GZIP
        stored.seek(0)
        return open_gzip(stored, self.name) if is_gzip else stored

    def head(self) -> bytes:
        """Return the first 256 KiB of the log, unpacked."""
        return self._read(_HEAD_BYTES)

    def read(self) -> bytes:
        """Return all bytes of the log, unpacked."""
        return self._read(None)

    def digest(self) -> bytes:
        """Return a digest of the bytes as stored, which only equal files share.

        Raises
        ------
        InputError
            If they can't be read.
        """
        digest = blake2b(digest_size=_DIGEST_BYTES)
        with self._open_stored() as stored:
            while chunk := read_chunk(stored, _CHUNK_BYTES):
                digest.update(chunk)
        return digest.digest()

    def _open_stored(self) -> Any:
        """Open the bytes as stored."""
        if self.error is not None:
            raise self.error
        if self.data is not None:
            return pa.BufferReader(self.data)
        try:
            # A memory-mapped file that shrinks while it is read would crash the process.
            return pa.OSFile(os.fsencode(str(self.path)))
        except OSError as error:
            raise InputError(_explain_error(error), path=self.name) from None

    def _read(self, size: int | None) -> bytes:
        """Read at most ``size`` unpacked bytes; None for all."""
        chunks: list[bytes] = []
        remaining = sys.maxsize if size is None else size
        try:
            with self.open() as stream:
                while remaining and (chunk := read_chunk(stream, min(remaining, _CHUNK_BYTES))):
                    chunks.append(chunk)
                    remaining -= len(chunk)
        except OSError as error:
            raise InputError(_explain_error(error), path=self.name) from None
        return b"".join(chunks)


@dataclass(frozen=True)
class _Stream:
    """A source of bytes that can be read only once.

    Parameters
    ----------
    name : str
        Name for messages.
    chunks : callable
        Yields the bytes.
    collection : str
        As for :class:`Source`.
    stored_bytes : int, optional
        Compressed size of a member of an archive.
    """

    name: str
    chunks: Callable[[], Iterator[bytes]]
    collection: str = ""
    stored_bytes: int | None = None


#: Stores a stream so that it can be read again.
_Keep = Callable[[_Stream], Source]

#: Suffixes of the files that make a folder one log.
_PARQUET = (".parquet", ".geoparquet")

#: Whether a zip archive means the files in it.
_Unzip = bool | Callable[[Source], bool]

#: Whether a file of a collection may be a log, by its name and its first bytes, unpacked.
_Wanted = Callable[[str, bytes], bool]

#: Sources that users may give.
_Items = Iterable[str | Path | BinaryIO | Source | InputError] | str | Path | BinaryIO


def expand(
    sources: _Items, *, unzip: _Unzip = True, wanted: _Wanted | None = None
) -> Iterator[Source | InputError]:
    """Turn names, patterns and streams into logs to read.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of the results of :func:`spooled`
        ``-`` is standard input. A name with ``*``, ``?`` or ``[`` that is no file is a pattern for
        files, in the order of their names. URLs such as ``s3://bucket/logs/*.parquet`` are fetched.
        A folder means all files in it, unless it is one log.
    unzip : bool or callable, default True
        Whether a zip archive means the files in it, which are named ``ARCHIVE/FILE``; a function
        decides for each archive. Archives in it are unpacked, too. Nothing is written to disk.
    wanted : callable, optional
        Whether a file in an archive may be a log, by its name and its first 256 KiB; of others,
        only these are read. All are read by default.

    Yields
    ------
    Source or InputError
        An error for a name that can't be read, so that the caller may omit it. Streams and members
        of archives are in memory, one at a time.
    """
    return _expand(sources, _Expansion(_in_memory, unzip, wanted))


@contextmanager
def spooled(
    sources: _Items, *, unzip: _Unzip = True, wanted: _Wanted | None = None
) -> Iterator[list[Source | InputError]]:
    r"""Find all logs, and store those without a file in temporary files until the context ends.

    So all of them can be read in batches and several times.

    Parameters
    ----------
    sources, unzip, wanted
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

        # Frames may be streams, too.
        found = _expand(sources, _Expansion(keep, unzip, wanted))
        yield [
            source.stored_at(folder / f"frame-{i}") if isinstance(source, Source) else source
            for i, source in enumerate(found)
        ]


def is_stray_file(source: Source | InputError, error: InputError) -> bool:
    """Whether an error only means that a folder or zip archive contains a file that is no log."""
    in_collection = isinstance(source, Source) and bool(source.collection)
    return in_collection and isinstance(error, (UnknownFormatError, NoPositionsError))


@dataclass(frozen=True)
class _Expansion:
    """How sources are expanded.

    Parameters
    ----------
    keep : callable
        Stores streams.
    unzip, wanted
        As for :func:`expand`.
    """

    keep: _Keep
    unzip: _Unzip
    wanted: _Wanted | None

    def unpacks(self, source: Source) -> bool:
        """Whether a source is a zip archive that means the files in it."""
        try:
            with source._open_stored() as stored:
                if not is_zip(stored.read(4)):
                    return False
        except (InputError, OSError):
            return False  # reading it reports the error
        return self.unzip(source) if callable(self.unzip) else self.unzip


def _expand(sources: Any, how: _Expansion) -> Iterator[Source | InputError]:
    """Turn names, patterns and streams into sources."""
    # Streams can be iterated, too, but they are one source.
    is_single = isinstance(sources, (str, Path)) or hasattr(sources, "read")
    for item in [sources] if is_single else _in_reading_order(sources):
        # Results of :func:`spooled` pass unchanged.
        if isinstance(item, (Source, InputError)):
            yield item
            continue

        for resolved in _resolve(item):
            found = _store_stream(resolved, how.keep) if isinstance(resolved, _Stream) else resolved
            if isinstance(found, Source) and how.unpacks(found):
                yield from _zip_sources(found, how)
            else:
                yield found


def _in_reading_order(sources: Any) -> Any:
    """Put archives of an export in order if all are named; others are taken one by one."""
    if not isinstance(sources, (list, tuple)):
        return sources
    last = reading_rank("")
    return sorted(
        sources, key=lambda item: reading_rank(item) if isinstance(item, (str, Path)) else last
    )


def _resolve(item: str | Path | BinaryIO) -> Iterator[Source | _Stream | InputError]:
    """The files and streams that a name refers to, before archives are unpacked."""
    # Open streams.
    if not isinstance(item, (str, Path)):
        yield _Stream(_stream_name(item), lambda: _read_stream(item))

    # Standard input, which is None if the interpreter was started without it.
    elif str(item) == "-":
        if sys.stdin is None:
            yield InputError("is closed", path="standard input", remedy="name a file")
        else:
            yield _Stream("standard input", lambda: _read_stream(sys.stdin.buffer))

    # Objects in a storage service.
    elif is_url(str(item)):
        for fetched in fetch_objects(str(item)):
            yield fetched if isinstance(fetched, InputError) else _fetched_stream(*fetched)

    # Files.
    else:
        for name in _match_pattern(str(item)):
            yield from _resolve_name(name)


def _store_stream(stream: _Stream, keep: _Keep) -> Source | InputError:
    """Store a stream; return the error if it can't be read."""
    try:
        return keep(stream)
    except InputError as error:
        return error


def _in_memory(stream: _Stream) -> Source:
    """Store a stream in memory."""
    return Source(
        stream.name,
        data=b"".join(_checked_chunks(stream)),
        collection=stream.collection,
        stored_bytes=stream.stored_bytes,
    )


def _on_disk(stream: _Stream, path: Path) -> Source:
    """Store a stream in a file."""
    # Errors of reading are InputErrors by then, so that only errors of writing are caught here.
    with disk_errors_as_output_errors(), path.open("wb") as file:
        for chunk in _checked_chunks(stream):
            file.write(chunk)
    return Source(
        stream.name, path=path, collection=stream.collection, stored_bytes=stream.stored_bytes
    )


def _checked_chunks(stream: _Stream) -> Iterator[bytes]:
    """Bytes of a stream, with system errors turned into InputError."""
    try:
        yield from stream.chunks()
    except (OSError, ValueError) as error:
        raise InputError(_explain_error(error), path=stream.name) from None


def _read_stream(stream: Any) -> Iterator[bytes]:
    """Read a stream to its end; text is encoded as UTF-8."""
    while chunk := stream.read(_CHUNK_BYTES):
        yield chunk.encode("utf-8", "replace") if isinstance(chunk, str) else chunk


def _read_file(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        yield from _read_stream(file)


def _fetched_stream(name: str, data: bytes) -> _Stream:
    return _Stream(printable_name(name), lambda: iter((data,)))


def _zip_sources(
    source: Source, how: _Expansion, depth: int = 1, outer: ExpansionLimit | None = None
) -> Iterator[Source | InputError]:
    """Files in a zip archive, each stored before the next one is opened."""
    # Open the archive, whether in memory or on disk.
    collection = source.collection or source.name
    file: Any
    try:
        if source.data is not None:
            file = io.BytesIO(source.data)
        else:
            assert source.path is not None
            file = source.path.open("rb")
    except OSError as error:
        yield _in_collection(InputError(_explain_error(error), path=source.name), collection)
        return

    # Store each member; an unreadable one doesn't end the archive.
    with file:
        for member in find_members(file, source.name, outer):
            if isinstance(member, InputError):
                yield _in_collection(member, collection)
                continue
            name = f"{source.name}/{printable_name(member.name)}"
            stream = _Stream(name, member.chunks, collection, member.stored_bytes)
            stored = _store_wanted(stream, how)

            # A member may be an archive, too.
            if isinstance(stored, InputError):
                yield _in_collection(stored, collection)
            elif not how.unpacks(stored):
                yield stored
            elif depth < _MAX_DEPTH:
                yield from _zip_sources(stored, how, depth + 1, member.limit)
            else:
                too_deep = InputError(
                    f"lies within more than {_MAX_DEPTH - 1} other zip archives",
                    path=name,
                    remedy="unpack it first",
                )
                yield _in_collection(too_deep, collection)


def _in_collection(error: InputError, collection: str) -> Source | InputError:
    """A file of a collection that can't be read; an error about the whole collection as it is."""
    if error.path is None or error.path == collection:
        return error
    return Source(error.path, collection=collection, error=error)


def _store_wanted(stream: _Stream, how: _Expansion) -> Source | InputError:
    """Store a file of an archive, or only its start if it can't be a log."""
    if how.wanted is None:
        return _store_stream(stream, how.keep)

    # Read the start.
    chunks = _checked_chunks(stream)
    start = b""
    try:
        while len(start) < _HEAD_BYTES and (chunk := next(chunks, b"")):
            start += chunk
    except InputError as error:
        return error

    # Of a video, or a database of a gigabyte, no more is needed to say that it is none.
    head = _unpack_start(start)
    if is_zip(start) or how.wanted(stream.name, head):
        whole = replace(stream, chunks=lambda: itertools.chain((start,), chunks))
        return _store_stream(whole, how.keep)
    return Source(
        stream.name, data=head, collection=stream.collection, stored_bytes=stream.stored_bytes
    )


def _unpack_start(start: bytes) -> bytes:
    """Return the first bytes of a file, unpacked if it is packed with gzip."""
    if not start.startswith(_GZIP):
        return start[:_HEAD_BYTES]
    try:
        return zlib.decompressobj(_GZIP_WINDOW).decompress(start, _HEAD_BYTES)
    except zlib.error:
        return start[:_HEAD_BYTES]  # reading it reports the damage


def _stream_name(stream: Any) -> str:
    """Name of an open stream, if it has one."""
    # Streams on a file descriptor have a number as their name.
    name = getattr(stream, "name", None)
    return printable_name(name) if isinstance(name, str) else "stream"


def _is_pattern(name: str) -> bool:
    return any(mark in name for mark in "*?[")


def _match_pattern(name: str) -> list[str]:
    """Names of the files that a pattern matches; the name itself if it is none or matches none."""
    # A file may have brackets in its name.
    if _is_pattern(name) and not Path(name).exists():
        # Path.glob accepts no absolute pattern.
        return _in_reading_order(sorted(glob.glob(name, recursive=True))) or [name]  # noqa: PTH207
    return [name]


def _resolve_name(name: str) -> Iterator[Source | _Stream | InputError]:
    """The file with a name, or the files of the log that is the folder with it."""
    # A name that can't be a path is an error of this source alone.
    shown = printable_name(name)
    try:
        path = Path(name).expanduser()
        is_folder = path.is_dir()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, or the home of no user
        yield InputError(_explain_error(error), path=shown)
        return
    if not is_folder and not is_folder_log(path):
        yield _resolve_file(name, path)
        return
    path = path if is_folder else path.parent

    # A folder may be a log of a known kind.
    if found := find_folder_log(path):
        yield Source(shown, path=found.path, folder=path, stored_bytes=found.stored_bytes)
        return

    yield from _folder_sources(path, shown)


def _folder_sources(folder: Path, shown: str) -> Iterator[Source | _Stream | InputError]:
    """The files of a folder: one log if they are tables of Parquet, else logs among other files."""
    # Of an export of Google, what devices measured is read first, in whatever folder it lies.
    items = sorted(walk_folder(folder), key=lambda item: reading_rank(item.path))

    # Parquet files are one log, maybe in partitions. What lies beside them is no part of it.
    tables = [item for item in items if item.path.suffix in _PARQUET and not item.log]
    collection = shown if len(tables) < len(items) else ""
    if not items:
        yield InputError("no file in this folder", path=shown, remedy="name one that holds logs")
    for item in items:
        found = _folder_source(item, collection)
        if isinstance(found, Source) and item in tables:
            found = replace(found, folder=folder)
        yield found


def _folder_source(item: FolderItem, collection: str) -> Source | _Stream | InputError:
    """A file of a folder, or a log that is a folder in it."""
    shown = printable_name(str(item.path))
    if item.error is not None:
        found: Source | _Stream | InputError = InputError(_explain_error(item.error), path=shown)
    elif item.log is not None:
        found = Source(
            shown, path=item.log.path, folder=item.path, stored_bytes=item.log.stored_bytes
        )
    # Opening a pipe would wait for who writes to it.
    elif item.path.exists() and not item.path.is_file():
        found = UnknownFormatError("is no regular file", path=shown)
    else:
        found = _resolve_file(str(item.path), item.path)

    if isinstance(found, InputError):
        return _in_collection(found, collection) if collection else found
    return replace(found, collection=collection)


def _resolve_file(name: str, path: Path) -> Source | _Stream | InputError:
    """A regular file as a source, others as a stream."""
    shown = printable_name(name)
    try:
        # A file whose name isn't printable is read as a stream.
        if path.is_file() and printable_name(str(path)) == str(path):
            # Opening the file finds out whether it may be read.
            with path.open("rb"):
                return Source(shown, path=path)
        # A name without a file raises an error here; what passes is a pipe or a device, or a file
        # whose name isn't printable.
        path.stat()
    except FileNotFoundError as error:
        reason = "no file matches this pattern" if _is_pattern(name) else _explain_error(error)
        return InputError(reason, path=shown)
    except (OSError, ValueError) as error:
        return InputError(_explain_error(error), path=shown)

    # A pipe can be read once only.
    return _Stream(shown, lambda: _read_file(path))


def _explain_error(error: Exception) -> str:
    """Reason why a file can't be read, for messages."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, PermissionError):
        return "no permission to read it"
    # ValueErrors have no number.
    number = getattr(error, "errno", None)
    return f"can't be read: {os.strerror(number) if number else str(error)[:120]}"
