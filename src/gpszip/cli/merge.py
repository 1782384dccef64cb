"""gpszip merge: several archives in, one archive out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.engine import engine_options, open_executor
from gpszip.cli.options import Settings, common_options, force, output_option
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import LENGTH

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model.merge_report import MergeReport

__all__ = ["command"]


@click.command("merge", short_help="Unite archives on one map.")
@click.argument("archives", metavar="ARCHIVE...", nargs=-1, required=True)
@output_option("city.gpsz")
@click.option(
    "--deviation",
    type=LENGTH,
    metavar="LENGTH",
    help="How far tracks may be moved in the root mean square, such as 5m.",
)
@click.option(
    "--max-deviation",
    type=LENGTH,
    metavar="LENGTH",
    help="How far tracks may be moved at any instant, such as 10m.",
)
@click.option(
    "--same-id",
    type=click.Choice(["refuse", "prefix", "join"]),
    default="refuse",
    show_default=True,
    help="Where a track's name is in several archives: refuse, name all tracks ARCHIVE:TRACK, or join them as one agent's.",
)
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out archives that can't be read, name them, end with exit code 3.",
)
@engine_options
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archives: tuple[str, ...],
    target: str,
    force: bool,
    quiet: bool,
    skip_bad: bool,
    **choices: Any,
) -> Outcome:
    """Unite every ARCHIVE on one map, without the logs: places and ways that are the same become one, all tracks are kept.

    Without --deviation or --max-deviation, tracks may be moved by the least that any archive promised before any merge.
    """
    from gpszip.cli.output import check_output, print_json, print_status, write_archive
    from gpszip.cli.progress import progress_bar
    from gpszip.cli.summary import output_label
    from gpszip.errors import OptionError
    from gpszip.model.merge_options import MergeOptions

    if choices["deviation"] is not None and choices["max_deviation"] is not None:
        raise OptionError("--deviation and --max-deviation were both given; give one")
    where = choices.pop("workers"), choices.pop("engine"), choices.pop("scheduler")
    options = MergeOptions(**choices)
    check_output(target, force=force, binary=True)
    from gpszip.pipeline.merge import merge

    _check_duplicates(archives)
    parts, bad = (
        _read_valid(archives) if skip_bad else ({name: _read_whole(name) for name in archives}, {})
    )
    with progress_bar(quiet=quiet or settings.json) as listener, open_executor(*where) as executor:
        made, report = merge(
            [*parts.values()],
            options,
            names=_short_names(tuple(parts)),
            executor=executor,
            progress=listener,
        )
    write_archive(target, made, force=force)
    if settings.json:
        print_json(
            {"output": target, **_facts(tuple(parts), made, report), "left_out": bad},
            err=target == "-",
        )
    elif not quiet:
        print_status(
            "; ".join(
                [
                    f"{output_label(target)}: {_describe(made, report)}",
                    *(f"left out {reason}" for reason in bad.values()),
                ]
            )
        )
    return Outcome.LEFT_OUT if bad else Outcome.DONE


def _check_duplicates(archives: tuple[str, ...]) -> None:
    """Refuse an archive that is named twice: its tracks would be there twice."""
    from gpszip.errors import OptionError

    for name in archives:
        if archives.count(name) > 1:
            raise OptionError(f"{name} is named twice; name each archive once")


def _read_valid(archives: tuple[str, ...]) -> tuple[dict[str, Archive], dict[str, str]]:
    """Archives that can be read, and why the others can't be."""
    from gpszip.errors import CorruptArchiveError, InputError

    whole: dict[str, Archive] = {}
    bad: dict[str, str] = {}
    for name in archives:
        try:
            whole[name] = _read_whole(name)
        except (CorruptArchiveError, InputError) as error:
            bad[name] = str(error)
    if bad and len(whole) < 2:
        raise InputError(
            f"{'only one' if whole else 'none'} of the archives can be read, a merge takes two: {'; '.join(bad.values())}"
        )
    return whole, bad


def _read_whole(name: str) -> Archive:
    """The archive of this name, all decoded, so that a corrupt one is known by its name."""
    from gpszip.cli.archives import open_archive_file

    with open_archive_file(name) as archive:
        if archive.contents.map is None and archive.ids:
            _ = archive.walks, archive.road_map
            if archive.kept_columns is not None:
                archive.sample_times(archive.ids[0])
        return archive


def _short_names(archives: tuple[str, ...]) -> list[str]:
    """Short names of the archives; their paths where these are not enough to tell them apart."""
    from gpszip.io.storage.display_name import printable_name

    short = [printable_name(Path(name).stem or name) for name in archives]
    return short if len(set(short)) == len(short) else [printable_name(name) for name in archives]


def _describe(made: Archive, report: MergeReport) -> str:
    """One line: what went in and came out, how far tracks were moved, and what is promised."""
    from gpszip.cli.units import format_bytes, format_length

    moved = report.deviation
    facts = [
        f"{report.archives:,} archives with {report.tracks:,} tracks",
        f"{format_bytes(report.bytes_in)} -> {format_bytes(report.bytes_out)}",
        f"nodes {report.nodes_in:,} -> {report.nodes:,}",
        f"ways {report.edges_in:,} -> {report.edges:,}",
        f"tracks were moved by {format_length(moved.rms)} in the root mean square, {format_length(moved.maximum)} at most",
        f"{report.seconds:.1f} s",
    ]
    error_bound = made.error_bound
    remarks = (
        []
        if error_bound is None
        else [
            f"promised: {'maximum' if error_bound.maximum else 'RMSE'} {format_length(error_bound.metres)}"
        ]
    )
    return "; ".join([", ".join(facts), *remarks, *report.notes])


def _facts(archives: tuple[str, ...], made: Archive, report: MergeReport) -> dict[str, Any]:
    """The same as values for programs; lengths in metres, times in seconds, sizes in bytes."""
    names = ("tracks", "parts", "nodes", "edges", "nodes_in", "edges_in", "bytes_in", "bytes_out")
    error_bound = made.error_bound
    return {
        **{name: getattr(report, name) for name in names},
        "archives": [
            {"name": name, "moved_rms": one.rms, "moved_max": one.maximum}
            for name, one in zip(archives, report.deviations, strict=True)
        ],
        "allowed": report.limit,
        "allowed_kind": "max" if report.limits_maximum else "rms",
        "promise": None if error_bound is None else error_bound.metres,
        "promise_kind": None
        if error_bound is None
        else ("max_error" if error_bound.maximum else "rmse"),
        "seconds": round(report.seconds, 3),
        "notes": list(report.notes),
    }
