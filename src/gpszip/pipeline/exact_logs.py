"""Logs that an archive keeps byte by byte: storing, comparing and writing them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from gpszip.archive import Archive
from gpszip.archive.exact import find_exact_logs, find_trails
from gpszip.archive.exact_rows import ChosenFrames, ChosenRows
from gpszip.container.contents import Section
from gpszip.container.layout import EXACT_KINDS, SectionKind
from gpszip.errors import CorruptArchiveError, InputError, OptionError
from gpszip.files.atomic_write import atomic_write_all
from gpszip.files.os_errors import as_output_error
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.sink import open_sink
from gpszip.io.storage.source import Source
from gpszip.lossless.layout import TableLayout
from gpszip.lossless.logs import ExactLogs, write_exact_logs
from gpszip.lossless.trails import NO_TRAILS
from gpszip.pipeline.exact_frames import check_frames, find_frame
from gpszip.pipeline.exact_layout import find_layout
from gpszip.pipeline.spooled_section import spooled_section

if TYPE_CHECKING:
    from gpszip.lossless.frame_logs import FrameLog

__all__ = [
    "check_exact",
    "check_keepable",
    "check_removable",
    "exact_logs",
    "exact_name",
    "exact_section",
    "find_log",
    "kept_exactly",
    "prove_exact",
    "remove_sources",
    "without_guides",
    "write_logs",
    "write_rows",
]

#: Bytes that are read and compared at a time.
_CHUNK_BYTES = 1 << 20

#: Characters of a line that messages show.
_MAX_SHOWN = 60

#: What to do where a new archive would not return a log.
_REMEDY = (
    "the log is untouched, and nothing was written; if another program writes to the log, compress "
    "it afterwards, else please report this"
)


def exact_section(
    sources: Sequence[Source | InputError], archive: Archive | None = None
) -> Section:
    """Store logs byte by byte.

    Parameters
    ----------
    sources : sequence of Source
        The logs; gzip files are stored unpacked.
    archive : Archive, optional
        Whose walks predict the logs; to read the section takes the same walks.

    Raises
    ------
    InputError
        If a log can't be read: nothing of it could be kept.
    OptionError
        If two logs have the same name.
    """
    readable = check_keepable(sources)
    names = [exact_name(source) for source in readable]
    logs = [(name, partial(_chunks, source)) for name, source in zip(names, readable, strict=True)]
    trails = NO_TRAILS if archive is None else find_trails(archive)
    layouts = find_layouts(readable, trails.names)
    found = {exact_name(source): find_frame(source, frozenset(trails.names)) for source in readable}
    frames = {name: frame for name, frame in found.items() if frame is not None}
    write = partial(write_exact_logs, logs, trails=trails, layouts=layouts, frames=frames)
    return spooled_section(SectionKind.GUIDED_LOGS, write)


def find_layouts(sources: Sequence[Source], tracks: Sequence[str]) -> dict[str, TableLayout]:
    """Find the layouts of logs with rows and columns, by the names under which they are kept."""
    names, is_only = frozenset(tracks), len(sources) == 1
    found = {exact_name(source): find_layout(source, names, is_only=is_only) for source in sources}
    return {name: layout for name, layout in found.items() if layout is not None}


def check_keepable(sources: Sequence[Source | InputError]) -> list[Source]:
    """Refuse logs that can't be kept exactly; return all others.

    Raises
    ------
    InputError
        If a log can't be read: nothing of it could be kept.
    OptionError
        If two logs have the same name.
    """
    readable: list[Source] = []
    for source in sources:
        if isinstance(source, InputError):
            raise source
        readable.append(source)
    names = [exact_name(source) for source in readable]
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise OptionError(
            f"--lossless: two logs are named {twice!r}",
            remedy="rename one, or make an archive for each folder",
        )
    return readable


def without_guides(archive: Archive) -> Archive:
    """Return the archive with logs that need no walks, so that these may change."""
    logs = find_exact_logs(archive)
    if logs is None or not logs.is_guided:
        return archive
    kept = [(log.name, partial(logs.read, number)) for number, log in enumerate(logs.logs)]
    layouts = {log.name: logs.layout(number) for number, log in enumerate(logs.logs)}
    known = {name: layout for name, layout in layouts.items() if layout is not None}
    frames = {}
    for number, frame in logs.frames.items():
        from gpszip.lossless.frame_logs import FrameSource

        frames[logs.logs[number].name] = FrameSource(frame.head, partial(_batches, frame))
    write = partial(write_exact_logs, kept, layouts=known, frames=frames)
    section = spooled_section(SectionKind.GUIDED_LOGS, write)
    extras = [each for each in archive.contents.extras if each.kind not in EXACT_KINDS]
    contents = replace(archive.contents, extras=(*extras, section))
    return replace(archive, contents=contents)


def exact_name(source: Source) -> str:
    r"""Name under which a log is kept: that of its file, without folders and ``.gz``.

    Letters that can't be printed are escaped in names of sources, and no archive may hold a
    backslash: of ``a\nb.csv`` remains ``a_nb.csv``.
    """
    name = PurePath(source.name).name.replace("\\", "_") or "log"
    is_packed = name.lower().endswith(".gz") and source.is_gzip
    return name[:-3] if is_packed and len(name) > 3 else name


def exact_logs(archive: Archive) -> ExactLogs:
    """Return the logs that an archive keeps byte by byte.

    Raises
    ------
    OptionError
        If it keeps none.
    """
    logs = find_exact_logs(archive)
    if logs is None:
        raise OptionError(
            "the archive keeps no log exactly", remedy="compress the log with --lossless"
        )
    return logs


def kept_exactly(logs: ExactLogs) -> str:
    """What is kept of logs, for messages."""
    return "every byte, of Parquet every value" if logs.frames else "every byte"


def find_log(logs: ExactLogs, name: str) -> int:
    """Return the number of the log with a name.

    Raises
    ------
    OptionError
        If there is none.
    """
    names = [log.name for log in logs.logs]
    if name not in names:
        raise OptionError(
            f"no log {name!r} is kept exactly", remedy=f"there are {', '.join(names)}"
        )
    return names.index(name)


def check_exact(archive: Archive, sources: Sequence[Source | InputError]) -> int:
    """Compare logs with what an archive keeps of them; return the number of bytes compared.

    Parameters
    ----------
    archive : Archive
        Keeps the logs exactly.
    sources : sequence of Source
        The logs. A single one is compared with the only log of the archive, whatever its name.

    Raises
    ------
    InputError
        If a log can't be read, or differs; the first line that does is named.
    OptionError
        If the archive does not keep a log.
    """
    logs = exact_logs(archive)
    total = 0
    for source in sources:
        if isinstance(source, InputError):
            raise source
        is_only = len(sources) == 1 and len(logs.logs) == 1
        number = 0 if is_only else find_log(logs, exact_name(source))
        if number in logs.frames:
            check_frames(source, logs.frames[number])
            total += logs.logs[number].size
        else:
            total += _compare(source, logs.read(number))
    return total


def prove_exact(archive: Archive, sources: Sequence[Source | InputError]) -> None:
    """Refuse a new archive that would not return the logs byte by byte; this takes 1.2 us a row.

    Parameters
    ----------
    archive : Archive
        Keeps the logs exactly; it is not written yet.
    sources : sequence of Source
        All of its logs.

    Raises
    ------
    InputError
        If a log would come back with other bytes, or changed while it was compressed.
    """
    try:
        check_exact(archive, sources)
    except InputError as error:
        raise InputError(
            error.reason, path=error.path, location=error.location, remedy=error.remedy or _REMEDY
        ) from None
    except CorruptArchiveError as error:
        names = ", ".join(log.name for log in exact_logs(archive).logs)
        raise InputError(
            f"the archive can't return the log ({error.detail})", path=names, remedy=_REMEDY
        ) from error


def write_logs(
    logs: ExactLogs, numbers: Sequence[int], target: str | None, *, force: bool
) -> dict[str, int]:
    """Write logs to files, none of which appears before all are on disk.

    Parameters
    ----------
    logs : ExactLogs
        The logs.
    numbers : sequence of int
        Which of them.
    target : str or None
        File for a single log, ``-`` for standard output; a folder that exists, or is made, for
        several. By default each log goes into the current folder, under its own name.
    force : bool
        Whether to replace files.

    Returns
    -------
    dict of str to int
        Bytes of each file written.

    Raises
    ------
    OutputError
        If a file exists, or can't be written.
    CorruptArchiveError
        If the archive is damaged.
    """
    names = [logs.logs[number].name for number in numbers]
    if target == "-":
        with open_sink("-") as sink:
            for number in numbers:
                sink.writelines(logs.read(number))
        return {}

    # Names of the files, and the folder that several need.
    paths = [Path(name) for name in names]
    if target is not None and (len(names) != 1 or Path(target).is_dir()):
        with as_output_error(target):
            Path(target).mkdir(parents=True, exist_ok=True)
        paths = [Path(target) / name for name in names]
    elif target is not None:
        paths = [Path(target)]

    sizes = []
    with atomic_write_all(paths, force=force) as temporary_paths:
        for number, path, name in zip(numbers, temporary_paths, names, strict=True):
            with as_output_error(name), path.open("wb") as file:
                file.writelines(logs.read(number))
                sizes.append(file.tell())
    return {str(path): size for path, size in zip(paths, sizes, strict=True)}


def write_rows(rows: ChosenRows | ChosenFrames, target: str, *, force: bool) -> tuple[int, int]:
    """Write chosen rows and columns of logs, with what stands before the rows in the log.

    Parameters
    ----------
    rows : ChosenRows
        The rows.
    target : str
        A file, or ``-`` for standard output.
    force : bool
        Whether to replace the file.

    Returns
    -------
    rows, bytes : int
        Numbers of rows, without what stands before them, and of bytes.

    Raises
    ------
    OutputError
        If the file exists, or can't be written.
    CorruptArchiveError
        If the archive is damaged.
    """
    lines, size = 0, 0

    def counted() -> Iterator[bytes]:
        nonlocal lines, size
        for part, count in rows.parts():
            lines, size = lines + count, size + len(part)
            yield part

    if target == "-":
        with open_sink("-") as sink:
            sink.writelines(counted())
        return lines, size
    with (
        atomic_write_all([Path(target)], force=force) as paths,
        as_output_error(target),
        paths[0].open("wb") as file,
    ):
        file.writelines(counted())
    return lines, size


def check_removable(sources: Sequence[Source | InputError]) -> None:
    """Refuse to delete what was not named as a file, such as members of archives and folders.

    Raises
    ------
    OptionError
        If there are any.
    """
    for source in sources:
        if isinstance(source, InputError):
            raise source
        if source.collection or source.path is None or str(source.path) != source.name:
            raise OptionError(
                f"--rm: {source.name} is no file by itself that could be deleted",
                remedy="leave out --rm, or name files",
            )


def remove_sources(sources: Sequence[Source | InputError]) -> int:
    """Delete the files of logs; return how many there were.

    Raises
    ------
    OutputError
        If one can't be deleted; those before it are.
    """
    paths = [source.path for source in sources if isinstance(source, Source)]
    for path in paths:
        assert path is not None
        with as_output_error(str(path)):
            path.unlink()
    return len(paths)


def _batches(frame: FrameLog, _rows: int) -> Iterator[Any]:
    """Rows of a log of columns, in batches as they are kept."""
    return frame.batches()


def _chunks(source: Source) -> Iterator[bytes]:
    """Bytes of a log, unpacked."""
    with source.open() as stream:
        while chunk := read_chunk(stream, _CHUNK_BYTES):
            yield chunk


def _even(chunks: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes in chunks of one size, but for the last."""
    pending = b""
    for chunk in chunks:
        pending += chunk
        while len(pending) >= _CHUNK_BYTES:
            yield pending[:_CHUNK_BYTES]
            pending = pending[_CHUNK_BYTES:]
    if pending:
        yield pending


def _compare(source: Source, kept: Iterable[bytes]) -> int:
    """Compare a log with the bytes kept of it; return how many there are."""
    size, lines, line = 0, 0, b""
    for there, here in zip_longest(_even(_chunks(source)), _even(kept), fillvalue=b""):
        if there != here:
            raise _difference(source, line + there, line + here, lines)
        size += len(there)
        lines += there.count(b"\n")
        # The beginning of a line that goes on in the next chunk.
        line = (line + there).rpartition(b"\n")[2][-_CHUNK_BYTES:]
    return size


def _difference(source: Source, there: bytes, here: bytes, lines: int) -> InputError:
    """Describe the first line that differs, after so many lines before these bytes."""
    pairs = zip_longest(there.split(b"\n"), here.split(b"\n"))
    number, (log, archive) = next((i, pair) for i, pair in enumerate(pairs) if pair[0] != pair[1])
    return InputError(
        f"the log has {_shown(log)}, the archive {_shown(archive)}",
        path=source.name,
        location=f"line {lines + number + 1}",
    )


def _shown(line: bytes | None) -> str:
    """A line for messages."""
    if line is None:
        return "no more lines"
    text = line.decode("utf-8", "backslashreplace")
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "...")
