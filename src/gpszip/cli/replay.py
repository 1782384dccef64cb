"""gpszip replay: send a log as if it came live."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, urlsplit

import click
from click.core import ParameterSource

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    check_token,
    common_options,
    quiet,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, selection_options

if TYPE_CHECKING:
    from gpszip.live.replay.messages import Sample
    from gpszip.live.replay.play import Played, Target

__all__ = ["command"]

#: Kinds of messages, those of gpszip.live.replay.messages, whose import --help must not wait for.
_APPS = ("owntracks", "overland", "traccar", "osmand", "gpslogger", "nmea")

#: Kinds that are no apps and no receivers.
_OTHERS = ("ros", "mavlink", "signalk", "kafka")

#: Kinds of servers that wait for a client, and have one connection.
_SERVERS = ("ros", "signalk")

#: Schemes of --to for apps, for OwnTracks, and for NMEA.
_HTTP_SCHEMES = ("http", "https")
_MQTT_SCHEMES = ("mqtt", "mqtts")
_NMEA_SCHEMES = ("tcp", "udp")


@click.command("replay", cls=CommandWithFormats, short_help="Send a log as if it came live.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@click.option(
    "--as",
    "kind",
    type=click.Choice((*_APPS, *_OTHERS)),
    required=True,
    help="The app, receiver or server whose messages are sent.",
)
@click.option(
    "--to",
    "target",
    metavar="URL",
    required=True,
    help="http://HOST:PORT/PATH; for OwnTracks mqtt://HOST/BASE, too; for NMEA udp://HOST:PORT, "
    "tcp://HOST:PORT to wait for a client there, or - for standard output; for ROS and Signal K "
    "ws://HOST:PORT to wait for a client; for MAVLink udp://HOST:PORT; for Kafka HOST:PORT/TOPIC.",
)
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    default=1.0,
    show_default=True,
    help="Seconds of the log in a second; inf sends all at once.",
)
@click.option(
    "--connections",
    type=click.IntRange(1, 256),
    default=8,
    show_default=True,
    help="Connections at once, as of so many phones; each track has one.",
)
@click.option(
    "--token",
    metavar="TEXT",
    envvar="GPSZIP_TOKEN",
    show_envvar=True,
    callback=check_token,
    help="Token of the server, sent as a bearer token.",
)
@time_order_options
@click.option("--columns", metavar="ROLES", help="Which column of LOG is what: t=when,x=east.")
@time_options
@selection_options
@quiet
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    kind: str,
    target: str,
    speed: float,
    connections: int,
    token: str | None,
    quiet: bool,
    **reading: Any,
) -> Outcome:
    """Send the positions of LOG as an app or receiver would, when they are due.

    Times are those of the log. Each track is a sender of its own name. What is not acknowledged is
    sent again, as apps do. Formats of LOG: LOG_FORMATS.
    """
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import print_losses
    from gpszip.errors import OptionError, OutputError
    from gpszip.io.logs.read import read_logs
    from gpszip.live.replay.play import play, samples_of
    from gpszip.live.sources.connection import without_password

    # Refuse what can be refused before the log is read.
    if math.isnan(speed):
        raise click.UsageError("--speed nan: give a number of seconds, or inf")
    source = click.get_current_context().get_parameter_source("token")
    if source is ParameterSource.COMMANDLINE and not target.startswith(("http://", "https://")):
        raise click.UsageError("--token is for http:// and https:// only; leave it out")
    open_target = _target(target, kind, token)
    selection = pop_selection(reading)
    read_result = read_logs(logs, selection=selection, **reading)
    if not quiet and not settings.json:
        print_losses(read_result)
    if kind == "nmea" and len(read_result.tracks) > 1:
        raise OptionError(
            f"NMEA has no names, and there are {len(read_result.tracks):,} tracks",
            remedy="choose one with --track",
        )

    # Send.
    samples = samples_of(read_result.tracks)
    names = [track.id for track in read_result.tracks]
    connections = 1 if kind in _SERVERS else connections
    shown = without_password(target)
    tell = (lambda _line: None) if quiet or settings.json else print_status
    try:
        played = play(
            samples,
            lambda: open_target(names),
            speed,
            connections,
            lambda text: tell(f"{shown}: {text}"),
        )
    except OutputError as error:
        raise error.located_at(shown) from error
    _print_result(shown, samples, played, settings, quiet=quiet)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _target(target: str, kind: str, token: str | None) -> Callable[[Sequence[str]], Target]:
    """Return what opens a connection to the target for some tracks.

    A target that the messages don't fit is refused.
    """
    if kind not in _OTHERS:
        opener = _app_target(target, kind, token)
        return lambda _tracks: opener()

    # Brokers have addresses of their own.
    from gpszip.live.replay.brokers import KafkaTarget, MavlinkTarget
    from gpszip.live.replay.servers import RosTarget, SignalKTarget
    from gpszip.live.sources.kafka import split_address

    if kind == "kafka":
        brokers, topic = split_address(target, "--to")
        return lambda _tracks: KafkaTarget(brokers, topic)
    scheme = "udp" if kind == "mavlink" else "ws"
    url = _split(target)
    if url.scheme != scheme or not url.hostname or url.port is None:
        raise click.UsageError(f"--to {target}: give {scheme}://HOST:PORT for {kind}")

    # Vehicles and servers.
    host, port = url.hostname, url.port
    if kind == "mavlink":
        return lambda tracks: MavlinkTarget(host, port, tracks)
    if kind == "ros":
        return lambda tracks: RosTarget(host, port, tracks)
    return lambda _tracks: SignalKTarget(host, port)


def _app_target(target: str, kind: str, token: str | None) -> Callable[[], Target]:
    """Return what opens a connection to the target of an app or a receiver."""
    from gpszip.live.replay.targets import (
        DatagramTarget,
        HttpTarget,
        MqttTarget,
        StreamTarget,
        accept_client,
    )

    # Apps speak HTTP, and OwnTracks MQTT, too.
    url = _split(target)
    if kind == "owntracks" and url.scheme in _MQTT_SCHEMES and url.hostname:
        return lambda: MqttTarget(url)
    if kind != "nmea":
        if url.scheme not in _HTTP_SCHEMES or not url.hostname:
            raise click.UsageError(f"--to {target}: give http://HOST:PORT for {kind}")
        return lambda: HttpTarget(url, kind, token)

    # Receivers write to sockets and pipes.
    if target == "-":
        return lambda: StreamTarget(sys.stdout.buffer)
    if url.scheme not in _NMEA_SCHEMES or not url.hostname or url.port is None:
        raise click.UsageError(f"--to {target}: give udp://HOST:PORT, tcp://HOST:PORT or -")
    host, port = url.hostname, url.port
    if url.scheme == "udp":
        return lambda: DatagramTarget(host, port)
    return lambda: StreamTarget(accept_client(host, port))


def _split(target: str) -> SplitResult:
    """Split a URL; one whose host or port can't be any has no scheme."""
    try:
        url = urlsplit(target)
        # These raise, too.
        _ = url.port, (url.hostname or "").encode("idna")
    except ValueError:
        return urlsplit("")
    return url


def _print_result(
    target: str, samples: Sequence[Sample], played: Played, settings: Settings, *, quiet: bool
) -> None:
    """Say what was sent."""
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.units import format_count, format_duration

    # For programs.
    tracks = len({sample.track for sample in samples})
    if settings.json:
        facts = {
            "to": target,
            "tracks": tracks,
            "points": played.samples,
            "messages": played.messages,
            "repeated": played.repeated,
            "lag_s": played.lag,
        }
        print_json(facts, err=target == "-")
        return

    # For a person.
    if quiet:
        return
    text = (
        f"{target}: {format_count(played.samples, 'point')} of "
        f"{format_count(tracks, 'track')} sent in {format_count(played.messages, 'message')}"
    )
    text += f"; {played.repeated:,} of them again" if played.repeated else ""
    text += f"; up to {format_duration(played.lag)} late" if played.lag > 1 else ""
    print_status(text)
