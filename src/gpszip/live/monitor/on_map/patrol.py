"""The rounds of a patrol while it travels: what it visits, and what it has missed at the end."""

from __future__ import annotations

from typing import Any

from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.passes import Pass
from gpszip.live.monitor.text import duration_text
from gpszip.model.rounds import Rounds

__all__ = ["PatrolTracker"]

#: Share of an edge that is travelled at least where an agent passes a base, and traversals by which
#: a round may fall short, as for ``gpszip rounds``.
_PASSED, _TOLERANCE = 0.5, 0.1


class PatrolTracker:
    """Compares the travel of one agent with the usual round of an archive.

    Parameters
    ----------
    known_map : KnownMap
        The map.
    rounds : Rounds
        Of the archive.
    """

    def __init__(self, known_map: KnownMap, rounds: Rounds) -> None:
        self._map, self._rounds = known_map, rounds
        edge, forward = rounds.usual[0]
        self._base = 2 * edge + (not forward)
        self._usual = {each.edge: each.usual for each in rounds.edges if each.usual > 0}
        self._begin: float | None = None
        self._counts: dict[int, float] = {}
        self._number = 0

    def add(self, passed: Pass) -> list[Finding]:
        """Take a pass that is over; return what it completes."""
        # The base ends a round and begins the next one.
        edge = passed.directed >> 1
        share = min(passed.metres / float(self._map.lengths[edge]), 1.0)
        findings: list[Finding] = []
        if passed.directed == self._base and share > _PASSED:
            if self._begin is not None:
                findings += self._complete(passed.enter)
            self._begin, self._counts = passed.enter, {}
        if self._begin is None:
            return findings

        # An edge is visited once it was travelled as often as usual.
        usual = self._usual.get(edge, 0.0)
        before = self._counts.get(edge, 0.0)
        self._counts[edge] = before + share
        if usual and before < usual - _TOLERANCE <= before + share:
            place = self._map.place_on(passed.directed, passed.along)
            details = {"round": self._number + 1}
            findings.append(
                Finding("visited", passed.leave, place, "", "", details, passed.directed)
            )
        return findings

    def _complete(self, time: float) -> list[Finding]:
        """End a round: what it has missed, and how it was."""
        assert self._begin is not None
        self._number += 1
        lengths, counts = self._map.lengths, self._counts
        missed = [
            edge
            for edge, usual in self._usual.items()
            if counts.get(edge, 0.0) < usual - _TOLERANCE
        ]
        covered = sum(
            float(lengths[edge]) * min(counts.get(edge, 0.0), usual)
            for edge, usual in self._usual.items()
        )
        share = covered / self._rounds.length if self._rounds.length else 0.0
        findings = [
            Finding(
                "missed",
                time,
                self._map.place_on(2 * edge, 0.5 * float(lengths[edge])),
                "",
                f"not in round {self._number}",
                {"round": self._number},
                2 * edge,
            )
            for edge in missed
        ]

        # The round itself.
        seconds = time - self._begin
        details = {
            "round": self._number,
            "start": round(self._begin, 3),
            "share": round(share, 3),
            "late": round(seconds - self._rounds.duration, 1),
            "missed": missed,
        }
        why = f"{share:.0%} of the usual round in {duration_text(seconds)}"
        place = self._map.place_on(self._base, 0.0)
        return [*findings, Finding("round.complete", time, place, "", why, details)]

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "begin": self._begin,
            "counts": list(self._counts.items()),
            "number": self._number,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._begin, self._number = row["begin"], row["number"]
        self._counts = {int(edge): count for edge, count in row["counts"]}
