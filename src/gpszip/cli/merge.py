"""gpszip merge: merge several archives to one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.engine import engine_options, open_executor
from gpszip.cli.options import (
    Settings,
    common_options,
    dry_run_option,
    force,
    output_option,
    quiet,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import LENGTH

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model.merge_report import MergeReport

__all__ = ["command"]


@click.command("merge", short_help="Merge archives on one map.")
@click.argument(
    "archives",
    metavar="ARCHIVE...",
    nargs=-1,
    required=True,
    shell_complete=complete_files(".gpsz"),
)
@output_option("city.gpsz")
@click.option(
    "--deviation",
    type=LENGTH,
    metavar="LENGTH",
    help="Largest root mean square by which tracks may be moved, such as 5m.",
)
@click.option(
    "--max-deviation",
    type=LENGTH,
    metavar="LENGTH",
    help="Largest distance by which tracks may be moved at any time, such as 10m.",
)
@click.option(
    "--same-id",
    type=click.Choice(["refuse", "prefix", "join"]),
    default="refuse",
    show_default=True,
    help="If archives share a track's name: refuse, name all tracks ARCHIVE:TRACK, or join "
    "the tracks as one agent's.",
)
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out archives that can't be read, name them, end with exit code 3.",
)
@engine_options
@dry_run_option
@quiet
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
    deviation: float | None,
    max_deviation: float | None,
    same_id: str,
    workers: int | None,
    engine: str | None,
    scheduler: str | None,
    dry_run: bool,
) -> Outcome:
    """Merge every ARCHIVE on one map, without the logs.

    Nodes and edges that are the same become one; all tracks are kept. Without --deviation or
    --max-deviation, tracks may be moved by the smallest error bound of the archives before any
    merge.
    """
    from gpszip.cli.archives import read_decoded_archive
    from gpszip.cli.output import check_output, print_json, print_status, write_archive
    from gpszip.cli.progress import progress_bar
    from gpszip.cli.summary import output_label
    from gpszip.errors import OptionError
    from gpszip.model.merge_options import MergeOptions

    # Refuse what can be refused before archives are read.
    if deviation is not None and max_deviation is not None:
        raise OptionError("--deviation and --max-deviation were both given", remedy="give one")
    options = MergeOptions(deviation=deviation, max_deviation=max_deviation, same_id=same_id)
    check_output(target, force=force, binary=True, in_place=True)
    _check_duplicates(archives)
    from gpszip.pipeline.merge import merge, plan_merge

    # Read and merge.
    bad: dict[str, str] = {}
    if skip_bad:
        readable, bad = _read_valid(archives)
    else:
        readable = {name: read_decoded_archive(name) for name in archives}
    names = _short_names(tuple(readable))
    if dry_run:
        from gpszip.cli.plans import print_merge_plan

        plan = plan_merge([*readable.values()], options, names=names)
        print_merge_plan(target, readable, plan, bad, as_json=settings.json)
        return Outcome.LEFT_OUT if bad else Outcome.DONE
    with (
        progress_bar(quiet=quiet or settings.json) as listener,
        open_executor(workers, engine, scheduler) as executor,
    ):
        merged, report = merge(
            [*readable.values()],
            options,
            names=names,
            executor=executor,
            progress=listener,
        )

    # Write.
    write_archive(target, merged, force=force)
    if settings.json:
        facts = _facts(tuple(readable), merged, report)
        print_json({"output": target, **facts, "left_out": bad}, err=target == "-")
    elif not quiet:
        left_out = [f"left out {reason}" for reason in bad.values()]
        lines = [f"{output_label(target)}: {_describe(merged, report)}", *left_out]
        print_status("; ".join(lines))
    return Outcome.LEFT_OUT if bad else Outcome.DONE


def _check_duplicates(archives: tuple[str, ...]) -> None:
    """Refuse an archive that is named twice: its tracks would be in the result twice."""
    from gpszip.errors import OptionError

    for name in archives:
        if archives.count(name) > 1:
            raise OptionError(f"{name} is named twice", remedy="name each archive once")


def _read_valid(archives: tuple[str, ...]) -> tuple[dict[str, Archive], dict[str, str]]:
    """Return the archives that can be read, and why the others can't be."""
    from gpszip.cli.archives import read_decoded_archive
    from gpszip.errors import CorruptArchiveError, InputError

    readable: dict[str, Archive] = {}
    bad: dict[str, str] = {}
    for name in archives:
        try:
            readable[name] = read_decoded_archive(name)
        except (CorruptArchiveError, InputError) as error:
            bad[name] = str(error)

    # All reasons in one error: there is no result beside which they could be listed.
    if bad and len(readable) < 2:
        count = "only one" if readable else "none"
        raise InputError(
            f"{count} of the archives can be read, a merge takes two: {'; '.join(bad.values())}"
        )
    return readable, bad


def _short_names(archives: tuple[str, ...]) -> list[str]:
    """Return short names of the archives, or their paths if short names are not distinct."""
    from gpszip.io.storage.display_name import printable_name

    # Names without folder and suffix, which become a part of tracks' names with --same-id prefix.
    short = [printable_name(Path(name).stem or name) for name in archives]
    return short if len(set(short)) == len(short) else [printable_name(name) for name in archives]


def _describe(merged: Archive, report: MergeReport) -> str:
    """Describe what was merged, how far tracks were moved, and the error bound, in one line."""
    from gpszip.cli.units import format_bytes, format_length

    # What the merge saved, and how far it moved the tracks for that.
    moved = report.deviation
    facts = [
        f"{report.archives:,} archives with {report.tracks:,} tracks",
        f"{format_bytes(report.bytes_in)} -> {format_bytes(report.bytes_out)}",
        f"nodes {report.nodes_in:,} -> {report.nodes:,}",
        f"edges {report.edges_in:,} -> {report.edges:,}",
        f"tracks were moved by {format_length(moved.rms)} in the root mean square, "
        f"{format_length(moved.maximum)} at most",
        f"{report.seconds:.1f} s",
    ]

    # The error bound that still holds, which includes those moves; some archives state none.
    remarks = []
    error_bound = merged.error_bound
    if error_bound is not None:
        kind = "maximum" if error_bound.maximum else "RMSE"
        remarks.append(f"error bound: {kind} {format_length(error_bound.metres)}")
    return "; ".join([", ".join(facts), *remarks, *report.notes])


def _facts(archives: tuple[str, ...], merged: Archive, report: MergeReport) -> dict[str, Any]:
    """Return the same for JSON: lengths in metres, times in seconds, sizes in bytes."""
    from gpszip.archive.facts import error_bound_facts

    # Counts before (_in) and after the merge.
    names = (
        "tracks",
        "segments",
        "nodes",
        "edges",
        "nodes_in",
        "edges_in",
        "bytes_in",
        "bytes_out",
    )

    # How far the merge moved each archive's tracks, how far it was allowed to, and the error
    # bound that still holds.
    return {
        **{name: getattr(report, name) for name in names},
        "archives": [
            {"name": name, "moved_rms": deviation.rms, "moved_max": deviation.maximum}
            for name, deviation in zip(archives, report.deviations, strict=True)
        ],
        "allowed": report.limit,
        "allowed_kind": "max" if report.limits_maximum else "rms",
        **error_bound_facts(merged.error_bound),
        "seconds": round(report.seconds, 3),
        "notes": list(report.notes),
    }
