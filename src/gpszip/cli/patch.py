"""gpszip patch: gaps of a log filled over roads."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, common_options, force, output_option, time_options
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION

if TYPE_CHECKING:
    from gpszip.io.logs.csv_patching import PatchableCsv
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model import Patching, ReadResult
    from gpszip.model.read_result import Repair

__all__ = ["command"]

#: So many gaps that were left open are named; JSON names them all.
_MAX_NAMED = 20


@click.command("patch", short_help="Fill the gaps of a log over the roads of a network.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@click.option(
    "--network",
    metavar="FILE",
    multiple=True,
    required=True,
    help="Roads, prepared ones, or an archive, for its map.",
)
@output_option("patched.csv")
@click.option(
    "--gap",
    type=DURATION,
    metavar="DURATION",
    help="Silences longer than this are gaps. Estimated where left out.",
)
@click.option(
    "--ignore-oneway",
    is_flag=True,
    help="All roads lead both ways, as for those who walk or cycle.",
)
@click.option("--sort", is_flag=True, help="Sort points by time where it goes back.")
@click.option("--split", is_flag=True, help="Begin a new track where time goes back.")
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out logs that can't be read, name them, end with exit code 3.",
)
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column is what: t=when,x=east,y=north, or names in order for a log without a header.",
)
@time_options
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    network: tuple[str, ...],
    target: str,
    **choices: Any,
) -> Outcome:
    """Fill the gaps of every LOG with the likeliest way over a network's roads, at the log's own rhythm.

    A CSV log comes back row by row as it was, with rows added and the columns source (log or patched) and confidence appended. A gap that
    can't be filled plausibly is left open and named.
    """
    from gpszip.cli.output import check_output

    check_output(target, force=choices["force"])
    from gpszip.io.logs.csv_patching import read_for_patching
    from gpszip.pipeline.match import patch, read_network

    start = time.perf_counter()
    names = ("columns", "time_unit", "dates", "sort", "split", "skip_bad")
    read_result, text = read_for_patching(
        list(logs), heading=True, **{name: choices[name] for name in names}
    )
    roads = read_network(list(network), near=read_result.tracks)
    patching = patch(
        read_result.tracks,
        roads.network,
        gap=choices["gap"],
        ignore_oneway=choices["ignore_oneway"],
    )
    again = text if target.lower().endswith((".csv", ".tsv", ".txt", "-")) else None
    _write(patching, again, target)
    if again is not None:
        read_result = replace(
            read_result, repairs=tuple(map(_as_kept, read_result.repairs)), losses=()
        )
    if settings.json or not choices["quiet"]:
        _print_result(target, read_result, roads, patching, time.perf_counter() - start, settings)
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
    """Say what becomes of rows that reading drops where all rows are written again."""
    if not repair.what.endswith(" dropped"):
        return repair
    return replace(
        repair, what=repair.what.removesuffix("dropped") + "kept, but not used", drops=False
    )


def _print_result(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    patching: Patching,
    seconds: float,
    settings: Settings,
) -> None:
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        losses_as_dict,
        output_label,
        print_left_out,
        print_losses,
        repairs_as_dict,
    )
    from gpszip.cli.units import format_duration

    repairs = [*read_result.repairs, *roads.repairs]
    if settings.json:
        facts = _facts(patching) | {"seconds": round(seconds, 3)}
        print_json(
            {
                "output": target,
                **facts,
                **losses_as_dict(read_result),
                **repairs_as_dict(repairs, read_result.left_out),
            },
            err=target == STDOUT,
        )
        return
    print_losses(read_result)
    print_left_out(read_result)
    open_ = _open_gaps(patching)
    for one in open_[:_MAX_NAMED]:
        print_status(
            f"left open: track {one['track']!r} at {one['from']:.15g}, {format_duration(one['seconds'])}: {one['reason']}"
        )
    if len(open_) > _MAX_NAMED:
        print_status(f"left open: {len(open_) - _MAX_NAMED:,} gaps more; --json names them all")
    print_status(
        f"{output_label(target)}: {'; '.join([f'{_describe_patching(patching)}, {seconds:.1f} s', *describe_repairs(repairs)])}"
    )


def _describe_patching(patching: Patching) -> str:
    """What became of the gaps, in words."""
    from gpszip.cli.units import format_duration

    if not patching.patches:
        longer = (
            f" longer than {format_duration(patching.gap)}" if math.isfinite(patching.gap) else ""
        )
        return f"no gaps{longer}, no points added"
    filled = f"{patching.filled:,} of {len(patching.patches):,} gaps over {format_duration(patching.gap)}"
    return f"{patching.added:,} points added in {filled}"


def _facts(patching: Patching) -> dict[str, Any]:
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
    answer = []
    for patch in patching.open:
        track = patching.tracks[patch.track]
        answer.append(
            {
                "track": track.id,
                "from": float(track.times[patch.after]),
                "seconds": patch.seconds,
                "reason": patch.reason,
            }
        )
    return answer
