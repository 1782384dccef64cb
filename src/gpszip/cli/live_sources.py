"""Options of gpszip listen for robots, vehicles, boats and brokers, and the sources they open."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from datetime import tzinfo
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from gpszip.live import FixSource, Notices

__all__ = ["open_subscriptions", "owntracks_keys", "subscription_options"]

#: Letters of --name at most: agents have 100, some with the number of a system.
_MAX_NAME_LETTERS = 90

#: Variable of the environment with the key of encrypted messages of OwnTracks.
KEY_VARIABLE = "GPSZIP_OWNTRACKS_KEY"


def _check_rate(_context: click.Context, _parameter: click.Parameter, rate: float) -> float:
    """Refuse what is in no range, and limits nothing."""
    if math.isnan(rate):
        raise click.BadParameter("nan is no number of requests; give one such as 1000")
    return rate


_OPTIONS = (
    click.option(
        "--ros",
        metavar="URL",
        help="Subscribe to poses and positions of ROS at rosbridge: ws://HOST[:PORT], wss://.",
    ),
    click.option(
        "--topic",
        "ros_topics",
        metavar="NAME",
        multiple=True,
        help="A topic of --ros; by default one of each robot; repeatable.",
    ),
    click.option(
        "--mavlink",
        metavar="URL",
        multiple=True,
        help="Read MAVLink: udp://:PORT, udpout://HOST:PORT, tcp://HOST:PORT, or a serial device; "
        "?frame=local behind it for metres; repeatable.",
    ),
    click.option(
        "--signalk",
        metavar="URL",
        help="Subscribe to vessels of a Signal K server: ws://HOST:PORT, or http://HOST:PORT, "
        "which says where its stream is; ?vessels=self behind it for its own only.",
    ),
    click.option(
        "--kafka",
        metavar="HOST:PORT/TOPIC",
        help="Read a topic of Kafka, of objects of JSON as standard input has them.",
    ),
    click.option(
        "--owntracks-keys",
        "keys",
        metavar="FILE",
        help="File with the keys of encrypted messages of OwnTracks, one in each line; or set "
        "GPSZIP_OWNTRACKS_KEY to one key.",
    ),
    click.option(
        "--max-rate",
        metavar="NUMBER",
        type=click.FloatRange(min=0, min_open=True),
        default=1_000.0,
        callback=_check_rate,
        show_default="1000",
        help="Requests to --http of one sender in a second; faster ones have to come again.",
    ),
)


def subscription_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def owntracks_keys(choices: Mapping[str, Any]) -> Callable[[Any], Any] | None:
    """Return what opens encrypted messages, with keys of a file or of the environment."""
    key = os.environ.get(KEY_VARIABLE)
    if choices["keys"] is None and not key:
        return None
    from gpszip.live.formats.encrypted import OwnTracksKeys

    if choices["keys"] is not None:
        return OwnTracksKeys.from_file(choices["keys"]).open
    return OwnTracksKeys([key or ""], KEY_VARIABLE).open


def open_subscriptions(
    choices: Mapping[str, Any], name: str, notices: Notices, timezone: tzinfo
) -> list[FixSource]:
    """Open the sources that were asked for."""
    # Messages of an agent whose name can't be one would all be left out.
    if len(name) > _MAX_NAME_LETTERS or not name.isprintable():
        raise click.UsageError(f"--name: give at most {_MAX_NAME_LETTERS} letters and signs")

    # Robots, vehicles and boats.
    sources: list[FixSource] = []
    if choices["ros_topics"] and not choices["ros"]:
        raise click.UsageError("--topic needs --ros, the address of rosbridge")
    if choices["ros"]:
        from gpszip.live.sources.ros import RosSource

        sources.append(RosSource(choices["ros"], choices["ros_topics"], name, notices))
    for address in choices["mavlink"]:
        from gpszip.live.sources.mavlink import open_mavlink

        sources.append(open_mavlink(address, name, notices))
    if choices["signalk"]:
        from gpszip.live.sources.signalk import SignalKSource

        sources.append(SignalKSource(choices["signalk"], name, notices))

    # Brokers.
    if choices["kafka"]:
        from gpszip.live.sources.kafka import KafkaSource

        folder = choices["folder"]
        sources.append(KafkaSource(choices["kafka"], folder, name, notices, timezone))
    return sources
