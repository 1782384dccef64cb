"""Where a log's bytes come from: a file, a stream, standard input; packed with gzip or not."""

from __future__ import annotations

import glob
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.remote import fetch, is_remote
from gpszip.io.scratch import scratch, writing

__all__ = ["Source", "expand", "readable", "spooled"]

_GZIP = b"\x1f\x8b"
_HEAD = 1 << 18
_PIECE = 1 << 20


@dataclass(frozen=True)
class Source:
    """One log, not read yet.

    Parameters
    ----------
    name : str
        What to call it in messages.
    path : Path, optional
        The file.
    data : bytes, optional
        The log itself where it doesn't come from a file.
    base : Path, optional
        The folder that was named, for a file in it; folders between them may be keys of partitions (``vehicle=7``).
    """

    name: str
    path: Path | None = None
    data: bytes | None = None
    base: Path | None = None

    @property
    def log(self) -> str:
        """What was named: all files of a folder are one log."""
        return self.name if self.base is None else str(self.base)

    @property
    def size(self) -> int:
        """Number of bytes as stored."""
        if self.data is not None:
            return len(self.data)
        assert self.path is not None
        return self.path.stat().st_size

    @property
    def stem(self) -> str:
        """The log's name: the file's without its suffixes ``.gz`` and the like, or that of the folder that was named.

        Bytes that are no UTF-8 are written out, see :func:`readable`.
        """
        if self.base is not None:
            return readable(self.base.resolve().name)
        name = readable(Path(self.name).name)
        name = name[:-3] if name.lower().endswith(".gz") else name
        return Path(name).stem or name

    @property
    def packed(self) -> bool:
        """Whether it is packed with gzip."""
        with self._plain() as plain:
            return bool(plain.read(2) == _GZIP)

    def open(self) -> Any:
        """Open the log for reading, unpacked, as an Arrow file.

        Raises
        ------
        InputError
            If it can't be opened.
        """
        plain = self._plain()
        packed = plain.read(2) == _GZIP
        plain.seek(0)
        return pa.CompressedInputStream(plain, "gzip") if packed else plain

    def head(self) -> bytes:
        """Return the first 256 KiB of the log, unpacked."""
        with self.open() as stream:
            return self._read(stream, _HEAD)

    def read(self) -> bytes:
        """Return the whole log, unpacked."""
        with self.open() as stream:
            return self._read(stream, None)

    def _plain(self) -> Any:
        try:
            return pa.BufferReader(self.data) if self.data is not None else pa.memory_map(str(self.path))
        except OSError as error:
            raise InputError(f"{self.name}: can't be read: {error}") from None

    def _read(self, stream: Any, size: int | None) -> bytes:
        try:
            return bytes(stream.read(size))
        except OSError as error:
            raise InputError(f"{self.name}: damaged gzip file ({error}); unpack what is left of it with zcat, or fetch it again") from None


@contextmanager
def spooled(sources: Iterable[Any] | Any) -> Iterator[list[Any]]:
    r"""Copy streams and objects of a storage to temporary files for as long as the context lasts, so that they may be read in pieces.

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
    single = isinstance(sources, (str, Path)) or hasattr(sources, "read")
    with scratch() as folder:
        found: list[Any] = []
        for item in [sources] if single else sources:
            stream = sys.stdin.buffer if item == "-" else item
            path = folder / str(len(found))
            if isinstance(item, str) and is_remote(item):
                path.mkdir()
                found += [_stored(one, path / str(number)) for number, one in enumerate(fetch(item))]
                continue
            if not hasattr(stream, "read"):
                found.append(item)
                continue
            with path.open("wb") as file:
                while piece := _read(stream, _PIECE):
                    with writing():
                        file.write(piece)
                with writing():
                    file.flush()
            found.append(Source("standard input" if item == "-" else _name(stream), path=path))
        yield found


def readable(name: str) -> str:
    r"""Name of a file as text, in which bytes that are no UTF-8 are written out.

    Examples
    --------
    >>> readable("caf\udce9.csv")
    'caf\\xe9.csv'
    """
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _stored(fetched: tuple[str, bytes] | InputError, path: Path) -> Source | InputError:
    if isinstance(fetched, InputError):
        return fetched
    with writing():
        path.write_bytes(fetched[1])
    return Source(fetched[0], path=path)


def expand(sources: Iterable[str | Path | BinaryIO | Source | InputError] | str | Path | BinaryIO) -> Iterator[Source | InputError]:
    """Turn names, patterns and streams into logs to read.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of what :func:`spooled` gives
        ``-`` is standard input. A name with ``*``, ``?`` or ``[`` that is no file is a pattern; it stands for the
        files it matches, in the order of their names. URLs such as ``s3://bucket/logs/*.parquet`` are fetched.

    Yields
    ------
    Source or InputError
        The error where a name can't be read, so that the caller may leave it out.
    """
    single = isinstance(sources, (str, Path)) or hasattr(sources, "read")
    for item in [sources] if single else sources:  # type: ignore[union-attr]
        if isinstance(item, (Source, InputError)):
            yield item
        elif not isinstance(item, (str, Path)):
            yield _stream(item)
        elif str(item) == "-":
            yield Source("standard input", data=_read(sys.stdin.buffer))
        elif is_remote(str(item)):
            for found in fetch(str(item)):
                yield found if isinstance(found, InputError) else Source(found[0], data=found[1])
        else:
            for name in _names(str(item)):
                yield from _files(name)


def _stream(stream: Any) -> Source:
    return Source(_name(stream), data=_read(stream))


def _read(stream: Any, size: int = -1) -> bytes:
    """Bytes from a stream, of bytes or text."""
    try:
        data = stream.read(size)
    except OSError as error:
        name = "standard input" if stream is sys.stdin.buffer else _name(stream)
        raise InputError(f"{name}: can't be read: {error.strerror or error}; is it open?") from None
    return data.encode() if isinstance(data, str) else bytes(data)


def _name(stream: Any) -> str:
    name = getattr(stream, "name", None)
    return name if isinstance(name, str) else "stream"


def _names(name: str) -> list[str]:
    if any(mark in name for mark in "*?[") and not Path(name).exists():
        return sorted(glob.glob(name, recursive=True)) or [name]  # noqa: PTH207 (Path.glob takes no absolute pattern)
    return [name]


def _files(name: str) -> Iterator[Source | InputError]:
    """The file of this name, or the Parquet files in the folder of this name."""
    path = Path(name).expanduser()
    if not path.is_dir():
        yield _file(name, path)
        return
    found = sorted(path.rglob("*.parquet"))
    yield from (Source(str(file), path=file, base=path) for file in found)
    if not found:
        yield InputError(f"{name}: is a folder; name the files in it: '{name.rstrip('/')}/*.csv'")


def _file(name: str, path: Path) -> Source | InputError:
    try:
        if path.is_file() and readable(str(path)) == str(path):
            with path.open("rb"):
                return Source(name, path=path)
        return Source(name, data=path.read_bytes())  # libraries can't map a pipe to memory, nor open a name that is no UTF-8
    except FileNotFoundError:
        pattern = any(mark in name for mark in "*?[")
        return InputError(f"{name}: no file matches this pattern" if pattern else f"{name}: no such file")
    except PermissionError:
        return InputError(f"{name}: no permission to read it")
    except (OSError, ValueError) as error:
        return InputError(f"{name}: can't be read: {getattr(error, 'strerror', None) or error}")
