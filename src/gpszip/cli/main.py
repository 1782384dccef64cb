"""The entry point of the command line.

It turns the outcome of a command, or its error, into an exit code and a message.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from enum import IntEnum

import click

from gpszip.cli.options import Settings
from gpszip.cli.outcome import Outcome
from gpszip.cli.output import print_json, print_status
from gpszip.cli.signals import ignore_signals, interrupt_on_signals
from gpszip.cli.streams import flush_stdout, open_standard_streams
from gpszip.errors import BoundError, CorruptArchiveError, GPSZipError, MapError, OptionError
from gpszip.files.os_errors import explain_os_error
from gpszip.files.written import collect_outputs
from gpszip.io.pandas_import import hide_pandas

__all__ = ["ERROR_CODES", "ExitCode", "cli", "main", "run"]

#: Help of ``gpszip`` itself.
_HELP = """Learn the map that position logs repeat, and store the logs as walks on it.

\b
gpszip compress walks/*.gpx -o walks.gpsz --rmse 5m
gpszip decompress walks.gpsz -o walks.csv
gpszip map walks.gpsz -o map.geojson
"""

#: Objects made between two collections of garbage, and collections between two of older objects.
_GARBAGE_THRESHOLDS = (50_000, 20, 50)

#: Commands in the order of the help; each is a module of this package.
_COMMANDS = (
    "compress",
    "decompress",
    "cat",
    "select",
    "split",
    "join",
    "map",
    "plot",
    "coreset",
    "segments",
    "network",
    "match",
    "patch",
    "trips",
    "usage",
    "route",
    "rounds",
    "changes",
    "predict",
    "unusual",
    "merge",
    "view",
    "report",
    "listen",
    "replay",
    "info",
    "verify",
    "diff",
    "recover",
    "warm",
    "demo",
    "experiment",
    "formats",
    "completion",
    "help",
)


class ExitCode(IntEnum):
    """Exit codes, which docs/cli.md documents."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    LEFT_OUT = 3
    CORRUPT = 4
    MAP = 5
    BOUND = 6
    INTERRUPTED = 130  # 128 and the number of SIGINT, as shells have it


#: Exit codes of errors; other errors of GPSZip are failures.
ERROR_CODES: dict[type[GPSZipError], ExitCode] = {
    OptionError: ExitCode.USAGE,
    CorruptArchiveError: ExitCode.CORRUPT,
    MapError: ExitCode.MAP,
    BoundError: ExitCode.BOUND,
}

#: What to do about errors of the system.
_OS_ERROR_HINTS: tuple[tuple[type[OSError], str], ...] = (
    (FileNotFoundError, "no such file; check the path"),
    (IsADirectoryError, "is a folder; name a file"),
    (NotADirectoryError, "a file stands where a folder should be; check the path"),
    (PermissionError, "no permission; check the owner and mode"),
)


class _LazyGroup(click.Group):
    """Commands whose modules are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(_COMMANDS)

    def get_command(
        self,
        ctx: click.Context,  # noqa: ARG002
        cmd_name: str,
    ) -> click.Command | None:
        # None makes click say that there is no such command.
        if cmd_name not in _COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"gpszip.cli.{cmd_name}").command
        return command


def _version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    # Shell completion parses in the resilient way: it must not print.
    if wanted and not context.resilient_parsing:
        from gpszip import __version__

        click.echo(f"gpszip {__version__}")
        context.exit()


@click.command(
    cls=_LazyGroup,
    help=_HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Exit codes: 0 done, 1 failed, 2 usage, 3 done but inputs or many points were left "
    "out, 4 corrupt archive, 5 map missing or wrong, 6 bound not met, 130 interrupted.",
)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_version,
    help="Show the version and exit.",
)
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """Learn the map that position logs repeat, and store the logs as walks on it."""


def run() -> None:
    """Run the command line, and end the process with its exit code."""
    # Imports make objects that stay: to look for garbage among them takes .2 s of a small command.
    gc.set_threshold(*_GARBAGE_THRESHOLDS)

    # Warnings of libraries are for programmers.
    open_standard_streams()
    if not sys.warnoptions and "--debug" not in sys.argv:
        warnings.simplefilter("ignore")

    # Arrow imports pandas, where it is installed, for its first scalar, which takes 0.3 s. Only
    # packages that experiments compare need it.
    settings = Settings.from_arguments(sys.argv[1:])
    if settings.command != "experiment":
        hide_pandas()

    # An output that can't be flushed is an error of a command that was done otherwise. An interrupt
    # before the command starts, or while its outcome is reported, is reported here.
    with collect_outputs() as written:
        try:
            code = main(sys.argv[1:])
            flush_error = flush_stdout()
            if flush_error is not None and code in (ExitCode.DONE, ExitCode.LEFT_OUT):
                code = _report_error(flush_error, settings)
            ignore_signals()
        except KeyboardInterrupt as interrupt:
            ignore_signals()
            code = _report_error(interrupt, settings, written)
    sys.exit(code)


def main(arguments: list[str]) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : list of str
        The words after ``gpszip``.

    Returns
    -------
    int
        The exit code.
    """
    settings = Settings.from_arguments(arguments)
    # Click raises its errors instead of printing them and ending the process. It returns what the
    # command returned; after --help that is no Outcome, and all is done.
    with collect_outputs() as written:
        try:
            with interrupt_on_signals():
                outcome = cli.main(
                    arguments, prog_name="gpszip", standalone_mode=False, obj=settings
                )
        # Interrupts and SystemExit are no Exceptions, and get an exit code here like all others.
        except BaseException as error:
            if settings.debug:
                traceback.print_exc()
            return _report_error(error, settings, written)
    return ExitCode.LEFT_OUT if outcome is Outcome.LEFT_OUT else ExitCode.DONE


def _report_error(error: BaseException, settings: Settings, written: Sequence[str] = ()) -> int:
    """Print an error in one line, and return the exit code."""
    code, text = _explain(error, settings.command)
    # What was written before an interrupt is complete: files appear whole or not at all.
    if code == ExitCode.INTERRUPTED:
        text = f"interrupted; {'; '.join(written) or 'nothing was written'}"
    if settings.json and text:
        report = {"kind": type(error).__name__, "message": text, "exit_code": int(code)}
        print_json({"error": report}, err=True)
    elif text:
        print_status(f"gpszip: {text}")
    return code


def _explain(error: BaseException, command: str) -> tuple[int, str]:
    """Return the exit code and the message of an error; no message if it was shown already."""
    silent_code = _find_silent_code(error)
    if silent_code is not None:
        return silent_code, ""
    code, text = _explain_in_words(error, command)

    # Messages of libraries may have several lines; split and join make one of them.
    notes = getattr(error, "__notes__", ())
    return code, " ".join("; ".join([text, *notes]).split())


def _find_silent_code(error: BaseException) -> int | None:
    """Return the exit code of an error that needs no message; None for other errors."""
    if isinstance(error, BrokenPipeError):  # the program that reads the output has ended
        return ExitCode.FAILED
    # A number is an exit code; a text in its place stands for failure, as in Python.
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else ExitCode.FAILED
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return ExitCode.USAGE
    return None


def _explain_in_words(error: BaseException, command: str) -> tuple[int, str]:
    # Errors of the user, of files and of the machine.
    if isinstance(error, click.ClickException):
        return ExitCode.USAGE, _explain_usage(error)
    if _is_interrupt(error):
        return ExitCode.INTERRUPTED, "interrupted"
    if isinstance(error, GPSZipError):
        codes = (code for kind, code in ERROR_CODES.items() if isinstance(error, kind))
        return next(codes, ExitCode.FAILED), str(error)
    if isinstance(error, OSError):
        return ExitCode.FAILED, _explain_os_error(error)
    if isinstance(error, MemoryError):
        less = "give less at once"
        advice = f"{less}, or --memory" if _has_option(command, "--memory") else less
        return ExitCode.FAILED, f"not enough memory; {advice}"

    # Errors of the program.
    return ExitCode.FAILED, (
        f"a fault of GPSZip's own: {type(error).__name__}: {error}; "
        "please report it with what --debug shows"
    )


def _has_option(command: str, option: str) -> bool:
    """Whether a command, which may not exist, has an option."""
    found = _LazyGroup().get_command(click.Context(cli), command)
    return found is not None and any(option in parameter.opts for parameter in found.params)


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether the user stopped the run.

    Compiled code raises a SystemError whose cause is the interrupt.
    """
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, click.Abort | KeyboardInterrupt)


def _explain_usage(error: click.ClickException) -> str:
    # An error of parsing knows its command, whose help is the one to read.
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "gpszip"
    return f"{error.format_message().rstrip('.')}; see {command} --help"


def _explain_os_error(error: OSError) -> str:
    # Errors of files name their file. What is left are writes to an open stream.
    if error.filename is None:
        return f"standard output: can't be written: {explain_os_error(error)}"
    hints = (hint for kind, hint in _OS_ERROR_HINTS if isinstance(error, kind))
    reason = next(hints, error.strerror or str(error))
    return f"{os.fsdecode(error.filename)}: {reason}"
