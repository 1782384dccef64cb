"""Events that were told of an agent, and what has to be told when more is known."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gpszip.live.events import Event, event_id
from gpszip.live.fix import Fix, distance

__all__ = ["SAME_TIME", "Finding", "KnownEvents", "make_event", "make_withdrawal"]

#: Seconds by which the time of an event may change without a revision.
_TIME_TOLERANCE = 1.0

#: Metres by which its position may change without one, for places of 100 m.
_POSITION_TOLERANCE = 50.0

#: Seconds within which an event is another version of one of its kind, rather than a new one.
SAME_TIME = 1800.0

#: Withdrawn events that are kept in mind for each agent: what comes back revises them.
_MAX_WITHDRAWN = 16

#: Events of which it is kept in mind for each agent how often they were told.
_MAX_VERSIONS = 64


@dataclass(frozen=True, slots=True)
class Finding:
    """What is known to have happened to an agent: an event without its id.

    Parameters
    ----------
    kind : str
        One of :data:`gpszip.live.events.KINDS`.
    time : float
        Seconds.
    position : tuple of float, optional
        Where.
    mark : str
        A change of it makes another event, such as that a stay became a pause.
    why : str
        The evidence.
    details : mapping
        More facts.
    directed : int, optional
        Twice the edge of the map, plus 1 if it is travelled backward.
    offset : float, optional
        Metres from the edge's start.
    confidence : float, optional
        Probability that it is true.
    """

    kind: str
    time: float
    position: tuple[float, ...] | None = None
    mark: str = ""
    why: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)
    directed: int | None = None
    offset: float | None = None
    confidence: float | None = None


@dataclass(frozen=True, slots=True)
class _Told:
    """An event that was told, as far as it matters for revisions."""

    kind: str
    time: float
    id: str
    position: tuple[float, ...] | None
    mark: str
    directed: int | None = None


class KnownEvents:
    """Tells findings of one agent once, and what changes in them.

    Parameters
    ----------
    agent : str
        Its name.
    geographic : bool
        Whether positions are in degrees.

    Examples
    --------
    >>> known = KnownEvents("bus", geographic=True)
    >>> first = known.update([Finding("stay.start", 7.0)], 400.0)
    >>> known.update([Finding("stay.start", 7.5)], 500.0)
    []
    >>> (event,) = known.update([Finding("stay.start", 90.0)], 600.0)
    >>> event.revises == first[0].id
    True
    >>> [event.withdrawn for event in known.update([], 700.0)]
    [True]
    """

    def __init__(self, agent: str, *, geographic: bool) -> None:
        self._agent, self._geographic = agent, geographic
        self._told: list[_Told] = []
        self._withdrawn: list[_Told] = []
        self._versions: dict[str, int] = {}

    def update(
        self,
        findings: Sequence[Finding],
        received: float,
        *,
        after: float = float("-inf"),
        kinds: Collection[str] | None = None,
    ) -> list[Event]:
        """Return the events that turn what was told into what is known now.

        Parameters
        ----------
        findings : sequence of Finding
            All that is known.
        received : float
            When the last fix was received.
        after : float
            Seconds: what was told up to then stays, and is not told again.
        kinds : collection of str, optional
            Kinds of the findings; by default all.
        """
        # What is as it was.
        old = [
            told
            for told in self._told
            if told.time > after and (kinds is None or told.kind in kinds)
        ]
        new = []
        for finding in findings:
            if finding.time <= after:
                continue
            same = next((told for told in old if self._is_same(told, finding)), None)
            if same is None:
                new.append(finding)
            else:
                old.remove(same)

        # What changed, what is new, and what did not happen.
        events = []
        for finding in sorted(new, key=lambda each: each.time):
            before = _nearest(old, finding) or _nearest(self._withdrawn, finding)
            for known in (old, self._told, self._withdrawn):
                if before in known:
                    known.remove(before)
            events.append(self._event(finding, received, before))
        for told in old:
            self._told.remove(told)
            events.append(self._withdrawal(told, received))
        return events

    def tell(self, finding: Finding, received: float, *, like: str | None = None) -> Event:
        """Tell a finding that later ones don't change; ``like`` names it instead of its time."""
        return self._make(finding, received, event_id(finding.kind, self._agent, like), None)

    def forget(self, until: float) -> None:
        """Forget what happened up to a time, so that it stays as it was told."""
        self._told = [told for told in self._told if told.time > until]
        self._withdrawn = [told for told in self._withdrawn if told.time > until]

    def _is_same(self, told: _Told, finding: Finding) -> bool:
        if (
            told.kind != finding.kind
            or told.directed != finding.directed
            or told.mark != finding.mark
            or abs(told.time - finding.time) > _TIME_TOLERANCE
        ):
            return False
        if told.position is None or finding.position is None:
            return True
        return self._metres(told.position, finding.position) <= _POSITION_TOLERANCE

    def _metres(self, one: tuple[float, ...], other: tuple[float, ...]) -> float:
        fixes = [Fix("", "", 0.0, 0.0, place, self._geographic) for place in (one, other)]
        return distance(*fixes)

    def _event(self, finding: Finding, received: float, before: _Told | None) -> Event:
        revises = None if before is None else before.id
        id = self._new_id(finding)
        facts = (finding.position, finding.mark, finding.directed)
        self._told.append(_Told(finding.kind, finding.time, id, *facts))
        return self._make(finding, received, id, revises)

    def _new_id(self, finding: Finding) -> str:
        """Id of a finding; where it was told before and then revised, that of its next version."""
        facts = (finding.kind, self._agent, float(finding.time), finding.mark)
        first = event_id(*facts)
        count = self._versions[first] = self._versions.pop(first, 0) + 1
        for old in list(self._versions)[:-_MAX_VERSIONS]:
            del self._versions[old]
        return first if count == 1 else event_id(*facts, count)

    def _make(self, finding: Finding, received: float, id: str, revises: str | None) -> Event:
        return make_event(
            self._agent, finding, received, id, revises=revises, geographic=self._geographic
        )

    def _withdrawal(self, told: _Told, received: float) -> Event:
        event = make_withdrawal(
            self._agent,
            Finding(told.kind, told.time, told.position, directed=told.directed),
            received,
            told.id,
            geographic=self._geographic,
        )

        # What comes back revises it.
        self._withdrawn.append(replace(told, id=event.id))
        del self._withdrawn[:-_MAX_WITHDRAWN]
        return event

    def to_rows(self) -> list[list[Any]]:
        """Return what is known as a value of JSON."""
        versions = [["versions", *item] for item in self._versions.items()]
        return versions + [
            [known, told.kind, told.time, told.id, told.position, told.mark, told.directed]
            for known, group in (("told", self._told), ("withdrawn", self._withdrawn))
            for told in group
        ]

    def restore(self, rows: Sequence[Sequence[Any]]) -> None:
        """Know what :meth:`to_rows` returned."""
        for known, *row in rows:
            if known == "versions":
                id, count = row
                self._versions[id] = count
                continue
            kind, time, id, position, mark, directed = row
            place = None if position is None else tuple(position)
            group = self._told if known == "told" else self._withdrawn
            group.append(_Told(kind, time, id, place, mark, directed))


def make_event(
    agent: str,
    finding: Finding,
    received: float,
    id: str,
    *,
    revises: str | None = None,
    geographic: bool,
) -> Event:
    """Return a finding as an event."""
    return Event(
        finding.kind,
        id,
        agent,
        finding.time,
        received,
        revises=revises,
        edge=None if finding.directed is None else finding.directed >> 1,
        forward=None if finding.directed is None else not finding.directed & 1,
        offset=finding.offset,
        confidence=finding.confidence,
        position=finding.position,
        geographic=geographic,
        why=finding.why,
        details=finding.details,
    )


def make_withdrawal(
    agent: str, told: Finding, received: float, told_id: str, *, geographic: bool
) -> Event:
    """Return the event that says where and when another one did not happen."""
    return Event(
        told.kind,
        event_id("withdrawn", told_id),
        agent,
        told.time,
        received,
        revises=told_id,
        withdrawn=True,
        edge=None if told.directed is None else told.directed >> 1,
        forward=None if told.directed is None else not told.directed & 1,
        position=told.position,
        geographic=geographic,
        why="later fixes contradict it",
    )


def _nearest(group: Sequence[_Told], finding: Finding) -> _Told | None:
    """Return the event of a kind that is nearest in time, if it may be the same one."""
    same = [
        told
        for told in group
        if told.kind == finding.kind
        and told.directed == finding.directed
        and abs(told.time - finding.time) <= SAME_TIME
    ]
    return min(same, key=lambda told: abs(told.time - finding.time), default=None)
