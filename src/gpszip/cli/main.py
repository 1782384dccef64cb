"""The entry point, and the only place that turns an outcome into an exit code."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
import warnings
from collections.abc import Sequence

import click

from gpszip.cli.options import Settings
from gpszip.cli.outcome import Outcome
from gpszip.cli.output import print_json, print_status
from gpszip.cli.signals import ignore_signals, interrupt_on_signals
from gpszip.cli.streams import flush_stdout, open_standard_streams
from gpszip.errors import BoundError, CorruptArchiveError, GPSZipError, MapError, OptionError
from gpszip.files.os_errors import explain_os_error
from gpszip.files.written import collect_outputs

__all__ = ["cli", "main", "run"]

_HELP = """Learn the map that position logs repeat, and store the logs as walks on it.

\b
gpszip compress walks/*.gpx -o walks.gpsz --rmse 5m
gpszip decompress walks.gpsz -o walks.csv
gpszip map walks.gpsz -o map.geojson
"""

_COMMANDS = (
    "compress",
    "decompress",
    "map",
    "coreset",
    "network",
    "match",
    "patch",
    "merge",
    "info",
    "verify",
    "recover",
    "warm",
    "demo",
    "formats",
)

_DONE, _FAILED, _USAGE, _LEFT_OUT, _CORRUPT, _MAP, _BOUND, _INTERRUPTED = 0, 1, 2, 3, 4, 5, 6, 130

_EXIT_CODES: dict[type[GPSZipError], int] = {
    OptionError: _USAGE,
    CorruptArchiveError: _CORRUPT,
    MapError: _MAP,
    BoundError: _BOUND,
}


class _LazyGroup(click.Group):
    """Commands that are imported when they are named."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in _COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"gpszip.cli.{cmd_name}").command
        return command


def _version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from gpszip import __version__

        click.echo(f"gpszip {__version__}")
        context.exit()


@click.command(
    cls=_LazyGroup,
    help=_HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Exit codes: 0 done, 1 failed, 2 usage, 3 done but inputs or many points were left out, 4 corrupt archive, "
    "5 map missing or wrong, 6 bound not met, 130 interrupted.",
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
    """Run the command line and leave the interpreter with its exit code."""
    open_standard_streams()
    if not sys.warnoptions and "--debug" not in sys.argv:
        warnings.simplefilter("ignore")  # what libraries say to programmers is no news for users
    settings = Settings.from_arguments(sys.argv[1:])
    try:
        code = main(sys.argv[1:])
        broken = flush_stdout()
        if broken is not None and code in (_DONE, _LEFT_OUT):
            code = _report_error(broken, settings)
        ignore_signals()
    except KeyboardInterrupt:
        code = _INTERRUPTED  # while the outcome was told
    sys.exit(code)


def main(arguments: list[str]) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : list of str
        What the user typed after ``gpszip``.

    Returns
    -------
    int
        The exit code.
    """
    settings = Settings.from_arguments(arguments)
    with collect_outputs() as written:
        try:
            with interrupt_on_signals():
                outcome = cli.main(
                    arguments, prog_name="gpszip", standalone_mode=False, obj=settings
                )
        except BaseException as error:
            if settings.debug:
                traceback.print_exc()
            return _report_error(error, settings, written)
    return _LEFT_OUT if outcome is Outcome.LEFT_OUT else _DONE


def _report_error(error: BaseException, settings: Settings, written: Sequence[str] = ()) -> int:
    """Say what is wrong in one line and choose the exit code."""
    code, text = _explain(error)
    if code == _INTERRUPTED:
        text = f"interrupted; {'; '.join(written) or 'nothing was written'}"
    if settings.json and text:
        print_json(
            {"error": {"kind": type(error).__name__, "message": text, "exit_code": code}}, err=True
        )
    elif text:
        print_status(f"gpszip: {text}")
    return code


def _explain(error: BaseException) -> tuple[int, str]:
    """Exit code and message of an error; no message where it has been shown."""
    code, text = (
        _FAILED,
        f"a fault of GPSZip's own: {type(error).__name__}: {error}; please report it with what --debug shows",
    )
    if isinstance(error, BrokenPipeError):
        text = ""  # whoever reads the output has had enough
    elif isinstance(error, SystemExit):
        code, text = (error.code if isinstance(error.code, int) else _FAILED), ""
    elif isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        code, text = _USAGE, ""
    elif isinstance(error, click.ClickException):
        code, text = _USAGE, _explain_usage(error)
    elif _is_interrupt(error):
        code, text = _INTERRUPTED, "interrupted"
    elif isinstance(error, GPSZipError):
        code, text = (
            next((code for kind, code in _EXIT_CODES.items() if isinstance(error, kind)), _FAILED),
            str(error),
        )
    elif isinstance(error, OSError):
        text = _explain_os_error(error)
    elif isinstance(error, MemoryError):
        text = "not enough memory; compress fewer tracks at once"
    notes = getattr(error, "__notes__", ()) if text else ()
    return code, " ".join("; ".join([text, *notes]).split())


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether somebody stopped the run; compiled code tells that by a SystemError, whose cause it is."""
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, click.Abort | KeyboardInterrupt)


def _explain_usage(error: click.ClickException) -> str:
    where = getattr(error, "ctx", None)
    return f"{error.format_message().rstrip('.')}; see {where.command_path if where else 'gpszip'} --help"


def _explain_os_error(error: OSError) -> str:
    if error.filename is None:
        return f"standard output: can't be written: {explain_os_error(error)}"
    hints: list[tuple[type[OSError], str]] = [
        (FileNotFoundError, "no such file; check the path"),
        (IsADirectoryError, "is a folder; name a file"),
        (NotADirectoryError, "a file stands where a folder should be; check the path"),
        (PermissionError, "no permission; check the owner and mode"),
    ]
    reason = next(
        (hint for kind, hint in hints if isinstance(error, kind)), error.strerror or str(error)
    )
    return f"{os.fsdecode(error.filename)}: {reason}"
