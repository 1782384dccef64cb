"""The command gpszip compress: it reads logs and writes one archive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from gpszip.cli.completing import complete_files
from gpszip.cli.engine import engine_options, open_executor
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.keep_option import KeptColumns, keep_options, parse_keep
from gpszip.cli.lossless import (
    check_lossless,
    keep_all_columns,
    log_keeper,
    lossless_options,
    open_sources,
    remove_logs,
)
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    no_output_error,
    output_name,
    output_option,
    quiet,
    robot_options,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, selection_options
from gpszip.cli.stream import check_stream_options, compress_stream, stream_options
from gpszip.cli.units import DURATION, LENGTH, SIZE, Quantity

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Listener, Options, Report
    from gpszip.model.log import Log
    from gpszip.model.selection import Selection
    from gpszip.pipeline.compress import LogKeeper
    from gpszip.run.executor import Executor

__all__ = ["command"]

#: Durations in seconds; infinite for "none".
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})

#: Options that need the samples of a log, which a coreset lacks.
_OPTIONS_OF_LOGS = {
    "map_name": "--map",
    "append": "--append",
    "lossless": "--lossless",
    "clean": "--clean",
    "sort": "--sort",
    "split": "--split",
    "columns": "--columns",
    "gap": "--gap",
    "layer": "--layer",
    "stated_memory": "--memory",
    "skip_bad": "--skip-bad",
    "format": "--format",
    "time_unit": "--time-unit",
    "dates": "--dates",
    "topics": "--topic",
    "frame": "--frame",
    "times_file": "--times",
    "rate": "--rate",
    "dry_run": "--dry-run",
    "selection": "--track, --since, --until, --bbox",
}

#: Fields of Options that bound the archive, and their options on the command line.
_BOUND_OPTIONS = {
    "rmse": "--rmse",
    "max_error": "--max-error",
    "size": "--bytes",
    "ratio": "--ratio",
}


@click.command(
    "compress",
    cls=CommandWithFormats,
    short_help="Learn the map of logs and store them as walks on it.",
)
@click.argument("logs", metavar="LOG...", nargs=-1, shell_complete=complete_files())
@output_option("walks.gpsz", default="the name of the only LOG or folder with .gpsz, beside it")
@click.option(
    "--rmse", type=LENGTH, metavar="LENGTH", help="Largest root mean square error, such as 5m."
)
@click.option(
    "--max-error",
    type=LENGTH,
    metavar="LENGTH",
    help="Largest error of any point, such as 10m; may go with --rmse.",
)
@click.option(
    "--bytes",
    "size",
    type=SIZE,
    metavar="SIZE",
    help="Largest archive, such as 900 or 4KiB, with the smallest RMSE that fits.",
)
@click.option(
    "--ratio",
    type=click.FloatRange(min=0, min_open=True),
    metavar="X",
    help="The same as a ratio: at most 1 byte for X bytes of the logs.",
)
@click.option(
    "--gap",
    type=_GAP,
    metavar="DURATION",
    help="Intervals between points longer than this are gaps; none: no gaps. By default estimated.",
)
@click.option(
    "--map",
    "map_name",
    metavar="CITY.gpsz",
    help="Store walks on the map of this archive, and no map; decompress needs it, too.",
)
@click.option(
    "--update-map",
    metavar="FILE",
    help="With --map: write that map, extended by these logs, to FILE, for later logs.",
)
@click.option(
    "--append",
    is_flag=True,
    help="Append the logs to the archive that -o names, and extend its map.",
)
@click.option(
    "--effort",
    type=click.IntRange(1, 9),
    default=5,
    show_default=True,
    envvar="GPSZIP_EFFORT",
    show_envvar=True,
    help="From 1, fast, to 9, small archives.",
)
@click.option(
    "--coreset",
    type=click.IntRange(1),
    metavar="N",
    help="Learn from a coreset of N blocks; the bound is measured at all points.",
)
@click.option(
    "--memory",
    type=SIZE,
    metavar="SIZE",
    envvar="GPSZIP_MEMORY",
    show_envvar=True,
    help="Memory to use, such as 1GiB; larger logs are compressed in batches.",
)
@click.option(
    "--k",
    type=click.IntRange(1),
    help="Number of parts in the thesis's (k,m)-segment mean, instead of the connected map. With a "
    "bound, the least --m that holds it is found.",
)
@click.option(
    "--m",
    type=click.IntRange(1),
    help="Number of segments that the k parts share; by default searched.",
)
@click.option(
    "--no-times",
    "times",
    is_flag=True,
    callback=lambda _context, _option, is_given: not is_given,
    help="Keep the shapes only, without times; a table then needs no column of times.",
)
@click.option(
    "--layer", type=click.Choice(["bz2"]), help="Pack the archive once more, as the thesis did."
)
@click.option(
    "--clean",
    is_flag=True,
    help="Drop outliers, which no vehicle could reach, and positions at 0,0 far from others.",
)
@time_order_options
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out logs, features and points that can't be read, name them, end with exit code 3.",
)
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column is what: t=when,x=east,y=north; or names in order, without a header.",
)
@time_options
@selection_options
@robot_options
@keep_options
@lossless_options
@click.option(
    "--format",
    metavar="FORMAT",
    help="Format of the logs: LOG_FORMATS; by default found from the content.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Say what would be read, and estimate bytes and CPU time from a sample; write nothing.",
)
@stream_options
@engine_options
@quiet
@force
@common_options
@click.pass_context
def command(
    context: click.Context,
    /,
    logs: tuple[str, ...],
    target: str | None,
    force: bool,
    quiet: bool,
    dry_run: bool,
    **choices: Any,
) -> Outcome:
    """Read every LOG, learn the map that they repeat, and write one archive.

    Formats of LOG: LOG_FORMATS; - is standard input. Without --rmse, --max-error,
    --bytes or --ratio, an RMSE that suits the log is estimated, with a maximum of four times that,
    and printed. Exit code 3 says that points or logs were lost; the first lines name them.
    """
    from gpszip.cli.output import check_output, print_status
    from gpszip.cli.progress import progress_bar
    from gpszip.cli.summary import print_summary

    # Refuse what can be refused before the logs are read.
    settings: Settings = context.obj
    _check_logs(context, logs, stream=choices["stream"])
    check_stream_options(choices)
    target = _output_name(target, logs, choices)
    selection = pop_selection(choices)
    kept = parse_keep(choices["keep"], heights=choices["heights"] and choices["times"])
    options = _compress_options(choices, kept)
    lossless, remove = choices["lossless"], choices["remove"]
    check_lossless(target, lossless=lossless, remove=remove, append=choices["append"])
    extended = _archive_to_extend(target, choices)
    known_map = _open_map(choices)
    reading = _Reading(choices, kept, selection, options.thesis, extended, known_map)
    # An archive that is extended has to be replaced.
    overwrite = force or extended is not None
    check_output(target, force=overwrite, binary=True)
    if choices["update_map"]:
        check_output(choices["update_map"], force=force, binary=True)

    # What can't be had of streams and coresets is refused there; GPSZIP_MEMORY is for logs alone.
    is_stated = context.get_parameter_source("memory") is ParameterSource.COMMANDLINE
    choices |= {
        "selection": None if selection.is_everything else selection,
        "dry_run": dry_run,
        "stated_memory": is_stated,
    }
    if choices["stream"]:
        return compress_stream(
            logs, target, options, choices, extended, quiet=quiet, as_json=settings.json
        )
    if _is_coreset(logs):
        return _compress_coreset(logs[0], target, options, choices, settings, quiet=quiet)
    if dry_run:
        return _dry_run(target, logs, reading, options, as_json=settings.json)

    # Make the archive, and the map extended by the logs.
    with (
        progress_bar(quiet=quiet or settings.json) as listener,
        open_executor(*_executor_choices(choices)) as executor,
        open_sources(logs, lossless=lossless) as sources,
        reading.open(sources, listener) as log,
    ):
        keeper = log_keeper(sources, lossless=lossless, remove=remove)
        work = _Work(_memory(choices), executor, listener, keeper)
        if extended is not None:
            archive, report = work.append(extended, log, options)
        else:
            archive, report = work.compress(log, options, known_map)
        updated_map = None
        if known_map is not None and choices["update_map"]:
            updated_map = work.append(known_map, log, _map_options(options))[0]
        read_result = log.read_result

        # What can't be read back is not written.
        if lossless:
            from gpszip.pipeline.exact_logs import prove_exact

            prove_exact(archive, sources)

        # Write the files; delete the logs once what was written is proved to hold them.
        _write(target, archive, choices["update_map"], updated_map, force=overwrite)
        removed = remove_logs(target, sources) if remove else 0

    # Print the summary.
    # Logs that come from files always have one.
    assert read_result is not None
    if lossless:
        read_result = keep_all_columns(read_result)
    if settings.json or not quiet:
        print_summary(target, read_result, report, as_json=settings.json)
        if removed and not settings.json:
            print_status(f"{target}: holds the logs, as proved; deleted {removed:,}")
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _dry_run(
    target: str,
    logs: tuple[str, ...],
    reading: _Reading,
    options: Options,
    *,
    as_json: bool,
) -> Outcome:
    """Read the logs, and say what would be written."""
    import time

    from gpszip.cli.dry_run import DryRun, describe_files, print_dry_run
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.logs.mixed_files import may_be_log
    from gpszip.io.storage.source import spooled
    from gpszip.pipeline.estimate import estimate

    # Standard input is read twice, for its format and its rows, so that it is copied first.
    with spooled(logs, unzip=is_bundle, wanted=may_be_log) as sources:
        files = tuple(describe_files(sources, reading.choices["format"]))
        with reading.open(sources, None) as log:
            read_seconds = time.process_time()
            exact = reading.choices["lossless"]
            found = estimate(
                log,
                options,
                memory=_memory(reading.choices),
                map=reading.known_map,
                extended=reading.extended,
                exact=exact,
            )
            dry_run = DryRun(target, files, log, found, read_seconds, exact=exact)
            print_dry_run(dry_run, as_json=as_json)
            return Outcome.DONE if dry_run.read_result.complete else Outcome.LEFT_OUT


def _check_logs(context: click.Context, logs: tuple[str, ...], *, stream: bool) -> None:
    """Require a log, unless standard input is followed."""
    if not logs and not stream:
        [argument] = (each for each in context.command.params if isinstance(each, click.Argument))
        raise click.MissingParameter(ctx=context, param=argument)


def _is_coreset(logs: tuple[str, ...]) -> bool:
    """Whether the one log is the coreset of some."""
    from gpszip.io.coreset_files import holds_coreset

    return len(logs) == 1 and holds_coreset(logs[0])


def _compress_coreset(
    path: str,
    target: str,
    options: Options,
    choices: dict[str, Any],
    settings: Settings,
    *,
    quiet: bool,
) -> Outcome:
    """Learn from a coreset, whose samples are not at hand."""
    from gpszip.cli.output import write_archive
    from gpszip.cli.progress import progress_bar
    from gpszip.cli.summary import print_summary
    from gpszip.io.coresets import read_coreset
    from gpszip.model.read_result import ReadResult
    from gpszip.pipeline.compress_coreset import compress_coreset

    # Refuse what needs the log.
    for name, option in _OPTIONS_OF_LOGS.items():
        if choices[name]:
            raise click.UsageError(f"{option} takes a log, and {path} is its coreset")

    # Learn, write and say what holds.
    coreset = read_coreset(path)
    with (
        progress_bar(quiet=quiet or settings.json) as listener,
        open_executor(*_executor_choices(choices)) as executor,
    ):
        archive, report = compress_coreset(coreset, options, executor=executor, progress=listener)
    write_archive(target, archive, force=True)
    if settings.json or not quiet:
        size = Path(path).stat().st_size
        geographic = coreset.plane is not None
        read_result = ReadResult((), coreset.samples, size, geographic)
        print_summary(target, read_result, report, as_json=settings.json)
    return Outcome.DONE


def _output_name(target: str | None, logs: tuple[str, ...], choices: dict[str, Any]) -> str:
    """Name of the archive; one that is appended to has to be named."""
    if target is None and choices["append"]:
        raise no_output_error("walks.gpsz")
    return output_name(target, logs, ".gpsz", "walks.gpsz")


@dataclass(frozen=True, eq=False)
class _Work:
    """What logs are compressed with, and what keeps them exactly."""

    memory: int | None
    executor: Executor | None
    listener: Listener | None
    logs: LogKeeper | None = None

    def compress(self, log: Log, options: Options, map: Archive | None) -> tuple[Archive, Report]:
        """Compress a log, on the map of another archive if one is given."""
        from gpszip.pipeline.compress import compress

        return compress(
            log,
            options,
            memory=self.memory,
            map=map,
            logs=self.logs,
            executor=self.executor,
            progress=self.listener,
        )

    def append(self, archive: Archive, log: Log, options: Options) -> tuple[Archive, Report]:
        """Append a log to an archive."""
        from gpszip.pipeline.append import append

        return append(
            archive,
            log,
            options,
            memory=self.memory,
            executor=self.executor,
            progress=self.listener,
        )


@dataclass(frozen=True, eq=False)
class _Reading:
    """How logs are read, and what they extend."""

    choices: dict[str, Any]
    kept: KeptColumns
    selection: Selection
    thesis: bool
    extended: Archive | None
    known_map: Archive | None

    def open(self, logs: Sequence[Any], listener: Listener | None) -> AbstractContextManager[Log]:
        """Read the logs into memory, or sort them on disk where they don't fit."""
        from gpszip.pipeline.open_log import open_log

        # Positions must be on the plane of the map or archive that the logs extend.
        choices, map = self.choices, self.extended or self.known_map
        return open_log(
            logs,
            memory=_memory(choices),
            plane=None if map is None else map.grid.plane,
            progress=listener,
            thesis=self.thesis,
            format=choices["format"],
            columns=choices["columns"],
            time_unit=choices["time_unit"],
            dates=choices["dates"],
            clean=choices["clean"],
            sort=choices["sort"],
            split=choices["split"],
            skip_bad=choices["skip_bad"],
            keep=self.kept.to_read(self.extended),
            heights=self.kept.reads_heights(self.extended),
            times=choices["times"],
            selection=self.selection,
            topics=choices["topics"],
            frame=choices["frame"],
            times_file=choices["times_file"],
            rate=choices["rate"],
        )


def _memory(choices: dict[str, Any]) -> int | None:
    return None if choices["memory"] is None else int(choices["memory"])


def _write(
    target: str,
    archive: Archive,
    map_target: str | None,
    updated_map: Archive | None,
    *,
    force: bool,
) -> None:
    """Write the archive, and the map if it was updated."""
    from gpszip.cli.output import write_archive, write_archive_and_map

    if updated_map is None or map_target is None:
        write_archive(target, archive, force=force)
    else:
        write_archive_and_map(target, archive, map_target, updated_map)


def _executor_choices(choices: dict[str, Any]) -> tuple[int | None, str | None, str | None]:
    return choices["workers"], choices["engine"], choices["scheduler"]


def _archive_to_extend(target: str, choices: dict[str, Any]) -> Archive | None:
    """Open the archive to which logs are appended; return None where a new one is written."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.errors import OptionError

    if not choices["append"]:
        return None
    if target == "-" or choices["map_name"]:
        raise OptionError(
            "--append adds to the archive that -o names; "
            "it goes with neither standard output nor --map"
        )
    # The first --append to a name makes the archive, so that a script needs no special case.
    if not Path(target).exists():
        return None
    with open_archive_file(target) as archive:
        return archive


def _open_map(choices: dict[str, Any]) -> Archive | None:
    from gpszip.cli.archives import open_map_file
    from gpszip.errors import OptionError

    if choices["map_name"] is not None:
        return open_map_file(choices["map_name"])
    if choices["update_map"]:
        raise OptionError("--update-map needs --map, the map to be updated")
    return None


def _map_options(options: Options) -> Options:
    """Return options for the updated map: no limit of size, no columns, no exact times."""
    # A size was asked for the walks. The map grows with each log, and needs no columns of their
    # samples.
    no_columns = replace(options, keep=(), keep_times=False, curves=(), heights=False)
    return replace(no_columns, size=None, ratio=None)


def _compress_options(choices: dict[str, Any], kept: KeptColumns) -> Options:
    """Return the options of the pipeline; refuse those that contradict each other."""
    from gpszip.errors import OptionError
    from gpszip.model import Options

    # Options checks the same again; here the message has the words that the user typed.
    given = [option for name, option in _BOUND_OPTIONS.items() if choices[name] is not None]
    if len(given) > 1 and given != ["--rmse", "--max-error"]:
        raise OptionError(f"{given[0]} and {given[-1]} were both given", remedy="give one")
    names = (*_BOUND_OPTIONS, "gap", "effort", "coreset", "k", "m", "times", "layer", "keep_times")
    size = None if choices["size"] is None else int(choices["size"])
    return Options(
        **{name: choices[name] for name in names}
        | {"size": size, "keep": kept.exact, "curves": kept.curves, "heights": kept.heights}
    )
