"""What was told of one agent on the map, as far as it may be revised."""

from __future__ import annotations

import json
from collections import OrderedDict, defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

from gpszip.live.events import Event, event_id
from gpszip.live.monitor.known import SAME_TIME, Finding, make_event, make_withdrawal

__all__ = ["ToldFindings"]

#: Ids of which it is kept in mind how often their events were revised.
_MAX_VERSIONS = 1_000


class _Told(NamedTuple):
    """A finding that was told: its id as an event, and what tells it from others."""

    id: str
    facts: str
    kind: str
    time: float
    directed: int | None
    position: tuple[float, ...] | None

    def finding(self) -> Finding:
        return Finding(self.kind, self.time, self.position, directed=self.directed)


class ToldFindings:
    """Tells findings in the order of travel, and replaces the last of them.

    Parameters
    ----------
    agent : str
        Its name.
    geographic : bool
        Whether positions are in degrees.

    Examples
    --------
    >>> told = ToldFindings("bus", geographic=True)
    >>> first, second = (Finding("edge.enter", time, directed=4) for time in (7.0, 9.0))
    >>> (event,) = told.tell([first], 8.0)
    >>> [each.revises == event.id for each in told.replace(0, [second], 12.0)]
    [True]
    >>> told.replace(0, [second], 13.0), len(told.replace(0, [], 14.0)), told.count
    ([], 1, 0)
    """

    def __init__(self, agent: str, *, geographic: bool) -> None:
        self._agent, self._geographic = agent, geographic
        self._told: list[_Told] = []
        self._first = 0
        self._versions: OrderedDict[str, int] = OrderedDict()

    def __len__(self) -> int:
        return len(self._told)

    @property
    def count(self) -> int:
        """Number of findings that are told and stand, those that are forgotten, too."""
        return self._first + len(self._told)

    def tell(self, findings: Sequence[Finding], received: float) -> list[Event]:
        """Tell further findings."""
        return [self._tell(finding, received, None) for finding in findings]

    def replace(self, count: int, findings: Sequence[Finding], received: float) -> list[Event]:
        """Tell what differs between findings and those that were told instead.

        Parameters
        ----------
        count : int
            Findings that are left as they are.
        findings : sequence of Finding
            What follows these.
        received : float
            When that was known, in seconds.
        """
        # What is as it was.
        number = max(count - self._first, 0)
        old, self._told = self._told[number:], self._told[:number]
        same: dict[str, list[_Told]] = defaultdict(list)
        for told in old:
            same[told.facts].append(told)
        kept = [same[facts].pop(0) if same[facts] else None for facts in map(_facts, findings)]

        # What is no more: each may become a new one of its kind.
        gone: dict[tuple[str, int | None], list[_Told]] = defaultdict(list)
        for told in (each for group in same.values() for each in group):
            gone[told.kind, told.directed].append(told)
            first_id = event_id(*self._named(told))
            self._versions[first_id] = self._versions.pop(first_id, 0) + 1

        # Revisions and new ones in the order of travel, then what did not happen.
        events = []
        for finding, known in zip(findings, kept, strict=True):
            if known is not None:
                self._told.append(known)
                continue
            before = _take_nearest(gone[finding.kind, finding.directed], finding.time)
            events.append(self._tell(finding, received, before))
        left = sorted((each for group in gone.values() for each in group), key=lambda t: t.time)
        events += [
            make_withdrawal(
                self._agent, told.finding(), received, told.id, geographic=self._geographic
            )
            for told in left
        ]
        while len(self._versions) > _MAX_VERSIONS:
            self._versions.popitem(last=False)
        return events

    def forget(self, count: int) -> None:
        """Forget the first findings, which stay as they were told."""
        number = min(max(count - self._first, 0), len(self._told))
        del self._told[:number]
        self._first += number

    def _tell(self, finding: Finding, received: float, before: _Told | None) -> Event:
        # What was revised or withdrawn comes back with an id of its own.
        names = self._named(finding)
        first_id = id = event_id(*names)
        if first_id in self._versions:
            id = event_id(*names, self._versions[first_id])
        what = (finding.kind, finding.time, finding.directed, finding.position)
        self._told.append(_Told(id, _facts(finding), *what))
        revises = None if before is None else before.id
        return make_event(
            self._agent, finding, received, id, revises=revises, geographic=self._geographic
        )

    def _named(self, each: Finding | _Told) -> tuple[str, str, str]:
        """What names an event."""
        return each.kind, self._agent, f"{each.time:.3f} {each.directed}"

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {"told": self._told, "first": self._first, "versions": list(self._versions.items())}

    def restore(self, row: dict[str, Any]) -> None:
        """Know what :meth:`to_row` returned."""
        self._told = []
        for *facts, position in row["told"]:
            told = _Told._make([*facts, None if position is None else tuple(position)])
            self._told.append(told)
        self._first = row["first"]
        self._versions = OrderedDict((id, count) for id, count in row["versions"])


def _facts(finding: Finding) -> str:
    """Digest of all that a finding says."""
    place = [finding.position, finding.directed, finding.offset]
    facts = [finding.kind, finding.time, *place, finding.confidence, finding.details]
    return event_id(json.dumps(facts, sort_keys=True))


def _take_nearest(group: list[_Told], time: float) -> _Told | None:
    """Take the event that is nearest in time, if it may be the same one."""
    near = [told for told in group if abs(told.time - time) <= SAME_TIME]
    if not near:
        return None
    told = min(near, key=lambda each: abs(each.time - time))
    group.remove(told)
    return told
