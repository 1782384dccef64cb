"""Positions of a frame in another, from the transforms of a bag.

The bag is read twice: for the tree of frames, and for the transforms on the way between the two
frames, which alone are kept in memory.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.ros.bags import Bag, Topic
from gpszip.io.logs.ros.messages import TRANSFORMS, Transform, transforms_of
from gpszip.io.logs.ros.topics import ATTRIBUTES, NOUN, attributes_of
from gpszip.io.logs.ros.transforms import Link, LinkTransforms, compose, find_chain
from gpszip.io.logs.trajectories.headings import forward_of_quaternions, heading_of_vectors
from gpszip.model.read_result import Repair

__all__ = ["FrameReader", "parse_frames", "transform_topics"]

#: End of the names of topics whose transforms hold for all times.
_STATIC = "tf_static"

#: Poses of a batch.
_BATCH_ROWS = 1 << 17

#: Numbers of a transform in a buffer: time, position, orientation.
_WIDTH = 8

#: Numbers beyond this are damage: their squares are infinite.
_LARGEST = 1e100

#: Nanoseconds in a second.
_SECOND = 1_000_000_000

Floats = NDArray[np.float64]


def parse_frames(text: str) -> tuple[str, str]:
    """Return the two frames of the option ``--frame``.

    Raises
    ------
    OptionError
        If there are not two.

    Examples
    --------
    >>> parse_frames("map:/base_link")
    ('map', 'base_link')
    """
    names = [name.strip().lstrip("/") for name in text.split(":")]
    if len(names) != 2 or not all(names) or names[0] == names[1]:
        raise OptionError(
            f"--frame {text!r}: there have to be two frames", remedy="such as map:base_link"
        )
    return names[0], names[1]


def transform_topics(bag: Bag, request: Request, where: str) -> list[Topic]:
    """Return the topics whose transforms are composed: all, or those that the user names.

    Raises
    ------
    InputError
        If there are none.
    """
    found = [topic for topic in bag.topics if topic.type == TRANSFORMS]
    wanted = {name.lstrip("/") for name in request.topics}
    missing = wanted - {topic.name.lstrip("/") for topic in found}
    if not found or missing:
        reason = f"topic {min(missing)!r} holds no transforms" if missing else "has no transforms"
        listed = ", ".join(topic.name for topic in found)
        remedy = f"topics of transforms: {listed}" if found else "choose a topic: --topic /odom"
        raise InputError(reason, path=where, remedy=remedy)
    return [topic for topic in found if not wanted or topic.name.lstrip("/") in wanted]


class _Moves(NamedTuple):
    """Transforms of a link, as they were read."""

    numbers: array[float]
    static: list[bool]


class FrameReader:
    """Reads the positions of a frame in another.

    Parameters
    ----------
    name : str
        Name of the log.
    topics : sequence of Topic
        Topics of transforms.
    request : Request
        The frames, attributes, and whether headings are kept.
    """

    def __init__(self, name: str, topics: Sequence[Topic], request: Request) -> None:
        assert request.frame is not None
        self.name = name
        self.topics = [topic.name for topic in topics]
        self.request = request
        self.frames = parse_frames(request.frame)
        self.kept = attributes_of(request, name, geographic=False)
        self._counts: Counter[str] = Counter()

    def read(self, bag: Bag) -> Iterator[RawLog]:
        """Yield the poses of an open bag.

        Raises
        ------
        InputError
            If the frames are not connected, or their transforms share no time.
        """
        # The way between the frames, and its transforms.
        chain = self._find_chain(bag)
        moves = self._read_moves(bag, chain)
        transforms = {link: self._sort(link, moves[link]) for link in chain}
        times = self._times(chain, transforms)

        # Compose them, batch by batch.
        for first in range(0, len(times), _BATCH_ROWS):
            batch = times[first : first + _BATCH_ROWS]
            is_last = first + _BATCH_ROWS >= len(times)
            yield self._to_log(
                batch, *compose(chain, transforms, batch), first + 1, is_last=is_last
            )

    def _find_chain(self, bag: Bag) -> list[Link]:
        """Return the way between the two frames."""
        # The tree, and the topics of each transform that is not static.
        parents: dict[str, set[str]] = {}
        topics: dict[tuple[str, str], set[str]] = {}
        for topic, _, move in self._transforms(bag, counted=True):
            parents.setdefault(move.child, set()).add(move.parent)
            if not topic.endswith(_STATIC):
                topics.setdefault((move.parent, move.child), set()).add(topic)
        chain = find_chain(parents, *self.frames, self.name)

        # Robots of a fleet may have frames of one name on topics of their own.
        for link in chain:
            names = sorted(topics.get((link.parent, link.child), ()))
            if len(names) > 1:
                raise InputError(
                    f"transforms of {link.parent} -> {link.child} are on several topics: "
                    f"{', '.join(names)}",
                    path=self.name,
                    remedy=f"choose those of one robot: --topic {names[0]} --topic /tf_static",
                )
        return chain

    def _transforms(self, bag: Bag, *, counted: bool) -> Iterator[tuple[str, int, Transform]]:
        """Yield topic, time of the log and transform."""
        for message in bag.messages(self.topics):
            if message.type != TRANSFORMS:
                continue
            try:
                moves = list(transforms_of(message.decode()))
            # Damaged bytes make decoders raise nearly anything.
            except Exception:
                self._counts["messages that can't be decoded left out"] += counted
                continue
            for move in moves:
                yield message.topic, message.log_time, move

    def _read_moves(self, bag: Bag, chain: Sequence[Link]) -> dict[Link, _Moves]:
        """Return the transforms of each link of a chain."""
        moves = {link: _Moves(array("d"), []) for link in chain}
        by_frames = {(link.parent, link.child): moves[link] for link in chain}
        for topic, log_time, move in self._transforms(bag, counted=False):
            link = by_frames.get((move.parent, move.child))
            if link is None:
                continue
            is_static = topic.endswith(_STATIC)
            stamp = move.stamp
            if not stamp and not is_static:
                self._counts["stamps that are zero replaced by the log's times"] += 1
                stamp = log_time
            link.numbers.extend((stamp / _SECOND, *move.position, *move.orientation))
            link.static.append(is_static)
        return moves

    def _sort(self, link: Link, moves: _Moves) -> LinkTransforms:
        """Return the transforms of a link in the order of time."""
        # Leave out what is no transform.
        table = np.frombuffer(moves.numbers, float).reshape(-1, _WIDTH)
        # NaN compares as false.
        good = (np.abs(table) < _LARGEST).all(axis=1)
        lengths = np.zeros(len(table))
        lengths[good] = np.sqrt((table[good, 4:] ** 2).sum(axis=1))
        good &= lengths > 0
        self._counts["transforms that are not numbers left out"] += int((~good).sum())
        table, lengths, static = table[good], lengths[good], np.array(moves.static)[good]
        if not len(table):
            raise InputError(
                f"no transform of {link.parent} -> {link.child} can be used", path=self.name
            )

        # Of a static transform, the last one holds. Others are moving, even if some are static.
        is_static = bool(static.all())
        if is_static:
            table, lengths = table[-1:], lengths[-1:]
        elif static.any():
            table, lengths = table[~static], lengths[~static]

        # Of several at one time, the first one holds.
        order = np.argsort(table[:, 0], kind="stable")
        table, lengths = table[order], lengths[order]
        is_new = np.append(True, np.diff(table[:, 0]) > 0)
        leader = np.maximum.accumulate(np.where(is_new, np.arange(len(table)), 0))
        differs = (table != table[leader]).any(axis=1)
        self._counts["transforms that differ from one of the same time left out"] += int(
            differs.sum()
        )
        table, lengths = table[is_new], lengths[is_new]
        return LinkTransforms(
            table[:, 0], table[:, 1:4], table[:, 4:] / lengths[:, None], is_static
        )

    def _times(self, chain: Sequence[Link], transforms: dict[Link, LinkTransforms]) -> Floats:
        """Return the stamps at which the chain is known: those of its busiest link."""
        # Something has to move.
        moving = [link for link in chain if not transforms[link].is_static]
        start, end = self.frames
        if not moving:
            raise InputError(
                f"all transforms between {start!r} and {end!r} are static, so nothing moves",
                path=self.name,
                remedy="name a frame of the robot and one of the map",
            )

        # The busiest link; of equals, the one next to the robot.
        busiest = max(reversed(moving), key=lambda link: len(transforms[link].times))
        times = transforms[busiest].times

        # Nothing is extrapolated.
        first = max(transforms[link].times[0] for link in moving)
        last = min(transforms[link].times[-1] for link in moving)
        within = (times >= first) & (times <= last)
        if not within.any():
            names = ", ".join(f"{link.parent} -> {link.child}" for link in moving)
            raise InputError(
                f"the transforms of {names} share no time",
                path=self.name,
                remedy="name frames that are connected while the robot moves",
            )
        self._counts["positions outside the times of other transforms dropped"] += int(
            (~within).sum()
        )
        known: Floats = times[within]
        return known

    def _to_log(
        self, times: Floats, positions: Floats, turns: Floats, row: int, *, is_last: bool
    ) -> RawLog:
        """Return poses as a log."""
        # Attributes and headings come from the orientation.
        columns = dict(zip(ATTRIBUTES, turns.T, strict=True))
        attributes = {name: columns[own].copy() for name, own in self.kept.items()}
        if self.request.heading:
            attributes["heading"] = heading_of_vectors(*forward_of_quaternions(*turns.T).T)

        # What was repaired comes with the last poses.
        return RawLog(
            name=self.name,
            ids=(),
            codes=None,
            times=times,
            coordinates=positions,
            geographic=False,
            attributes=attributes,
            first=row,
            row_noun=NOUN,
            dropped_columns=tuple(name for name in ATTRIBUTES if name not in self.kept.values()),
            repairs=tuple(self._repairs()) if is_last else (),
        )

    def _repairs(self) -> Iterator[Repair]:
        for what, count in self._counts.items():
            if count:
                yield Repair(what, count, self.name, drops=what.endswith("dropped"))
