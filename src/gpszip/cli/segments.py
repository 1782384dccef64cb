"""gpszip segments: the thesis's (k,m)-segment mean of logs, and its Markov model."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
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
from gpszip.cli.selecting import pop_selection, selection_options
from gpszip.cli.units import DURATION, LENGTH, Quantity

if TYPE_CHECKING:
    from gpszip.model import Likelihood, MarkovModel, ReadResult, SegmentMean
    from gpszip.pipeline.segment_mean import Signal

__all__ = ["command"]

#: A number, or the least and the greatest of a range.
_RANGE = re.compile(r"(\d+)(?:\.\.(\d+))?")

#: Suffixes of pictures, those of gpszip.drawing.style, whose import takes longer than --help may.
_PICTURES = (".png", ".svg", ".pdf")

#: Durations in seconds; infinite for "none".
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})


class _Number(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A whole number from 1 on, or a range of them: ``12`` or ``50..500``."""

    name = "number"

    def convert(
        self,
        value: Any,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> int | tuple[int, int]:
        """Return the number, or both ends of the range."""
        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        match = _RANGE.fullmatch(value.strip())
        if match is None:
            self.fail(
                f"{value!r} is neither a number such as 12 nor a range such as 50..500", param, ctx
            )
        least, greatest = int(match[1]), int(match[2] or match[1])
        if not 1 <= least <= greatest:
            self.fail(f"{value!r}: give the least, at least 1, then the greatest", param, ctx)
        return least if match[2] is None else (least, greatest)


@click.command(
    "segments",
    cls=CommandWithFormats,
    short_help="Cut logs into k parts that follow m segments, the thesis's model.",
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, shell_complete=complete_files())
@output_option("segments.geojson")
@click.option(
    "--k",
    type=_Number(),
    metavar="K",
    help="Number of parts, or a range such as 50..500; by default searched.",
)
@click.option(
    "--m",
    type=_Number(),
    metavar="M",
    help="Number of segments that the parts share, or a range; by default searched.",
)
@click.option(
    "--rmse",
    type=LENGTH,
    metavar="LENGTH",
    help="Largest RMSE, such as 5m: takes the least of --k and --m that hold it.",
)
@click.option(
    "--max-error", type=LENGTH, metavar="LENGTH", help="Largest error of any point, alike."
)
@click.option(
    "--given",
    metavar="FILE.json",
    help="Follow the segments of another log, which segments -o FILE.json wrote.",
    shell_complete=complete_files(".json"),
)
@click.option(
    "--memo",
    metavar="FOLDER",
    help="Keep what a search solves in FOLDER; an interrupted one goes on there.",
    shell_complete=complete_files(),
)
@click.option(
    "--coreset",
    type=click.IntRange(1),
    metavar="N",
    help="Learn from a coreset of N blocks, for long logs. LOG may be a coreset itself.",
)
@click.option(
    "--gap",
    type=_GAP,
    metavar="DURATION",
    help="Longer intervals between points are gaps, which no part crosses; none: no gaps. By "
    "default estimated.",
)
@click.option(
    "--weight",
    metavar="COLUMN",
    help="Column of the weights of points, which multiply their squared errors.",
)
@click.option("--clean", is_flag=True, help="Drop outliers, as compress does.")
@time_order_options
@skip_bad_logs
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column is what: t=when,x=east,y=north, or names in order.",
)
@time_options
@selection_options
@robot_options
@click.option(
    "--format",
    metavar="FORMAT",
    help="Format of the logs: LOG_FORMATS; by default found from the content.",
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
    quiet: bool,
    force: bool,
    **choices: Any,
) -> Outcome:
    """Cut every LOG into k parts, each of which follows one of m directed segments.

    Writes parts, segments and transitions (the Markov model) as SEGMENT_FORMATS, or a picture as
    png, svg or pdf, by the suffix of FILE. Without --k, --m and a bound, both are searched at the
    elbow of the cost. LOG - is standard input.
    """
    from gpszip.cli.output import check_output
    from gpszip.cli.progress import progress_bar
    from gpszip.io.logs.read import read_logs
    from gpszip.pipeline.segment_mean import fit_model, follow_model, join_runs

    # Refuse what can be refused before the logs are read.
    learning = {name: choices.pop(name) for name in ("k", "m", "rmse", "max_error", "memo")}
    given, gap, coreset = (choices.pop(name) for name in ("given", "gap", "coreset"))
    engine = [choices.pop(name) for name in ("workers", "engine", "scheduler")]
    _check_choices(target, learning, given, coreset)
    check_output(target, force=force, binary=target.endswith(_PICTURES))
    model = None if given is None else _read_model(given)

    # Read and segment.
    choices["selection"] = pop_selection(choices)
    with progress_bar(quiet=quiet or settings.json) as listener, open_executor(*engine) as executor:
        if _is_coreset(logs):
            _check_options_of_logs(given, coreset)
            signal, read_result = _open_coreset(logs[0]), None
        else:
            read_result = read_logs(logs, **choices)
            tracks = read_result.tracks if model is None else _on_plane_of(model, read_result)
            signal = join_runs(tracks, gap, coreset=coreset)
        if model is None:
            mean = _learn(signal, learning, executor, listener)
        else:
            mean = follow_model(model, signal)
    model, likelihood = fit_model(signal, mean, model)

    # Write.
    facts = _facts(signal, mean, likelihood)
    _write(target, mean, model, signal, facts)
    _print_result(target, facts, read_result, settings, quiet=quiet)
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _is_coreset(logs: tuple[str, ...]) -> bool:
    """Whether the one log is the coreset of some."""
    from gpszip.io.coreset_files import holds_coreset

    return len(logs) == 1 and holds_coreset(logs[0])


def _check_options_of_logs(given: str | None, coreset: int | None) -> None:
    """Refuse options that need the samples of a log."""
    from gpszip.errors import OptionError

    for name, value in (("--given", given), ("--coreset", coreset)):
        if value is not None:
            raise OptionError(f"{name} takes a log, and this is its coreset", remedy="give the log")


def _open_coreset(path: str) -> Signal:
    from gpszip.io.coresets import read_coreset
    from gpszip.pipeline.segment_mean import signal_of_coreset

    return signal_of_coreset(read_coreset(path))


def _check_choices(
    target: str, learning: dict[str, Any], given: str | None, coreset: int | None
) -> None:
    """Refuse a format that there is not, and options of learning where nothing is learned."""
    from gpszip.errors import OptionError
    from gpszip.io.segments import segment_format

    if target.lower().endswith(_PICTURES):
        from gpszip.drawing.style import require_matplotlib

        require_matplotlib()
    else:
        segment_format(target)
    named = [name for name, value in {**learning, "coreset": coreset}.items() if value is not None]
    if given is not None and named:
        option = named[0].replace("_", "-")
        raise OptionError(
            f"--{option} and --given were both given", remedy="a given model has its segments"
        )
    bounded = learning["rmse"] is not None or learning["max_error"] is not None
    if bounded and learning["memo"] is not None:
        raise OptionError(
            "--memo keeps what a search for the elbow solves, and a bound needs none",
            remedy="leave out either",
        )


def _read_model(path: str) -> MarkovModel:
    from gpszip.io.segments import read_model

    return read_model(path)


def _on_plane_of(model: MarkovModel, read_result: ReadResult) -> list[Any]:
    """Return the tracks on the plane of a model, which they must fit."""
    from gpszip.errors import OptionError
    from gpszip.geo.planes import reproject_track
    from gpszip.model.text import axes_text

    first = read_result.tracks[0]
    if first.dimension != model.dimension or (first.plane is None) != (model.plane is None):
        raise OptionError(
            f"the segments have {axes_text(model.dimension, model.plane)}, the log "
            f"{axes_text(first.dimension, first.plane)}",
            remedy="give a log of the same place",
        )
    if model.plane is None:
        return list(read_result.tracks)
    return [reproject_track(track, model.plane) for track in read_result.tracks]


def _learn(signal: Signal, learning: dict[str, Any], executor: Any, listener: Any) -> SegmentMean:
    """Learn the segment mean."""
    from gpszip.pipeline.segment_mean import learn_model
    from gpszip.segmentation.memo import Memo

    folder = learning.pop("memo")
    k, m = learning.pop("k"), learning.pop("m")
    memo = None if folder is None else Memo(Path(folder))
    return learn_model(signal, k, m, **learning, memo=memo, executor=executor, progress=listener)


def _facts(signal: Signal, mean: SegmentMean, likelihood: Likelihood) -> dict[str, Any]:
    """Return the results for JSON: lengths in metres, costs in square metres."""
    # Of a coreset alone, errors are bounds that hold at the samples of the log.
    least_cost, bounds, max_error = None, None, None
    if signal.coreset is not None:
        from gpszip.pipeline.coreset_problem import CoresetProblem

        assert isinstance(signal.problem, CoresetProblem)
        least_cost = signal.coreset.least_cost(mean.k)
        cost = signal.problem.cost(mean)
        bounds = [cost.lower, cost.upper]
    if signal.tracks:
        max_error = signal.problem.max_error(mean)
    return {
        "k": mean.k,
        "m": mean.m,
        "points": signal.samples,
        "tracks": len(signal.tracks or signal.problem.begins),
        "runs": len(mean.heads),
        "gap": signal.gap,
        "cost": mean.cost,
        "cost_bounds": bounds,
        "least_cost": least_cost,
        "rmse": signal.problem.rmse(mean),
        "max_error": max_error,
        "log_likelihood": likelihood.total,
        "log_likelihood_transitions": likelihood.transitions,
        "log_likelihood_samples": likelihood.samples,
    }


def _write(
    target: str, mean: SegmentMean, model: MarkovModel, signal: Signal, facts: dict[str, Any]
) -> None:
    """Write the segments, or draw them."""
    from gpszip.io.segments import write_segments
    from gpszip.pipeline.segment_mean import part_rows

    if not target.lower().endswith(_PICTURES):
        write_segments(target, mean, model, part_rows(signal, mean), facts)
        return
    import numpy as np

    from gpszip.drawing.segment_figure import draw_segment_mean
    from gpszip.drawing.style import Layout, picture_format, save_figure, style
    from gpszip.io.storage.sink import atomic_write

    parts = np.bincount(mean.labels, minlength=mean.m)
    with style():
        figure = draw_segment_mean(model, parts, signal.tracks or [signal.joined], Layout())
    with atomic_write(target) as path:
        save_figure(figure, path, picture_format(target))


def _print_result(
    target: str,
    facts: dict[str, Any],
    read_result: ReadResult | None,
    settings: Settings,
    *,
    quiet: bool,
) -> None:
    """Say what was found, and what reading the logs lost."""
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.model.text import count_text

    # As JSON; a coreset file loses nothing.
    if settings.json and read_result is not None:
        print_json_result(target, facts, read_result, read_result.repairs)
        return
    if settings.json:
        print_json({"output": target, **facts}, err=target == STDOUT)
        return
    if quiet:
        return

    # As text, losses first.
    if read_result is not None:
        print_losses(read_result)
    points = count_text(facts["points"], "point")
    text = (
        f"{points} in k = {facts['k']:,} parts on m = {facts['m']:,} segments; "
        f"{_describe_errors(facts)}; log-likelihood {facts['log_likelihood']:.6g}"
    )
    lines = [text, *describe_repairs(() if read_result is None else read_result.repairs)]
    print_status(f"{output_label(target)}: {'; '.join(lines)}")


def _describe_errors(facts: dict[str, Any]) -> str:
    """Describe errors and cost; of a coreset, within which bounds they are."""
    from gpszip.cli.units import format_length

    # Without the samples, errors are bounds.
    text = f"RMSE {format_length(facts['rmse'])}"
    if facts["max_error"] is None:
        text = f"RMSE at most {format_length(facts['rmse'])} at the points of the log"
    else:
        text += f", maximum {format_length(facts['max_error'])}"
    text += f"; cost {facts['cost']:.4g} m^2"
    if facts["cost_bounds"] is None:
        return text
    lower, upper = facts["cost_bounds"]
    return (
        f"{text} by the coreset, truly from {lower:.4g} to {upper:.4g}; no {facts['k']:,} segments "
        f"cost less than {facts['least_cost']:.4g}"
    )
