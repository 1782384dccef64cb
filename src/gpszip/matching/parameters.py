"""The numbers of the model: those that come from the log, and those that are a matter of belief."""

from __future__ import annotations

import math

from gpszip.matching.kernels.roads import ModelParameters
from gpszip.model.match import Scales

__all__ = [
    "JUMP_COST",
    "MAX_SPEED_FACTOR",
    "MIN_GAP",
    "backward_tolerance",
    "brisk_speed",
    "min_spacing",
    "model_parameters",
    "search_radius",
]

#: No shorter silence, in seconds, breaks a way unless asked for: logs of a point every other minute are matched, too. Tunnels are shorter.
MIN_GAP = 120.0

#: Samples nearer than so many errors to the last one used make no layer of their own: two differ by less in one case of five even if
#: nobody moved (Newson and Krumm 2009 skip within two).
_APART = 2.5

#: Roads farther than so many errors from a sample are none of its candidates. Errors are those of the usual layers, and map and receiver
#: now and then err by far more.
_REACH = 10.0

#: Places on roads that a sample has as candidates, the nearest; each in the directions that are open.
_MOST_ROADS = 16

#: A way so many times as long as the straight line is none that was taken, unless the usual speed allows it.
_DETOUR = 6.0

#: Price of leaving the roads, or of a link that the network lacks: it must outweigh a stretch on the wrong one of two parallel roads.
JUMP_COST = 30.0

#: Price of turning off against going on, for a half turn, and of turning round where one may: one crossing in a few, and in a few hundred.
_TURN, _U_TURN = 1.0, 5.0

#: No speed is more than so many times the one that one in twenty exceeds.
MAX_SPEED_FACTOR = 4.0

#: Errors of two samples make of standing still a step back, or one off a crossing and back, of so many errors.
_SLACK, _SPUR = 4.0, 3.0

#: Ways that cost so much more than the best one found don't count for the confidence of it.
_MARGIN = 4.0


def min_spacing(scales: Scales) -> float:
    """Metres between samples that make layers."""
    return _APART * scales.error


def search_radius(scales: Scales) -> float:
    """Metres within which roads are candidates."""
    return _REACH * scales.error


def backward_tolerance(scales: Scales) -> float:
    """Metres by which errors make a standing agent seem to go back."""
    return _SLACK * scales.error


def brisk_speed(scales: Scales) -> float:
    """Speed in m/s that one in twenty steps of the log exceeds."""
    return scales.max_speed / MAX_SPEED_FACTOR


def model_parameters(scales: Scales) -> ModelParameters:
    """What the kernels take.

    A sample off the roads costs as much as on one at the edge of reach.
    """
    far, error = search_radius(scales), scales.error
    heading = 1.0 / math.radians(scales.heading) ** 2
    prices = (
        scales.sigma,
        scales.beta,
        far,
        0.5 * (far / scales.sigma) ** 2,
        JUMP_COST,
        _TURN,
        _U_TURN,
    )
    return ModelParameters(
        *prices,
        _SLACK * error,
        _SPUR * error,
        _MARGIN,
        _MOST_ROADS,
        scales.max_speed,
        scales.median_speed,
        _DETOUR,
        far,
        heading,
    )
