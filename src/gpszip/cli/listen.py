"""gpszip listen: take positions as they come, and keep them durably."""

from __future__ import annotations

import asyncio
import functools
import os
from collections.abc import Sequence
from datetime import UTC, tzinfo
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.listen_checks import check_choices
from gpszip.cli.live_page import open_page, page_option
from gpszip.cli.live_sources import open_subscriptions, owntracks_keys, subscription_options
from gpszip.cli.options import Settings, check_token, common_options, quiet
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION, LENGTH

if TYPE_CHECKING:
    from gpszip.live import FixSource, Journal, Notices, Recorder
    from gpszip.live.follow import Follower
    from gpszip.live.listen import Rolling
    from gpszip.live.outbox import Outbox
    from gpszip.live.page.server import PageServer
    from gpszip.live.rolling.roll import RollReport

__all__ = ["command"]

#: Agent of receivers and streams that name none.
_DEFAULT_NAME = "log"

#: Variable of the environment with the token.
_TOKEN_VARIABLE = "GPSZIP_TOKEN"

#: Variable of the environment with the key that signs events.
_KEY_VARIABLE = "GPSZIP_EVENTS_KEY"


@click.command(
    "listen",
    cls=CommandWithFormats,
    short_help="Take positions as they come, and keep them durably.",
)
@click.argument("map", metavar="[MAP.gpsz]", required=False, shell_complete=complete_files())
@click.option(
    "--journal",
    "folder",
    metavar="DIR",
    required=True,
    help="Folder of the journal; it is made if it is missing.",
)
@click.option(
    "--http",
    metavar="HOST:PORT",
    help="Serve OwnTracks, Overland, Traccar Client, OsmAnd and GPSLogger; 8085 means "
    "127.0.0.1:8085.",
)
@click.option(
    "--mqtt",
    metavar="URL",
    help="Subscribe to OwnTracks at a broker: mqtt://[USER:PASSWORD@]HOST[:PORT][/BASE], mqtts://.",
)
@click.option("--gpsd", metavar="HOST:PORT", help="Read the reports of gpsd; port 2947 by default.")
@click.option(
    "--nmea",
    metavar="URL",
    multiple=True,
    help="Read NMEA: tcp://HOST:PORT, udp://:PORT, or a file, pipe or serial device; repeatable.",
)
@subscription_options
@click.option("--stdin", is_flag=True, help="Read standard input; the default without a source.")
@click.option(
    "--token",
    metavar="TEXT",
    envvar=_TOKEN_VARIABLE,
    show_envvar=True,
    callback=check_token,
    help="What senders and visitors of the page have to know: a bearer token, or the password of "
    "basic authentication.",
)
@click.option(
    "--name", metavar="TEXT", help="Name of the agent where a receiver or stream names none."
)
@click.option("--columns", metavar="ROLES", help="Which column of CSV is what: t=when,x=east.")
@click.option(
    "--timezone",
    metavar="ZONE",
    default="UTC",
    show_default=True,
    help="Zone of times that name none, such as Europe/Berlin.",
)
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="EVENTS",
    multiple=True,
    help="Send events as lines of JSON: a file, http:// or https:// for a webhook, mqtt://, or - "
    "for standard output; repeatable.",
)
@click.option(
    "--sign",
    "key",
    metavar="KEY",
    envvar=_KEY_VARIABLE,
    show_envvar=True,
    callback=check_token,
    help="Sign what is sent to webhooks with this key.",
)
@page_option
@click.option(
    "--silent-after",
    type=DURATION,
    metavar="DURATION",
    default="1h",
    show_default=True,
    help="An agent is silent after so long without a fix.",
)
@click.option(
    "--delay",
    type=DURATION,
    metavar="DURATION",
    default="10s",
    show_default=True,
    help="Events wait so long for fixes that come late; later ones revise events.",
)
@click.option(
    "--archive",
    metavar="FILE",
    help="Append the journal to this archive at the end, and with --roll; made if it is missing.",
)
@click.option(
    "--roll",
    "every",
    type=DURATION,
    metavar="DURATION",
    help="Append the journal to the archive each time so long has passed, such as 1h.",
)
@click.option(
    "--roll-now",
    is_flag=True,
    help="Append the journal to the archive, and end; no source is opened.",
)
@click.option("--rmse", type=LENGTH, metavar="LENGTH", help="RMSE of a new archive.")
@click.option(
    "--max-error",
    type=LENGTH,
    metavar="LENGTH",
    help="Largest error of any fix in a new archive; by default four times the RMSE.",
)
@click.option(
    "--effort",
    type=click.IntRange(1, 9),
    default=5,
    show_default=True,
    help="From 1, fast, to 9, small archives.",
)
@quiet
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    folder: str,
    quiet: bool,
    **choices: Any,
) -> Outcome:
    """Take positions of phones, receivers and streams, and keep them in a journal on disk.

    Senders are told that a position was taken once it is on disk: nothing that was acknowledged is
    lost, whenever the machine stops. Repeats are left out. What can't be used is counted and told,
    and not sent again by apps. With -o, the stays and trips of each agent, and what is wrong with
    its source, become events; with the archive of a map, also where it is on it, where it goes, and
    what is unusual. A browser shows all that with --page. Ctrl-C ends the command.
    """
    from gpszip.cli.output import print_status
    from gpszip.live import Journal, Notices, Recorder

    # Refuse what can be refused before anything is opened.
    is_quiet = quiet or settings.json
    check_choices(choices, folder)
    if settings.json and "-" in choices["outputs"]:
        raise click.UsageError("--json and -o - both write to standard output; name a file")
    notices = Notices(_no_line if is_quiet else print_status)
    timezone = _timezone(choices["timezone"])
    _check_token_variable(choices)
    archive = _check_archive(choices)
    if choices["roll_now"]:
        _print_result(folder, notices, _roll(folder, choices), settings, quiet=quiet)
        return Outcome.DONE
    journal = Journal(folder)
    try:
        # Known fixes first, then sources: whoever connects is answered at once.
        recorder = Recorder(journal, notices)
        tell = _no_line if is_quiet else print_status
        sources = _open_sources(choices | {"folder": folder}, timezone, notices, recorder, tell)
        page = _open_page(choices, notices, tell)
        rolling = _rolling(folder, choices)
        asyncio.run(_listen(sources, journal, recorder, notices, rolling, choices, page))
    finally:
        journal.close()

    # What came since the archive was written last.
    report = None if archive is None else _roll(folder, choices)
    _print_result(folder, notices, report, settings, quiet=quiet)
    return Outcome.DONE


def _no_line(_text: str) -> None:
    """Take a line that nobody wants to see."""


async def _listen(
    sources: Sequence[FixSource],
    journal: Journal,
    recorder: Recorder,
    notices: Notices,
    rolling: Rolling | None,
    choices: dict[str, Any],
    page: PageServer | None,
) -> None:
    from gpszip.live.listen import listen

    events = _open_events(journal, notices, choices, page)
    await listen(sources, journal, recorder, notices, rolling, events, page)


def _open_page(choices: dict[str, Any], notices: Notices, tell: Any) -> PageServer | None:
    """The server of the live page; None where nobody wants it."""
    if not choices["page"]:
        return None
    host, port = _address(choices["page"], "--page", 8086)
    page = open_page(host, port, notices, choices["map"], choices["token"])
    tell(f"live page at http://{page.address}/")
    return page


def _open_events(
    journal: Journal, notices: Notices, choices: dict[str, Any], page: PageServer | None
) -> tuple[Follower, Outbox] | None:
    """What finds events and sends them; None where nobody wants any."""
    if not choices["outputs"] and page is None:
        return None
    from gpszip.live.follow import Follower
    from gpszip.live.monitor.monitor import Monitor
    from gpszip.live.outbox import Outbox
    from gpszip.live.sinks.open import open_sink

    # What is known of the map first, as it is what may be wrong.
    monitor = Monitor(choices["map"], delay=choices["delay"], silent_after=choices["silent_after"])
    sinks = {text: open_sink(text, choices["key"]) for text in choices["outputs"]}
    if page is not None:
        sinks["--page"] = page.board
    outbox = Outbox(journal.folder, sinks, notices)
    return Follower(journal, monitor, outbox, notices), outbox


def _check_token_variable(choices: dict[str, Any]) -> None:
    """Refuse a server that everybody may use since a variable is empty: click takes it for none."""
    is_server = choices["http"] or choices["page"]
    if is_server and choices["token"] is None and os.environ.get(_TOKEN_VARIABLE) == "":
        raise click.UsageError(f"{_TOKEN_VARIABLE} is empty; set it to the token, or unset it")


def _check_archive(choices: dict[str, Any]) -> str | None:
    """Refuse an archive to which nothing can be appended."""
    from gpszip.cli.output import check_output
    from gpszip.live.rolling.archives import open_archives

    archive: str | None = choices["archive"]
    if archive is None:
        return None
    check_output(archive, force=True)
    is_bounded = choices["rmse"] is not None or choices["max_error"] is not None
    if not open_archives(archive) and not is_bounded:
        raise click.UsageError(f"{archive}: a new archive needs a bound; add one, as --rmse 5m")
    return archive


def _rolling(folder: str, choices: dict[str, Any]) -> Rolling | None:
    """Append to the archive from time to time, by this command in another process."""
    from gpszip.live.listen import Rolling

    if choices["every"] is None:
        return None
    words = ["-m", "gpszip", "listen", "--journal", folder, "--archive", choices["archive"]]
    words += ["--roll-now", "--quiet", "--effort", str(choices["effort"])]
    for name in ("rmse", "max_error"):
        if choices[name] is not None:
            words += [f"--{name.replace('_', '-')}", repr(choices[name])]
    return Rolling(choices["every"], words)


def _roll(folder: str, choices: dict[str, Any]) -> RollReport:
    from gpszip.live.rolling.roll import roll
    from gpszip.model import Options

    options = Options(
        rmse=choices["rmse"], max_error=choices["max_error"], effort=choices["effort"]
    )
    return roll(folder, choices["archive"], options)


def _open_sources(
    choices: dict[str, Any],
    timezone: tzinfo,
    notices: Notices,
    recorder: Recorder,
    tell: Any,
) -> list[FixSource]:
    """Open the sources that were asked for; standard input if there is none."""
    # A server for apps.
    sources: list[FixSource] = []
    name = choices["name"] or ""
    unseal = owntracks_keys(choices)
    if choices["http"]:
        from gpszip.live.sources.http import HttpSource

        host, port = _address(choices["http"], "--http", 8085)
        health = functools.partial(_health, recorder)
        server = HttpSource(
            host,
            port,
            notices,
            token=choices["token"],
            timezone=timezone,
            health=health,
            max_rate=choices["max_rate"],
            unseal=unseal,
        )
        tell(f"listening at http://{server.address}")
        sources.append(server)

    # Brokers and receivers.
    if choices["mqtt"]:
        from gpszip.live.sources.mqtt import MqttSource

        sources.append(MqttSource(choices["mqtt"], choices["folder"], notices, unseal))
    if choices["gpsd"]:
        from gpszip.live.sources.gpsd import GpsdSource

        sources.append(GpsdSource(*_address(choices["gpsd"], "--gpsd", 2947), name, notices))
    for address in choices["nmea"]:
        from gpszip.live.sources.nmea import open_nmea

        sources.append(open_nmea(address, name, notices))
    sources += open_subscriptions(choices, name, notices, timezone)

    # Standard input.
    if choices["stdin"] or not sources:
        from gpszip.io.tables.roles import parse_columns
        from gpszip.live.sources.stdin import StreamSource

        columns = parse_columns(choices["columns"])
        if isinstance(columns, tuple):
            raise click.UsageError("--columns: name columns of the header, as t=when,x=east")
        sources.append(
            StreamSource(
                0, "standard input", name or _DEFAULT_NAME, columns=columns, timezone=timezone
            )
        )
    return sources


def _health(recorder: Recorder) -> dict[str, Any]:
    """Facts for monitors."""
    return {
        "status": "ok" if recorder.last_error is None else recorder.last_error,
        "last_received": recorder.last_received,
    }


def _address(text: str, option: str, default_port: int) -> tuple[str, int]:
    """Split HOST:PORT; a port alone is one of this machine.

    Examples
    --------
    >>> _address("8085", "--http", 1), _address("[::1]:9", "--http", 1)
    (('127.0.0.1', 8085), ('::1', 9))
    """
    # A bare number is a port, a bare name a host.
    host, colon, port = text.rpartition(":")
    if not colon:
        host, port = ("127.0.0.1", text) if text.isdecimal() else (text, str(default_port))
    host = host.strip("[]") or "127.0.0.1"
    if not port.isdecimal() or int(port) > 65_535:
        raise click.UsageError(f"{option} {text}: give HOST:PORT, such as 127.0.0.1:{default_port}")
    return host, int(port)


def _timezone(name: str) -> tzinfo:
    from zoneinfo import ZoneInfo

    if name == "UTC":
        return UTC
    try:
        return ZoneInfo(name)
    except (ValueError, OSError, KeyError):
        raise click.UsageError(
            f"--timezone {name}: no such zone; give one such as Europe/Berlin"
        ) from None


def _print_result(
    folder: str,
    notices: Notices,
    report: RollReport | None,
    settings: Settings,
    *,
    quiet: bool,
) -> None:
    """Say what was stored, left out and archived."""
    from dataclasses import asdict

    from gpszip.cli.output import print_json, print_status

    # For programs.
    counts = dict(notices.counts)
    stored = counts.pop("stored", 0)
    if settings.json:
        archived = None if report is None else asdict(report)
        print_json({"journal": folder, "stored": stored, "counts": counts, "archived": archived})
        return

    # For a person.
    if quiet:
        return
    others = [f"{event}: {number:,}" for event, number in counts.items()]
    print_status("; ".join([f"{folder}: {_fixes(stored)} stored", *others]))
    if report is not None:
        print_status(_describe(report))


def _describe(report: RollReport) -> str:
    """Say what was archived."""
    where = ", ".join(report.archives) or "no archive was written"
    facts = [f"{where}: {_fixes(report.fixes - report.known)} appended"]
    facts += [f"{report.known:,} held already"] if report.known else []
    facts += [f"{report.late:,} in further tracks, late or after a break"] if report.late else []
    facts += [f"{report.damaged:,} damaged records passed over"] if report.damaged else []
    deleted = "1 segment" if report.segments == 1 else f"{report.segments:,} segments"
    facts.append(f"{deleted} of the journal deleted")
    waiting = f"{report.waiting:,} not read for events yet, and kept"
    return "; ".join([*facts, waiting] if report.waiting else facts)


def _fixes(count: int) -> str:
    return "1 fix" if count == 1 else f"{count:,} fixes"
