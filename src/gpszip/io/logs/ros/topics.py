"""Positions of topics, in batches: which topics are read, and the poses of their messages."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request
from gpszip.io.logs.ros.bags import Bag, Message, Topic
from gpszip.io.logs.ros.messages import (
    GEOGRAPHIC_TYPES,
    PATH,
    POSE_TYPES,
    TRANSFORMS,
    Pose,
    poses_of,
)
from gpszip.io.logs.trajectories.headings import forward_of_quaternions, heading_of_vectors
from gpszip.model.read_result import Repair

__all__ = ["ATTRIBUTES", "TopicReader", "attributes_of", "choose_topics", "describe_topics"]

#: Poses of a batch.
_BATCH_ROWS = 1 << 17

#: Topics and frames that messages list.
_MAX_LISTED = 20

#: Numbers of a pose in a buffer: time, position, orientation.
_WIDTH = 8

#: Attributes of poses in metres, and of positions on the globe.
ATTRIBUTES = ("qx", "qy", "qz", "qw")
_ALTITUDE = "alt"

#: Word for a row in messages.
NOUN = "pose"

#: Nanoseconds in a second.
_SECOND = 1_000_000_000

Floats = NDArray[np.float64]


# The choice of topics


def choose_topics(bag: Bag, request: Request, where: str) -> list[Topic]:
    """Return the topics that are read: those asked for, or the only one with poses.

    Parameters
    ----------
    bag : Bag
        The open bag.
    request : Request
        Topics that the user names; a slash at the start may be missing.
    where : str
        Name of the log for messages.

    Raises
    ------
    InputError
        If a topic doesn't exist or holds no poses, none or several are candidates, or some hold
        degrees and some metres.
    """
    # Those that the user names, or the only one.
    with_poses = [topic for topic in bag.topics if topic.type in POSE_TYPES]
    if request.topics:
        chosen = [_find_topic(bag, name, where) for name in dict.fromkeys(request.topics)]
    else:
        chosen = [topic for topic in with_poses if topic.messages]
        if len(chosen) != 1:
            raise _choice_error(bag, chosen, where)

    # Degrees and metres share no plane.
    geographic = {topic.type in GEOGRAPHIC_TYPES for topic in chosen}
    if len(geographic) > 1:
        degrees = next(topic for topic in chosen if topic.type in GEOGRAPHIC_TYPES)
        metres = next(topic for topic in chosen if topic.type not in GEOGRAPHIC_TYPES)
        raise InputError(
            f"{degrees.name} holds latitude and longitude, but {metres.name} metres",
            path=where,
            remedy="read them apart",
        )
    return chosen


def describe_topics(topics: Sequence[Topic]) -> str:
    """Return topics with their types and counts, as messages list them.

    Examples
    --------
    >>> describe_topics([Topic("/odom", "nav_msgs/msg/Odometry", 1200)])
    '/odom (nav_msgs/Odometry, 1,200 messages)'
    """
    shown = [
        f"{topic.name} ({topic.type.replace('/msg/', '/')}, {topic.messages:,} messages)"
        for topic in topics[:_MAX_LISTED]
    ]
    more = len(topics) - _MAX_LISTED
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _find_topic(bag: Bag, name: str, where: str) -> Topic:
    """Return the topic of a name that holds poses."""
    # Find it.
    named = [topic for topic in bag.topics if topic.name.lstrip("/") == name.lstrip("/")]
    with_poses = [topic for topic in named if topic.type in POSE_TYPES]
    if len(with_poses) == 1 and with_poses[0].messages:
        return with_poses[0]

    # Say why it can't be read, and which ones can.
    others = [topic for topic in bag.topics if topic.type in POSE_TYPES and topic.messages]
    remedy = f"topics with poses: {describe_topics(others)}" if others else "no topic holds poses"
    if not named:
        reason = f"has no topic {name!r}"
    elif len(with_poses) > 1:
        reason = f"topic {name!r} holds messages of several types"
    elif with_poses:
        reason = f"topic {name!r} has no messages"
    elif named[0].type == TRANSFORMS:
        reason = f"topic {name!r} holds transforms"
        remedy = "name two frames: --frame map:base_link"
    else:
        reason = f"topic {name!r} holds {named[0].type.replace('/msg/', '/')}, which is no pose"
    raise InputError(reason, path=where, remedy=remedy)


def _choice_error(bag: Bag, found: Sequence[Topic], where: str) -> InputError:
    """Return the error if it isn't clear which topic is meant."""
    # Several topics, which are listed.
    has_transforms = any(topic.type == TRANSFORMS and topic.messages for topic in bag.topics)
    frames = "; or two frames of its transforms: --frame map:base_link" if has_transforms else ""
    if found:
        return InputError(
            f"{len(found)} topics hold poses: {describe_topics(found)}",
            path=where,
            remedy=f"choose one: --topic {found[0].name}; each --topic is a track{frames}",
        )

    # None, but transforms; or neither.
    if has_transforms:
        return InputError(
            "no topic holds poses, but there are transforms",
            path=where,
            remedy="name two frames: --frame map:base_link",
        )
    listed = describe_topics(bag.topics) or "none"
    known = ", ".join(kind.replace("/msg/", "/") for kind in POSE_TYPES)
    return NoPositionsError(
        f"no topic holds poses; its topics: {listed}", path=where, remedy=f"poses are {known}"
    )


def attributes_of(request: Request, where: str, *, geographic: bool) -> dict[str, str]:
    """Return the attributes to keep, each with the name that the user gave it.

    Raises
    ------
    InputError
        If poses have no such attribute.
    """
    known = (_ALTITUDE,) if geographic else ATTRIBUTES
    kept: dict[str, str] = {}
    for name in request.keep:
        own = _ALTITUDE if geographic and name in HEIGHT_NAMES else name
        if own not in known:
            raise InputError(
                f"no column {name!r}", path=where, remedy=f"poses have {', '.join(known)}"
            )
        kept[name] = own
    return kept


# Poses


@dataclass
class _Batch:
    """Poses of some messages."""

    numbers: array[float] = field(default_factory=lambda: array("d"))
    codes: array[int] = field(default_factory=lambda: array("i"))

    def add(self, time: float, pose: Pose, code: int) -> None:
        self.numbers.extend((time, *pose.position, *pose.orientation))
        self.codes.append(code)

    def __len__(self) -> int:
        return len(self.codes)


class TopicReader:
    """Reads the poses of topics batch by batch.

    Each topic is a track. Where messages of one topic tell of several child frames, or of several
    receivers, each of these is a track; a repair says so.

    Parameters
    ----------
    name : str
        Name of the log.
    topics : sequence of Topic
        The topics, from :func:`choose_topics`.
    request : Request
        Attributes, and whether headings are kept.
    """

    def __init__(self, name: str, topics: Sequence[Topic], request: Request) -> None:
        self.name = name
        self.topics = topics
        self.request = request
        self.geographic = topics[0].type in GEOGRAPHIC_TYPES
        self.kept = attributes_of(request, name, geographic=self.geographic)

        # Agents are numbered in the order of their first poses.
        self._agents: dict[tuple[str, str], int] = {}
        self._frames: dict[str, str] = {}
        self._names: list[str] = []
        self._is_unnamed = False
        self._counts: dict[str, int] = {}
        self._first: dict[str, str] = {}

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return 2 if self.geographic else 3

    def read(self, bag: Bag) -> Iterator[RawLog]:
        """Yield the poses of an open bag.

        Raises
        ------
        InputError
            If messages of one topic have positions in several frames.
        """
        batch, row = _Batch(), 1
        for time, pose, code in self._poses(bag):
            batch.add(time, pose, code)
            if len(batch) == _BATCH_ROWS:
                yield self._to_log(batch, row)
                row, batch = row + len(batch), _Batch()

        # What was dropped and repaired comes with the last poses.
        yield replace(self._to_log(batch, row), repairs=tuple(self._repairs()))

    def _poses(self, bag: Bag) -> Iterator[tuple[float, Pose, int]]:
        """Yield time, pose and number of the agent."""
        kinds = {topic.name: topic.type for topic in self.topics}
        paths: dict[str, Message] = {}
        for number, message in enumerate(bag.messages(list(kinds))):
            # A topic may have messages of other types, too.
            if kinds[message.topic] != message.type:
                continue
            # Each path repeats the poses of those before it, so the last one is read.
            if message.type == PATH:
                if message.topic in paths:
                    self._count("paths that a later one replaces not read", message.topic)
                paths[message.topic] = message
                continue
            yield from self._poses_of(message, number)
        for message in paths.values():
            yield from self._poses_of(message, 0)

    def _poses_of(self, message: Message, number: int) -> Iterator[tuple[float, Pose, int]]:
        """Yield the poses of a message; one that can't be decoded is counted."""
        try:
            poses = list(poses_of(message.type, message.decode()))
        # Damaged bytes make decoders raise nearly anything.
        except Exception as error:
            reason = (str(error) or type(error).__name__).splitlines()[0][:80]
            what = "messages that can't be decoded dropped"
            self._count(what, f"{message.topic}: message {number + 1} ({reason})")
            return

        # Poses without a stamp have the time at which they were recorded.
        for pose in poses:
            stamp = pose.stamp
            if not stamp:
                if message.type == PATH and len(poses) > 1:
                    raise InputError(
                        f"the poses of a path on {message.topic} have no stamps",
                        path=self.name,
                        remedy="name a topic of odometry or poses",
                    )
                self._count("stamps that are zero replaced by the log's times", message.topic)
                stamp = message.log_time
            if not pose.has_fix:
                self._count("positions without a fix dropped", message.topic)
                continue
            # Of whole numbers, Python rounds the quotient correctly.
            yield stamp / _SECOND, pose, self._agent_of(message.topic, pose)

    def _agent_of(self, topic: str, pose: Pose) -> int:
        """Return the number of whoever the pose is of."""
        # Receivers are told apart by their frames, which have no meaning for positions in degrees.
        child = pose.frame if self.geographic else pose.child
        if not self.geographic and self._frames.setdefault(topic, pose.frame) != pose.frame:
            raise InputError(
                f"positions on {topic} are in two frames, {self._frames[topic]!r} and "
                f"{pose.frame!r}, which are no common map",
                path=self.name,
                remedy="choose another --topic, or compose transforms: --frame map:base_link",
            )
        return self._agents.setdefault((topic, child), len(self._agents))

    # Logs

    def _to_log(self, batch: _Batch, row: int) -> RawLog:
        """Return poses as a log."""
        # Buffers as arrays; an empty one has no memory to share.
        numbers = np.frombuffer(batch.numbers, float) if len(batch) else np.zeros(0)
        table = numbers.reshape(-1, _WIDTH)
        codes = np.frombuffer(batch.codes, np.intc) if len(batch) else np.zeros(0, np.intc)

        # The only agent needs no name: its track is named after the file.
        if row == 1:
            self._is_unnamed = len(self._agents) <= 1 and len(self.topics) == 1
        if self._is_unnamed and len(self._agents) > 1:
            raise self._late_agent_error()
        self._name_agents()

        # Copies, as the buffers of attributes would stay in memory with their neighbours.
        return RawLog(
            name=self.name,
            ids=() if self._is_unnamed else tuple(self._names),
            codes=None if self._is_unnamed else codes,
            times=table[:, 0].copy(),
            coordinates=table[:, 1 : 1 + self.dimension].copy(),
            geographic=self.geographic,
            attributes=self._attributes(table),
            first=row,
            row_noun=NOUN,
            dropped_columns=self._dropped_columns(),
        )

    def _name_agents(self) -> None:
        """Name the tracks of new agents. A name stays, as later batches refer to it."""
        # The agent of a topic with no other one so far is named by the topic.
        counts = Counter(topic for topic, _ in self._agents)
        for topic, child in list(self._agents)[len(self._names) :]:
            if len(self.topics) == 1:
                self._names.append(child or topic)
            else:
                self._names.append(topic if counts[topic] == 1 else f"{topic} {child}".rstrip())

    def _late_agent_error(self) -> InputError:
        (topic, first), (_, second), *_ = self._agents
        return InputError(
            f"poses of a second frame {second!r} begin on {topic} after more than "
            f"{_BATCH_ROWS:,} poses of {first!r}",
            path=self.name,
            remedy="split the bag before them, or compose transforms: --frame map:base_link",
        )

    def _attributes(self, table: Floats) -> dict[str, Any]:
        columns = {name: table[:, 4 + i] for i, name in enumerate(ATTRIBUTES)}
        columns[_ALTITUDE] = table[:, 3]
        attributes = {name: columns[own].copy() for name, own in self.kept.items()}
        if self.request.heading and not self.geographic:
            forward = forward_of_quaternions(*table[:, 4:].T)
            attributes["heading"] = heading_of_vectors(*forward.T)
        return attributes

    def _dropped_columns(self) -> tuple[str, ...]:
        known = (_ALTITUDE,) if self.geographic else ATTRIBUTES
        return tuple(name for name in known if name not in self.kept.values())

    # Repairs

    def _count(self, what: str, where: str) -> None:
        self._counts[what] = self._counts.get(what, 0) + 1
        self._first.setdefault(what, where)

    def _repairs(self) -> Iterator[Repair]:
        # Which topic was read, if the user left that open.
        if not self.request.topics:
            (only,) = self.topics
            what = f"{only.type.replace('/msg/', '/')} read, the only poses of the log"
            yield Repair(what, only.messages, f"{self.name}: {only.name}", drops=False)

        for what, count in self._counts.items():
            yield Repair(
                what, count, f"{self.name}: {self._first[what]}", drops=what.endswith("dropped")
            )

        # Tracks of one topic.
        of_topic: dict[str, list[str]] = {}
        for topic, child in self._agents:
            of_topic.setdefault(topic, []).append(child)
        for topic, children in of_topic.items():
            if len(children) > 1:
                shown = ", ".join(map(repr, children[:_MAX_LISTED]))
                yield Repair(
                    f"frames of one topic read as tracks of their own: {shown}",
                    len(children),
                    f"{self.name}: {topic}",
                    drops=False,
                )

        # Topics in different frames.
        if len(set(self._frames.values())) > 1:
            shown = ", ".join(f"{topic} in {frame!r}" for topic, frame in self._frames.items())
            what = f"topics in different frames read as if they had one map: {shown}"
            yield Repair(what, len(self._frames), self.name, drops=False)
