"""Rounds of a patrol: what :func:`gpszip.rounds` returns."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.model.text import count_text

__all__ = ["EdgeVisits", "Round", "Rounds"]


@dataclass(frozen=True)
class Round:
    """One round of an agent.

    Parameters
    ----------
    track : str
        Name of the track.
    number : int
        From 1, in the order of the track's rounds.
    start, end : float
        Seconds, as the log counts them; NaN without times.
    length : float
        Metres travelled.
    share : float
        Metres of the usual round that it covers, as a share: its score, from 0 to 1.
    extra : float
        Metres travelled that the usual round doesn't have.
    late : float
        Seconds that it took longer than the median round; negative if it took less.
    missed : tuple of int
        Edges of the usual round that it travels less often, or not at all.
    """

    track: str
    number: int
    start: float
    end: float
    length: float
    share: float
    extra: float
    late: float
    missed: tuple[int, ...]


@dataclass(frozen=True)
class EdgeVisits:
    """When an edge is visited, and how often rounds miss it.

    Parameters
    ----------
    edge : int
        Edge of the network.
    usual : float
        Traversals in a usual round, both directions together; half an edge and back are one.
    visits : int
        Traversals in all.
    missed : int
        Rounds with fewer traversals than usual.
    first, last : float
        Seconds at which it is first and last entered; NaN without times or visits.
    interval : float
        Median of the seconds from one visit to the next; NaN below two visits.
    longest : float
        Longest such interval, also that from the last visit to the end of the log.
    """

    edge: int
    usual: float
    visits: int
    missed: int
    first: float
    last: float
    interval: float
    longest: float


@dataclass(frozen=True, eq=False, repr=False)
class Rounds:
    """The usual round of a patrol, all rounds, and the visits of edges.

    Parameters
    ----------
    usual : tuple of (int, bool)
        Edges of the usual round in the order of travel, and whether each is travelled forward: the
        real round that is most like the others.
    length : float
        Its metres.
    duration : float
        Median seconds of a round; NaN without times.
    regularity : float
        From 0 to 1: the share of all travel that need not be told by who knows the usual round.
    rounds : tuple of Round
        Complete rounds, track by track in the order of time.
    edges : tuple of EdgeVisits
        By edge.
    """

    usual: tuple[tuple[int, bool], ...]
    length: float
    duration: float
    regularity: float
    rounds: tuple[Round, ...]
    edges: tuple[EdgeVisits, ...]

    def __repr__(self) -> str:
        return (
            f"Rounds({count_text(len(self.rounds), 'round')} of usually {self.length:,.0f} m, "
            f"{self.regularity:.0%} regular)"
        )
