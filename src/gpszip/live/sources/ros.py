"""Robots with ROS, by rosbridge: poses and positions that its topics carry, in JSON over WebSocket.

Protocol: ROSBRIDGE_PROTOCOL.md of rosbridge_suite. Nothing is published, and nothing acknowledged:
what is sent while the listener is off is gone.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gpszip.live.fix import Fix, Marks, Unusable
from gpszip.live.formats.ros import (
    ROS_TYPES,
    agent_of_ros_topic,
    frame_of,
    is_of_robot,
    parse_ros,
)
from gpszip.live.formats.values import Context, MessageError, clean_name, member, parse_json
from gpszip.live.notices import Notices
from gpszip.live.source import Receiver
from gpszip.live.sources.batches import batches_of
from gpszip.live.sources.connection import split_url
from gpszip.live.sources.lines import store_patiently
from gpszip.live.sources.websocket import keep_connected, require_websockets

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

__all__ = ["RosSource"]

#: Port of rosbridge, where the address has none.
_PORT = 9090

#: Seconds after which topics are asked for again: robots come later.
_ASK_SECONDS = 10.0

#: Topics of a list that are looked at, and that are subscribed to, at most.
_MAX_LISTED = 10_000
_MAX_TOPICS = 1_000

#: Agent of topics without a namespace.
_DEFAULT_NAME = "robot"

#: Identifiers of what is asked for.
_LIST_ID = "gpszip:topics"
_SUBSCRIPTION_ID = "gpszip"

_EXAMPLE = "ws://robot:9090"


class RosSource:
    """Subscribes to topics of rosbridge.

    Parameters
    ----------
    text : str
        ``ws://HOST[:PORT]``, or ``wss://`` with TLS.
    topics : sequence of str
        Topics to subscribe to. Without any, one for each namespace: the first type of
        :data:`~gpszip.live.formats.ros.ROS_TYPES` that is advertised there.
    name : str
        Agent of topics without a namespace, such as ``/odom``.
    notices : Notices
        Is told what happens.

    Raises
    ------
    MissingExtraError
        If websockets is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(self, text: str, topics: Sequence[str], name: str, notices: Notices) -> None:
        require_websockets("--ros")
        url = split_url(text, "--ros", ("ws", "wss"), _EXAMPLE)
        self._server = f"rosbridge at {url.hostname}"
        self._url = text if url.port else url._replace(netloc=f"{url.netloc}:{_PORT}").geturl()
        self._topics = ["/" + topic.strip("/") for topic in topics]
        self._name, self._notices = name or _DEFAULT_NAME, notices
        self._agents: dict[str, str] = {}
        self._frames: dict[str, str] = {}

    async def run(self, receiver: Receiver) -> None:
        """Store positions until the task is cancelled."""

        async def talk(connection: ClientConnection) -> None:
            await self._talk(connection, receiver)

        await keep_connected(self._find_url, self._server, self._notices, talk)

    async def _find_url(self) -> str:
        return self._url

    async def _talk(self, connection: ClientConnection, receiver: Receiver) -> None:
        """Subscribe, and store what comes, until the connection ends."""
        # A new connection has no subscriptions.
        self._agents = {}
        self._frames = {}
        asking = asyncio.create_task(self._ask(connection))
        try:
            async for batch in batches_of(connection.recv):
                received = time.time()
                found: list[Fix | Unusable] = []
                for text in batch:
                    found += await self._take(connection, text, received)
                await store_patiently(receiver, found)
        finally:
            asking.cancel()
            await asyncio.wait([asking])

    async def _ask(self, connection: ClientConnection) -> None:
        """Ask for topics again and again; those that are named are subscribed to at once."""
        while True:
            if self._topics:
                await self._subscribe(connection, agents_of(self._topics, self._name))
            else:
                service = {"op": "call_service", "id": _LIST_ID, "service": "/rosapi/topics"}
                await connection.send(json.dumps(service))
            await asyncio.sleep(_ASK_SECONDS)

    async def _subscribe(self, connection: ClientConnection, agents: Mapping[str, str]) -> None:
        """Subscribe to topics from which nothing has come: they may not have been there before."""
        for topic, agent in agents.items():
            if topic in self._frames:
                continue
            if topic not in self._agents:
                self._notices.note("topics subscribed to", agent, topic)
            self._agents[topic] = agent
            request = {"op": "subscribe", "id": _SUBSCRIPTION_ID, "topic": topic}
            await connection.send(json.dumps(request))

    async def _take(
        self, connection: ClientConnection, text: str | bytes, received: float
    ) -> list[Fix | Unusable]:
        """Return what a message of rosbridge holds."""
        # Older versions write NaN as it is.
        try:
            message = parse_json(text, lambda _name: None)
        except MessageError as error:
            return [Unusable(self._server, str(error))]
        if not isinstance(message, Mapping):
            return [Unusable(self._server, "messages that are no object of JSON left out")]

        # A position, the list of topics, or what rosbridge has to say.
        kind = message.get("op")
        if kind == "publish":
            return [self._parse(message, received)]
        if kind == "service_response" and message.get("id") == _LIST_ID:
            await self._choose(connection, message)
        elif kind == "status" and message.get("level") in ("error", "warning"):
            shown = str(message.get("msg"))
            self._notices.note("rosbridge reports a problem", self._server, shown)
        elif kind not in ("status", "service_response"):
            return [Unusable(self._server, "messages of rosbridge other than publish left out")]
        return []

    def _parse(self, message: Mapping[str, Any], received: float) -> Fix | Unusable:
        """Return the fix of a message of a topic."""
        topic = message.get("topic")
        agent = self._agents.get(topic) if isinstance(topic, str) else None
        if agent is None or not isinstance(topic, str):
            return Unusable(self._server, "messages of topics that were not asked for left out")
        content = message.get("msg")
        fix = parse_ros(content, Context(received, "ros", agent))

        # In another frame, the same place has other coordinates.
        frame = frame_of(content)
        last = self._frames.setdefault(topic, frame)
        if isinstance(fix, Fix) and frame != last:
            self._frames[topic] = frame
            self._notices.note("frames changed, taken as a break", agent, f"{last} to {frame}")
            return fix.marked(Marks.BREAK)
        return fix

    async def _choose(self, connection: ClientConnection, answer: Mapping[str, Any]) -> None:
        """Subscribe to the best topic of each namespace."""
        values = member(answer, "values")
        topics, types = values.get("topics"), values.get("types")
        if not isinstance(topics, list) or not isinstance(types, list):
            event = "topics can't be listed; start rosapi, or name them with --topic"
            self._notices.note(event, self._server)
            return
        chosen = choose_topics(topics[:_MAX_LISTED], types, self._name)
        if not chosen:
            self._notices.note("no topic with positions yet", self._server)
        await self._subscribe(connection, chosen)


def choose_topics(topics: Sequence[Any], types: Sequence[Any], name: str) -> dict[str, str]:
    """Return the best topic of each namespace, and its agent.

    Parameters
    ----------
    topics, types : sequence
        What a robot advertises, which may be anything.
    name : str
        Agent of topics without a namespace.

    Examples
    --------
    >>> types = ["nav_msgs/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"]
    >>> choose_topics(["/odom", "/amcl_pose"], types, "robot")
    {'/amcl_pose': 'robot'}
    """
    best: dict[str, tuple[int, str]] = {}
    for topic, kind in zip(topics, types, strict=False):
        if not isinstance(topic, str) or not isinstance(kind, str) or not is_of_robot(topic):
            continue
        base = kind.rpartition("/")[2]
        if base not in ROS_TYPES or not is_name(topic):
            continue
        found = ROS_TYPES.index(base), topic
        space = agent_of_ros_topic(topic)
        best[space] = min(found, best.get(space, found))
    chosen = [topic for _, topic in best.values()][:_MAX_TOPICS]
    return agents_of(chosen, name)


def agents_of(topics: Sequence[str], name: str) -> dict[str, str]:
    """Return the agent of each topic: its namespace, or the topic where several share it.

    Examples
    --------
    >>> agents_of(["/r1/odom", "/r2/odom", "/r2/fix", "/odom"], "robot")
    {'/r1/odom': 'r1', '/r2/odom': 'r2/odom', '/r2/fix': 'r2/fix', '/odom': 'robot'}
    """
    spaces = [agent_of_ros_topic(topic) or name for topic in topics]
    number = Counter(spaces)
    return {
        topic: space if number[space] == 1 else topic.strip("/")
        for topic, space in zip(topics, spaces, strict=True)
    }


def is_name(topic: str) -> bool:
    """Whether a topic can be the name of an agent."""
    try:
        clean_name(topic)
    except MessageError:
        return False
    return True
