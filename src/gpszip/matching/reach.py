"""How far from all edges of a learned map an agent is off the map.

A network tells where roads are, however bad a log is. The map of an archive was learned from logs
with errors of their own: what is farther from it than errors explain travels where nobody did. A
log that lies wholly beside the map would otherwise look like one with large errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gpszip.matching.averaging import estimate_noise
from gpszip.matching.viterbi import Observations
from gpszip.model import Network

__all__ = ["choose_reach", "log_noise", "reach_of_log"]

#: Errors of map and log within which an agent may be on an edge. In logs of buses, whose map is of
#: their first days, all samples of later ones are within 4.7.
_REACH = 6.0

#: Metres by which receivers err for minutes, which noise doesn't show.
_RECEIVER_ERROR = 10.0

#: Correlation of successive steps below which they are noise rather than travel.
_NOISE_CORRELATION = -0.25


def log_noise(observations: Sequence[Observations], error: float) -> float:
    """Noise of a log in metres, as far as its samples tell it.

    Steps of noise turn back: the correlation of each with the next is -1/2. Where travel is longer
    than noise, turns look like noise, and it is taken to be no larger than the error of the map.

    Parameters
    ----------
    observations : sequence of Observations
        The log.
    error : float
        Error of the map in metres.
    """
    noises = []
    for observed in observations:
        noise = math.sqrt(2) * estimate_noise(observed.positions[:, :2], observed.is_gap)
        steps = np.diff(observed.positions, axis=0)[~observed.is_gap]
        turned = float((steps[1:] * steps[:-1]).sum())
        is_noise = turned < _NOISE_CORRELATION * float((steps**2).sum())
        noises.append(noise if is_noise else min(noise, error))
    return float(np.median(noises))


def choose_reach(network: Network, noise: float | None = None) -> float:
    """Metres from all edges within which an agent may be on one; infinite for other networks.

    It is six times the root mean square of the errors of map and log.

    Parameters
    ----------
    network : Network
        The map.
    noise : float, optional
        Noise of the log in metres; by default that of the logs of the map. Receivers err by 10 m at
        least.
    """
    if network.error is None:
        return math.inf
    noise = network.error if noise is None else noise
    if network.plane is not None:
        noise = max(noise, _RECEIVER_ERROR)
    return _REACH * math.hypot(network.error, noise)


def reach_of_log(network: Network, observations: Sequence[Observations]) -> float:
    """Metres from all edges of a map within which the agents of a log may be on one."""
    if network.error is None:
        return math.inf
    return choose_reach(network, log_noise(observations, network.error))
