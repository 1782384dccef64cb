"""gpszip compress --stream: read a pipe that may never end, and keep its archive whole."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.live.notices import Notices
    from gpszip.live.stream.compressor import StreamCompressor
    from gpszip.live.stream.run import StreamResult
    from gpszip.model import Options

__all__ = ["check_stream_options", "compress_stream", "stream_options"]

#: Lines of a batch, those of gpszip.live.stream.run, whose import takes longer than --help may.
_BATCH_LINES = 10_000

#: Options that a stream can't have, by their names in the command.
_REFUSED = {
    "size": "--bytes",
    "ratio": "--ratio",
    "map_name": "--map",
    "update_map": "--update-map",
    "coreset": "--coreset",
    "stated_memory": "--memory",
    "k": "--k",
    "m": "--m",
    "layer": "--layer",
    "skip_bad": "--skip-bad",
    "keep": "--keep",
    "keep_times": "--keep-times",
    "lossless": "--lossless",
    "remove": "--rm",
    "topics": "--topic",
    "frame": "--frame",
    "times_file": "--times",
    "rate": "--rate",
    "dry_run": "--dry-run",
    "selection": "--track, --since, --until, --bbox",
}

F = TypeVar("F", bound=Callable[..., Any])


def stream_options(command: F) -> F:
    """Add the options --stream, --batch and --every."""
    # When the archive is written.
    command = click.option(
        "--every",
        "batch_seconds",
        type=DURATION,
        metavar="DURATION",
        help="With --stream: write the archive so long after a line came; by default 60s.",
    )(command)
    command = click.option(
        "--batch",
        "batch_lines",
        type=click.IntRange(1),
        metavar="LINES",
        help=f"With --stream: write it after so many lines at least; by default {_BATCH_LINES}.",
    )(command)

    # Decorators apply from the last to the first: help lists this one first.
    return click.option(
        "--stream",
        is_flag=True,
        help="Read standard input, or a pipe, for as long as lines come, and write the archive "
        "again and again.",
    )(command)


def compress_stream(
    logs: tuple[str, ...],
    target: str,
    options: Options,
    choices: dict[str, Any],
    archive: Archive | None,
    *,
    quiet: bool,
    as_json: bool,
) -> Outcome:
    """Follow a stream until it ends, or a signal comes; print what came of it.

    Parameters
    ----------
    logs : tuple of str
        Standard input, or the name of a pipe or file.
    target : str
        The archive.
    options : Options
        Bound, gap and effort.
    choices : dict
        Options of the command.
    archive : Archive, optional
        What is continued.
    quiet, as_json : bool
        What is printed.
    """
    from gpszip.cli.engine import open_executor
    from gpszip.cli.output import print_status
    from gpszip.io.logs.read import parse_options
    from gpszip.live.notices import Notices
    from gpszip.live.stream.compressor import StreamCompressor
    from gpszip.live.stream.lines import StreamLines
    from gpszip.live.stream.rows import StreamReader
    from gpszip.live.stream.run import BATCH_SECONDS, follow_stream, stop_at_signals
    from gpszip.pipeline.bounds import requested_bound

    # Refuse what can't be had batch by batch.
    _check_stream(logs, target, choices)
    if archive is not None:
        from gpszip.live.rolling.archives import check_archive

        check_archive(archive, Path(target), needs_maximum=False, option="-o")
    request, _ = parse_options(
        {
            "columns": choices["columns"],
            "time_unit": choices["time_unit"],
            "dates": choices["dates"],
        }
    )

    # Follow the stream.
    name = "standard input" if logs in ((), ("-",)) else logs[0]
    notices = Notices(_no_line if quiet or as_json else print_status)
    if archive is not None and options.bounded and requested_bound(options) != archive.error_bound:
        notices.note("the bound that the archive states holds, not the one given", target)
    executor_choices = choices["workers"], choices["engine"], choices["scheduler"]
    with open_executor(*executor_choices) as executor:
        lines = StreamLines(_open_stream(logs))
        reader = StreamReader(name, request, choices["format"], clean=choices["clean"])
        compressor = StreamCompressor(
            options,
            archive,
            sort=choices["sort"],
            split=choices["split"],
            clean=choices["clean"],
            executor=executor,
        )
        with stop_at_signals(lines.stop):
            result = follow_stream(
                lines,
                reader,
                compressor,
                Path(target),
                notices,
                batch_lines=choices["batch_lines"] or _BATCH_LINES,
                batch_seconds=choices["batch_seconds"] or BATCH_SECONDS,
                name=name,
            )

    # Say what was done.
    if as_json or not quiet:
        _print_result(target, compressor, result, notices, as_json=as_json)
    return Outcome.LEFT_OUT if result.lost else Outcome.DONE


def check_stream_options(choices: dict[str, Any]) -> None:
    """Refuse options of streams where none is read.

    Raises
    ------
    click.UsageError
        With the option.
    """
    for name, option in (("batch_lines", "--batch"), ("batch_seconds", "--every")):
        if choices[name] is not None and not choices["stream"]:
            raise click.UsageError(f"{option} needs --stream, the stream that is read in batches")


def _check_stream(logs: tuple[str, ...], target: str, choices: dict[str, Any]) -> None:
    """Refuse options that don't go with --stream, several logs, and an archive that is a stream.

    Raises
    ------
    click.UsageError
        With the options.
    """
    from gpszip.cli.output import STDOUT

    given = [option for name, option in _REFUSED.items() if choices.get(name)]
    if not choices["times"]:
        given.append("--no-times")
    if given:
        raise click.UsageError(f"{given[0]} does not go with --stream; leave it out")
    if len(logs) > 1:
        raise click.UsageError("--stream reads one stream; name one, or - for standard input")
    if target == STDOUT:
        raise click.UsageError(
            "--stream replaces its archive again and again, which standard output can't; name a "
            "file with -o"
        )


def _no_line(_text: str) -> None:
    """Take a line that nobody wants to see."""


def _open_stream(logs: tuple[str, ...]) -> int:
    """Return the descriptor of standard input, or of a pipe, device or file.

    It stays open: a thread may still read from it when the process ends.
    """
    from gpszip.errors import InputError

    if logs in ((), ("-",)):
        return 0
    if Path(logs[0]).is_dir():
        raise InputError("is a folder", path=logs[0], remedy="name a pipe, or - for stdin")
    try:
        return os.open(logs[0], os.O_RDONLY)
    except OSError as error:
        raise InputError(
            f"can't be read ({error.strerror})", path=logs[0], remedy="name a pipe, or - for stdin"
        ) from None


def _print_result(
    target: str,
    compressor: StreamCompressor,
    result: StreamResult,
    notices: Notices,
    *,
    as_json: bool,
) -> None:
    """Say how much came, and what the archive holds."""
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.units import format_bytes, format_count, format_length

    # For a program.
    archive = compressor.archive
    assert archive is not None
    rmse, max_error = compressor.errors
    if as_json:
        bound = archive.error_bound
        print_json(
            {
                "output": target,
                "lines": result.lines,
                "points": compressor.points,
                "lost": result.lost,
                "batches": result.batches,
                "tracks": len(archive.ids),
                "bytes_out": archive.size,
                "rmse": rmse,
                "max_error": max_error,
                "bound": None if bound is None else bound.metres,
                "nodes": len(archive.road_map.nodes),
                "edges": len(archive.road_map.edges),
                "counts": dict(notices.counts),
            }
        )
        return

    # For a person.
    facts = [
        f"{format_count(compressor.points, 'point')} in {format_count(len(archive.ids), 'track')}",
        f"{format_bytes(archive.size)} written {format_count(result.batches, 'time')}",
        f"RMSE {format_length(rmse)}",
        f"maximum {format_length(max_error)}",
    ]
    others = [f"{event}: {number:,}" for event, number in notices.counts.items()]
    print_status(f"{target}: {'; '.join([', '.join(facts), *others])}")
