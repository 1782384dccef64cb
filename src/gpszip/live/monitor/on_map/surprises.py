"""What an agent does on the map that hardly anybody did before."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpszip.history.trips import MIN_STOP
from gpszip.history.unusual.route_surprise import direction_bits
from gpszip.live.fix import Fix, distance
from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.passes import Pass
from gpszip.live.monitor.text import duration_text

__all__ = ["Surprises"]

#: Probability of a turn that is told, at most.
_TURN_CHANCE = 0.002

#: Edges before a turn that tell how likely it is.
_LOOK_BACK = 32

#: Bits of a minute's pace, and of a stop, as for ``gpszip unusual``.
_PACE_BITS, _STOP_BITS = 12.0, 8.0

#: Expected seconds of travel whose pace is compared.
_PART_SECONDS = 60.0

#: Metres, or share of the edge, that are travelled in a wrong direction before that is told.
_WRONG_METRES, _WRONG_SHARE = 40.0, 0.5

#: Seconds of standing that are a stop, and no light; it is looked at again when it is twice as
#: long.
_MIN_STOP = 120.0

#: Trips that end at a place, as a share of the passes of its edge, from which a stop there is none
#: on the way.
_MAX_ENDS = 2.0**-_STOP_BITS

#: Metres within which an agent stands.
_STANDING = 20.0

#: Share of an edge, and metres, below which a pass tells no pace.
_MIN_SHARE, _MIN_METRES = 0.5, 20.0


class Surprises:
    """Compares one agent with what is usual.

    Parameters
    ----------
    agent : str
        Its name.
    known_map : KnownMap
        What is usual.
    """

    def __init__(self, agent: str, known_map: KnownMap) -> None:
        self._map, self._usual = known_map, known_map.usual
        self._number = known_map.predictor.agent_number(agent)
        self._wrong: int | None = None
        self._took = self._expected = 0.0
        self._pace = ""
        self._still: Fix | None = None
        self._next_look = _MIN_STOP
        self._is_stop_told = False

    def enter(self, route: list[int], time: float) -> list[Finding]:
        """Return what is unusual about the last turn of a route."""
        # The model was not trained with turns onto edges that no route connects.
        if len(route) < 2:
            return []
        options = self._usual.model.options[route[-2]]
        if route[-1] not in options:
            return []

        # How likely the turn was after the edges before it.
        before = route[-_LOOK_BACK - 1 : -1]
        probabilities = self._usual.model.predict(
            before, self._usual.predictor.hour_of(time), self._number
        )
        chance = probabilities[options.index(route[-1])]
        if chance > _TURN_CHANCE:
            return []
        why = f"rare turn onto edge {route[-1] >> 1}, probability {chance:.2g}"
        place = self._map.place_on(route[-1], 0.0)
        return [
            Finding("unusual.turn", time, place, "", why, {}, route[-1], confidence=1.0 - chance)
        ]

    def travel(self, current: Pass) -> list[Finding]:
        """Return that an edge is travelled in the wrong direction, once for each edge."""
        # Travelled far enough, and not told yet?
        length = float(self._map.lengths[current.directed >> 1])
        if self._wrong == current.directed:
            return []
        if current.metres < min(_WRONG_METRES, _WRONG_SHARE * length):
            return []
        if not direction_bits(self._usual.index, current.directed):
            self._wrong = None
            return []

        # Nobody travelled it this way; confidence is that of the rule of succession.
        self._wrong = current.directed
        others = self._usual.index.passes(current.directed ^ 1)
        why = f"{others:,} passed edge {current.directed >> 1} the other way, and none this way"
        place = self._map.place_on(current.directed, current.along)
        confidence = (others + 1) / (others + 2)
        return [
            Finding(
                "wrong_way",
                current.leave,
                place,
                "",
                why,
                {"others": others},
                current.directed,
                self._map.offset(current.directed, current.along),
                confidence,
            )
        ]

    def leave(self, passed: Pass) -> list[Finding]:
        """Return that the pace of the last minute or more is unusual, once while it is."""
        # Passes of whole edges tell a pace.
        paces = self._usual.paces
        length = float(self._map.lengths[passed.directed >> 1])
        seconds = passed.leave - passed.enter - passed.standing
        is_told = passed.metres >= max(_MIN_METRES, _MIN_SHARE * length) and seconds > 0
        if passed.starts or paces is None or not is_told:
            return []

        # Add them up to a part of the drive.
        hour = self._usual.predictor.hour_of(passed.enter)
        expected = paces.expected(
            np.array([passed.directed]), np.array([-1 if hour is None else hour])
        )
        self._expected += float(expected[0]) * passed.metres
        self._took += seconds
        if self._expected < _PART_SECONDS:
            return []

        # A part of the drive is complete.
        took, usual = self._took, self._expected
        self._took = self._expected = 0.0
        bits = paces.bits(took / usual)
        kind = "" if bits <= _PACE_BITS else "slow" if took > usual else "fast"
        before, self._pace = self._pace, kind
        if not kind or kind == before:
            return []
        why = f"{kind}: {took:,.0f} s of travel, usual are {usual:,.0f} s"
        details = {"pace": kind, "seconds": round(took, 1), "usual": round(usual, 1)}
        place = self._map.place_on(passed.directed, passed.along)
        confidence = 1.0 - 2.0**-bits
        return [
            Finding(
                "unusual.speed",
                passed.leave,
                place,
                "",
                why,
                details,
                passed.directed,
                confidence=confidence,
            )
        ]

    def stand(self, fix: Fix, directed: int) -> list[Finding]:
        """Return that the agent stands where nobody does, once for each stop on the way.

        Stops of five minutes or more are stays, and so are those where trips end.
        """
        # Somewhere else than before?
        if self._still is None or distance(self._still, fix) > _STANDING:
            self._still, self._next_look, self._is_stop_told = fix, _MIN_STOP, False
            return []
        seconds = fix.time - self._still.time
        if self._is_stop_told or not self._next_look <= seconds < MIN_STOP:
            # A longer one ends the trip, as in archives.
            return []

        # Is it unusual to stop so long there?
        self._next_look = 2 * seconds
        if self._is_end(fix, directed):
            return []
        bits = self._usual.stops.bits(directed, seconds)
        if bits <= _STOP_BITS:
            return []

        # Tell it once.
        self._is_stop_told = True
        why = f"stands for {duration_text(seconds)} on edge {directed >> 1}"
        details = {"since": round(self._still.time, 3), "bits": round(bits, 1)}
        confidence = 1.0 - 2.0**-bits
        return [
            Finding(
                "unusual.stop",
                fix.time,
                fix.position,
                "",
                why,
                details,
                directed,
                confidence=confidence,
            )
        ]

    def _is_end(self, fix: Fix, directed: int) -> bool:
        """Whether trips of the archive end where the agent stands."""
        position = self._map.project(fix)
        if position is None:
            return False
        passes = int(self._usual.stops.passes[[directed, directed ^ 1]].sum())
        return bool(self._map.ends_near(position) > _MAX_ENDS * passes)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "wrong": self._wrong,
            "took": self._took,
            "expected": self._expected,
            "pace": self._pace,
            "still": None if self._still is None else self._still.to_row(),
            "next_look": self._next_look,
            "told": self._is_stop_told,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._wrong, self._took, self._expected = row["wrong"], row["took"], row["expected"]
        self._pace, self._next_look = row["pace"], row["next_look"]
        self._still = None if row["still"] is None else Fix.from_row(row["still"])
        self._is_stop_told = row["told"]
