"""The logs that an archive keeps byte by byte."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpszip.container.contents import Contents
from gpszip.container.layout import SectionKind
from gpszip.errors import CorruptArchiveError

if TYPE_CHECKING:
    from gpszip.lossless.logs import ExactLogs

__all__ = ["find_exact_logs", "find_section"]


def find_section(contents: Contents, kind: SectionKind, what: str) -> bytes | None:
    """Return the body of the only further section of a kind; None if there is none.

    Raises
    ------
    CorruptArchiveError
        If there are two.
    """
    bodies = [extra.body for extra in contents.extras if extra.kind == kind]
    if len(bodies) > 1:
        raise CorruptArchiveError(f"there are two sections of {what}")
    # The body may still be in the file; bytes reads it.
    return bytes(bodies[0]) if bodies else None


def find_exact_logs(contents: Contents) -> ExactLogs | None:
    """Return the logs that are kept byte by byte; None if none are.

    Raises
    ------
    CorruptArchiveError
        If their section is damaged.
    """
    body = find_section(contents, SectionKind.EXACT_LOGS, "exact logs")
    if body is None:
        return None
    # Archives without such a section need not import what reads it.
    from gpszip.lossless.logs import read_exact_logs

    return read_exact_logs(body)
