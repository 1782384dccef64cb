"""What a plain decoder knows so far: counts, weights, the map, and the last steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import INTEGER_CONTEXTS
from gpszip.codec.kernels.walk_priors import (
    AMONG_EDGES,
    BIT_CONTEXTS,
    DISTRIBUTIONS,
    HISTOGRAM_BINS,
    initial_bit_counts,
    initial_chosen,
    initial_mixture_weights,
    initial_offered,
)
from gpszip.codec.plain.adaptive import read_bit, read_signed, read_unsigned
from gpszip.codec.plain.distributions import Distributions
from gpszip.codec.plain.mixture import Mixture, read_mixture
from gpszip.codec.plain.range_decoder import RangeDecoder
from gpszip.codec.plain.rotation import DIRECTIONS, nearest_direction
from gpszip.codec.plain.walk_map import HalfEdge, WalkMap
from gpszip.codec.plain.work import WorkLimit

__all__ = [
    "FIRST_POSITION",
    "KIND_BACK",
    "KIND_KNOWN",
    "KIND_NEW_EDGE",
    "KIND_NEW_NODE",
    "KIND_STAY",
    "LARGE_DURATION",
    "LARGE_OFFSET",
    "MAX_MAGNITUDE",
    "MIXTURE_LIMIT",
    "START_GAP",
    "TRACK_ORDER",
    "TRACK_START",
    "PlainModel",
]

#: Kinds of steps.
KIND_BACK = 0  # along the edge on which the walk came
KIND_KNOWN = 1  # along another known edge
KIND_NEW_EDGE = 2  # along a new edge to a known node
KIND_NEW_NODE = 3  # along a new edge to a new node
KIND_STAY = 4  # a stop

#: Sets of contexts for integers of any size, by what they code.
LARGE_DURATION = 0
LARGE_OFFSET = 1
FIRST_POSITION = 2  # of the very first node
TRACK_START = 3  # time step of a track's first knot, after that of the track before
START_GAP = 4  # the same, of tracks sorted by their starts
TRACK_ORDER = 5  # starts passed over, of those sorted

#: Numbers at or beyond this are coded apart from the mixtures.
MIXTURE_LIMIT = 1 << 25

#: Scales, lengths at some speed and durations in logarithms are at most this.
MAX_MAGNITUDE = 1 << 36

#: The step to expect is at least this long, in sixteenths of a space step.
_MIN_REACH = 64


class PlainModel:
    """State of a decoder.

    Parameters
    ----------
    decoder : RangeDecoder
        The decoder of the bytes.
    dimension : int
        Number of coordinates.
    timed : bool
        Whether there are times.
    modes : int
        Modes of the payload.
    work : WorkLimit
        How much may be done.
    """

    def __init__(
        self, decoder: RangeDecoder, dimension: int, timed: bool, modes: int, work: WorkLimit
    ) -> None:
        self.decoder, self.dimension, self.timed, self.modes = decoder, dimension, timed, modes
        self.work = work
        self.map = WalkMap(dimension)

        # What the last steps were like.
        self.log_pace: int | None = None  # logarithm of duration by length
        self.mean_log_pace = 0  # its fading mean
        self.step_length = 0  # fading mean of the lengths of steps
        self.heading: int | None = None
        self.turn: int | None = None  # that led to the heading
        self.speed: tuple[int, int] | None = None  # length and duration of the last step
        self.speed_sums = (0, 0)  # fading sums of both
        self.last_log_duration = 0  # of the last new node where durations come first
        self.means: dict[int, tuple[int, int]] = {}  # mean logarithm and samples, by what lasts

        # Choices.
        self.path: list[int] = []  # nodes on the way to the target, the next one last
        self.cheap_choices = 0  # how many more choices were cheap than not
        # A class is 8 times its octave plus its kind: octaves and kinds in one row.
        tables = len(initial_chosen())
        self.chosen: NDArray[np.int64] = initial_chosen().reshape(tables, -1)
        self.offered: NDArray[np.int64] = initial_offered().reshape(tables, -1)
        self.turns_chosen: list[int] = initial_chosen()[AMONG_EDGES, 0].tolist()
        self.turns_offered: list[int] = initial_offered()[AMONG_EDGES, 0].tolist()

        # Numbers.
        self._bit_counts: list[list[int]] = initial_bit_counts().tolist()
        self._mixture_weights: list[list[int]] = initial_mixture_weights().tolist()
        self._mixtures: dict[int, Mixture] = {}

    @property
    def reach(self) -> int:
        """Length of the step to expect, in sixteenths of a space step."""
        return max(self.step_length, _MIN_REACH)

    def read_bit(self, context: int) -> int:
        """Read a bit in a context."""
        return read_bit(self.decoder, self._bit_counts, context)

    def read_signed(self, contexts: int) -> int:
        """Read an integer of any size with one of the sets of contexts."""
        # Contexts of single bits come first in the table, then one set after the other.
        first = BIT_CONTEXTS + contexts * INTEGER_CONTEXTS
        return read_signed(self.decoder, self._bit_counts, first)

    def read_unsigned(self, contexts: int) -> int:
        """Read an integer >= 0 with one of the sets of contexts."""
        first = BIT_CONTEXTS + contexts * INTEGER_CONTEXTS
        return read_unsigned(self.decoder, self._bit_counts, first)

    def mixture(self, mixture_id: int) -> Mixture:
        """One of the mixtures."""
        if mixture_id not in self._mixtures:
            # Made when it is first used; the last column of the table is a count, not a weight.
            weights = self._mixture_weights[mixture_id][:DISTRIBUTIONS]
            self._mixtures[mixture_id] = Mixture(weights, HISTOGRAM_BINS)
        return self._mixtures[mixture_id]

    def read_mixture(
        self, mixture: Mixture, low: int, high: int, distributions: Distributions
    ) -> int:
        """Read an integer in [low, high) with a mixture."""
        return read_mixture(self.decoder, mixture, low, high, distributions, self.work)

    def forget_heading(self) -> None:
        """Forget where the walk came from: a track begins, or goes on after a gap."""
        self.heading = self.turn = None

    def learn_step(self, u: int, v: int, incoming: HalfEdge | None) -> HalfEdge:
        """Learn the edge of a step from u to v, its length and heading; return its half-edge."""
        edge = self.map.take_edge(u, v, incoming)
        if self.dimension > 1:
            self._learn_heading(u, v)
        # The first step is its own mean; later ones weigh an eighth.
        self.step_length += (
            (edge.length - self.step_length) // 8 if self.step_length else edge.length
        )
        return edge

    def _learn_heading(self, u: int, v: int) -> None:
        """Learn the direction of a step, and the turn that led to it."""
        start, end = self.map.positions[u], self.map.positions[v]
        heading = nearest_direction(end[0] - start[0], end[1] - start[1])
        half = DIRECTIONS // 2
        self.turn = None
        if self.heading is not None:
            # From -128 to 127: a turn to the right is negative.
            self.turn = (heading - self.heading + half) % DIRECTIONS - half
        self.heading = heading
