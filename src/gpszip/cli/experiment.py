"""gpszip experiment: run the experiments of the thesis."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    quiet,
    robot_options,
    seed_option,
    skip_bad_logs,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import LENGTH
from gpszip.experiments.listing import ALL, EXPERIMENTS, Experiment, experiments_named

if TYPE_CHECKING:
    from gpszip.experiments.experiment import Setting
    from gpszip.model import Network, ReadResult, Track

__all__ = ["command"]

#: Help of the command; ``\\b`` keeps the lines below it.
_HELP = "\n".join(
    [
        "Run experiment NAME of the thesis, and write its tables and figures to a folder.",
        "",
        "Logs are generated, unless LOGs are given. Tables are Markdown, CSV and JSON, figures PNG",
        "and SVG; each says how it was made.",
        "",
        "\b",
        *(f"{each.name:<12}{each.description}" for each in EXPERIMENTS),
        f"{ALL:<12}all of them",
    ]
)


@click.command(
    "experiment",
    cls=CommandWithFormats,
    help=_HELP,
    short_help="Run the experiments of the thesis.",
)
@click.argument("name", metavar="NAME", type=click.Choice([*(e.name for e in EXPERIMENTS), ALL]))
@click.argument("logs", metavar="[LOG]...", nargs=-1)
@click.option(
    "-o",
    "--output",
    "folder",
    metavar="DIR",
    default="gpszip-experiments",
    show_default=True,
    help="Folder to write to.",
)
@click.option("--quick", is_flag=True, help="Small logs, few settings and effort 1, to try it.")
@seed_option("the generated logs")
@click.option(
    "--rmse",
    type=LENGTH,
    metavar="LENGTH",
    help="RMSE to aim at; by default that of the thesis for generated "
    "logs, and that at the elbow of the cost for yours, in peers that of compress.",
)
@click.option(
    "--network",
    metavar="FILE",
    multiple=True,
    help="Roads about LOG, for figures 5.1 and 8.5: NETWORK_FORMATS.",
    shell_complete=complete_files(),
)
@time_order_options
@skip_bad_logs
@click.option("--columns", metavar="ROLES", help="Which column of LOG is what: t=when,x=east.")
@time_options
@robot_options
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    name: str,
    logs: tuple[str, ...],
    folder: str,
    quick: bool,
    seed: int,
    rmse: float | None,
    network: tuple[str, ...],
    quiet: bool,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Run experiments."""
    from gpszip.cli.output import check_output, make_folder, print_json, print_status
    from gpszip.cli.summary import print_losses
    from gpszip.drawing.style import require_matplotlib
    from gpszip.experiments.experiment import Setting
    from gpszip.io.logs.read import read_logs

    # Refuse what can be refused before any work.
    require_matplotlib()
    target = Path(folder)
    experiments = _without_roads(
        experiments_named(name), logs, network, quiet=quiet or settings.json
    )
    make_folder(target, "-o")
    for experiment in experiments:
        check_output(str(target / f"{experiment.name}.md"), force=force)

    # Read the user's logs, and run.
    read_result = read_logs(logs, **reading) if logs else None
    if read_result is not None and not quiet and not settings.json:
        print_losses(read_result)
    tracks = () if read_result is None else _with_times(read_result)
    roads = _read_roads(network, tracks)
    setting = Setting(tracks, rmse, seed, quick, roads)
    written: list[str] = []
    for experiment in experiments:
        if not quiet and not settings.json:
            print_status(f"{experiment.name}: {experiment.description}")
        text = _command_text(experiment.name, logs, network, setting)
        written += _run(experiment, setting, target, text, force=force)

    # Say what was written.
    if settings.json:
        print_json({"folder": folder, "written": written})
    elif not quiet:
        print_status(f"in {folder}: {', '.join(written)}")
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _without_roads(
    experiments: Sequence[Experiment],
    logs: Sequence[str],
    network: Sequence[str],
    *,
    quiet: bool,
) -> list[Experiment]:
    """Return the experiments that can run: of all, those that lack roads are left out.

    Raises
    ------
    OptionError
        If the only one lacks roads.
    """
    from gpszip.cli.output import print_status
    from gpszip.errors import OptionError

    # Roads of generated logs are known.
    lacking = [each for each in experiments if each.needs_roads and logs and not network]
    if lacking and len(experiments) == 1:
        raise OptionError(
            f"{lacking[0].name} patches gaps along roads, and has none for your log",
            remedy="name a road network with --network",
        )

    # Of all experiments, the others run.
    for each in lacking if not quiet else ():
        print_status(f"{each.name}: left out, as it needs roads; name them with --network")
    return [each for each in experiments if each not in lacking]


def _read_roads(network: Sequence[str], tracks: Sequence[Track]) -> Network | None:
    """Read the roads about the user's tracks, if there are any."""
    if not (network and tracks):
        return None
    from gpszip.pipeline.match import read_network

    return read_network(list(network), near=tracks).network


def _with_times(read_result: ReadResult) -> tuple[Track, ...]:
    """Return the tracks with times, which experiments need."""
    from gpszip.errors import OptionError
    from gpszip.pipeline.validate import check_tracks

    tracks = [track for track in read_result.tracks if track.timed and len(track) > 1]
    if not tracks:
        raise OptionError(
            "no track has two points with times, which experiments need",
            remedy="give a log with times",
        )
    return check_tracks(tracks)


def _run(
    experiment: Experiment, setting: Setting, folder: Path, text: str, *, force: bool
) -> list[str]:
    """Run one experiment, write its files, and return their names."""
    from importlib import import_module

    from gpszip import __version__
    from gpszip.experiments.write import write_outcome

    outcome = import_module(experiment.module).run(setting)
    return write_outcome(
        experiment,
        outcome,
        folder,
        seed=setting.seed,
        command=text,
        version=__version__,
        force=force,
    )


def _command_text(name: str, logs: Sequence[str], network: Sequence[str], setting: Setting) -> str:
    """Return the command that runs one experiment the same way, with all that changes numbers."""
    words = ["gpszip", "experiment", name, *map(shlex.quote, logs)]
    for path in network:
        words += ["--network", shlex.quote(path)]
    words += ["--quick"] if setting.quick else []
    words += ["--seed", str(setting.seed)]
    words += [] if setting.rmse is None else ["--rmse", f"{setting.rmse:g}m"]
    return " ".join(words)
