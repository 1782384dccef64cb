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


def log_noise(observations: Sequence[Observations]) -> float:
    """Noise of a log in metres, at most: turns of sparse samples look like noise, too.

    Parameters
    ----------
    observations : sequence of Observations
        The log.
    """
    noises = [estimate_noise(each.positions[:, :2], each.is_gap) for each in observations]
    return math.sqrt(2) * float(np.median(noises))


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
    return choose_reach(network, log_noise(observations))
