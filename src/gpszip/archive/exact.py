"""What an archive keeps exactly: columns of the logs, and the logs themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpszip.container.contents import Contents
from gpszip.container.layout import EXACT_KINDS, SectionKind
from gpszip.errors import CorruptArchiveError

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.lossless.logs import ExactLogs
    from gpszip.lossless.trails import Trails

__all__ = ["find_exact_logs", "find_kept", "find_trails"]


def find_kept(contents: Contents) -> tuple[int, bytes] | None:
    """Return kind and body of the section of kept columns; None if there is none.

    Raises
    ------
    CorruptArchiveError
        If there are two.
    """
    kinds = (SectionKind.ATTRIBUTES, SectionKind.CODED_ATTRIBUTES)
    return _find_section(contents, kinds, "kept columns")


def _find_section(
    contents: Contents, kinds: tuple[SectionKind, ...], what: str
) -> tuple[int, bytes] | None:
    """Return kind and body of the only further section of some kinds; None if there is none.

    Raises
    ------
    CorruptArchiveError
        If there are two.
    """
    found = [extra for extra in contents.extras if extra.kind in kinds]
    if len(found) > 1:
        raise CorruptArchiveError(f"there are two sections of {what}")
    # The body may still be in the file; bytes reads it.
    return (found[0].kind, bytes(found[0].body)) if found else None


def find_exact_logs(archive: Archive) -> ExactLogs | None:
    """Return the logs that are kept byte by byte; None if none are.

    Raises
    ------
    CorruptArchiveError
        If their section is damaged.
    """
    found = _find_section(archive.contents, EXACT_KINDS, "exact logs")
    if found is None:
        return None
    # Archives without such a section need not import what reads it.
    from gpszip.lossless.logs import read_exact_logs

    kind, body = found
    return read_exact_logs(body, None if kind == SectionKind.EXACT_LOGS else find_trails(archive))


def find_trails(archive: Archive) -> Trails:
    """Return walks that predict logs; none of an archive without times, or on a known map."""
    from gpszip.archive.trails import ArchiveTrails
    from gpszip.lossless.trails import NamedTrails

    # Logs are not to need another archive.
    has_walks = archive.timed and archive.contents.map is None
    return ArchiveTrails(archive) if has_walks else NamedTrails(archive.ids)
