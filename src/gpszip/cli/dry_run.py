"""gpszip compress --dry-run: say what would be read and written, and write nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.lossless import keep_all_columns
from gpszip.cli.output import print_json
from gpszip.cli.summary import describe_repairs, losses_as_dict, print_losses, repairs_as_dict
from gpszip.cli.units import format_bytes, format_count, format_duration, format_time

if TYPE_CHECKING:
    from gpszip.io.storage.source import Source
    from gpszip.model.log import Log
    from gpszip.model.read_result import ReadResult
    from gpszip.pipeline.estimate import Estimate

__all__ = [
    "DryRun",
    "InputFile",
    "cpu_time_text",
    "describe_files",
    "print_dry_run",
    "print_plan",
    "row_count_text",
]

#: Files that a person is shown; JSON names them all.
_MAX_NAMED = 5


@dataclass(frozen=True)
class InputFile:
    """A file that would be read.

    Parameters
    ----------
    name : str
        Its name.
    format : str or None
        Name of its format; None if it can't be read.
    bytes : int
        Its size as stored.
    """

    name: str
    format: str | None
    bytes: int


@dataclass(frozen=True, eq=False)
class DryRun:
    """What a compression would read and write.

    Parameters
    ----------
    target : str
        The archive.
    files : sequence of InputFile
        The logs.
    log : Log
        Their tracks.
    estimate : Estimate
        Of the archive.
    read_seconds : float
        CPU time to start and to read.
    exact : bool, default False
        Whether the logs are kept exactly, with all columns.
    """

    target: str
    files: Sequence[InputFile]
    log: Log
    estimate: Estimate
    read_seconds: float
    exact: bool = False

    @property
    def read_result(self) -> ReadResult:
        """What was read: logs that come from files always have it."""
        read_result = self.log.read_result
        assert read_result is not None
        return keep_all_columns(read_result) if self.exact else read_result

    @property
    def coordinates(self) -> str:
        """Names of the coordinates."""
        if self.read_result.geographic:
            return "lat,lon"
        dimension = self.log.dimension
        return ",".join("xyz"[:dimension] if dimension <= 3 else _numbered(dimension))

    @property
    def time_range(self) -> tuple[float, float] | None:
        """First and last time in seconds; None without times."""
        log = self.log
        ends = [
            (log.read(track, 0, 1).times[0], log.read(track, len(track) - 1).times[0])
            for track in log.tracks
            if track.timed
        ]
        if not ends:
            return None
        return float(min(first for first, _ in ends)), float(max(last for _, last in ends))

    @property
    def cpu_seconds(self) -> float | None:
        """CPU time of the whole command; None if it is not estimated."""
        seconds = self.estimate.cpu_seconds
        return None if seconds is None else self.read_seconds + seconds


def describe_files(
    sources: Sequence[Source | Exception], format: str | None
) -> Iterator[InputFile]:
    """Yield the name, format and size of each file; those that can't be read have no format."""
    from gpszip.errors import GPSZipError
    from gpszip.io.logs.formats import format_for_reading, format_named
    from gpszip.io.storage.source import Source

    for source in sources:
        # Reading reports these errors.
        if not isinstance(source, Source):
            continue
        try:
            name = (format_for_reading(source) if format is None else format_named(format)).name
        except GPSZipError:
            name = None
        yield InputFile(source.name, name, source.size)


def print_dry_run(dry_run: DryRun, *, as_json: bool) -> None:
    """Print what would be read, the bound, and the estimate: on standard output, as info does."""
    if as_json:
        print_json(_facts(dry_run))
        return

    # For a person: losses first.
    print_losses(dry_run.read_result)
    print_plan([*_rows_read(dry_run), *_rows_written(dry_run)], dry_run.target)


def print_plan(rows: Sequence[tuple[str, str]], target: str) -> None:
    """Print labels and texts in two columns, and that nothing was written."""
    width = max(len("written"), *(len(label) for label, _ in rows))
    for label, text in rows:
        click.echo(f"{label:<{width}}  {text}")
    click.echo(f"{'written':<{width}}  nothing: this is a dry run; it would be {target}")


def row_count_text(read_result: ReadResult) -> str:
    """Return how many rows were read, and how many of them are dropped."""
    lost = f", of which {read_result.lost:,} are dropped" if read_result.lost else ""
    return f"{read_result.points:,}{lost}"


def cpu_time_text(seconds: float) -> str:
    """Return an estimate of a CPU time, to two digits."""
    return f"about {format_duration(float(f'{seconds:.2g}'))}"


def _facts(dry_run: DryRun) -> dict[str, Any]:
    """Return the same for JSON: times in seconds, sizes in bytes."""
    # What was read.
    estimate, read_result, log = dry_run.estimate, dry_run.read_result, dry_run.log
    t_start, t_end = dry_run.time_range or (None, None)
    read = {
        "files": [asdict(file) for file in dry_run.files],
        "points": estimate.points,
        "tracks": len(log.tracks),
        "coordinates": dry_run.coordinates,
        "t_start": t_start,
        "t_end": t_end,
        "gap": estimate.gap,
        "bytes_in": read_result.bytes,
        **losses_as_dict(read_result),
        **repairs_as_dict(read_result.repairs, read_result.left_out),
        "dropped": list(read_result.dropped_columns),
    }

    # What would be written, estimated.
    seconds = dry_run.cpu_seconds
    return {
        "dry_run": True,
        "output": dry_run.target,
        **read,
        "bound": estimate.bound,
        "estimated_bytes": estimate.bytes,
        "estimated_cpu_seconds": None if seconds is None else round(seconds, 3),
        "sampled_points": estimate.sampled,
        "notes": list(estimate.notes),
    }


def _rows_read(dry_run: DryRun) -> list[tuple[str, str]]:
    """Return label and text of each line about what was read."""
    # The files.
    read_result, log = dry_run.read_result, dry_run.log
    named = [
        f"{file.name} ({file.format or 'unreadable'}, {format_bytes(file.bytes)})"
        for file in dry_run.files[:_MAX_NAMED]
    ]
    if len(dry_run.files) > _MAX_NAMED:
        named.append(f"{len(dry_run.files) - _MAX_NAMED:,} more, which --json names")

    # Their rows.
    rows = [("read", text) for text in named[:1]] + [("", text) for text in named[1:]]
    rows.append(("rows", row_count_text(read_result)))
    rows.append(("tracks", f"{len(log.tracks):,}"))
    rows.append(("coordinates", dry_run.coordinates))
    times = dry_run.time_range
    ends = "none" if times is None else f"{format_time(times[0])} to {format_time(times[1])}"
    rows.append(("times", ends))
    rows += [("repair", text) for text in describe_repairs(read_result.repairs)]
    if read_result.dropped_columns:
        rows.append(("not kept", ", ".join(read_result.dropped_columns)))
    return rows


def _rows_written(dry_run: DryRun) -> list[tuple[str, str]]:
    """Return label and text of each line about what would be written."""
    # The bound.
    estimate = dry_run.estimate
    rows = [("bound", estimate.bound or "none")]
    longer = "" if math.isinf(estimate.gap) else "over "
    rows.append(("gaps", f"{longer}{format_duration(estimate.gap)}"))
    rows += [("note", note) for note in estimate.notes]

    # The archive.
    size, seconds = estimate.bytes, dry_run.cpu_seconds
    if size is None:
        rows.append(("estimate", "none: with --k or --m, size and time depend on these"))
    elif estimate.sampled == 0:
        rows.append(("estimate", f"{format_bytes(size)} at most; the time depends on the tries"))
    elif estimate.is_exact:
        rows.append(("archive", f"{format_bytes(size)}: all of this small log was compressed"))
    else:
        basis = f"from {format_count(estimate.sampled, 'point')} of {estimate.points:,}"
        rows.append(("estimate", f"about {format_bytes(size)}, {basis}"))
    if seconds is not None:
        rows.append(("CPU time", f"{cpu_time_text(seconds)}, estimated"))
    return rows


def _numbered(dimension: int) -> list[str]:
    return [f"x{axis}" for axis in range(dimension)]
