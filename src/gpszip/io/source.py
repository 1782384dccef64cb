"""Where a log's bytes come from: a file, a stream, standard input; packed with gzip or not."""

from __future__ import annotations

import glob
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError

__all__ = ["Source", "expand"]

_GZIP = b"\x1f\x8b"
_HEAD = 1 << 18


@dataclass(frozen=True)
class Source:
    """One log, not read yet.

    Parameters
    ----------
    name : str
        What to call it in messages.
    path : Path, optional
        The file, or a folder of Parquet files.
    data : bytes, optional
        The log itself where it doesn't come from a file.
    """

    name: str
    path: Path | None = None
    data: bytes | None = None

    @property
    def folder(self) -> bool:
        """Whether this is a folder of files."""
        return self.path is not None and self.path.is_dir()

    @property
    def size(self) -> int:
        """Number of bytes as stored."""
        if self.data is not None:
            return len(self.data)
        assert self.path is not None
        files = self.path.rglob("*.parquet") if self.folder else [self.path]
        return sum(file.stat().st_size for file in files)

    @property
    def stem(self) -> str:
        """The file's name without its suffixes ``.gz`` and the like."""
        name = Path(self.name).name
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


def expand(sources: Iterable[str | Path | BinaryIO] | str | Path | BinaryIO) -> Iterator[Source | InputError]:
    """Turn names, patterns and streams into logs to read.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        ``-`` is standard input. A name with ``*``, ``?`` or ``[`` that is no file is a pattern; it stands for the
        files it matches, in the order of their names.

    Yields
    ------
    Source or InputError
        The error where a name can't be read, so that the caller may leave it out.
    """
    single = isinstance(sources, (str, Path)) or hasattr(sources, "read")
    for item in [sources] if single else sources:  # type: ignore[union-attr]
        if not isinstance(item, (str, Path)):
            yield _stream(item)
        elif str(item) == "-":
            yield Source("standard input", data=sys.stdin.buffer.read())
        else:
            yield from (_file(name) for name in _names(str(item)))


def _stream(stream: Any) -> Source:
    data = stream.read()
    if isinstance(data, str):
        data = data.encode()
    name = getattr(stream, "name", None)
    return Source(name if isinstance(name, str) else "stream", data=data)


def _names(name: str) -> list[str]:
    if any(mark in name for mark in "*?[") and not Path(name).exists():
        return sorted(glob.glob(name, recursive=True)) or [name]  # noqa: PTH207 (Path.glob takes no absolute pattern)
    return [name]


def _file(name: str) -> Source | InputError:
    path = Path(name).expanduser()
    try:
        if path.is_dir():
            return _folder(name, path)
        if path.is_file():
            with path.open("rb"):
                return Source(name, path=path)
        return Source(name, data=path.read_bytes())  # a pipe can't be mapped to memory
    except FileNotFoundError:
        pattern = any(mark in name for mark in "*?[")
        return InputError(f"{name}: no file matches this pattern" if pattern else f"{name}: no such file")
    except PermissionError:
        return InputError(f"{name}: no permission to read it")
    except (OSError, ValueError) as error:
        return InputError(f"{name}: can't be read: {getattr(error, 'strerror', None) or error}")


def _folder(name: str, path: Path) -> Source | InputError:
    if next(path.rglob("*.parquet"), None) is not None:
        return Source(name, path=path)
    return InputError(f"{name}: is a folder; name the files in it: '{name.rstrip('/')}/*.csv'")
