"""What matching found: routes on the roads of a network, where each sample lies on them, and where and why they break."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.network import Network
from gpszip.model.text import count_text

__all__ = ["Break", "Match", "Matching", "Piece", "Route", "Scales"]


@dataclass(frozen=True)
class Scales:
    """What the model of matching knows of a log.

    Parameters
    ----------
    error : float
        Root mean square distance in metres between samples and the roads travelled, where they are on roads: the log's and the map's
        errors together.
    sigma : float
        Scale in metres of the distance in the prices of candidates: the error, larger by as much as errors of samples in a row are alike.
    beta : float
        Scale in metres of the difference between the way over roads and the straight line.
    median_speed, max_speed : float
        Median speed in m/s, and one that is never exceeded.
    heading : float, default infinite
        Spread in degrees between headings that the log tells and the roads travelled, larger by as much as differences of samples in
        a row are alike; infinite where there are none, or they don't follow the roads.
    averaging_window : int, default 1
        Number of samples in a row of which means are matched, odd: as many as are travelled within twice their white noise.
    """

    error: float
    sigma: float
    beta: float
    median_speed: float
    max_speed: float
    heading: float = math.inf
    averaging_window: int = 1


@dataclass(frozen=True, eq=False)
class Route:
    """A way over roads: legs, each along one road in one direction.

    A leg begins where the one before it ended; where the next leg is on the same road in the other direction, the
    agent turned inside the road.

    Parameters
    ----------
    edges : int32 array, shape (L,)
        Roads of the network in the order of travel, L >= 1.
    forward : bool array, shape (L,)
        Whether each was travelled from its start to its end.
    begin, end : float64 array, shape (L,)
        Metres from the road's start, along it, at which the leg begins and ends: ``begin <= end`` where it goes forward and
        ``begin >= end`` where not.
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
        return np.abs(self.end - self.begin)

    @property
    def length(self) -> float:
        """Metres of the whole route."""
        return float(self.lengths.sum())


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of a track that lies on roads without a break.

    Parameters
    ----------
    first, last : int
        Samples of the track at which it begins and ends, both on it.
    route : Route
        Roads travelled, cut at the first and the last sample.
    line : float64 array, shape (P, 2)
        The same as vertices in metres, P >= 1.
    confidence : float
        Mean of its samples' confidence, from 0 to 1.
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
    """A stretch of a track of which no way over the roads is claimed.

    Parameters
    ----------
    after, before : int
        Samples between which it lies, and any samples in between off the roads; -1 where the track begins off the roads, and the
        number of its samples where it ends so. Both are on a piece, or in another break beside it that has another reason.
    reason : str
        Why: ``"gap"``, ``"no road near"``, ``"no route"``, ``"detour"`` (the only way over roads is far longer than what was
        travelled), ``"off road"`` (it lies between roads rather than on one), ``"too fast"``, ``"one-way"`` (it leads against
        one-way roads), or ``"leap"``: the samples in between leap far away and back, and the piece goes on.
    edges : tuple of int
        The roads that a ``"one-way"`` break leads against, in the order of travel; empty for other reasons.
    """

    after: int
    before: int
    reason: str
    edges: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Match:
    """Where one track lies on the roads of a network.

    Parameters
    ----------
    track : str
        Name of the track.
    pieces : tuple of Piece
        Stretches on roads, in order of time.
    breaks : tuple of Break
        What lies between, before and after them.
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
        Metres between the sample and its place on the road, NaN for none.
    confidence : float64 array, shape (n,)
        Probability of the road travelled, as the model sees it, 0 for samples on no piece.
    scales : Scales
        What it was matched with.
    """

    track: str
    pieces: tuple[Piece, ...]
    breaks: tuple[Break, ...]
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
        return float((self.piece >= 0).mean())

    @property
    def unmatched(self) -> dict[str, int]:
        """Number of samples on no piece by reason, the most frequent first."""
        counts: Counter[str] = Counter()
        for one in self.breaks:
            counts[one.reason] += int((self.piece[one.after + 1 : one.before] < 0).sum())
        return {reason: count for reason, count in counts.most_common() if count}

    def snapped_positions(self, network: Network) -> NDArray[np.float64]:
        """Positions on the roads, shape (n, d) in metres, NaN for samples on no piece."""
        out = np.full((len(self), network.dimension), np.nan)
        on = np.flatnonzero(self.edge >= 0)
        edge, offset = self.edge[on], self.offset[on]
        last = np.concatenate(([0.0], np.cumsum(network.lengths)))  # all roads laid end to end
        along = last[:-1].repeat(np.diff(network.offsets)) + network.along
        vertex = np.searchsorted(along, last[edge] + offset, side="right") - 1
        vertex = np.clip(vertex, network.offsets[edge], network.offsets[edge + 1] - 2)
        begin, bit = network.along[vertex], network.along[vertex + 1] - network.along[vertex]
        share = np.clip(
            np.divide(offset - begin, bit, out=np.zeros(len(on)), where=bit > 0), 0.0, 1.0
        )[:, None]
        out[on] = network.points[vertex] + share * (
            network.points[vertex + 1] - network.points[vertex]
        )
        return out


@dataclass(frozen=True, eq=False)
class Matching:
    """Matches of all tracks of a log, in their order.

    Parameters
    ----------
    matches : tuple of Match
        One for each track.
    scales : Scales
        Of the log as a whole; a track's own are nearer to them the shorter it is.
    headings_ignored : tuple of str
        Tracks whose headings were left out, since they don't show that they follow the roads travelled.
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
            sum((Counter(match.unmatched) for match in self.matches), Counter[str]()).most_common()
        )

    @property
    def wrong_way(self) -> tuple[int, ...]:
        """One-way roads of the network that samples travel against, in the order of travel."""
        return tuple(
            dict.fromkeys(
                edge for match in self.matches for one in match.breaks for edge in one.edges
            )
        )

    @property
    def breaks(self) -> dict[str, int]:
        """Number of breaks by reason, the most frequent first."""
        return dict(
            Counter(one.reason for match in self.matches for one in match.breaks).most_common()
        )
