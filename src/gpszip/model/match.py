"""Results of map matching: routes on a network, the samples along them, and breaks with reasons.

A :class:`Matching` holds a :class:`Match` for each track. A match has pieces, which lie on roads
without a break, and the breaks between them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gpszip.model.network import Network
from gpszip.model.text import count_text

__all__ = ["Break", "Match", "Matching", "Piece", "Route", "Scales"]


@dataclass(frozen=True)
class Scales:
    """Scales of the hidden Markov model, estimated from a log.

    Parameters
    ----------
    error : float
        Root mean square distance in metres between samples and the roads travelled, where they are
        on roads: the errors of log and map together.
    sigma : float
        Scale in metres of the distance in emission costs. It is the error times
        sqrt((1 + rho) / (1 - rho)), with the autocorrelation rho of successive errors.
    beta : float
        Scale in metres of the difference between a path over roads and the straight line.
    median_speed, max_speed : float
        Median speed, and one that is never exceeded, in m/s.
    heading : float, default infinite
        Spread in degrees between the headings in the log and the roads travelled, larger for
        autocorrelated errors as sigma is. Infinite where there are no headings, or they don't
        follow the roads.
    averaging_window : int, default 1
        Number of successive samples whose mean is matched, odd: as many as lie within twice their
        white noise.
    reach : float, default infinite
        Metres from all roads beyond which an agent is off the map, however large the error seems.
        Learned maps have one.
    """

    error: float
    sigma: float
    beta: float
    median_speed: float
    max_speed: float
    heading: float = math.inf
    averaging_window: int = 1
    reach: float = math.inf

    def __repr__(self) -> str:
        facts = (f"{each.name}={getattr(self, each.name):.4g}" for each in fields(self))
        return f"Scales({', '.join(facts)})"


@dataclass(frozen=True, eq=False)
class Route:
    """A route over roads: legs, each along one road in one direction.

    A leg begins where the last one ended. Where the next leg is on the same road in the other
    direction, the agent turned round on the road.

    Parameters
    ----------
    edges : int32 array, shape (L,)
        Roads of the network in the order of travel, L >= 1.
    forward : bool array, shape (L,)
        Whether each was travelled from its start to its end.
    begin, end : float64 array, shape (L,)
        Metres from the road's start, along it, at which the leg begins and ends:
        ``begin <= end`` where it goes forward and ``begin >= end`` where not.
    """

    edges: NDArray[np.int32]
    forward: NDArray[np.bool_]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"Route({count_text(len(self), 'leg')}, {self.length:,.0f} m)"

    def __len__(self) -> int:
        return len(self.edges)

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Metres of each leg."""
        # A leg that goes backward begins farther along the road than it ends.
        return np.abs(self.end - self.begin)

    @property
    def length(self) -> float:
        """Metres of the route."""
        return float(self.lengths.sum())


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a track that lies on roads without a break.

    Parameters
    ----------
    first, last : int
        Samples of the track at which it begins and ends, both on it.
    route : Route
        Roads travelled, cut at the first and the last sample.
    line : float64 array, shape (P, 2)
        Vertices of the route in metres, P >= 1.
    confidence : float
        Mean confidence of its samples, from 0 to 1.
    reason : str
        Why it ends: ``"end of track"``, or the reason of the break after it.
    """

    first: int
    last: int
    route: Route
    line: NDArray[np.float64]
    confidence: float
    reason: str

    def __repr__(self) -> str:
        return (
            f"Piece(samples {self.first} to {self.last}, {self.length:,.0f} m, "
            f"confidence {self.confidence:.2f}, ends: {self.reason})"
        )

    @property
    def length(self) -> float:
        """Metres along the route."""
        return self.route.length


@dataclass(frozen=True)
class Break:
    """An interval of a track without a route over roads.

    Parameters
    ----------
    after, before : int
        Samples between which it lies; any samples between them are off the roads. -1 where the
        track begins with the break, and the number of its samples where it ends with it. Both
        samples are on a piece, or in the next break, which has another reason.
    reason : str
        Why: ``"gap"``, ``"no road near"``, ``"no route"``, ``"detour"`` (the only path over roads
        is far longer than what was travelled), ``"off road"`` (it lies between roads rather than on
        one), ``"too fast"``, ``"one-way"`` (it leads against one-way roads), or ``"leap"``: the
        samples between are outliers, and the piece goes on.
    edges : tuple of int
        The roads that a ``"one-way"`` break leads against, in the order of travel; empty for other
        reasons.
    """

    after: int
    before: int
    reason: str
    edges: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Match:
    """The match of one track: where it lies on the roads of a network.

    Parameters
    ----------
    track : str
        Name of the track.
    pieces : tuple of Piece
        Pieces on roads, in order of time.
    breaks : tuple of Break
        The intervals between, before and after them.
    piece : int32 array, shape (n,)
        Piece on which each sample lies, -1 for none.
    leg : int32 array, shape (n,)
        Leg of its piece's route, -1 for none.
    edge : int32 array, shape (n,)
        Road, -1 for none.
    forward : bool array, shape (n,)
        Whether it was travelled from its start to its end.
    offset : float64 array, shape (n,)
        Metres from the road's start, NaN for none.
    along : float64 array, shape (n,)
        Metres along the piece's route, never decreasing on a piece, NaN for none.
    distance : float64 array, shape (n,)
        Metres between the sample and its position on the road, NaN for none.
    confidence : float64 array, shape (n,)
        Probability of the road travelled by the model, 0 for samples on no piece.
    scales : Scales
        The scales it was matched with.
    """

    track: str
    pieces: tuple[Piece, ...]
    breaks: tuple[Break, ...]
    # From here to ``confidence``, row i is sample i of the track.
    piece: NDArray[np.int32]
    leg: NDArray[np.int32]
    edge: NDArray[np.int32]
    forward: NDArray[np.bool_]
    offset: NDArray[np.float64]
    along: NDArray[np.float64]
    distance: NDArray[np.float64]
    confidence: NDArray[np.float64]
    scales: Scales

    def __repr__(self) -> str:
        return (
            f"Match({self.track!r}, {count_text(len(self), 'sample')}, {self.share:.1%} on roads, "
            f"{count_text(len(self.pieces), 'piece')}, {count_text(len(self.breaks), 'break')})"
        )

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def share(self) -> float:
        """Share of the samples that lie on a piece."""
        # A track has a sample at least, so that the mean exists.
        return float((self.piece >= 0).mean())

    @property
    def unmatched(self) -> dict[str, int]:
        """Number of samples on no piece by reason, the most frequent first."""
        counts: Counter[str] = Counter()
        for break_ in self.breaks:
            # The samples at both sides are on pieces or belong to the next break. At the ends of a
            # track these are -1 and n, so that the slice starts at 0 or ends with the last sample.
            inside = slice(break_.after + 1, break_.before)
            counts[break_.reason] += int((self.piece[inside] < 0).sum())
        # A break between two successive samples leaves out none, and is not listed.
        return {reason: count for reason, count in counts.most_common() if count}

    def snapped_positions(self, network: Network) -> NDArray[np.float64]:
        """Positions on the roads, shape (n, d) in metres, NaN for samples on no piece."""
        # Leave NaN for samples on no piece.
        out = np.full((len(self), network.dimension), np.nan)
        matched = np.flatnonzero(self.edge >= 0)
        edge, offset = self.edge[matched], self.offset[matched]

        # Last vertex before each sample: one search in distances along all roads, end to end.
        road_starts = np.concatenate(([0.0], np.cumsum(network.lengths)))
        along = road_starts[:-1].repeat(np.diff(network.offsets)) + network.along
        vertex = np.searchsorted(along, road_starts[edge] + offset, side="right") - 1
        # Rounding may put the end of a road on the next one; the last vertex starts no segment.
        vertex = np.clip(vertex, network.offsets[edge], network.offsets[edge + 1] - 2)

        # Interpolate to the next vertex.
        begin = network.along[vertex]
        length = network.along[vertex + 1] - begin
        # A segment of no length has one point for any fraction.
        fraction = np.divide(offset - begin, length, out=np.zeros(len(matched)), where=length > 0)
        fraction = np.clip(fraction, 0.0, 1.0)[:, None]
        step = network.points[vertex + 1] - network.points[vertex]
        out[matched] = network.points[vertex] + fraction * step
        return out


@dataclass(frozen=True, eq=False)
class Matching:
    """Matches of all tracks of a log, in their order.

    Parameters
    ----------
    matches : tuple of Match
        One for each track.
    scales : Scales
        Scales of the log. Those of a track are nearer to them the shorter it is.
    headings_ignored : tuple of str
        Tracks whose headings were ignored, since they don't follow the roads travelled.
    """

    matches: tuple[Match, ...]
    scales: Scales
    headings_ignored: tuple[str, ...] = ()

    def __repr__(self) -> str:
        tracks, samples = count_text(len(self), "track"), count_text(self.points, "sample")
        return f"Matching({tracks}, {samples}, {self.share:.1%} on roads)"

    def __len__(self) -> int:
        return len(self.matches)

    def __iter__(self) -> Iterator[Match]:
        return iter(self.matches)

    def __getitem__(self, number: int) -> Match:
        return self.matches[number]

    @property
    def points(self) -> int:
        """Number of samples."""
        return sum(map(len, self.matches))

    @property
    def share(self) -> float:
        """Share of all samples that lie on a piece."""
        return self.matched / self.points if self.points else 0.0

    @property
    def matched(self) -> int:
        """Number of samples that lie on a piece."""
        return sum(int((match.piece >= 0).sum()) for match in self.matches)

    @property
    def unmatched(self) -> dict[str, int]:
        """Number of samples on no piece by reason, the most frequent first."""
        return dict(
            # Counters add up by key; sum() needs an empty one to start with.
            sum((Counter(match.unmatched) for match in self.matches), Counter[str]()).most_common()
        )

    @property
    def wrong_way(self) -> tuple[int, ...]:
        """One-way roads of the network that samples travel against, in the order of travel."""
        return tuple(
            # A dictionary drops repeated roads and keeps the order, which a set would not.
            dict.fromkeys(
                edge for match in self.matches for break_ in match.breaks for edge in break_.edges
            )
        )

    @property
    def breaks(self) -> dict[str, int]:
        """Number of breaks by reason, the most frequent first."""
        return dict(
            Counter(
                break_.reason for match in self.matches for break_ in match.breaks
            ).most_common()
        )
