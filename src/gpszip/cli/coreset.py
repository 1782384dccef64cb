"""gpszip coreset: write the coreset of logs, which gives the cost of any k-segment."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.engine import engine_options, open_executor
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    output_option,
    quiet,
    robot_options,
    skip_bad_logs,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import SIZE

if TYPE_CHECKING:
    from gpszip.io.large.store import StoredLog
    from gpszip.run.executor import Executor
    from gpszip.sketches.coreset import Coreset

__all__ = ["command"]

#: Decimals of metres of the points that are written.
_DECIMALS = 6

#: Rows of the logs in memory at once: about 100 MB.
_ROWS_IN_MEMORY = 1 << 20

#: Relative error from which a bound says nothing.
_MAX_USEFUL_EPS = 10


@click.command("coreset", cls=CommandWithFormats, short_help="Make the (k, eps)-coreset of logs.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@output_option("coreset.parquet")
@click.option("--size", type=click.IntRange(1), help="Largest number of blocks.")
@click.option(
    "--eps",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Relative error of every cost; with --k.",
)
@click.option(
    "--k",
    type=click.IntRange(1),
    help="Segments of the functions whose costs are asked for; with --size, for the summary.",
)
@click.option("--max-bytes", type=SIZE, metavar="SIZE", help="Largest file, such as 100kB.")
@click.option(
    "--points",
    is_flag=True,
    help="Write weighted points of the log instead, at most 2 d + 4 for each block.",
)
@time_order_options
@skip_bad_logs
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column is what: t=when,x=east,y=north, or names in order.",
)
@time_options
@robot_options
@click.option(
    "--format", metavar="FORMAT", help="Format of the logs; by default found from the content."
)
@engine_options
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    target: str,
    size: int | None,
    eps: float | None,
    k: int | None,
    max_bytes: float | None,
    points: bool,
    sort: bool,
    split: bool,
    skip_bad: bool,
    columns: str | None,
    time_unit: str | None,
    dates: str | None,
    format: str | None,
    workers: int | None,
    engine: str | None,
    scheduler: str | None,
    quiet: bool,
    force: bool,
    **robot: Any,
) -> Outcome:
    """Read every LOG, of any size, and write its coreset as Parquet.

    Its blocks have moments, which give the cost of any line exactly. Give one of --size,
    --max-bytes, or --k with --eps. LOG - is standard input.
    """
    from gpszip.cli.output import check_output, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.io.coresets import write_coreset
    from gpszip.io.large.store import store_logs
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.logs.mixed_files import may_be_log
    from gpszip.io.storage.source import spooled
    from gpszip.pipeline.coreset import sketch_log

    # Refuse what can be refused before the logs are read.
    _check_size_options(size, max_bytes, eps, k)
    # A coreset is Parquet in any case; points have the format of the output's suffix.
    check_output(target, force=force, binary=not points or target.endswith(".parquet"))

    # Read and sketch.
    point_count = None
    with (
        spooled(logs, unzip=is_bundle, wanted=may_be_log) as sources,
        open_executor(workers, engine, scheduler) as executor,
        store_logs(
            sources,
            rows=_ROWS_IN_MEMORY,
            format=format,
            columns=columns,
            time_unit=time_unit,
            dates=dates,
            **robot,
            sort=sort,
            split=split,
            skip_bad=skip_bad,
        ) as log,
    ):
        coreset = sketch_log(
            log,
            # With --size, k is for the summary only.
            k=k if eps else None,
            eps=eps,
            size=size,
            max_bytes=None if max_bytes is None else int(max_bytes),
            executor=executor,
        )
        if points:
            point_count = _write_points(coreset, log, target, executor)
        # The log's temporary file is removed with the block; this stays.
        read_result = log.read_result

    # Write.
    if not points:
        write_coreset(coreset, target, force=True)
    facts = _facts(coreset, k, eps, point_count)
    if settings.json:
        print_json_result(target, facts, read_result, read_result.repairs)
    elif not quiet:
        print_losses(read_result)
        lines = [_describe(facts), *describe_repairs(read_result.repairs)]
        print_status(f"{output_label(target)}: {'; '.join(lines)}")
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _check_size_options(
    size: int | None, max_bytes: float | None, eps: float | None, k: int | None
) -> None:
    """Require one way to say how large the coreset is."""
    from gpszip.errors import OptionError

    # k alone says nothing about the size, so it doesn't count here.
    given = (size is not None) + (max_bytes is not None) + (eps is not None)
    if given != 1 or (eps is not None and k is None):
        raise OptionError(
            "how large is the coreset to be? give --size, or --max-bytes, or --k and --eps together"
        )


def _write_points(coreset: Coreset, log: StoredLog, target: str, executor: Executor) -> int:
    """Write weighted points of a log, and return their number."""
    from dataclasses import replace

    import numpy as np

    from gpszip.io.logs.write import write_tracks
    from gpszip.pipeline.coreset import thin_log

    thinned = thin_log(log, coreset, executor=executor)
    tracks = [replace(track, attributes={"weight": np.asarray(track.weights)}) for track in thinned]
    write_tracks(tracks, target, decimals=_DECIMALS)
    return sum(map(len, tracks))


def _facts(
    coreset: Coreset, k: int | None, asked_eps: float | None, points: int | None
) -> dict[str, Any]:
    """Return the results for JSON: lengths in metres, costs in square metres."""
    # Bounds are those of functions with k segments.
    eps = None if k is None else coreset.eps(k)
    least_cost = None if k is None else coreset.least_cost(k)

    # RMSE and largest cost are those of the best line of each block.
    return {
        "samples": coreset.samples,
        "tracks": len(coreset.tracks),
        "blocks": len(coreset),
        "points": points,
        "rmse": coreset.rmse,
        "largest": float(coreset.free_costs.max()),
        "k": k,
        "eps_asked": asked_eps,
        "eps": eps,
        "least_cost": least_cost,
        "uneven_blocks": int(coreset.uneven.sum()),
    }


def _describe(facts: dict[str, Any]) -> str:
    """Describe the results in one line."""
    from gpszip.cli.units import format_length

    text = f"{facts['samples']:,} samples in {facts['blocks']:,} blocks"
    if facts["points"] is not None:
        text += f", {facts['points']:,} weighted points"
    text += f", RMSE of the blocks {format_length(facts['rmse'])}"
    text += ", cost of lines over full blocks exact"
    return text if facts["k"] is None else f"{text}; {_describe_bound(facts)}"


def _describe_bound(facts: dict[str, Any]) -> str:
    """Describe what holds for every function of k segments, and for which it doesn't."""
    text = f"any {facts['k']}-segment costs {facts['least_cost']:.4g} m^2 or more"
    if facts["eps"] >= _MAX_USEFUL_EPS:
        return f"{text}; too few blocks for a bound on the error of its cost"
    text += f", known within {_format_percent(facts['eps'])}"
    if facts["eps_asked"] is not None:
        text += f" ({_format_percent(facts['eps_asked'])} asked for)"

    # Within a block of uneven times, a break is covered by bounds of its own.
    if facts["uneven_blocks"] and facts["k"] > 1:
        blocks = f"{facts['uneven_blocks']:,} of {facts['blocks']:,}"
        text += f"; for a break in a block of uneven times ({blocks}), see the bounds of its cost"
    return text


def _format_percent(share: float) -> str:
    """Format a share with three digits, rounded up: as a bound, it must not become smaller."""
    if share <= 0:
        return "0 %"
    # Round up to the third digit; the small number keeps 0.009 as it is, though 0.009 / 1e-5 is
    # 900.0000000000001.
    unit = 10.0 ** (math.floor(math.log10(share)) - 2)
    return f"{100 * math.ceil(share / unit - 1e-9) * unit:.3g} %"
