"""Options that several commands share, and the settings of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.derived_names import derive_output

__all__ = [
    "Settings",
    "archive_argument",
    "check_token",
    "common_options",
    "dry_run_option",
    "force",
    "ignore_oneway",
    "map_option",
    "network_option",
    "no_output_error",
    "output_name",
    "output_option",
    "quiet",
    "robot_options",
    "seed_option",
    "skip_bad_logs",
    "time_options",
    "time_order_options",
]

#: Choices of --time-unit, those of gpszip.io.values.timestamps, whose import takes longer than
#: --help may.
_TIME_UNITS = ("s", "ms", "us", "ns", "days", "excel", "matlab")

#: Choices of --dates, those of gpszip.io.values.dates.
_DATE_ORDERS = ("dmy", "mdy", "ymd")

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Settings:
    """How a run talks to its user.

    Parameters
    ----------
    json : bool
        Write results and errors as JSON instead of text.
    debug : bool
        Show the traceback of an error.
    command : str
        Name of the command; empty if there is none.
    """

    json: bool = False
    debug: bool = False
    command: str = ""

    @classmethod
    def from_arguments(cls, arguments: list[str]) -> Settings:
        """Find flags and command without parsing: messages about parsing obey them, too."""
        # What follows -- are file names, even if they look like flags. Flags ahead of the command
        # take no value, so that the first other word is the command.
        flags = arguments[: arguments.index("--")] if "--" in arguments else arguments
        command = next((word for word in flags if not word.startswith("-")), "")
        return cls(json="--json" in flags, debug="--debug" in flags, command=command)


def common_options(command: F) -> F:
    """Add the options --json and --debug, which are in :class:`Settings`."""
    command = click.option(
        "--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."
    )(command)
    return click.option(
        "--json", is_flag=True, expose_value=False, help="Write results and errors as JSON."
    )(command)


def check_token(
    _context: click.Context, _parameter: click.Parameter, token: str | None
) -> str | None:
    """Refuse a token that no header can hold, and an empty one, which lets everybody in."""
    if token is not None and (not token or token != token.strip() or not token.isprintable()):
        raise click.BadParameter(
            "a token has letters, and neither control signs nor blanks at its ends"
        )
    return token


def force(command: F) -> F:
    """Add the option --force."""
    return click.option("--force", is_flag=True, help="Replace the output if it exists.")(command)


def quiet(command: F) -> F:
    """Add the option --quiet."""
    return click.option("--quiet", is_flag=True, help="Print nothing but errors.")(command)


def skip_bad_logs(command: F) -> F:
    """Add the option --skip-bad of commands that read logs."""
    text = "Leave out logs that can't be read, name them, end with exit code 3."
    return click.option("--skip-bad", is_flag=True, help=text)(command)


def network_option(command: F) -> F:
    """Add the required option --network, which may be given several times."""
    text = "Roads: NETWORK_FORMATS. Of an archive, the map is the network."
    return click.option(
        "--network",
        metavar="FILE",
        multiple=True,
        required=True,
        help=text,
        shell_complete=complete_files(),
    )(command)


def dry_run_option(command: F) -> F:
    """Add the option --dry-run to a command that says what it would do."""
    text = "Say what would be read and done; write nothing."
    return click.option("--dry-run", is_flag=True, help=text)(command)


def seed_option(of: str) -> Callable[[F], F]:
    """Return a decorator that adds the option --seed of what is generated."""
    return click.option(
        "--seed", type=click.IntRange(0), default=1, show_default=True, help=f"Seed of {of}."
    )


def ignore_oneway(command: F) -> F:
    """Add the option --ignore-oneway."""
    text = "Travel all roads both ways, as on foot."
    return click.option("--ignore-oneway", is_flag=True, help=text)(command)


def map_option(command: F) -> F:
    """Add the option --map, for archives whose map is another archive."""
    text = "Map of ARCHIVE, if it has none of its own; by default searched in its folder."
    return click.option(
        "--map",
        "map_name",
        metavar="CITY.gpsz",
        help=text,
        shell_complete=complete_files(".gpsz"),
    )(command)


def time_options(command: F) -> F:
    """Add the options --time-unit and --dates, which say how times in a log are read."""
    orders = (
        "Order of day, month and year in dates such as 03/04/2024; "
        "by default found from all dates of the column."
    )
    units = (
        "Unit of times that are numbers; by default found from their size. "
        "excel: days since 1899-12-30."
    )
    command = click.option("--dates", type=click.Choice(_DATE_ORDERS), help=orders)(command)
    return click.option("--time-unit", type=click.Choice(_TIME_UNITS), help=units)(command)


def time_order_options(command: F) -> F:
    """Add the options --sort and --split, for logs whose time goes back."""
    sort = "Sort points by time where it goes back."
    split = "Start a new track where time goes back."
    command = click.option("--split", is_flag=True, help=split)(command)
    return click.option("--sort", is_flag=True, help=sort)(command)


def robot_options(command: F) -> F:
    """Add the options of robots' logs: --topic, --frame, --times and --rate."""
    topic = "Topic of a ROS log; each is a track. Needless if only one has poses."
    frame = "Positions of a frame in another, from transforms of a ROS log, such as map:base_link."
    times = "File with a time in each line, for KITTI's poses."
    rate = "Poses a second, for KITTI's poses."
    command = click.option("--rate", type=float, metavar="HZ", help=rate)(command)
    command = click.option(
        "--times", "times_file", metavar="FILE", help=times, shell_complete=complete_files()
    )(command)
    command = click.option("--frame", metavar="MAP:ROBOT", help=frame)(command)
    return click.option("--topic", "topics", metavar="NAME", multiple=True, help=topic)(command)


def output_option(example: str, *, default: str = "") -> Callable[[F], F]:
    """Add the option -o.

    Parameters
    ----------
    example : str
        A file name, for the help and for the message of an error.
    default : str, optional
        Which name the command derives from its input, for the help. Without it, -o is required.
    """

    def decorate(command: F) -> F:
        text = f"File to write, such as {example}; - is standard output."
        if default:
            text += f" By default {default}."
        # A callback, rather than required=True, names an example in its message.
        return click.option(
            "-o",
            "--output",
            "target",
            metavar="FILE",
            help=text,
            shell_complete=complete_files(),
            callback=_required(example, derived=bool(default)),
        )(command)

    return decorate


def _required(
    example: str, *, derived: bool
) -> Callable[[click.Context, click.Parameter, str | None], str | None]:
    def check(context: click.Context, _: click.Parameter, value: str | None) -> str | None:
        if not value and not derived:
            raise no_output_error(example, context)
        return value or None

    return check


def output_name(target: str | None, inputs: Sequence[str], ending: str, example: str) -> str:
    """Name of the output: the one that was given, or one derived from the input.

    Raises
    ------
    click.UsageError
        If none was given, and the inputs leave none but a guess.
    """
    name = target or derive_output(inputs, ending)
    if name is None:
        raise no_output_error(example)
    return name


def no_output_error(example: str, context: click.Context | None = None) -> click.UsageError:
    """Error of a command that doesn't know where to write."""
    return click.UsageError(f"no output was named; add -o {example}", context)


archive_argument = click.argument(
    "archive", metavar="ARCHIVE", shell_complete=complete_files(".gpsz")
)
