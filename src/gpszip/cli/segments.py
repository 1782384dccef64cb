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
    from numpy.typing import NDArray

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
    given, gap = choices.pop("given"), choices.pop("gap")
    engine = [choices.pop(name) for name in ("workers", "engine", "scheduler")]
    _check_choices(target, learning, given)
    check_output(target, force=force, binary=target.endswith(_PICTURES))
    model = None if given is None else _read_model(given)

    # Read and segment.
    choices["selection"] = pop_selection(choices)
    with progress_bar(quiet=quiet or settings.json) as listener, open_executor(*engine) as executor:
        read_result = read_logs(logs, **choices)
        tracks = read_result.tracks if model is None else _on_plane_of(model, read_result)
        signal = join_runs(tracks, gap)
        if model is None:
            mean = _learn(signal, learning, executor, listener)
        else:
            mean = follow_model(model, signal)
    model, likelihood = fit_model(signal, mean, model)

    # Write.
    facts = _facts(signal, mean, likelihood)
    _write(target, mean, model, signal, facts)
    _print_result(target, facts, read_result, settings, quiet=quiet)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _check_choices(target: str, learning: dict[str, Any], given: str | None) -> None:
    """Refuse a format that there is not, and options of learning where nothing is learned."""
    from gpszip.errors import OptionError
    from gpszip.io.segments import segment_format

    if target.lower().endswith(_PICTURES):
        from gpszip.drawing.style import require_matplotlib

        require_matplotlib()
    else:
        segment_format(target)
    named = [name for name, value in learning.items() if value is not None]
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
    from gpszip.segmentation.evaluate import distances, rmse

    return {
        "k": mean.k,
        "m": mean.m,
        "points": len(signal.joined),
        "tracks": len(signal.tracks),
        "runs": len(mean.heads),
        "gap": signal.gap,
        "cost": mean.cost,
        "rmse": rmse(mean, signal.joined),
        "max_error": float(distances(mean, signal.joined).max()),
        "log_likelihood": likelihood.total,
        "log_likelihood_transitions": likelihood.transitions,
        "log_likelihood_samples": likelihood.samples,
    }


def _part_costs(mean: SegmentMean, signal: Signal) -> NDArray[Any]:
    """Fitting cost of each part in square metres."""
    import numpy as np

    from gpszip.segmentation.evaluate import distances

    weights = 1.0 if signal.joined.weights is None else signal.joined.weights
    costs = weights * np.square(distances(mean, signal.joined))
    return np.add.reduceat(costs, mean.boundaries[:-1])


def _write(
    target: str, mean: SegmentMean, model: MarkovModel, signal: Signal, facts: dict[str, Any]
) -> None:
    """Write the segments, or draw them."""
    from gpszip.io.segments import write_segments

    if not target.lower().endswith(_PICTURES):
        write_segments(target, mean, model, signal.tracks, facts, _part_costs(mean, signal))
        return
    import numpy as np

    from gpszip.drawing.segment_figure import draw_segment_mean
    from gpszip.drawing.style import Layout, picture_format, save_figure, style
    from gpszip.io.storage.sink import atomic_write

    parts = np.bincount(mean.labels, minlength=mean.m)
    with style():
        figure = draw_segment_mean(model, parts, signal.tracks, Layout())
    with atomic_write(target) as path:
        save_figure(figure, path, picture_format(target))


def _print_result(
    target: str,
    facts: dict[str, Any],
    read_result: ReadResult,
    settings: Settings,
    *,
    quiet: bool,
) -> None:
    """Say what was found, and what reading the logs lost."""
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.cli.units import format_length
    from gpszip.model.text import count_text

    if settings.json:
        print_json_result(target, facts, read_result, read_result.repairs)
        return
    if quiet:
        return
    print_losses(read_result)
    points = count_text(facts["points"], "point")
    text = (
        f"{points} in k = {facts['k']:,} parts on m = {facts['m']:,} segments; RMSE "
        f"{format_length(facts['rmse'])}, maximum {format_length(facts['max_error'])}; "
        f"cost {facts['cost']:.4g} m^2; log-likelihood {facts['log_likelihood']:.6g}"
    )
    lines = [text, *describe_repairs(read_result.repairs)]
    print_status(f"{output_label(target)}: {'; '.join(lines)}")
