"""gpszip coreset: logs in, a small file out that prices any piecewise linear function of time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.engine import engine_options, open_executor
from gpszip.cli.options import Settings, common_options, force, output_option, time_options
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import SIZE

if TYPE_CHECKING:
    from gpszip.io.large.store import StoredLog
    from gpszip.run.executor import Executor
    from gpszip.sketches.coreset import Coreset

__all__ = ["command"]

#: Decimals of metres of the points that are written, and rows of the logs that are in memory at once.
_DECIMALS, _ROWS = 6, 1 << 20

#: From this relative error on, a promise would be none.
_MAX_USEFUL_EPS = 10


@click.command("coreset", short_help="Make the (k, eps)-coreset of logs.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@output_option("coreset.parquet")
@click.option("--size", type=click.IntRange(1), help="Largest number of blocks.")
@click.option(
    "--eps",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Relative error of every price; with --k.",
)
@click.option(
    "--k",
    type=click.IntRange(1),
    help="Parts of the functions that are to be priced; with --size, what to say the error of.",
)
@click.option("--max-bytes", type=SIZE, metavar="SIZE", help="Largest file, such as 100kB.")
@click.option(
    "--points",
    is_flag=True,
    help="Write weighted points of the log instead, at most 2 d + 4 for each block.",
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
    help="Which column is what: t=when,x=east,y=north, or names in order.",
)
@time_options
@click.option(
    "--format", metavar="FORMAT", help="Format of the logs; found from the content where left out."
)
@engine_options
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
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
    workers: int | None,
    engine: str | None,
    scheduler: str | None,
    quiet: bool,
    force: bool,
    **choices: Any,
) -> Outcome:
    """Read every LOG, of any size, and write its coreset as Parquet: blocks whose moments price every line exactly.

    Give one of --size, --max-bytes, or --k with --eps. LOG - is standard input.
    """
    from gpszip.cli.output import check_output, print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        losses_as_dict,
        output_label,
        print_left_out,
        print_losses,
        repairs_as_dict,
    )
    from gpszip.errors import OptionError
    from gpszip.io.coresets import write_coreset
    from gpszip.io.large.store import store_logs
    from gpszip.io.storage.source import spooled
    from gpszip.pipeline.coreset import sketch_log

    if (size is not None) + (max_bytes is not None) + (eps is not None) != 1 or (
        eps is not None and k is None
    ):
        raise OptionError(
            "how large is the coreset to be? give --size, or --max-bytes, or --k and --eps together"
        )
    check_output(target, force=force, binary=not points or target.endswith(".parquet"))
    limit = None if max_bytes is None else int(max_bytes)
    with (
        spooled(logs) as sources,
        open_executor(workers, engine, scheduler) as executor,
        store_logs(sources, rows=_ROWS, **choices) as log,
    ):
        made = sketch_log(
            log, k=k if eps else None, eps=eps, size=size, max_bytes=limit, executor=executor
        )
        written = _write(made, log, target, executor) if points else None
        read_result = log.read_result
    if not points:
        write_coreset(made, target, force=True)
    facts = _facts(made, k, eps, written)
    if settings.json:
        print_json(
            {
                "output": target,
                **facts,
                **losses_as_dict(read_result),
                **repairs_as_dict(read_result.repairs, read_result.left_out),
            },
            err=target == "-",
        )
    elif not quiet:
        print_losses(read_result)
        print_left_out(read_result)
        print_status(
            f"{output_label(target)}: {'; '.join([_describe(facts), *describe_repairs(read_result.repairs)])}"
        )
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _write(made: Coreset, log: StoredLog, target: str, executor: Executor) -> int:
    """Write weighted points and return their number."""
    from dataclasses import replace

    import numpy as np

    from gpszip.io.logs.write import write_tracks
    from gpszip.pipeline.coreset import thin_log

    thinned = thin_log(log, made, executor=executor)
    few = [replace(track, attributes={"weight": np.asarray(track.weights)}) for track in thinned]
    write_tracks(few, target, decimals=_DECIMALS)
    return sum(map(len, few))


def _facts(made: Coreset, k: int | None, asked: float | None, points: int | None) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "samples": made.samples,
        "tracks": len(made.tracks),
        "blocks": len(made),
        "points": points,
    }
    facts |= {
        "rmse": made.rmse,
        "largest": float(made.free_costs.max()),
        "k": k,
        "eps_asked": asked,
    }
    facts |= (
        {"eps": None, "least_cost": None}
        if k is None
        else {"eps": made.eps(k), "least_cost": made.least_cost(k)}
    )
    return facts | {"uneven_blocks": int(made.uneven.sum())}


def _describe(facts: dict[str, Any]) -> str:
    from gpszip.cli.units import format_length

    text = f"{facts['samples']:,} samples in {facts['blocks']:,} blocks"
    text += "" if facts["points"] is None else f", {facts['points']:,} weighted points"
    text += (
        f", RMSE of the blocks {format_length(facts['rmse'])}, lines on whole blocks priced exactly"
    )
    return text if facts["k"] is None else f"{text}; {_describe_bound(facts)}"


def _describe_bound(facts: dict[str, Any]) -> str:
    """What holds for every function of k parts, and where it doesn't."""
    text = f"any {facts['k']}-segment costs {facts['least_cost']:.4g} m^2 or more"
    if facts["eps"] >= _MAX_USEFUL_EPS:
        return f"{text}; too few blocks to promise its price beforehand"
    text += f" and is priced within {_format_percent(facts['eps'])}"
    text += (
        "" if facts["eps_asked"] is None else f" ({_format_percent(facts['eps_asked'])} asked for)"
    )
    if facts["uneven_blocks"] and facts["k"] > 1:
        uneven = f"{facts['uneven_blocks']:,} of {facts['blocks']:,}"
        text += f"; where it breaks in a block of uneven times ({uneven}), the bounds of its price tell instead"
    return text


def _format_percent(share: float) -> str:
    """Three digits, rounded up: a promise is not to become larger by being told."""
    if share <= 0:
        return "0 %"
    unit = 10.0 ** (math.floor(math.log10(share)) - 2)
    return f"{100 * math.ceil(share / unit - 1e-9) * unit:.3g} %"
