"""gpszip patch: fill the gaps of a log over roads."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    common_options,
    dry_run_option,
    force,
    ignore_oneway,
    network_option,
    output_option,
    quiet,
    robot_options,
    skip_bad_logs,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION

if TYPE_CHECKING:
    from gpszip.io.logs.csv_patching import PatchableCsv
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model import Patching, ReadResult
    from gpszip.model.read_result import Repair

__all__ = ["command"]

#: Gaps left open that messages name; JSON names them all.
_MAX_NAMED = 20

#: Outputs that get the text of a CSV log row by row; ``-`` is standard output.
_TEXT_SUFFIXES = (".csv", ".tsv", ".txt", "-")


@click.command(
    "patch",
    cls=CommandWithFormats,
    short_help="Fill the gaps of a log over the roads of a network.",
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@network_option
@output_option("patched.csv")
@click.option(
    "--gap",
    type=DURATION,
    metavar="DURATION",
    help="Intervals without points longer than this are gaps. By default estimated.",
)
@ignore_oneway
@time_order_options
@skip_bad_logs
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column is what: t=when,x=east,y=north; or names in order, without a header.",
)
@time_options
@robot_options
@dry_run_option
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    network: tuple[str, ...],
    target: str,
    gap: float | None,
    ignore_oneway: bool,
    sort: bool,
    split: bool,
    skip_bad: bool,
    columns: str | None,
    time_unit: str | None,
    dates: str | None,
    dry_run: bool,
    quiet: bool,
    force: bool,
    **robot: Any,
) -> Outcome:
    """Fill the gaps of every LOG with the likeliest path over roads, at the log's own sampling.

    A CSV log comes back row by row as it was, with rows added, and with the columns source (log or
    patched) and confidence appended. A gap that can't be filled plausibly is left open and named.
    """
    from gpszip.cli.output import check_output

    # Imports that take long follow the check, so that a mistake is reported at once.
    check_output(target, force=force, in_place=True)
    from gpszip.io.logs.csv_patching import read_for_patching
    from gpszip.pipeline.match import patch, read_network

    # Read.
    start = time.perf_counter()
    read_result, text = read_for_patching(
        list(logs),
        heading=True,
        columns=columns,
        time_unit=time_unit,
        dates=dates,
        **robot,
        sort=sort,
        split=split,
        skip_bad=skip_bad,
    )
    roads = read_network(list(network), near=read_result.tracks)

    if dry_run:
        from gpszip.cli.plans import print_patch_plan
        from gpszip.pipeline.plans import plan_patch

        plan = plan_patch(read_result.tracks, roads.network, gap=gap)
        print_patch_plan(target, read_result, roads, plan, as_json=settings.json)
        return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT

    # Fill the gaps, and write; of a CSV log, all rows are written again.
    patching = patch(read_result.tracks, roads.network, gap=gap, ignore_oneway=ignore_oneway)
    # Only text can hold the rows of the log as they were; other formats get tracks.
    patched_text = text if target.lower().endswith(_TEXT_SUFFIXES) else None
    _write(patching, patched_text, target)
    if patched_text is not None:
        # Rows that reading dropped are in the output again, so that they are not lost.
        repairs = tuple(map(_as_kept, read_result.repairs))
        read_result = replace(read_result, repairs=repairs, losses=())

    seconds = time.perf_counter() - start
    if settings.json or not quiet:
        _print_result(target, read_result, roads, patching, seconds, settings)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _write(patching: Patching, text: PatchableCsv | None, target: str) -> None:
    from gpszip.io.logs.write import write_tracks
    from gpszip.io.storage.sink import open_sink

    if text is None:
        write_tracks(patching.to_tracks(), target)
        return
    with open_sink(target) as stream:
        text.write(patching.patches, stream)


def _as_kept(repair: Repair) -> Repair:
    """Return the repair of rows that reading drops, but that are written again."""
    # The text of a repair ends with what was done about it, see Repair.
    if not repair.what.endswith(" dropped"):
        return repair
    what = repair.what.removesuffix("dropped") + "kept, but not used"
    return replace(repair, what=what, drops=False)


def _print_result(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    patching: Patching,
    seconds: float,
    settings: Settings,
) -> None:
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.cli.units import format_duration

    # For programs.
    repairs = [*read_result.repairs, *roads.repairs]
    facts = _facts(patching)
    if settings.json:
        facts["seconds"] = round(seconds, 3)
        print_json_result(target, facts, read_result, repairs)
        return

    # For a person: what was lost, the open gaps, then one line.
    print_losses(read_result)
    open_gaps = facts["open"]
    for gap in open_gaps[:_MAX_NAMED]:
        where = f"track {gap['track']!r} at {gap['from']:.15g}, {format_duration(gap['seconds'])}"
        print_status(f"left open: {where}: {gap['reason']}")
    if len(open_gaps) > _MAX_NAMED:
        more = len(open_gaps) - _MAX_NAMED
        print_status(f"left open: {more:,} gaps more; --json names them all")
    lines = [f"{_describe_patching(patching)}, {seconds:.1f} s", *describe_repairs(repairs)]
    print_status(f"{output_label(target)}: {'; '.join(lines)}")


def _describe_patching(patching: Patching) -> str:
    """Describe how many gaps were filled."""
    from gpszip.cli.units import format_duration

    gap = format_duration(patching.gap)
    if not patching.patches:
        longer = f" longer than {gap}" if math.isfinite(patching.gap) else ""
        return f"no gaps{longer}, no points added"
    gaps = f"{patching.filled:,} of {len(patching.patches):,} gaps over {gap}"
    return f"{patching.added:,} points added in {gaps}"


def _facts(patching: Patching) -> dict[str, Any]:
    """Return the results for JSON: times in seconds."""
    return {
        "points": sum(map(len, patching.tracks)),
        "tracks": len(patching.tracks),
        "gap": patching.gap,
        "gaps": len(patching.patches),
        "filled": patching.filled,
        "added": patching.added,
        "open": _open_gaps(patching),
    }


def _open_gaps(patching: Patching) -> list[dict[str, Any]]:
    """Return the gaps left open, with the time and length of each and the reason."""
    gaps = []
    for patch in patching.open:
        track = patching.tracks[patch.track]
        gaps.append(
            {
                "track": track.id,
                "from": float(track.times[patch.after]),
                "seconds": patch.seconds,
                "reason": patch.reason,
            }
        )
    return gaps
