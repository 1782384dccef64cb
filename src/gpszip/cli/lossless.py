"""The options --lossless and --rm: logs that an archive keeps byte by byte, and may replace."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from gpszip.model.read_result import ReadResult
    from gpszip.pipeline.compress import LogKeeper

__all__ = [
    "check_lossless",
    "keep_all_columns",
    "log_keeper",
    "lossless_options",
    "open_sources",
    "remove_logs",
]


def lossless_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--lossless`` and ``--rm``."""
    remove = click.option(
        "--rm",
        "remove",
        is_flag=True,
        help="With --lossless: delete the logs once the archive is written and proved to hold "
        "them.",
    )
    lossless = click.option(
        "--lossless",
        is_flag=True,
        help="Keep the logs themselves, too, byte by byte, of Parquet every value: decompress "
        "--exact returns them.",
    )
    return lossless(remove(command))


def check_lossless(target: str, *, lossless: bool, remove: bool, append: bool) -> None:
    """Refuse options that don't go with logs that are kept exactly, or deleted."""
    from gpszip.errors import OptionError

    if remove and not lossless:
        raise OptionError("--rm deletes logs", remedy="add --lossless, which keeps every byte")
    if remove and target == "-":
        raise OptionError(
            "--rm: standard output can't be read back to prove that it holds the logs",
            remedy="name a file with -o",
        )
    if lossless and append:
        raise OptionError(
            "--lossless and --append were both given",
            remedy="compress all logs together, or make another archive",
        )


def open_sources(logs: tuple[str, ...], *, lossless: bool) -> AbstractContextManager[Sequence[Any]]:
    """Find the logs; those that are kept exactly are read twice, so that streams are stored."""
    if not lossless:
        return nullcontext(logs)
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.storage.source import spooled

    return spooled(logs, unzip=is_bundle)


def log_keeper(sources: Sequence[Any], *, lossless: bool, remove: bool) -> LogKeeper | None:
    """What makes the section of the logs that are kept exactly, where any are."""
    if not lossless:
        return None
    from gpszip.pipeline.exact_logs import check_keepable, check_removable, exact_section

    check_keepable(sources)
    if remove:
        check_removable(sources)
    return partial(exact_section, sources)


def keep_all_columns(read_result: ReadResult) -> ReadResult:
    """What was read of logs that are kept exactly: no column of theirs is dropped."""
    return replace(read_result, dropped_columns=())


def remove_logs(target: str, sources: Sequence[Any]) -> int:
    """Delete logs that the written archive holds; return how many."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.pipeline.exact_logs import check_exact, remove_sources

    with open_archive_file(target) as archive:
        check_exact(archive, sources)
    return remove_sources(sources)
