"""The numbers of the model: those that come from the log, and those that are a matter of belief."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.kernels.match_roads import Model

__all__ = ["Scales"]

#: Places on roads that a sample has as candidates, the nearest; each in the directions that are open.
_MOST_ROADS = 16

#: Samples nearer than so many errors to the last one used make no layer of their own (Newson and Krumm 2009).
_APART = 2.0

#: Roads farther than so many errors from a sample are none of its candidates.
_REACH = 8.0

#: A way so many times as long as the straight line is none that was taken, unless the usual speed allows it.
_DETOUR = 6.0

#: Price of leaving the roads, or of a link that the network lacks: it must outweigh a stretch on the wrong one of two parallel roads.
_JUMP = 30.0

#: Price of turning off against going on, for a half turn, and of turning round where one may: one crossing in a few, and in a few hundred.
_TURN, _U_TURN = 1.0, 5.0

#: Ways that cost so much more than the best one found don't count for the confidence of it.
_MARGIN = 4.0


@dataclass(frozen=True)
class Scales:
    """What the model knows of a log.

    Parameters
    ----------
    error : float
        Root mean square distance in metres between samples and the roads travelled: the log's and the map's errors together.
    sigma : float
        Scale in metres of the distance in the prices of candidates: the error, larger by as much as errors of successive layers are alike.
    beta : float
        Scale in metres of the difference between the way over roads and the straight line.
    usual, fastest : float
        Median speed in m/s of the log, and one that it never exceeds.
    """

    error: float
    sigma: float
    beta: float
    usual: float
    fastest: float

    @property
    def apart(self) -> float:
        """Metres between samples that make layers."""
        return _APART * self.error

    @property
    def reach(self) -> float:
        """Metres within which roads are candidates."""
        return _REACH * self.error

    @property
    def model(self) -> Model:
        """What the kernels take."""
        off = 0.5 * (self.reach / self.sigma) ** 2  # as a road at the edge of reach
        slack = self.apart + 2.0 * self.error  # what errors of two samples make of standing still
        prices = (self.sigma, self.beta, self.reach, off, _JUMP, _TURN, _U_TURN)
        return Model(*prices, slack, _MARGIN, _MOST_ROADS, self.fastest, self.usual, _DETOUR, self.reach)
