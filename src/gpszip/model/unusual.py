"""How unusual trips are: scores in bits, with reasons and places."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.model.text import count_text

__all__ = ["Anomaly", "Unusual", "UnusualTrip"]


@dataclass(frozen=True)
class Anomaly:
    """A part of a trip that is unusual.

    Parameters
    ----------
    track : str
        Name of the track.
    kind : str
        ``"route"`` (rare turns, or another way than usual), ``"wrong direction"``, ``"off the
        map"``, ``"slow"``, ``"fast"``, ``"stop"`` or ``"absence"``.
    start, end : float
        Seconds from when to when.
    bits : float
        How surprising it is: a bit more for half the probability.
    reason : str
        What is unusual, for people.
    position : tuple of float
        Where: latitude and longitude, or x and y in metres; the middle of its way. Empty for an
        absence.
    edges : tuple of (int, bool)
        Edges of the archive's map, and whether each was travelled from its start to its end; empty
        off the map.
    coded_bits : float
        What the archive's own coder takes to write the steps of the path from start to end; NaN
        where that was not asked for, and for an absence.
    """

    track: str
    kind: str
    start: float
    end: float
    bits: float
    reason: str
    position: tuple[float, ...]
    edges: tuple[tuple[int, bool], ...] = ()
    coded_bits: float = float("nan")


@dataclass(frozen=True)
class UnusualTrip:
    """A trip with its score.

    Parameters
    ----------
    track : str
        Name of the track.
    start, end : float
        Seconds from when to when.
    score : float
        Bits: the higher, the more unusual.
    reason : str
        What is the most unusual of it, for people.
    anomalies : tuple of Anomaly
        Its unusual parts, those that add most to the score first.
    coded_bits : float
        What the archive's own coder takes to write the steps of its path; NaN where that was not
        asked for.
    """

    track: str
    start: float
    end: float
    score: float
    reason: str
    anomalies: tuple[Anomaly, ...]
    coded_bits: float = float("nan")


@dataclass(frozen=True, repr=False)
class Unusual:
    """All trips of a log, and what is unusual about them.

    Parameters
    ----------
    trips : tuple of UnusualTrip
        In the order of the log.
    absences : tuple of Anomaly
        Hours at which an agent always travels, and this time did not.
    geographic : bool
        Whether positions are degrees.
    """

    trips: tuple[UnusualTrip, ...]
    absences: tuple[Anomaly, ...]
    geographic: bool

    def __repr__(self) -> str:
        trips, absences = len(self.trips), len(self.absences)
        return f"Unusual({count_text(trips, 'trip')}, {count_text(absences, 'absence')})"

    def __len__(self) -> int:
        return len(self.trips)

    @property
    def ranked(self) -> tuple[UnusualTrip, ...]:
        """The trips, the most unusual first."""
        return tuple(sorted(self.trips, key=lambda trip: -trip.score))

    @property
    def anomalies(self) -> tuple[Anomaly, ...]:
        """All unusual parts and absences, the most unusual first."""
        parts = [part for trip in self.trips for part in trip.anomalies]
        return tuple(sorted([*parts, *self.absences], key=lambda part: -part.bits))
