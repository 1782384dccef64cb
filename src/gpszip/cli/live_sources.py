"""Options of gpszip listen for robots, vehicles, boats and brokers, and the sources they open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from gpszip.live import FixSource, Notices

__all__ = ["open_subscriptions", "subscription_options"]

_OPTIONS = (
    click.option(
        "--ros",
        metavar="URL",
        help="Subscribe to poses and positions of ROS at rosbridge: ws://HOST[:PORT], wss://.",
    ),
    click.option(
        "--topic",
        "topics",
        metavar="NAME",
        multiple=True,
        help="A topic of --ros; by default one of each robot; repeatable.",
    ),
)


def subscription_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def open_subscriptions(choices: Mapping[str, Any], name: str, notices: Notices) -> list[FixSource]:
    """Open the sources that were asked for."""
    # Robots.
    sources: list[FixSource] = []
    if choices["topics"] and not choices["ros"]:
        raise click.UsageError("--topic needs --ros, the address of rosbridge")
    if choices["ros"]:
        from gpszip.live.sources.ros import RosSource

        sources.append(RosSource(choices["ros"], choices["topics"], name, notices))
    return sources
